"""`simulate`: what an accelerometer and a gyro on a turntable read."""

from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import host_float64, is_traced
from .._types import Array
from ._frames import EARTH_RATE, GRAVITY, earth_rate, in_body, table_from_nav
from ._positions import IDEAL, Positions, Readings, Sensor, as_positions, check_latitude


def true_rate(matrix: Array, latitude: Array, positions: Any) -> Array:
    """Angular rate in body axes, (n, 3), rad/s."""
    angle, rate, width = (_as(value, matrix) for value in (positions.angle, positions.rate, positions.width))
    rates = EARTH_RATE * in_body(earth_rate(matrix, latitude), angle, attenuation(width))
    return rates.at[:, 2].add(rate)


def true_force(matrix: Array, latitude: Array, positions: Any, lever_arm: Array, gravity: Array) -> Array:
    """Specific force in body axes at [l, 0, 0], (n, 3), m/s^2: centripetal, tangential and Coriolis parts, less gravity."""
    angle, rate, acceleration, width = (
        _as(value, matrix) for value in (positions.angle, positions.rate, positions.acceleration, positions.width)
    )
    k = attenuation(width)
    w = EARTH_RATE * in_body(earth_rate(matrix, latitude), angle, k)
    lever = jnp.stack(
        [-lever_arm * rate**2 - 2 * lever_arm * rate * w[:, 2], lever_arm * acceleration, 2 * lever_arm * rate * w[:, 0]], axis=1
    )
    return lever - gravity * in_body(matrix[:, 2], angle, k)


def attenuation(width: Array) -> Array:
    """Factor by which the mean over a sector lowers a first harmonic."""
    moving = width != 0
    half = jnp.where(moving, width, 1) / 2
    return jnp.where(moving, jnp.sin(half) / half, 1)


def read(vectors: Array, axes: Array, sensor: Sensor, time: Array) -> Array:
    """One row of the sensor's error model at every position, without noise."""
    s, (first, second), b, rate = (_as(v, vectors) for v in (sensor.scale_error, sensor.misalignment, sensor.bias, sensor.bias_rate))
    row = jnp.stack([1 + s, first, second])
    return jnp.einsum("k,nki,ni->n", row, axes, vectors) + b + rate * time


def walk_covariance(start: Any, dwell: Any) -> Array:
    """Covariance of the means over dwells of a unit random walk that starts with the test, (n, n), s."""
    start = start - jnp.min(start)
    earlier = jnp.minimum(start[:, None], start[None, :])
    shorter = jnp.where(start[:, None] <= start[None, :], dwell[:, None], dwell[None, :])
    same = jnp.eye(start.size, dtype=bool)
    return earlier + shorter * jnp.where(same, 1 / 3, 1 / 2)


def _noise(key: Array, sensor: Sensor, positions: Positions, like: Array, walking: bool) -> Array:
    white, walk, dwell, start = (_as(v, like) for v in (sensor.white, sensor.walk, positions.dwell, positions.start))
    one, two = jax.random.split(key)
    noise = white / jnp.sqrt(dwell) * jax.random.normal(one, dwell.shape, like.dtype)
    if not walking:
        return noise
    size = jnp.linalg.cholesky(walk_covariance(start, dwell))
    return noise + walk * (size @ jax.random.normal(two, dwell.shape, like.dtype))


def _as(value: Any, like: Array) -> Array:
    return jnp.asarray(value, dtype=like.dtype)


