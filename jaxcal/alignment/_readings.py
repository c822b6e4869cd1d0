"""`simulate`: readings of sensors with known errors."""

from typing import Any

import jax
import jax.core
import jax.numpy as jnp

from .._compile import filter_jit
from .._precision import host_float64
from .._types import AnyArray, Array, Numbers, Real
from ..noise import Noise, mean_covariance
from ._model import in_one_type, turntable
from ._noise import IDEAL, Sensor, as_noise, white_alone
from ._positions import GRAVITY, Positions, Readings, as_positions, check_latitude, checked_attitude


@filter_jit
def _noise(key: Array, noise: Noise, dwell: Array, start: Array) -> AnyArray:
    """Draw the noise of the means over the dwells."""
    drawn = jax.random.normal(key, dwell.shape, dwell.dtype)
    if white_alone(noise):
        return noise.N / jnp.sqrt(dwell) * drawn
    covariance = mean_covariance(noise, start, dwell)
    # without white noise the covariance may be singular, so add a small diagonal
    return jnp.linalg.cholesky(covariance + 1e-12 * jnp.mean(jnp.diag(covariance)) * jnp.eye(dwell.size, dtype=dwell.dtype)) @ drawn


@host_float64
def simulate(
    positions: Positions | Numbers,
    attitude: Numbers,
    latitude: Real,
    *,
    accel: Sensor = IDEAL,
    gyro: Sensor = IDEAL,
    lever_arm: Real = 0.0,
    gravity: Real = GRAVITY,
    seed: int | Array = 0,
) -> Readings:
    r"""Simulate readings of an accelerometer and a gyro on a turntable.

    .. math:: f = a_{rel} + 2\omega_E \times v_{rel} - g,\qquad m = (1+s)\,u\cdot v + MA_1 v_1\cdot v + MA_2 v_2\cdot v + b + n

    Here :math:`v_{rel} = [0, l\omega, 0]` and :math:`a_{rel} = [-l\omega^2, l\dot\omega, 0]`, with the lever arm l and the table rate.

    Parameters
    ----------
    positions : `Positions`, or table angles in rad.
    attitude : (3,) roll phi, pitch theta, azimuth psi of the table, rad.
    latitude : rad, north positive.
    accel, gyro : errors and noise of the sensors.
    lever_arm : distance of the sensors from the table's axis along body x, m.
    gravity : m/s^2.
    seed : seed of the noise; under tracing, a key of `jax.random`.

    Returns
    -------
    Readings
        They include the noise coefficients of the sensors that are not zero.

    Raises
    ------
    DataError
        If the attitude is not three finite angles, or the latitude is beyond a pole.

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
    attitude = checked_attitude(attitude)
    check_latitude(latitude)
    made = turntable(attitude, latitude, accel, gyro).measure(positions, gravity=gravity, lever_arm=lever_arm)
    dtype = jax.dtypes.canonicalize_dtype(jnp.result_type(attitude))
    made = in_one_type(made, dtype)
    keys = jax.random.split(seed if isinstance(seed, jax.Array) else jax.random.key(int(seed)))
    # convert to arrays, because a Python number would be a constant of the program and force a new compilation for every value
    as_array = lambda value: jnp.asarray(value, dtype=dtype)  # noqa: E731
    dwell, start = as_array(positions.dwell), as_array(positions.start)
    loud = (any(map(_some, (sensor.white, sensor.walk, sensor.flicker))) for sensor in (accel, gyro))
    known = [as_noise(sensor, "noise") if some else None for sensor, some in zip((accel, gyro), loud, strict=True)]
    noisy = [
        reading if noise is None else reading + _noise(key, jax.tree.map(lambda x: as_array(x) if _some(x) else 0.0, noise), dwell, start)
        for key, noise, reading in zip(keys, known, made, strict=True)
    ]
    return Readings(positions, *noisy, accel_noise=known[0], gyro_noise=known[1], lever_arm=lever_arm)


def _some(size: Any) -> bool:
    """Whether a noise coefficient is not zero, or is traced."""
    return isinstance(size, jax.core.Tracer) or float(size) > 0
