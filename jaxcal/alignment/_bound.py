"""`crlb`: how well positions can tell attitude, sensor errors and latitude, before anything is measured."""

from collections.abc import Iterable
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import host_float64, is_traced
from .._types import Array
from ._describe import know, physical
from ._frames import GRAVITY, table_from_nav
from ._model import COUNT, Rows, Table, as_arrays, residuals, tabulate, whitening
from ._options import free_of, priors_of
from ._positions import IDEAL, Readings, Sensor, as_positions, check_gravity, check_latitude
from ._result import Bound


def noise_of(noise: Any, name: str) -> tuple[Any, Any]:
    """N and K of a number, a `Sensor` or a `jaxcal.noise.Noise`."""
    if noise is None:
        raise DataError(f"There is no {name}; give its white noise, SI, or a `jaxcal.noise.Noise`: without it there is no bound.")
    as_readings = Readings(np.zeros(1), gyro=np.zeros(1), gyro_noise=noise)
    white, walk = as_readings.white("gyro"), as_readings.walk("gyro")
    if not is_traced(white) and not float(white) > 0:
        raise DataError(f"The {name} is {float(white):g}; it is positive, SI.")
    return white, walk


@host_float64
def crlb(
    positions: Any,
    attitude: Any,
    latitude: Any,
    *,
    accel_noise: Any,
    gyro_noise: Any,
    free: Iterable[str] | None = None,
    priors: dict[str, Any] | None = None,
    accel: Sensor = IDEAL,
    gyro: Sensor = IDEAL,
    lever_arm: Any = 0.0,
    gravity: Any = GRAVITY,
) -> Bound:
    r"""Cramer-Rao bound of the joint fit, :math:`(J^T J)^{-1}` of the whitened Jacobian with the priors.

    Parameters
    ----------
    positions : `Positions`, or table angles in rad.
    attitude : (3,) roll, pitch, azimuth, rad.
    latitude : rad; it counts as known unless "latitude" is in `free`.
    accel_noise, gyro_noise : white noise N (m/s^2 sqrt(s), rad/sqrt(s)), a `jaxcal.noise.Noise` (N and K) or a `Sensor`.
    free, priors : as of `fit`.
    accel, gyro : sensor errors at which the bound is taken.
    lever_arm : m. gravity : m/s^2.

    Returns
    -------
    Bound
        With covariance, rank and the parameters that are confounded. Traced, it is differentiable in every number.

    Raises
    ------
    DataError
        For unknown names, or noise that is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Positions, crlb
    >>> four = Positions(np.deg2rad([0.0, 90.0, 180.0, 270.0]), dwell=60.0)
    >>> arw = np.deg2rad(0.01) / 60
    >>> bound = crlb(four, np.deg2rad([0.0, 0.0, 88.0]), np.deg2rad(35.0), accel_noise=5e-4, gyro_noise=arw)
    >>> print(np.rad2deg(bound.azimuth_std).round(4))
    0.2547

    References
    ----------
    S. M. Kay, Fundamentals of Statistical Signal Processing: Estimation Theory, 1993, section 3.9 (white Gaussian noise).
    """
    positions = as_positions(positions)
    check_latitude(latitude)
    check_gravity(gravity)
    chosen = free_of(free, priors, positions, latitude, (True, True))
    certainty = priors_of(priors)[1]
    noise = [noise_of(accel_noise, "accelerometer noise"), noise_of(gyro_noise, "gyro noise")]
    correlated = any(isinstance(k, jax.core.Tracer) or float(k) > 0 for _, k in noise)
    attitude = jnp.asarray(attitude)
    dtype = attitude.dtype
    if attitude.shape != (3,):
        raise DataError(f"The attitude has shape {attitude.shape}; give (roll, pitch, azimuth) in rad.")
    zeros = np.zeros(len(positions)) if not is_traced(positions, attitude, latitude) else jnp.zeros(len(positions), dtype=dtype)
    table = tabulate(Readings(positions, zeros, zeros, lever_arm=lever_arm), gravity)
    table = as_arrays(table, dtype)
    to = lambda values: jnp.stack([jnp.asarray(value, dtype=dtype) for value in values])  # noqa: E731
    values = jnp.concatenate([attitude, to(_errors(accel, gyro)), to([latitude])])
    return _bound(table, values, to(certainty), jnp.asarray(chosen), tuple(to(pair) for pair in noise), correlated)


def _errors(accel: Sensor, gyro: Sensor) -> list[Any]:
    """Parameters 3 to 12."""
    (a1, a2), (g1, g2) = accel.misalignment, gyro.misalignment
    return [accel.bias, accel.scale_error, gyro.bias, gyro.scale_error, a1, a2, g1, g2, accel.bias_rate, gyro.bias_rate]


def jacobian_at(table: Table, values: Array, certainty: Array, noise: Any, correlated: bool) -> Array:
    """Whitened Jacobian of readings and priors with respect to the 14 parameters."""
    rows = Rows(table, whitening(table, noise, correlated), values, table_from_nav(*values[:3]), jnp.asarray(False), values, certainty)
    return jax.jacfwd(residuals)(jnp.zeros_like(values), rows)


@eqx.filter_jit
def _bound(table: Table, values: Array, certainty: Array, free: Array, noise: Any, correlated: bool) -> Bound:
    jacobian = jacobian_at(table, values, jnp.where(free, certainty, 0), noise, correlated)
    duration = jnp.max(table.start + table.dwell) - jnp.min(table.start)
    known = know(jax.lax.stop_gradient(jacobian), free, physical(table.gravity, duration, values.dtype))
    covariance = jnp.where(jnp.any(known.lost), known.covariance, inverse_information(jacobian, free, jnp.any(known.lost)))
    return Bound(covariance, free, known.rank, known.hidden, known.lost)


def inverse_information(jacobian: Array, free: Array, singular: Array) -> Array:
    """(J'J)^-1 of the free parameters through QR, differentiable; zero for those that are held, meaningless where J is singular."""
    eye = jnp.eye(COUNT, dtype=jacobian.dtype)
    safe = jnp.where(free[None, :], jacobian, 0)
    column = jax.lax.stop_gradient(jnp.linalg.norm(safe, axis=0))
    column = jnp.where(column > 0, column, 1)
    # held parameters, and all of them where the information is singular, get a row of their own instead
    held = jnp.where(free & ~singular, 0, 1).astype(jacobian.dtype)
    stack = jnp.concatenate([safe / column[None, :], held[:, None] * eye])
    triangle = jnp.linalg.qr(stack, mode="reduced")[1]
    inverse = jax.scipy.linalg.solve_triangular(triangle, eye) / column[:, None]
    inverse = jnp.where(free[:, None], inverse, 0)
    return inverse @ inverse.T
