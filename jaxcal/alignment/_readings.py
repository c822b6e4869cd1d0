"""`carousel`: readings from the raw log of a continuously turning table; `simulate`: readings of sensors with known errors."""

from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._errors import DataError
from .._precision import array_module, host_float64, is_traced
from .._types import Array
from ..noise import Noise, mean_covariance
from ._model import in_one_type, turntable
from ._noise import IDEAL, Sensor, as_noise, white_alone
from ._positions import GRAVITY, Positions, Readings, as_positions, check_latitude, least_squares


class Carousel(eqx.Module):
    """Sector means of a continuously turning table, and the wobble of the table.

    Attributes
    ----------
    readings : `Readings` with one position per sector (and per turn, unless folded), for `fit`.
    turns : number of turns in the log.
    rate : mean table rate, rad/s. rate_spread : standard deviation of the rate between sectors, rad/s.
    wobble : sensor -> (amplitude of the second harmonic, its standard deviation, p value), SI. The model has no second harmonic, so a
        significant one indicates wobble of the table or g-sensitivity.
    notes : sentences.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import carousel
    >>> time = np.arange(0.0, 720.0, 0.1)
    >>> angle = 0.1 * time
    >>> found = carousel(time, angle, gyro=6e-5 * np.cos(angle + 0.5), accel=-0.2 * np.sin(angle), accel_noise=5e-4, gyro_noise=3e-6)
    >>> print(round(found.rate, 6), len(found.readings.positions))
    0.1 12
    """

    readings: Readings
    turns: float
    rate: float
    rate_spread: float
    wobble: dict[str, tuple[float, float, float]]
    notes: tuple[str, ...] = eqx.field(static=True)


@host_float64
def carousel(
    time: Any,
    angle: Any,
    accel: Any = None,
    gyro: Any = None,
    *,
    sectors: int = 12,
    fold: bool = True,
    accel_noise: Any = None,
    gyro_noise: Any = None,
    lever_arm: Any = 0.0,
) -> Carousel:
    r"""Average the raw log of a continuously turning table over sectors of the table angle, as input for `fit`.

    Averaging over a sector of width :math:`\delta` attenuates the harmonic part of a reading by :math:`\sin(\delta/2)/(\delta/2)`; `fit`
    accounts for this. The fitted gyro bias includes the table rate times a misalignment, so leave the gyro bias free.

    Parameters
    ----------
    time : (n,) s, increasing.
    angle : (n,) table angle, rad, wrapped or unwrapped.
    accel, gyro : (n,) samples along the sensitive axis, m/s^2 and rad/s; one of them may be None.
    sectors : number of sectors per turn.
    fold : True averages each sector over all turns, which is optimal for white noise; False keeps the turns separate, to show a drift.
    accel_noise, gyro_noise : see `Readings`; the default is white noise with the scatter of the sector means about the fitted harmonics.
    lever_arm : m.

    Returns
    -------
    Carousel

    Raises
    ------
    DataError
        If array lengths differ, times do not increase, there is less than one turn, or a sector has fewer than two samples.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import carousel, fit
    >>> time = np.arange(0.0, 720.0, 0.1)
    >>> angle, rate = 0.1 * time, 7.292115e-5 * np.cos(0.6)
    >>> found = carousel(time, angle, -9.80665 * 0.02 * np.sin(angle), rate * np.cos(angle + 0.5), accel_noise=5e-4, gyro_noise=3e-6)
    >>> print(round(found.turns, 1), np.rad2deg(fit(found.readings, 0.6).psi).round(1))
    11.5 28.0

    References
    ----------
    The north-finding paper's equations (36) to (39) with a turning table; the attenuation is the mean of a cosine over the sector.
    """
    if is_traced(time, angle, accel, gyro):
        raise DataError("`carousel` sorts a log on the host and cannot be traced; its result goes into `fit`, which can.")
    time, angle = (np.asarray(v, dtype=float) for v in (time, angle))
    samples = {name: np.asarray(v, dtype=float) for name, v in (("accel", accel), ("gyro", gyro)) if v is not None}
    if not samples:
        raise DataError("There are neither accelerometer nor gyro samples; give at least one of them.")
    for name, v in {"angle": angle, **samples}.items():
        if v.shape != time.shape or time.ndim != 1:
            raise DataError(f"The {name} has shape {v.shape} and the time {time.shape}; give one value per sample, (n,).")
        if not np.isfinite(v).all():
            raise DataError(f"{int(np.sum(~np.isfinite(v)))} values of the {name} are not finite; leave those samples out.")
    if len(time) < 2 or not (np.diff(time) > 0).all():
        raise DataError("The times do not increase; sort the log and leave out repeated stamps.")
    angle = np.unwrap(angle)
    turns = abs(angle[-1] - angle[0]) / (2 * np.pi)
    if turns < 1 or sectors < 4:
        raise DataError(f"The log holds {turns:.2g} turns in {sectors} sectors; it takes one whole turn and four sectors at least.")
    width = 2 * np.pi / sectors
    label = np.floor(angle / width).astype(int)
    # leave out the first and last sectors: they are incomplete and have a different mean angle
    kept = (label != label[0]) & (label != label[-1])
    names, first, place = np.unique(label[kept], return_index=True, return_inverse=True)
    count = np.bincount(place)
    if count.min() < 2:
        raise DataError(f"Some sectors hold {count.min()} samples; sample faster, turn slower, or use fewer sectors.")
    mean = lambda v: np.bincount(place, weights=v[kept]) / count  # noqa: E731
    dwell, start = count * float(np.median(np.diff(time))), time[kept][first]
    rate, mean_angle = mean(np.gradient(angle, time)), mean(angle)
    means, noise = {name: mean(v) for name, v in samples.items()}, {"accel": accel_noise, "gyro": gyro_noise}
    wobble, notes = {}, []
    given = [as_noise(one, "noise") for one in (accel_noise, gyro_noise)]
    if fold and not all(one is None or white_alone(one) for one in given):
        notes.append("The noise wanders, and a folded mean mixes the times of all turns; take fold=False for covariances that hold.")
    for name, v in means.items():
        word, unit = ("accelerometer", "m/s^2") if name == "accel" else ("gyro", "rad/s")
        wobble[name], white = _second_harmonic(mean_angle, v, dwell)
        if noise[name] is None:
            noise[name] = max(white, 1e-300)
            notes.append(f"The noise of the {word} is that of the scatter of its sector means.")
        if wobble[name][2] < 1e-3:
            notes.append(
                f"The {word} has a second harmonic of {wobble[name][0]:.3g} {unit} ({wobble[name][0] / wobble[name][1]:.1f} standard "
                "deviations): the table wobbles, or the sensor is sensitive to acceleration."
            )
    spread = float(rate.std())
    if fold:
        over = np.unique(np.mod(names, sectors), return_inverse=True)[1]
        total = np.bincount(over, weights=dwell)
        # wrap the angles first, because angles of different turns differ by multiples of 2 pi
        folded = lambda v: np.bincount(over, weights=dwell * v) / total  # noqa: E731
        mean_angle, means, rate = folded(np.mod(mean_angle, 2 * np.pi)), {name: folded(v) for name, v in means.items()}, folded(rate)
        dwell, start = total, np.cumsum(total) - total
    positions = Positions(mean_angle, "x", dwell, start, rate=rate, width=width)
    noises = {f"{name}_noise": size for name, size in noise.items()}
    readings = Readings(positions, **means, **noises, lever_arm=lever_arm)
    return Carousel(readings, float(turns), float(rate.mean()), spread, wobble, tuple(notes))


