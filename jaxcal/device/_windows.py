"""A recording in windows: what the sensors did between two instants at which the attitude and the place are unknowns."""

import dataclasses
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._precision import array_module
from .._types import AnyArray, Array
from ..fitting import names_of
from ..imu import Triad
from ..imu._model import inverse
from ..magnetometer import MagModel
from ._model import DeviceModel

#: offsets of the samples that an interpolation takes, from the one before
_TAPS = np.arange(-3, 5)
_EDGE = 8  # samples at both ends, which the interpolation needs
WINDOW = 0.2  # s


class Windows(eqx.Module):
    """K windows of m steps each, of h seconds. Readings are raw.

    The gyroscope's are taken where its clock shows the instants of the accelerometer, and all derivatives by delays are held with them.
    """

    force: AnyArray  # (K, m + 1, 3) accelerometer
    rate: AnyArray  # (K, m + 1, 3) gyroscope
    slope: AnyArray  # (K, m + 1, 3) its derivative
    turn: AnyArray  # (K, m, 3) its integral over each step
    field: AnyArray  # (K, m, 3) magnetometer, one reading for each step, at a fixed part of it
    field_turn: AnyArray  # (K, m, 3) gyroscope from the beginning of the step to the reading, integrated
    field_rate: AnyArray  # (K, m, 3) gyroscope at the reading
    field_time: AnyArray  # (K, m) s from the beginning of the step to the reading
    step: AnyArray  # (K,) h


def _lagrange(x: float) -> np.ndarray:
    """(8, 8) coefficients of the polynomials that are one at one tap and zero at the others, in powers of the distance from `x`."""
    return np.linalg.inv(np.vander(_TAPS - x, increasing=True)).T


