"""`Positions` and `Readings`: the positions of the table and the readings taken there; frames and angles."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._arrays import namespace
from .._errors import DataError
from .._precision import array_module, as_there_is, is_traced
from .._types import AnyArray, Array, Checked, Held, Leaf, NoiseLike, Numbers, Real, Samples
from .._units import EARTH_RATE as EARTH_RATE, ON_EARTH, STANDARD_GRAVITY, on_earth
from ._findings import FINDINGS
from ._noise import as_noise, by_channel, covariance_of

GRAVITY = STANDARD_GRAVITY  # m/s^2
(POLE,) = FINDINGS["pole"].limits  # latitude from which on the horizontal part of the Earth's rate counts as zero
#: what is below it counts as zero, in rad or relative to its scale: rounding of readings and angles, and of a matrix
SMALL, ROUNDING = 1e-6, 1e-9

#: mounting -> index of the sensor in a triad; its sensitive axis and the two cross axes, in body axes
MOUNTINGS: dict[str, tuple[int, list[list[int]]]] = {
    "x": (0, [[1, 0, 0], [0, 1, 0], [0, 0, 1]]), "y": (1, [[0, 1, 0], [1, 0, 0], [0, 0, 1]]),
    "z": (0, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]), "-z": (0, [[0, 0, -1], [0, 1, 0], [1, 0, 0]]),
    "fixed z": (2, [[0, 0, 1], [1, 0, 0], [0, 1, 0]]),
}  # fmt: skip
#: sensor -> closed form -> mounting -> table angles in degrees at which it needs readings
METHODS: dict[str, dict[str, dict[str, tuple[int, ...]]]] = {
    "accel": {
        "four_point_x": {"x": (0, 90, 180, 270)}, "least_squares_x": {}, "four_point_y": {"y": (0, 90, 180, 270)}, "least_squares_y": {},
        "bias_and_scale": {"x": (0, 90, 180), "z": (0,)},
    },
    "gyro": {
        "opposed": {"x": (0, 180)}, "quadrature": {"x": (90, 270)}, "four_point": {"x": (0, 90, 180, 270)}, "single_reading": {},
        "maximum": {}, "bias_and_scale": {"x": (0, 90, 180)}, "scale_first": {"x": (0, 90, 180)}, "triad": {"x": (0, 90, 180), "z": (0,)},
    },
}  # fmt: skip
#: the body axes, the projection on each, and the cross product with each
_BODY = np.array(MOUNTINGS["x"][1], dtype=float)
_ALONG, _ACROSS = _BODY[:, :, None] * _BODY[:, None], np.stack([np.cross(one, _BODY).T for one in _BODY])


def wanted(sensor: str, method: str) -> list[tuple[str, float]]:
    """Mounting and table angle, rad, of the readings that a closed form needs."""
    return [(mounting, float(np.deg2rad(angle))) for mounting, angles in METHODS[sensor][method].items() for angle in angles]


def wrap(angle: Real) -> Any:
    """Wrap an angle to (-pi, pi]."""
    return angle - 2 * np.pi * array_module(angle).ceil((angle - np.pi) / (2 * np.pi))


def distance(first: Real, second: Real) -> Any:
    """Absolute difference between two azimuths, in [0, pi]."""
    return abs(wrap(first - second))


def table_from_nav(phi: Real, theta: Real, psi: Real) -> AnyArray:
    """Rotation matrix C_TN = Rx(phi) Ry(theta) Rz(psi), (3, 3), from north, east, down to table axes."""
    return _turn(0, phi) @ _turn(1, theta) @ _turn(2, psi)


def _turn(axis: int, angle: Real) -> AnyArray:
    """Rotation matrix (3, 3) from axes to those turned by an angle about one of them."""
    xp = array_module(angle)
    return _ALONG[axis] + xp.cos(angle) * (_BODY - _ALONG[axis]) - xp.sin(angle) * _ACROSS[axis]


class Positions(eqx.Module):
    """Positions of the table and the times spent at them.

    Attributes
    ----------
    angle : (n,) table angle, rad.
    mounting : "x" (normal), "z" or "-z" (the same sensor remounted by -90 or +90 degrees about body y), "y" or "fixed z" (other
        sensors, fixed along body y and z); one word, or one per position.
    dwell : averaging time, s, one number or (n,).
    start : (n,) time at which each dwell begins, s; by default each dwell begins when the previous one ends.
    rate, acceleration : rate and acceleration of the table during the dwell, rad/s and rad/s^2, one number or (n,).
    width : sector of table angle that a turning table covers during the dwell, rad; 0 for a table at rest.
    angle_std : uncertainty of the table angles, rad: standard deviation of independent errors, one number or (n,), or covariance (n, n)
        in rad^2; 0 for exact angles. None leaves it open: the intervals of `fit` allow for what the residuals do not exclude, up to 0.2
        degrees, and `crlb` and `plan` take exact angles. An error common to all positions is an error of the azimuth itself.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Positions
    >>> len(Positions(np.deg2rad([0.0, 90.0, 180.0, 0.0]), ("x", "x", "x", "z"), dwell=60.0))
    4
    """

    angle: Held
    mounting: tuple[str, ...] = eqx.field(static=True)
    dwell: Held
    start: Held
    rate: Held
    acceleration: Held
    width: Held
    angle_std: Held | None

    def __init__(
        self,
        angle: Samples,
        mounting: Checked[str | Sequence[str]] = "x",
        dwell: Samples = 1.0,
        start: Samples | None = None,
        *,
        rate: Leaf = 0.0,
        acceleration: Samples = 0.0,
        width: Samples = 0.0,
        angle_std: Samples | None = None,
    ):
        angle = _floats(angle, "table angle")
        if angle.ndim != 1 or not angle.size:
            raise DataError(f"The table angles have shape {angle.shape}; expected (n,), one per position, in rad.", code="shape")
        words = (mounting,) * angle.size if isinstance(mounting, str) else tuple(str(word) for word in mounting)
        unknown = sorted(set(words) - set(MOUNTINGS))
        if unknown:
            raise DataError(f"There is no mounting {unknown[0]!r}; known are {', '.join(map(repr, MOUNTINGS))}.", code="mounting")
        if len(words) != angle.size:
            raise DataError(f"There are {len(words)} mountings for {angle.size} table angles; give one per position.", code="shape")
        self.angle, self.mounting = angle, words
        self.dwell, self.rate, self.acceleration, self.width = (
            _per_position(value, angle, name)
            for value, name in ((dwell, "dwell"), (rate, "table rate"), (acceleration, "table acceleration"), (width, "sector width"))
        )
        if angle_std is not None:
            angle_std = _floats(angle_std, "standard deviation of the angles")
            if angle_std.shape != 2 * angle.shape:
                angle_std = _per_position(angle_std, angle, "standard deviation of the angles")
        self.angle_std = angle_std
        xp = namespace(self.dwell, concrete=True)
        self.start = xp.cumsum(self.dwell) - self.dwell if start is None else _per_position(start, angle, "start")
        if not is_traced(self.dwell) and not np.all(np.asarray(self.dwell) > 0):
            raise DataError(f"A dwell is {float(np.min(np.asarray(self.dwell))):g} s; dwells are positive.", code="dwell")

    def __len__(self) -> int:
        return len(self.mounting)

    @property
    def doubtful(self) -> bool:
        """Whether there are errors of the angles with a given size."""
        return self.angle_std is not None and (is_traced(self.angle_std) or bool(np.any(self.angle_std)))

    @property
    def axes(self) -> np.ndarray:
        """(n, 3, 3) sensitive axis and two cross axes at every position, in body axes."""
        return np.array([MOUNTINGS[word][1] for word in self.mounting], dtype=float)

    @property
    def channel(self) -> np.ndarray:
        """(n,) index of the sensor in the triad that is read at each position."""
        return np.array([float(MOUNTINGS[word][0]) for word in self.mounting])

    @property
    def time(self) -> Any:
        """(n,) middle of every dwell, s, counted from the middle of the test."""
        end = self.start + self.dwell
        return self.start + self.dwell / 2 - (self.start.min() + end.max()) / 2


class Readings(eqx.Module):
    """Mean readings at every position, and their noise.

    Attributes
    ----------
    positions : `Positions`.
    accel : (n,) mean accelerometer reading at every position, m/s^2; NaN if not measured there; None without an accelerometer.
    gyro : (n,) mean gyro reading, rad/s; NaN and None as for `accel`.
    accel_noise, gyro_noise : `jaxcal.noise.Noise`, or three of them for the axes of a triad; None if unknown. You may give a number,
        the white noise N (m/s^2 sqrt(s), rad/sqrt(s)), a `NoiseFit` or a `Sensor`; `noise_of` extracts the noise from a calibration.
        The closed-form methods use N only.
    lever_arm : distance of the sensors from the table's axis along body x, m; it matters only while the table turns.
    parts : readings of the quarters of the same dwells, which show a drift inside them; `from_log` makes them. None without.

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
    accel_noise: NoiseLike | None
    gyro_noise: NoiseLike | None
    lever_arm: Leaf
    parts: "Readings | None"

    def __init__(
        self,
        positions: Checked["Positions | Numbers"],
        accel: Samples | None = None,
        gyro: Samples | None = None,
        *,
        accel_noise: NoiseLike | None = None,
        gyro_noise: NoiseLike | None = None,
        lever_arm: Leaf = 0.0,
        parts: "Readings | None" = None,
    ):
        self.positions = as_positions(positions)
        for name, values in (("accel", accel), ("gyro", gyro)):
            values = None if values is None else _floats(values, f"{name} readings")
            if values is not None and values.shape != (len(self.positions),):
                raise DataError(f"{name} has shape {values.shape}; give one for each of {len(self.positions)} positions.", code="shape")
            setattr(self, name, values)
        self.accel_noise = by_channel(as_noise(accel_noise, "accelerometer noise"), self.positions)
        self.gyro_noise = by_channel(as_noise(gyro_noise, "gyro noise"), self.positions)
        self.lever_arm, self.parts = lever_arm, parts

    def variance(self, sensor: str) -> Any:
        """(n,) variance of each reading of "accel" or "gyro"; None if the noise is unknown."""
        noise = getattr(self, f"{sensor}_noise")
        if noise is None:
            return None
        found = covariance_of(noise, self.positions, np.isfinite(np.asarray(getattr(self, sensor))))
        return found if found.ndim == 1 else found.diagonal()


