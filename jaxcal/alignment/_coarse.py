"""`coarse`: attitude and latitude from the means of a full IMU at rest."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import host_float64, is_traced
from ._frames import EARTH_RATE, GRAVITY, angles_of
from ._positions import check_gravity, check_latitude
from ._verdict import Verdict, sentence, verdict_name

_POLE = np.deg2rad(89.9)
_SIGMAS = 4


class Coarse(eqx.Module):
    """Attitude and latitude of an IMU at rest.

    Attributes
    ----------
    attitude : (3,) roll, pitch, azimuth, rad; None where there is no horizontal rate or no gravity (traced: zero azimuth).
    latitude : rad, as found.
    attitude_std : (3,) first order, for a level IMU that points north; None without noise.
    latitude_std : rad; None without noise.
    rate_error, force_error : |w| - we in rad/s and |f| - g in m/s^2.
    latitude_error : found less given, rad; None where none was given.
    verdict : item of `Verdict`.
    """

    attitude: Any
    latitude: Any
    attitude_std: Any
    latitude_std: Any
    rate_error: Any
    force_error: Any
    latitude_error: Any
    verdict: Any

    @property
    def reason(self) -> str:
        """What the verdict means (host only)."""
        return sentence(self.verdict, "coarse")


@host_float64
def coarse(
    gyro_mean: Any, accel_mean: Any, *, latitude: Any = None, gravity: Any = GRAVITY, gyro_error: Any = None, accel_error: Any = None
) -> Coarse:
    r"""Attitude and latitude from the mean rate and specific force of three gyros and three accelerometers at rest.

    .. math:: d = -f/|f|,\quad n = \frac{w - (w\cdot d)\,d}{|w - (w\cdot d)\,d|},\quad e = d \times n,\quad C_{BN} = [n\; e\; d]

    Parameters
    ----------
    gyro_mean, accel_mean : (3,) rad/s and m/s^2 in body axes.
    latitude : rad, if known: it is compared with the one found.
    gravity : m/s^2.
    gyro_error, accel_error : standard deviation of one axis' mean with its bias, rad/s and m/s^2.

    Returns
    -------
    Coarse

    Raises
    ------
    DataError
        For means that are not three finite numbers.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import coarse
    >>> level = coarse(7.292115e-5 * np.array([0.0, -0.8, -0.6]), np.array([0.0, 0.0, -9.80665]))
    >>> print(np.rad2deg(level.attitude).round(3) + 0.0, np.rad2deg(level.latitude).round(3))
    [ 0.  0. 90.] 36.87

    References
    ----------
    P. G. Savage, Strapdown Analytics, 2000, section 6.1 (coarse alignment from two vectors).
    """
    w, f = jnp.asarray(gyro_mean), jnp.asarray(accel_mean)
    traced = is_traced(w, f)
    for name, v in (("gyro", w), ("accelerometer", f)):
        if v.shape != (3,):
            raise DataError(f"The {name} mean has shape {v.shape}; give its three axes.")
        if not traced and not np.isfinite(np.asarray(v)).all():
            raise DataError(f"The {name} mean is not finite; average the log of an IMU at rest.")
    check_gravity(gravity)
    if latitude is not None:
        check_latitude(latitude)
    force, rate = jnp.sqrt(f @ f), jnp.sqrt(w @ w)
    no_force = force < 0.1 * gravity
    d = -jnp.where(no_force, jnp.asarray([0.0, 0.0, -1.0], dtype=f.dtype), f) / jnp.where(no_force, 1, force)
    flat = w - (w @ d) * d
    some = flat @ flat > 0
    horizontal = jnp.where(some, jnp.sqrt(jnp.where(some, flat @ flat, 1)), 0)
    found = jnp.arctan2(-(w @ d), horizontal)
    pole = (jnp.abs(found) > _POLE) | (rate < 1e-3 * EARTH_RATE)
    n = jnp.where(pole, 0, flat) / jnp.where(pole, 1, horizontal)
    matrix = jnp.stack([n, jnp.cross(d, n), d], axis=1)
    angles = jnp.where(
        pole, jnp.stack([jnp.arctan2(d[1], d[2]), jnp.arctan2(-d[0], jnp.hypot(d[1], d[2])), jnp.zeros_like(force)]),
        angles_of(jnp.where(pole, jnp.eye(3, dtype=f.dtype), matrix)),
    )  # fmt: skip
    std = latitude_std = None
    if gyro_error is not None and accel_error is not None:
        tilt, drift = accel_error / gravity, gyro_error / EARTH_RATE
        cosine = jnp.cos(jnp.where(pole, 0, found))
        std = jnp.stack(
            [tilt + 0 * cosine, tilt + 0 * cosine, jnp.sqrt((drift / cosine) ** 2 + (jnp.tan(jnp.where(pole, 0, found)) * tilt) ** 2)]
        )
        latitude_std = jnp.sqrt(drift**2 + tilt**2)
    off = None if latitude is None else found - latitude
    verdict = Verdict.where(jnp.asarray(False) if std is None else std[2] > np.deg2rad(10.0), Verdict.weak, Verdict.ok)
    if off is not None and latitude_std is not None:
        verdict = Verdict.where(jnp.abs(off) > _SIGMAS * latitude_std, Verdict.integrity, verdict)
    verdict = Verdict.where(pole, Verdict.pole, verdict)
    verdict = Verdict.where(no_force, Verdict.degenerate, verdict)
    none = not traced and verdict_name(verdict) in ("pole", "degenerate")
    return Coarse(
        attitude=None if none else angles, latitude=found if traced or verdict_name(verdict) != "degenerate" else None,
        attitude_std=None if none else std, latitude_std=latitude_std, rate_error=rate - EARTH_RATE, force_error=force - gravity,
        latitude_error=off, verdict=verdict,
    )  # fmt: skip