def _filtered(y: np.ndarray, weights: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Sums of the samples about each index, with weights for the taps."""
    return sum(weight * y[index + tap] for weight, tap in zip(weights, _TAPS, strict=True))  # type: ignore[return-value]


def value_at(y: Any, x: float, index: np.ndarray) -> Any:
    """Readings at index + x, 0 <= x < 1."""
    return _filtered(y, _lagrange(x)[:, 0], index)


def slope_at(y: Any, x: float, index: np.ndarray) -> Any:
    """Derivative there, per sample."""
    return _filtered(y, _lagrange(x)[:, 1], index)


def integral(y: Any, low: float, high: float, index: np.ndarray) -> Any:
    """Integral from index + low to index + high, in samples."""
    power = np.arange(1, len(_TAPS) + 1)
    weights = _lagrange(0.0) @ ((high**power - low**power) / power)
    return _filtered(y, weights, index)


@dataclasses.dataclass(frozen=True)
class Grid:
    """Where the windows lie: first sample of each, samples to a window, and the step in s."""

    first: np.ndarray
    steps: int
    step: float

    @staticmethod
    def of(samples: int, rate: float, reach: float) -> "Grid":
        """All windows that lie far enough from the ends of a recording for delays up to `reach` seconds."""
        steps = max(round(WINDOW * rate), 2)
        edge = _EDGE + math.ceil(reach * rate)
        count = (samples - 2 * edge) // steps
        return Grid(edge + steps * np.arange(max(count, 0)), steps, 1 / rate)

    @property
    def inner(self) -> np.ndarray:
        """(K, m + 1) samples of each window."""
        return self.first[:, None] + np.arange(self.steps + 1)


def windows(grid: Grid, accel: Any, gyro: Any, mag: Any, gyro_delay: float, mag_delay: float, back: int | None = None) -> Windows:
    """Windows of raw readings (n, 3) on one grid, for these delays in s; `back` as `steps_back` gives it, or near to that."""
    whole, h = grid.inner, grid.step
    late = gyro_delay / h
    shift = math.floor(late)
    x, index = late - shift, whole + shift
    turn = integral(gyro, x, 1.0, index[:, :-1]) + integral(gyro, 0.0, x, index[:, 1:])
    # the reading j is the field at j - d: within the step that begins at i
    early = -mag_delay / h
    back = steps_back(grid, mag_delay) if back is None else back
    part = early - back
    readings = whole[:, :-1] - back
    first, start = index[:, :-1], x
    if x + part < 1:
        to_reading = integral(gyro, start, x + part, first)
        rate = value_at(gyro, x + part, first)
    else:
        to_reading = integral(gyro, start, 1.0, first) + integral(gyro, 0.0, x + part - 1, first + 1)
        rate = value_at(gyro, x + part - 1, first + 1)
    xp = array_module(accel, gyro, mag)
    shape = whole[:, :-1].shape
    return Windows(
        accel[whole], value_at(gyro, x, index), slope_at(gyro, x, index) / h, h * turn, mag[readings], h * to_reading, rate,
        xp.full(shape, part * h), xp.full(shape[:1], h),
    )  # fmt: skip


def steps_back(grid: Grid, mag_delay: float) -> int:
    """Steps from a reading of the magnetometer to the step in which the field was as it reads."""
    return math.floor(-mag_delay / grid.step)


# ----------------------------------------------------------------------------------------------------------------------------------------


class Pieces(eqx.Module):
    """What a window says before its noise is asked for."""

    turned: AnyArray  # (3,) rotation vector left between prediction and the next attitude
    speed: AnyArray  # (3,) change of velocity left, in the frame at the beginning
    place: AnyArray  # (3,) change of place left
    field: AnyArray  # (m, 3) field left, in the unit of the readings
    rotation: AnyArray  # (3, 3) over the window, by the gyroscope
    impulse: AnyArray  # (3,) integral of the specific force


def _times(a: Array, b: Array) -> Array:
    """Product of small matrices as sums, which XLA fuses."""
    return jnp.sum(a[..., :, :, None] * b[..., None, :, :], axis=-2)


def _apply(a: Array, v: Array) -> Array:
    return jnp.sum(a * v[..., None, :], axis=-1)


def _skew(v: Array) -> Array:
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    zero = jnp.zeros_like(x)
    return jnp.stack([jnp.stack([zero, -z, y], -1), jnp.stack([z, zero, -x], -1), jnp.stack([-y, x, zero], -1)], -2)


def exponential(v: Array) -> Array:
    """Rotation matrices of rotation vectors below one rad, by their series."""
    square = jnp.sum(v * v, axis=-1)[..., None, None]
    cross = _skew(v)
    first = 1 - square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72)))
    second = 0.5 * (1 - square / 12 * (1 - square / 30 * (1 - square / 56 * (1 - square / 90))))
    return jnp.eye(3) + first * cross + second * _times(cross, cross)


def _logarithm(r: Array) -> Array:
    """Rotation vector of a matrix; for the small rotations that are residuals, with its right derivative at the identity."""
    twice = jnp.stack([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    cosine = (jnp.trace(r) - 1) / 2
    # angle / sin(angle) as a series of 1 - cos(angle)
    x = jnp.clip(1 - cosine, 0, 1.5)
    return twice / 2 * (1 + x / 3 * (1 + 2 * x / 5 * (1 + 3 * x / 7 * (1 + 4 * x / 9 * (1 + 5 * x / 11)))))


def pieces(model: DeviceModel, delays: Array, here: Array, there: Array, before: tuple, after: tuple, w: Windows, gravity: Array) -> Pieces:
    """What one window leaves.

    Parameters
    ----------
    model : the sensors.
    delays : (2,) changes of both delays since the windows were made, s.
    here, there : (9,) changes of rotation (about the axes of the device), velocity and place at both ends.
    before, after : (rotation (3, 3), velocity (3,), place (3,)) at both ends, from which the changes count.
    w : a single window.
    gravity : m/s^2.
    """
    h = w.step
    gyro = inverse(model.gyro.matrix)
    rate = _apply(gyro, w.rate + delays[0] * w.slope - model.gyro.bias)
    force = _apply(inverse(model.accel.matrix), w.force - model.accel.bias)
    # the sensing elements y and z are elsewhere and feel the turning
    bend = _apply(gyro, w.slope)
    for axis in (1, 2):
        arm = model.lever[axis - 1]
        felt = jnp.cross(bend, arm) + jnp.cross(rate, jnp.cross(rate, arm))
        force = force.at[:, axis].add(-felt[:, axis])
    pull = _apply(model.gyro.g_sensitivity, force)
    rate = rate - _apply(gyro, pull)
    raw = w.turn + delays[0] * (w.rate[1:] - w.rate[:-1]) - h * (model.gyro.bias + (pull[1:] + pull[:-1]) / 2)
    small = exponential(_apply(gyro, raw) + h**2 / 12 * jnp.cross(rate[:-1], rate[1:]))

    def advance(state, step):
        turned, speed, place = state
        by, first, second = step
        after = _times(turned, by)
        both = _apply(turned, first) + _apply(after, second)
        return (after, speed + h / 2 * both, place + h * speed + h**2 / 4 * both), turned

    start = (jnp.eye(3), jnp.zeros(3), jnp.zeros(3))
    (turned, speed, place), along = jax.lax.scan(advance, start, (small, force[:-1], force[1:]))
    first = _times(before[0], exponential(here[:3]))
    last = _times(after[0], exponential(there[:3]))
    time, down = h * w.turn.shape[0], gravity * jnp.array([0.0, 0.0, 1.0])
    back = first.T
    v0, v1 = before[1] + here[3:6], after[1] + there[3:6]
    p0, p1 = before[2] + here[6:], after[2] + there[6:]
    # to the readings of the magnetometer
    raw = w.field_turn + delays[0] * (w.field_rate - w.rate[:-1]) - delays[1] * w.field_rate
    raw = raw - (w.field_time - delays[1])[:, None] * (model.gyro.bias + pull[:-1])
    at = _times(_times(first, along), exponential(_apply(gyro, raw)))
    world = model.field * jnp.stack([jnp.cos(model.dip), jnp.zeros(()), -jnp.sin(model.dip)])
    seen = jnp.sum(at * world[:, None], axis=-2)
    field = _apply(model.magnetometer.soft_iron, seen) + model.magnetometer.hard_iron - w.field
    return Pieces(
        _logarithm(_times(turned.T, _times(back, last))), _apply(back, v1 - v0 + time * down) - speed,
        _apply(back, p1 - p0 - time * v0 + time**2 / 2 * down) - place, field, turned, speed,
    )  # fmt: skip


# ----------------------------------------------------------------------------------------------------------------------------------------


def vector_of(model: DeviceModel) -> np.ndarray:
    """Parameters in the order of `names_of`."""
    return np.concatenate([np.ravel(np.asarray(leaf, dtype=float)) for leaf in jax.tree.leaves(model)])


def model_of(vector: Any) -> DeviceModel:
    """The model with these parameters."""
    part = lambda first, *shape: vector[first : first + math.prod(shape)].reshape(shape)  # noqa: E731
    return DeviceModel(
        Triad(part(0, 3, 3), part(9, 3), part(12, 3, 3)), Triad(part(21, 3, 3), part(30, 3), part(33, 3, 3)),
        MagModel(part(42, 3, 3), part(51, 3)), vector[54], vector[55], vector[56], vector[57], part(58, 2, 3),
    )  # fmt: skip


def template() -> DeviceModel:
    """A model without errors."""
    plain = Triad(np.eye(3), np.zeros(3))
    return DeviceModel(plain, plain, MagModel(np.eye(3), np.zeros(3)), *(np.asarray(x) for x in (1.0, 0.0, 0.0, 0.0)))


NAMES = names_of(template())
GYRO_DELAY, MAG_DELAY = NAMES.index("gyro_delay"), NAMES.index("mag_delay")