def _floats(values: Any, name: str) -> AnyArray:
    """Convert values to a floating-point array, of JAX if they are traced or JAX arrays, else of NumPy."""
    if is_traced(values) or isinstance(values, jax.Array):
        return jnp.asarray(as_there_is(values))
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"The {name} given are not numbers: {str(values)[:60]}.", code="not_numbers") from error


def _per_position(value: Any, angle: Any, name: str) -> AnyArray:
    value = _floats(value, name)
    if value.shape not in ((), angle.shape):
        raise DataError(f"The {name} has shape {value.shape}; give one number, or one for each of {angle.size} positions.", code="shape")
    return namespace(value, concrete=True).broadcast_to(value, angle.shape)


def as_positions(given: Positions | Numbers) -> Positions:
    """Return `Positions` unchanged, or make them from table angles."""
    return given if isinstance(given, Positions) else Positions(given)


class Geometry(eqx.Module):
    """Geometry of n positions, computed once. Both true vectors (specific force and angular rate) are linear in these arrays.

    Attributes
    ----------
    time : (n,) middle of the dwell, s, counted from the middle of the test.
    channel : (n,) index of the sensor in a triad.
    axes : (n, 3, 3) sensitive axis and two cross axes in table axes; averaging over a sector shortens their components in the plane.
    force : (n, 3) specific force along these axes due to the table's motion, m/s^2. coriolis : (n, 3, 3) m/s; its product with the
        Earth's rate is the Coriolis term.
    rate : (n, 3) angular rate along these axes due to the table's motion, rad/s.
    gravity : m/s^2.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Readings
    >>> from jaxcal.alignment._model import tabulate
    >>> places = tabulate(Readings(np.deg2rad([0.0, 90.0]), gyro=np.zeros(2), gyro_noise=1e-6)).places
    >>> print(places.axes[1, 0].round(6) + 0.0)
    [0. 1. 0.]
    """

    time: AnyArray
    channel: AnyArray
    axes: AnyArray
    force: AnyArray
    coriolis: AnyArray
    rate: AnyArray
    gravity: Any