def _second_harmonic(angle: np.ndarray, value: np.ndarray, dwell: np.ndarray) -> tuple[tuple[float, float, float], float]:
    """Amplitude of the second harmonic, its standard deviation and p value; and the white noise N."""
    rows = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)], axis=1)
    solution, unit, _ = least_squares(rows, value, np.sqrt(dwell))
    freedom = max(len(value) - rows.shape[1], 1)
    white = float(np.sqrt(np.sum(dwell * (value - rows @ solution) ** 2) / freedom))
    pair, covariance = solution[3:], white**2 * unit[3:, 3:]
    amplitude, sigma = float(np.hypot(*pair)), float(np.sqrt(np.trace(covariance) / 2))
    # in noise-free readings, rounding must not count as wobble
    tiny = amplitude < 1e-9 * float(np.abs(value).max())
    # the tail of F with two degrees of freedom above
    statistic = 0.0 if tiny or sigma == 0 else float(pair @ np.linalg.solve(covariance, pair)) / 2
    return (amplitude, sigma, (1 + 2 * statistic / freedom) ** (-freedom / 2)), white


@filter_jit
def _noise(key: Array, noise: Noise, dwell: Array, start: Array) -> Array:
    """Draw the noise of the means over the dwells."""
    drawn = jax.random.normal(key, dwell.shape, dwell.dtype)
    if white_alone(noise):
        return noise.N / jnp.sqrt(dwell) * drawn
    covariance = mean_covariance(noise, start, dwell)
    # without white noise the covariance may be singular, so add a small diagonal
    return jnp.linalg.cholesky(covariance + 1e-12 * jnp.mean(jnp.diag(covariance)) * jnp.eye(dwell.size, dtype=dwell.dtype)) @ drawn


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
    table_rate, table_acceleration : rad/s and rad/s^2; the default is those of the positions.
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
    for name, value in (("rate", table_rate), ("acceleration", table_acceleration)):
        if value is not None:
            whole = array_module(value).broadcast_to(value, positions.angle.shape)
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
    keys = jax.random.split(seed if isinstance(seed, jax.Array) else jax.random.key(int(seed)))
    # convert to arrays, because a Python number would be a constant of the program and force a new compilation for every value
    as_array = lambda value: jnp.asarray(value, dtype=dtype)  # noqa: E731
    dwell, start = as_array(positions.dwell), as_array(positions.start)
    known = [
        as_noise(sensor, "noise") if any(map(_some, (sensor.white, sensor.walk, sensor.flicker))) else None for sensor in (accel, gyro)
    ]
    noisy = [
        reading if noise is None else reading + _noise(key, jax.tree.map(lambda x: as_array(x) if _some(x) else 0.0, noise), dwell, start)
        for key, noise, reading in zip(keys, known, made, strict=True)
    ]
    return Readings(positions, *noisy, accel_noise=known[0], gyro_noise=known[1], lever_arm=lever_arm)


def _some(size: Any) -> bool:
    """Whether a noise coefficient is not zero, or is traced."""
    return isinstance(size, jax.core.Tracer) or float(size) > 0
