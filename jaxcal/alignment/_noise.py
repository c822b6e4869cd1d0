"""Noise of the sensors: known errors (`Sensor`), conversion of any source to `Noise` per axis, and the covariance of the readings."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import numpy as np

from .._errors import DataError
from .._precision import array_module, is_traced
from .._types import AnyArray, Checked, Leaf, NoiseLike, Real
from ..noise import Noise, mean_covariance

_AXES = "xyz"
SENSORS = {"accel": "accelerometer", "gyro": "gyro"}


class Sensor(eqx.Module):
    """Errors of an accelerometer (SI: m/s^2) or a gyro (rad/s).

    The reading is m = (1 + s) u.v + MA_1 v1.v + MA_2 v2.v + b + b' (t - t0) + n with the sensitive axis u and the cross axes v1, v2.

    Attributes
    ----------
    scale_error : s.
    misalignment : (2,) MA_1, MA_2, rad.
    bias : b, mean over the measured time.
    bias_rate : b', drift of the bias per second; t0 is the middle of the test.
    white : N, velocity or angle random walk (m/s^2 sqrt(s), rad/sqrt(s)); the mean over a dwell T has the variance N^2/T.
    walk : K, random walk of the bias (m/s^2/sqrt(s), rad/s/sqrt(s)).
    flicker : B, bias instability (m/s^2, rad/s).

    Examples
    --------
    >>> from jaxcal.alignment import Sensor
    >>> gyro = Sensor(bias=5e-8, white=3e-6)
    >>> gyro.bias, gyro.scale_error
    (5e-08, 0.0)
    """

    scale_error: Leaf = 0.0
    misalignment: Checked["tuple[Real, Real] | AnyArray"] = (0.0, 0.0)
    bias: Leaf = 0.0
    bias_rate: Leaf = 0.0
    white: Leaf = 0.0
    walk: Leaf = 0.0
    flicker: Leaf = 0.0


#: without any error or noise
IDEAL = Sensor()


def as_noise(given: Any, name: str) -> Any:
    """Convert a number, `Sensor`, `NoiseFit` or `Noise`, or three of them, to `Noise` or a tuple of three; None stays None."""
    if given is None or isinstance(given, Noise):
        return given
    if isinstance(given, (tuple, list)):
        if len(given) != 3:
            raise DataError(f"The {name} holds {len(given)} models; give one, or three for the axes of a triad.", code="noise")
        return tuple(as_noise(one, name) for one in given)
    if isinstance(given, Sensor):
        return Noise(N=given.white, B=given.flicker, K=given.walk)
    if isinstance(inner := getattr(given, "noise", None), Noise):
        return inner
    if hasattr(given, "aval") or (np.ndim(given) == 0 and isinstance(given, (int, float, np.number, np.ndarray))):
        return Noise(N=given)
    raise DataError(f"The {name} is a {type(given).__name__}; give its white noise N (SI), a Noise, a NoiseFit or a Sensor.", code="noise")


def noise_of(source: NoiseLike, axis: str | None = "x") -> dict[str, Any]:
    """Extract the noise of accelerometer and gyro from a noise fit or a calibration of the device.

    Parameters
    ----------
    source : result of `jaxcal.noise.characterise` (channel -> `NoiseFit`), a `jaxcal.Calibration` with noise, or {"accel": noise,
        "gyro": noise} with any noise that `Readings` accepts.
    axis : axis of the device that is the sensitive axis on the table, "x", "y" or "z"; None returns all three, for a full IMU.

    Returns
    -------
    {"accel_noise": ..., "gyro_noise": ...}, for `Readings`, `crlb` and `plan`; None for a sensor without noise in the source.

    Raises
    ------
    DataError
        If the source has no noise of either sensor, or the axis is not x, y or z.

    Examples
    --------
    >>> from jaxcal.alignment import noise_of
    >>> from jaxcal.noise import Noise
    >>> noise_of({"gyro": Noise(N=3e-6, B=1e-7)})["gyro_noise"].B
    1e-07
    """
    if axis is not None and axis not in tuple(_AXES):
        raise DataError(f"There is no axis {axis!r}; give 'x', 'y' or 'z', or None for all three.", code="axis")
    held = getattr(source, "noise", source)
    found = {}
    for sensor in SENSORS:
        if isinstance(held, Mapping) and sensor in held:
            found[sensor] = as_noise(held[sensor], f"{SENSORS[sensor]} noise")
            continue
        axes = [_channel(held, sensor, i) for i in range(3)] if axis is None else [_channel(held, sensor, _AXES.index(axis))]
        found[sensor] = None if any(one is None for one in axes) else axes[0] if axis else tuple(axes)
    if all(one is None for one in found.values()):
        which = "all three axes" if axis is None else f"the {axis} axis"
        raise DataError(f"The {type(source).__name__} holds no noise on {which}; give that of jaxcal.noise.characterise.", code="no_noise")
    return {f"{sensor}_noise": one for sensor, one in found.items()}


def _channel(held: Any, sensor: str, index: int) -> Noise | None:
    """Noise of one axis, from a mapping channel -> fit or from the noise of a calibration; None if it has none."""
    if isinstance(held, Mapping):
        return as_noise(held.get(f"{sensor}_{_AXES[index]}"), f"{SENSORS[sensor]} noise")
    stored = getattr(held, sensor, None)
    letters = {name: getattr(stored, name, None) for name in "QNBKR"}
    known = {name: float(values[index]) for name, values in letters.items() if values is not None and np.isfinite(values[index])}
    if not known:
        return None
    processes = {name: values[index] for name in ("markov", "sinusoid") if (values := getattr(stored, name))}
    further = tuple((float(one.coefficient[index]), one.term) for one in getattr(stored, "further") or ())  # noqa: B009
    return Noise(**known, **processes, further=further)


def by_channel(noise: Any, positions: Any) -> Any:
    """Repeat one noise model for the three sensors of a triad if the positions use several sensors, whose noise is independent."""
    several = noise is not None and not isinstance(noise, tuple) and bool(np.any(positions.channel > 0))
    return (noise,) * 3 if several else noise


def check_noise(noise: Any, name: str) -> None:
    """Refuse noise without white noise, or with a coefficient that is negative or not finite (host only)."""
    for one in noise if isinstance(noise, tuple) else (noise,):
        if one is None or is_traced(one):
            continue
        one.check()
        if not float(one.N) > 0:
            raise DataError(f"The {name} has a white part N of {float(one.N):g}; N is positive, in SI.", code="noise")


def mixed(noises: tuple[Noise, ...], matrix: np.ndarray) -> tuple[Noise, ...]:
    """Noise of the axes of a triad after rotation by a matrix: squared coefficients add up."""

    def one(row: np.ndarray) -> Noise:
        squares = {name: sum((w * float(getattr(n, name))) ** 2 for w, n in zip(row, noises, strict=True)) for name in "QNBKR"}
        sizes, processes = list(zip(np.abs(row), noises, strict=True)), ("markov", "sinusoid", "further")
        rest = {name: tuple((size * one[0], one[1]) for size, n in sizes for one in getattr(n, name)) for name in processes}
        return Noise(**{name: float(np.sqrt(square)) for name, square in squares.items()}, **rest)

    return tuple(one(row) for row in matrix)


def white_alone(noise: Noise) -> bool:
    """Whether a model has white noise only; a ramp is ignored, because it is not random."""
    return all(name in ("N", "R") or (isinstance(c, (int, float)) and c == 0) for name, c, _ in noise.parts)


def covariance_of(noise: Any, places: Any, here: AnyArray) -> AnyArray:
    """Variances (n,) of the readings of one sensor if its noise is white, else their covariance (n, n); one for unmeasured rows."""
    axes = noise if isinstance(noise, tuple) else (noise,)
    xp, white = array_module(axes, places, here), all(map(white_alone, axes))
    total = xp.where(here, 0.0, 1.0) if white else xp.diag(xp.where(here, 0.0, 1.0))
    for i, one in enumerate(axes):
        part = here & (places.channel == i) if len(axes) > 1 else here
        if white:
            total = total + xp.where(part, one.N**2 / places.dwell, 0)
        else:
            own = mean_covariance(one, places.start, places.dwell, xp.where(part, places.dwell, 0))
            total = total + xp.where(part[:, None] & part[None, :], own, 0)
    return total


def joined(parts: list[Any]) -> AnyArray:
    """Variances (2 n,) of the readings of both sensors, or their covariance (2 n, 2 n), from those of each."""
    xp, (first, second) = array_module(parts), parts
    if first.ndim == second.ndim == 1:
        return xp.concatenate(parts)
    first, second = (one if one.ndim == 2 else xp.diag(one) for one in parts)
    return xp.block([[first, xp.zeros_like(first)], [xp.zeros_like(first), second]])


def weight_of(covariance: AnyArray, here: AnyArray) -> AnyArray:
    """Reciprocal standard deviations (n,), or the inverse Cholesky factor (n, n); zero for unmeasured rows."""
    xp = array_module(covariance, here)
    if covariance.ndim == 1:
        return xp.where(here, 1 / xp.sqrt(covariance), 0)
    factor = xp.linalg.cholesky(covariance)
    both = here[:, None] & here[None, :]
    return xp.where(both, xp.linalg.solve(factor, xp.eye(here.size, dtype=factor.dtype)), 0)