#: positions, table angles in rad, or what `geometry` made of them
Places = Positions | Geometry | Numbers


def geometry(positions: Any, gravity: Any = GRAVITY, lever_arm: Any = 0.0) -> Geometry:
    """Geometry of `Positions`, of table angles in rad, or of any object with the arrays of `Positions`; a `Geometry` is unchanged."""
    if isinstance(positions, Geometry):
        return positions
    places = positions if hasattr(positions, "axes") else as_positions(positions)
    xp = array_module(places, gravity, lever_arm)
    angle, rate, width, axes = (xp.asarray(value) for value in (places.angle, places.rate, places.width, places.axes))
    # averaging a first harmonic over a sector attenuates it by this factor
    half = xp.where(width != 0, width, 1) / 2
    part = xp.where(width != 0, xp.sin(half) / half, 1)
    c, s, zero = part * xp.cos(angle), part * xp.sin(angle), xp.zeros_like(angle)
    body = xp.stack([xp.stack([c, s, zero], -1), xp.stack([-s, c, zero], -1), xp.stack([zero, zero, zero + 1], -1)], 1)
    motion = xp.stack([-lever_arm * rate**2, lever_arm * places.acceleration, zero], -1)
    # 2 w x [0, l omega, 0] = 2 l omega [-w_z, 0, w_x]
    coriolis = 2 * (lever_arm * rate)[:, None, None] * xp.stack([-body[:, 2], 0 * body[:, 1], body[:, 0]], 1)
    along = lambda vectors: (axes * vectors[:, None, :]).sum(-1)  # noqa: E731
    turning = xp.stack([zero, zero, zero + rate], -1)
    return Geometry(
        xp.asarray(places.time), xp.asarray(places.channel), axes @ body, along(motion), axes @ coriolis, along(turning), gravity
    )


