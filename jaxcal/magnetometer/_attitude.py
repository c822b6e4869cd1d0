"""Attitudes and the field in body axes (x forward, y right, z down; azimuth, elevation, bank)."""

from typing import Any

import numpy as np

from .._errors import DataError
from .._precision import host_float64
from .._types import AnyArray

#: dip of the field at Ankara, where the magnetometer paper's experiment was made
INCLINATION = np.deg2rad(57.0)


def rotation(attitudes: np.ndarray) -> np.ndarray:
    """C_bn = Rx(bank) Ry(elevation) Rz(azimuth), (n, 3, 3), from navigation (north, east, down) to body axes."""
    azimuth, elevation, bank = np.moveaxis(np.asarray(attitudes), -1, 0)
    zero, one = np.zeros_like(azimuth), np.ones_like(azimuth)
    (cs, ss), (ct, st), (cp, sp) = ((np.cos(a), np.sin(a)) for a in (azimuth, elevation, bank))

    def stack(*rows):
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)

    rx = stack((one, zero, zero), (zero, cp, sp), (zero, -sp, cp))
    ry = stack((ct, zero, -st), (zero, one, zero), (st, zero, ct))
    rz = stack((cs, ss, zero), (-ss, cs, zero), (zero, zero, one))
    return rx @ ry @ rz


@host_float64
def body_field(attitudes: Any, field: float = 1.0, inclination: float = INCLINATION) -> AnyArray:
    r"""Earth's field in body axes, without declination.

    .. math:: h = H\,R_x(\phi)R_y(\theta)R_z(\psi)\,[\cos I, 0, \sin I]^T

    Parameters
    ----------
    attitudes : (n, 3) azimuth, elevation and bank in rad.
    field : norm H of the field.
    inclination : dip I in rad, positive downwards.

    Returns
    -------
    (n, 3) in the unit of `field`.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import body_field
    >>> print(body_field(np.deg2rad([[90.0, 0.0, 0.0]]), 50.0, np.deg2rad(60.0)).round(2) + 0.0)
    [[  0.  -25.   43.3]]

    References
    ----------
    The magnetometer paper, section IV.
    """
    return field * rotation(np.asarray(attitudes)) @ np.array([np.cos(inclination), 0.0, np.sin(inclination)])


_SAMPLES = {"all": 360, "three_turns": 120, "twelve_points": 4}


@host_float64
def scenario(name: str, *, samples: int | None = None, elevation: float = np.deg2rad(30.0), seed: int = 0) -> AnyArray:
    """Attitudes of the magnetometer paper's three ways to collect readings.

    Parameters
    ----------
    name : "all", attitudes drawn uniformly; "three_turns", full turns at three elevations; "twelve_points", four headings at each.
    samples : attitudes for "all" (360), or headings per turn for the others (120 and 4).
    elevation : the three elevations are minus this, 0 and this, in rad.
    seed : of the random attitudes of "all".

    Returns
    -------
    (n, 3) azimuth, elevation and bank in rad.

    Raises
    ------
    DataError
        For an unknown name, or fewer than one sample.

    Examples
    --------
    >>> from jaxcal.magnetometer import scenario
    >>> scenario("all").shape, scenario("three_turns").shape, scenario("twelve_points").shape
    ((360, 3), (360, 3), (12, 3))

    References
    ----------
    The magnetometer paper, section IV.
    """
    if name not in _SAMPLES:
        raise DataError(f"There is no scenario {name!r}; known are {', '.join(map(repr, _SAMPLES))}.")
    count = _SAMPLES[name] if samples is None else int(samples)
    if count < 1:
        raise DataError(f"A scenario of {count} samples was asked for; it needs at least one.")
    if name == "all":
        rng = np.random.default_rng(seed)
        azimuth, bank = rng.uniform(0, 2 * np.pi, count), rng.uniform(-np.pi, np.pi, count)
        return np.stack([azimuth, np.arcsin(rng.uniform(-1, 1, count)), bank], axis=1)
    azimuth = np.tile(np.arange(count) * 2 * np.pi / count, 3)
    tilt = np.repeat([-elevation, 0.0, elevation], count)
    return np.stack([azimuth, tilt, np.zeros(3 * count)], axis=1)
