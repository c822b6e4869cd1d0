"""`Positions`, `Readings` and `Sensor`: where the table stood, what was read there, and what the sensor does."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import is_traced
from .._types import Array
from ._frames import AXES, GRAVITY

_SAME = 1e-6  # rad: table angles that count as one


class Sensor(eqx.Module):
    """Errors of an accelerometer (SI: m/s^2) or a gyro (rad/s).

    The reading is m = (1 + s) u.v + MA_1 v1.v + MA_2 v2.v + b + b' (t - t0) + n, with u the sensitive axis, v1 and v2 the cross axes.

    Attributes
    ----------
    scale_error : s.
    misalignment : (2,) MA_1, MA_2, rad.
    bias : b.
    bias_rate : b', per second, about the middle of the test.
    white : N, velocity or angle random walk (m/s^2 sqrt(s), rad/sqrt(s)); the mean over a dwell T has the variance N^2/T.
    walk : K, random walk of the bias (m/s^2/sqrt(s), rad/s/sqrt(s)).

    Examples
    --------
    >>> from jaxcal.alignment import Sensor
    >>> gyro = Sensor(bias=5e-8, white=3e-6)
    >>> gyro.bias, gyro.scale_error
    (5e-08, 0.0)
    """

    scale_error: Any = 0.0
    misalignment: Any = (0.0, 0.0)
    bias: Any = 0.0
    bias_rate: Any = 0.0
    white: Any = 0.0
    walk: Any = 0.0


#: without any error or noise
IDEAL = Sensor()


class Positions(eqx.Module):
    """Where the table stood, and how long.

    Attributes
    ----------
    angle : (n,) table angle, rad.
    mounting : "x" (normal), "z" or "-z" (the same sensor remounted by -90 or +90 degrees about body y), "y" (another sensor fixed
        on body y), one word or one per position.
    dwell : time averaged over, s, one number or (n,).
    start : (n,) time at which each dwell begins, s; by default one follows the other.
    rate, acceleration : of the table during the dwell, rad/s and rad/s^2, one number or (n,).
    width : sector of table angle that a turning table passes during the dwell, rad; 0 for a table that stands still.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Positions
    >>> len(Positions(np.deg2rad([0.0, 90.0, 180.0, 0.0]), ("x", "x", "x", "z"), dwell=60.0))
    4
    """

    angle: Any
    mounting: tuple[str, ...] = eqx.field(static=True)
    dwell: Any
    start: Any
    rate: Any
    acceleration: Any
    width: Any

    def __init__(
        self, angle: Any, mounting: Any = "x", dwell: Any = 1.0, start: Any = None, *, rate: Any = 0.0, acceleration: Any = 0.0,
        width: Any = 0.0,
    ):  # fmt: skip
        angle = _floats(angle, "table angle")
        if angle.ndim != 1 or not angle.size:
            raise DataError(f"The table angles have shape {angle.shape}; expected (n,), one per position, in rad.")
        words = (mounting,) * angle.size if isinstance(mounting, str) else tuple(str(word) for word in mounting)
        unknown = sorted(set(words) - set(AXES))
        if unknown:
            raise DataError(f"There is no mounting {unknown[0]!r}; known are {', '.join(map(repr, AXES))}.")
        if len(words) != angle.size:
            raise DataError(f"There are {len(words)} mountings for {angle.size} table angles; give one per position.")
        self.angle, self.mounting = angle, words
        self.dwell, self.rate, self.acceleration, self.width = (
            _per_position(value, angle, name)
            for value, name in ((dwell, "dwell"), (rate, "table rate"), (acceleration, "table acceleration"), (width, "sector width"))
        )
        xp = jnp if isinstance(self.dwell, jax.Array) else np
        self.start = xp.cumsum(self.dwell) - self.dwell if start is None else _per_position(start, angle, "start")
        if not is_traced(self.dwell) and not np.all(np.asarray(self.dwell) > 0):
            raise DataError(f"A dwell of {float(np.min(np.asarray(self.dwell))):g} s was given; dwells are positive, in seconds.")

    def __len__(self) -> int:
        return len(self.mounting)

    @property
    def axes(self) -> np.ndarray:
        """(n, 3, 3) sensitive axis and cross axes of every position, in body axes."""
        return np.array([AXES[word] for word in self.mounting])

    @property
    def time(self) -> Any:
        """(n,) middle of every dwell, s, counted from the middle of the test."""
        end = self.start + self.dwell
        return self.start + self.dwell / 2 - (self.start.min() + end.max()) / 2


class Readings(eqx.Module):
    """Mean readings at every position, and the noise they carry.

    Attributes
    ----------
    positions : `Positions`.
    accel : (n,) mean of the accelerometer at every position, m/s^2; NaN where there is none; None without an accelerometer.
    gyro : (n,) mean of the gyro, rad/s; likewise.
    accel_noise, gyro_noise : white noise N (m/s^2 sqrt(s), rad/sqrt(s)); or a `jaxcal.noise.Noise`, of which N and K count, or a
        `Sensor`; None where it is not known.
    lever_arm : distance of the sensors from the table's axis along body x, m; it matters while the table turns.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Positions, Readings
    >>> readings = Readings(Positions(np.deg2rad([0.0, 180.0])), gyro=np.array([2e-5, -2e-5]), gyro_noise=3e-6)
    >>> readings.accel is None
    True
    """

    positions: Positions
    accel: Any
    gyro: Any
    accel_noise: Any
    gyro_noise: Any
    lever_arm: Any

    def __init__(
        self, positions: Any, accel: Any = None, gyro: Any = None, *, accel_noise: Any = None, gyro_noise: Any = None, lever_arm: Any = 0.0
    ):
        self.positions = as_positions(positions)
        for name, values in (("accel", accel), ("gyro", gyro)):
            values = None if values is None else _floats(values, f"{name} readings")
            if values is not None and values.shape != (len(self.positions),):
                raise DataError(f"There are {name} readings of shape {values.shape} for {len(self.positions)} positions; give one each.")
            setattr(self, name, values)
        self.accel_noise, self.gyro_noise, self.lever_arm = accel_noise, gyro_noise, lever_arm

    def white(self, sensor: str) -> Any:
        """White noise N of "accel" or "gyro"; None where it is not known."""
        noise = getattr(self, f"{sensor}_noise")
        return noise.white if isinstance(noise, Sensor) else getattr(noise, "N", noise)

    def walk(self, sensor: str) -> Any:
        """Random walk K of the bias; 0 where it is not known."""
        noise = getattr(self, f"{sensor}_noise")
        return noise.walk if isinstance(noise, Sensor) else getattr(noise, "K", 0.0)


def _floats(values: Any, name: str) -> Any:
    """A floating array, traced or of NumPy."""
    if is_traced(values) or isinstance(values, jax.Array):
        return jnp.asarray(values)
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"The {name} given are not numbers: {str(values)[:60]}.") from error


def _per_position(value: Any, angle: Any, name: str) -> Any:
    value = _floats(value, name)
    if value.shape not in ((), angle.shape):
        raise DataError(f"The {name} has shape {value.shape} for {angle.size} positions; give one number, or one per position.")
    return (jnp if isinstance(value, jax.Array) else np).broadcast_to(value, angle.shape)


def as_positions(given: Any) -> Positions:
    """Positions from themselves, or from table angles alone."""
    return given if isinstance(given, Positions) else Positions(given)


class Means(eqx.Module):
    """Mean reading at one position over all its dwells, its variance (zero where the noise is not known), whether there is any."""

    value: Array
    variance: Array
    present: Array


def mean_at(readings: Readings, sensor: str, mounting: str, angle: Any, unit: Any) -> Means:
    """Readings of one position averaged by dwell, in units of `unit`."""
    positions, values = readings.positions, jnp.asarray(getattr(readings, sensor))
    known = np.array([word == mounting for word in positions.mounting])
    apart = jnp.asarray(positions.angle, dtype=values.dtype) - angle
    here = known & (jnp.abs(apart - 2 * np.pi * jnp.round(apart / (2 * np.pi))) < _SAME) & jnp.isfinite(values)
    dwell = jnp.where(here, jnp.asarray(positions.dwell, dtype=values.dtype), 0)
    total = jnp.sum(dwell)
    safe = jnp.where(total > 0, total, 1)
    white = readings.white(sensor)
    noise = jnp.asarray(0.0 if white is None else white, dtype=values.dtype) / unit
    return Means(jnp.sum(dwell * jnp.where(here, values, 0)) / safe / unit, noise**2 / safe, total > 0)


def measured(readings: Readings, sensor: str, mounting: str, angle: float) -> bool:
    """Whether there is a reading at a position (host only)."""
    apart = np.asarray(readings.positions.angle) - angle
    here = np.abs(apart - 2 * np.pi * np.round(apart / (2 * np.pi))) < _SAME
    return bool(np.any(here & np.isfinite(getattr(readings, sensor)) & (np.array(readings.positions.mounting) == mounting)))


def need(readings: Readings, sensor: str, wanted: list[tuple[str, float]], method: str) -> None:
    """Refuse readings that lack a position of a method, and name it (host only)."""
    values = getattr(readings, sensor)
    word = "accelerometer" if sensor == "accel" else "gyro"
    if values is None:
        raise DataError(f"There are no {word} readings; method {method!r} needs them.")
    if is_traced(readings):
        return
    missing = [f"{m} at {np.rad2deg(a):g} degrees" for m, a in wanted if not measured(readings, sensor, m, a)]
    if missing:
        raise DataError(
            f"Method {method!r} needs a {word} reading with mounting {', '.join(missing)}, and there is none; measure there, or use `fit`, "
            "which takes any positions."
        )


class Harmonics(eqx.Module):
    """Cosine amplitude, sine amplitude and offset of readings against the table angle, with covariance, and whether they are determined."""

    value: Array
    covariance: Array
    determined: Array


def harmonics(readings: Readings, sensor: str, mounting: str, unit: Any, offset: bool = True) -> Harmonics:
    """Weighted least squares of A cos tau + B sin tau + C, readings in units of `unit`."""
    positions, values = readings.positions, jnp.asarray(getattr(readings, sensor))
    dtype = values.dtype
    here = np.array([word == mounting for word in positions.mounting]) & jnp.isfinite(values)
    angle = jnp.asarray(positions.angle, dtype=dtype)
    rows = jnp.stack([jnp.cos(angle), jnp.sin(angle), jnp.full(angle.shape, float(offset), dtype=dtype)], axis=1)
    root = jnp.sqrt(jnp.where(here, jnp.asarray(positions.dwell, dtype=dtype), 0))
    u, s, v = jnp.linalg.svd(root[:, None] * rows, full_matrices=False)
    needed = 3 if offset else 2
    small = s < 1e-7 * jnp.max(s)
    inverse = jnp.where(small, 0, 1 / jnp.where(small, 1, s))
    value = v.T @ (inverse * (u.T @ (root * jnp.where(here, values, 0)))) / unit
    white = readings.white(sensor)
    noise = jnp.asarray(0.0 if white is None else white, dtype=dtype) / unit
    return Harmonics(value, noise**2 * (v.T * inverse[None, :] ** 2) @ v, jnp.sum(~small) >= needed)


def check_gravity(gravity: Any) -> Any:
    """Gravity, positive and in m/s^2."""
    if not is_traced(gravity) and not 9.5 < float(gravity) < 10.1:
        raise DataError(f"The gravity is {float(gravity):g}; give local gravity in m/s^2, {GRAVITY} where it is not known.")
    return gravity


def check_latitude(latitude: Any) -> Any:
    """Latitude, in rad."""
    if not is_traced(latitude) and not abs(float(latitude)) <= np.pi / 2 + 1e-9:
        raise DataError(f"The latitude is {float(latitude):g} rad; it lies between -pi/2 and pi/2 (degrees: numpy.deg2rad).")
    return latitude