def taken(readings: Readings, sensor: str, mounting: str, angle: Any) -> Any:
    """(n,) True for the readings of a sensor that were taken at the given mounting and table angle."""
    xp, values = array_module(readings, angle), getattr(readings, sensor)
    apart = xp.asarray(readings.positions.angle, dtype=values.dtype) - angle
    same = abs(apart - 2 * np.pi * xp.round(apart / (2 * np.pi))) < SMALL
    return same & np.array([word == mounting for word in readings.positions.mounting]) & xp.isfinite(values)


def means_at(readings: Readings, sensor: str, places: list[tuple[str, Any]], unit: Any) -> tuple[Array, Array, Array]:
    """Mean over all dwells at each position in units of `unit`, its variance (zero for unknown noise), and whether it was measured."""
    values = jnp.asarray(getattr(readings, sensor))
    here = jnp.stack([taken(readings, sensor, *place) for place in places])
    dwell = jnp.where(here, jnp.asarray(readings.positions.dwell, dtype=values.dtype)[None, :], 0)
    total = jnp.sum(dwell, axis=1)
    safe = jnp.where(total > 0, total, 1)
    return jnp.sum(dwell * jnp.where(here, values[None, :], 0), axis=1) / safe / unit, _noise(readings, sensor, unit) ** 2 / safe, total > 0