@host_float64
def simulate(
    positions: Any,
    attitude: Any,
    latitude: Any,
    *,
    accel: Sensor = IDEAL,
    gyro: Sensor = IDEAL,
    lever_arm: Any = 0.0,
    table_rate: Any = None,
    table_acceleration: Any = None,
    gravity: Any = GRAVITY,
    seed: Any = 0,
) -> Readings:
    r"""Readings of an accelerometer and a gyro on a turntable.

    .. math:: f = a_{rel} + 2\omega_E \times v_{rel} - g,\qquad m = (1+s)\,u\cdot v + MA_1 v_1\cdot v + MA_2 v_2\cdot v + b + n

    with :math:`v_{rel} = [0, l\omega, 0]`, :math:`a_{rel} = [-l\omega^2, l\dot\omega, 0]`, at every position, mounting and dwell.

    Parameters
    ----------
    positions : `Positions`, or table angles in rad.
    attitude : (3,) roll phi, pitch theta, azimuth psi of the table, rad.
    latitude : rad, north positive.
    accel, gyro : errors and noise of the sensors.
    lever_arm : distance of the sensors from the table's axis along body x, m.
    table_rate, table_acceleration : rad/s and rad/s^2; by default those of the positions.
    gravity : m/s^2.
    seed : of the noise; traced, a key of `jax.random`.

    Returns
    -------
    Readings; they carry the noise coefficients of the sensors, where these are not zero.

    Raises
    ------
    DataError
        For an attitude that is not three finite angles, or a latitude beyond the poles.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import simulate
    >>> readings = simulate(np.deg2rad([0.0, 90.0]), np.deg2rad([0.0, 30.0, 90.0]), 0.0)
    >>> print(readings.accel.round(3) + 0.0)
    [4.903 0.   ]

    References
    ----------
    The north-finding paper's equations (16), (18), (22), (23) and (36) to (39), in corrected form.
    """
    positions = as_positions(positions)
    given = (positions, attitude, latitude, accel, gyro, lever_arm, seed)
    for name, value in (("rate", table_rate), ("acceleration", table_acceleration)):
        if value is not None:
            spread = (jnp if is_traced(value) else np).broadcast_to(value, positions.angle.shape)
            positions = _with(positions, name, spread)
    attitude = jnp.asarray(attitude)
    if attitude.shape != (3,):
        raise DataError(f"The attitude has shape {attitude.shape}; give (roll, pitch, azimuth) in rad.")
    if not is_traced(given):
        if not np.isfinite(np.asarray(attitude)).all():
            raise DataError("The attitude is not finite; give (roll, pitch, azimuth) in rad.")
        check_latitude(latitude)
    key = seed if isinstance(seed, jax.Array) else jax.random.key(int(seed))
    walking = any(isinstance(k, jax.core.Tracer) or float(k) > 0 for k in (accel.walk, gyro.walk))
    # as arrays: a number would be part of the program, which would be compiled anew for every other
    numbers = (jnp.asarray(latitude), accel, gyro, lever_arm, gravity)
    here, accel_errors, gyro_errors, arm, weight = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=attitude.dtype), numbers)
    a, w = _simulated(positions, positions.axes, attitude, here, accel_errors, gyro_errors, arm, weight, key, walking)
    noise = [_known(sensor) for sensor in (accel, gyro)]
    return Readings(positions, a, w, accel_noise=noise[0], gyro_noise=noise[1], lever_arm=lever_arm)


def _known(sensor: Sensor) -> Any:
    """The sensor's noise; None where it has none."""
    return sensor if any(isinstance(n, jax.core.Tracer) or float(n) > 0 for n in (sensor.white, sensor.walk)) else None


def _with(positions: Positions, name: str, value: Any) -> Positions:
    return eqx.tree_at(lambda p: getattr(p, name), positions, value)


@eqx.filter_jit
def _simulated(positions, axes, attitude, latitude, accel, gyro, lever_arm, gravity, key, walking: bool):
    matrix = table_from_nav(*attitude)
    axes, time = _as(axes, attitude), _as(positions.time, attitude)
    force = true_force(matrix, latitude, positions, _as(lever_arm, attitude), _as(gravity, attitude))
    rate = true_rate(matrix, latitude, positions)
    one, two = jax.random.split(key)
    return (
        read(force, axes, accel, time) + _noise(one, accel, positions, attitude, walking),
        read(rate, axes, gyro, time) + _noise(two, gyro, positions, attitude, walking),
    )
