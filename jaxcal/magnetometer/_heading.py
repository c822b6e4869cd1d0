"""`heading`: magnetic heading with tilt compensation."""

import warnings
from typing import Any

import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import host_float64, is_traced
from .._types import AnyArray

_STEEPEST = 0.17  # horizontal share of the field below which (10 degrees from a magnetic pole) there is no heading
_LIGHTEST = 1.0  # m/s^2 of specific force below which there is no vertical


@host_float64
def heading(m: Any, accel: Any, *, declination: float = 0.0) -> AnyArray:
    r"""Heading from the corrected field and the specific force at rest, both in body axes (x forward, y right, z down).

    .. math:: \phi = \mathrm{atan2}(-f_y, -f_z),\quad \theta = \mathrm{atan2}(f_x, \sqrt{f_y^2 + f_z^2}),\quad
              \psi = \mathrm{atan2}(-Y_h, X_h) + \delta

    with X_h and Y_h the field turned back by bank and elevation.

    Parameters
    ----------
    m : (3,) or (n, 3) corrected field, any unit.
    accel : specific force, same shape, m/s^2; at rest it points up, (0, 0, -9.81) when level.
    declination : added to the magnetic heading, rad.

    Returns
    -------
    Heading in rad in [0, 2 pi), clockwise from north. NaN, with a warning that says how many and why, within 10 degrees of a
    magnetic pole and in free fall.

    Raises
    ------
    DataError
        If the shapes differ or do not end in three.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import heading
    >>> print(np.rad2deg(heading(np.array([0.0, -20.0, 40.0]), np.array([0.0, 0.0, -9.81]))).round(6))
    90.0

    References
    ----------
    NXP AN4248, equations 13 to 22, for these axes.
    """
    m, accel = jnp.asarray(m, dtype=jnp.result_type(float)), jnp.asarray(accel, dtype=jnp.result_type(float))
    if m.shape != accel.shape or m.ndim not in (1, 2) or m.shape[-1] != 3:
        raise DataError(f"The field has shape {m.shape} and the specific force {accel.shape}; both must be (3,) or (n, 3).")
    x, y, z = jnp.moveaxis(m, -1, 0)
    fx, fy, fz = jnp.moveaxis(accel, -1, 0)
    force, field = jnp.linalg.norm(accel, axis=-1), jnp.linalg.norm(m, axis=-1)
    falling = ~(force >= _LIGHTEST)
    # Double where: no derivative of atan2 at the origin.
    fz = jnp.where(falling, -1, fz)
    fx, fy = (jnp.where(falling, 0, f) for f in (fx, fy))
    cross = jnp.sqrt(fy**2 + fz**2)
    length = jnp.sqrt(fx**2 + cross**2)
    upright = cross > 0
    cross = jnp.where(upright, cross, 1)
    sp, cp = jnp.where(upright, -fy / cross, 0), jnp.where(upright, -fz / cross, 1)
    st, ct = fx / length, jnp.where(upright, cross, 0) / length
    forward, right = x * ct + y * sp * st + z * cp * st, y * cp - z * sp
    steep = ~(jnp.sqrt(forward**2 + right**2) > _STEEPEST * field)
    angle = jnp.arctan2(-jnp.where(steep, 0, right), jnp.where(steep, 1, forward))
    angle = jnp.mod(angle + declination, 2 * jnp.pi)
    if not is_traced(m, accel):
        _explain(int(np.sum(falling)), int(np.sum(steep & ~falling)), int(np.size(falling)))
    return jnp.where(falling | steep, jnp.nan, angle)


def _explain(falling: int, steep: int, count: int) -> None:
    reasons = []
    if falling:
        reasons.append(f"{falling} of {count} have no heading because the specific force is below {_LIGHTEST:g} m/s^2 (free fall)")
    if steep:
        reasons.append(f"{steep} of {count} have no heading because the field is within 10 degrees of the vertical (magnetic pole)")
    if reasons:
        warnings.warn(f"{'; '.join(reasons)}. They are NaN.", UserWarning, stacklevel=4)