def _noise(readings: Readings, sensor: str, unit: Any) -> Array:
    noise = getattr(readings, f"{sensor}_noise")
    white = 0.0 if noise is None else (noise[0] if isinstance(noise, tuple) else noise).N
    return jnp.asarray(white, dtype=jnp.asarray(getattr(readings, sensor)).dtype) / unit


def need(readings: Readings, sensor: str, method: str, more: tuple[tuple[str, float], ...] = ()) -> None:
    """Refuse readings that lack a position needed by a method, or one of `more`; the message names the position (host only)."""
    word = "accelerometer" if sensor == "accel" else "gyro"
    if getattr(readings, sensor) is None:
        raise DataError(f"There are no {word} readings; method {method!r} needs them.", code="no_sensor")
    if is_traced(readings):
        return
    missing = [(m, np.rad2deg(a)) for m, a in (*wanted(sensor, method), *more) if not np.any(taken(readings, sensor, m, a))]
    if missing:
        where = ", ".join(f"{mounting} at {angle:g} degrees" for mounting, angle in missing)
        raise DataError(f"Method {method!r} needs a {word} reading with mounting {where}; or use `fit`.", code="no_position")


def least_squares(rows: AnyArray, values: AnyArray, weight: AnyArray, tolerance: float = 1e-7) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Least-squares solution x (p,) of values = rows x, its covariance for variances 1 / weight^2, and which entries are determined."""
    xp = array_module(rows, values, weight)
    # a plain SVD compiles three times as fast as `fitting.information`
    left, s, right = xp.linalg.svd(weight[:, None] * rows, full_matrices=False)
    kept = s > tolerance * xp.max(s)
    inverse = xp.where(kept, 1 / xp.where(kept, s, 1), 0)
    hidden = 1 - xp.sum(xp.where(kept[:, None], right, 0) ** 2, axis=0)
    return right.T @ (inverse * (left.T @ (weight * values))), (right.T * inverse[None, :] ** 2) @ right, hidden < 1e-6


def harmonics(readings: Readings, sensor: str, mounting: str, unit: Any) -> tuple[Array, Array, Array]:
    """Fit A cos tau + B sin tau + C to readings in units of `unit`; return (A, B, C), their covariance, and whether they are determined."""
    values = jnp.asarray(getattr(readings, sensor))
    here = np.array([word == mounting for word in readings.positions.mounting]) & jnp.isfinite(values)
    angle, dwell = (jnp.asarray(part, dtype=values.dtype) for part in (readings.positions.angle, readings.positions.dwell))
    rows = jnp.stack([jnp.cos(angle), jnp.sin(angle), jnp.ones_like(angle)], axis=1)
    value, covariance, known = least_squares(rows, jnp.where(here, values, 0), jnp.sqrt(jnp.where(here, dwell, 0)))
    return value / unit, _noise(readings, sensor, unit) ** 2 * covariance, jnp.all(known)


def check_gravity(gravity: Real) -> Any:
    """Refuse gravity that is not in m/s^2 or does not occur on the Earth's surface."""
    if not is_traced(gravity) and not on_earth("gravity", float(gravity)):
        low, high = ON_EARTH["gravity"]
        raise DataError(f"The gravity is {float(gravity):g}; on the Earth it is {low} to {high} m/s^2.", code="gravity")
    return gravity


def check_latitude(latitude: Real) -> Any:
    """Refuse a latitude beyond a pole, which is probably in degrees."""
    if not is_traced(latitude) and not abs(float(latitude)) <= np.pi / 2 + 1e-9:
        raise DataError(f"The latitude is {float(latitude):g} rad; it lies within pi/2 (degrees: numpy.deg2rad).", code="latitude")
    return latitude


def checked_attitude(attitude: Numbers) -> Any:
    """Roll, pitch and azimuth (3,), which are finite."""
    found: Any = attitude if is_traced(attitude) else np.asarray(attitude, dtype=float)
    if found.shape != (3,) or not (is_traced(found) or np.isfinite(found).all()):
        raise DataError(f"The attitude is {attitude}; give finite (roll, pitch, azimuth) in rad.", code="attitude")
    return found
