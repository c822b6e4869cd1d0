"""`simulate`: what an accelerometer and a gyro on a turntable read."""

from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._errors import DataError
from .._precision import host_float64, is_traced
from .._types import Array
from ._frames import GRAVITY
from ._model import turntable
from ._positions import IDEAL, Readings, Sensor, as_positions, check_latitude
from ._table import in_one_type, walk_covariance


@filter_jit
def _noise(key: Array, white: Array, walk: Array | None, dwell: Array, start: Array) -> Array:
    """White noise of the means over dwells, and that of a bias that walks."""
    one, two = jax.random.split(key)
    noise = white / jnp.sqrt(dwell) * jax.random.normal(one, dwell.shape, dwell.dtype)
    if walk is None:
        return noise
    return noise + walk * (jnp.linalg.cholesky(walk_covariance(start, dwell)) @ jax.random.normal(two, dwell.shape, dwell.dtype))


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
    for name, value in (("rate", table_rate), ("acceleration", table_acceleration)):
        if value is not None:
            whole = (jnp if is_traced(value) else np).broadcast_to(value, positions.angle.shape)
            positions = eqx.tree_at(lambda p, name=name: getattr(p, name), positions, whole)
    attitude = attitude if is_traced(attitude) else np.asarray(attitude, dtype=float)
    if attitude.shape != (3,):
        raise DataError(f"The attitude has shape {attitude.shape}; give (roll, pitch, azimuth) in rad.")
    if not is_traced(attitude, latitude):
        if not np.isfinite(attitude).all():
            raise DataError("The attitude is not finite; give (roll, pitch, azimuth) in rad.")
        check_latitude(latitude)
    made = turntable(attitude, latitude, accel, gyro).measure(positions, gravity=gravity, lever_arm=lever_arm)
    dtype = jax.dtypes.canonicalize_dtype(attitude.dtype)
    made = in_one_type(made, dtype)
    walking = any(_some(sensor.walk) for sensor in (accel, gyro))
    keys = jax.random.split(seed if isinstance(seed, jax.Array) else jax.random.key(int(seed)))
    # as arrays: a number would be part of the program, which would be compiled anew for every other
    as_array = lambda value: jnp.asarray(value, dtype=dtype)  # noqa: E731
    dwell, start = as_array(positions.dwell), as_array(positions.start)
    noisy = [
        reading + _noise(key, as_array(sensor.white), as_array(sensor.walk) if walking else None, dwell, start) if known else reading
        for key, sensor, reading, known in zip(keys, (accel, gyro), made, map(_known, (accel, gyro)), strict=True)
    ]
    return Readings(positions, *noisy, accel_noise=_known(accel), gyro_noise=_known(gyro), lever_arm=lever_arm)


def _some(size: Any) -> bool:
    """Whether a noise coefficient is not zero, or not yet known."""
    return isinstance(size, jax.core.Tracer) or float(size) > 0


def _known(sensor: Sensor) -> Any:
    """The sensor's noise; None where it has none."""
    return sensor if _some(sensor.white) or _some(sensor.walk) else None
