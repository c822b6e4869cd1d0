"""`crlb`: how well positions can tell attitude, sensor errors and latitude, before anything is measured."""

import dataclasses
from collections.abc import Iterable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._errors import DataError
from .._precision import array_module, host_float64, is_traced
from .._types import Array
from ._describe import know, sizes_of
from ._frames import GRAVITY
from ._model import NAMES, Turntable, turntable, with_values
from ._options import free_of, priors_of
from ._positions import IDEAL, Readings, Sensor, as_positions, check_gravity, check_latitude
from ._result import Bound
from ._table import Table, in_one_type, residuals, tabulate


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
    chosen = free_of(free, priors, positions, latitude, (True, True), NAMES)
    certainty = priors_of(priors, NAMES)[1]
    noise = [noise_of(accel_noise, "accelerometer noise"), noise_of(gyro_noise, "gyro noise")]
    attitude = attitude if is_traced(attitude) else np.asarray(attitude, dtype=float)
    if attitude.shape != (3,):
        raise DataError(f"The attitude has shape {attitude.shape}; give (roll, pitch, azimuth) in rad.")
    zeros = np.zeros(len(positions))
    table = tabulate(Readings(positions, zeros, zeros, lever_arm=lever_arm), gravity, noise)
    model = turntable(attitude, latitude, accel, gyro)
    dtype = jax.dtypes.canonicalize_dtype(attitude.dtype)
    xp = array_module(table, model, certainty)
    weight = xp.stack([xp.asarray(certainty.get(name, 0.0)) for name in NAMES])
    table, model = in_one_type((dataclasses.replace(table, prior=0 * weight, certainty=weight), model), dtype)
    mask = np.array([name in chosen for name in NAMES])
    jacobian = jacobian_at(model, table)
    known = know(jacobian if is_traced(jacobian) else np.asarray(jacobian), 2 * table.accel.size, mask, sizes_of(NAMES, gravity, positions))
    return Bound(NAMES, known.covariance, mask, known.rank, known.hidden, known.lost)


@filter_jit
def jacobian_at(model: Turntable, table: Table) -> Array:
    """Jacobian of the residuals with respect to the parameters, in their order."""
    values = jnp.stack([jnp.asarray(leaf) for leaf in jax.tree.leaves(model)])
    return jax.jacfwd(lambda x: residuals(with_values(model, x), table))(values)
