"""A recording in windows: the readings between two instants at which attitude and position are unknowns."""

import dataclasses
import math
from typing import Any

import equinox as eqx
import numpy as np

from .._arrays import runs
from .._types import AnyArray
from ..evidence._rests import Variances
from ._model import NAMES

#: offsets of the samples that an interpolation uses, from the sample before the point
TAPS = np.arange(-3, 5)
#: s: length of a window, and largest delay
WINDOW, REACH = 0.2, 0.05
#: m/s^2 and rad/s: at rest, readings scatter by less, and the mean rate is within the second number of the bias; how much more than inside
#: the rest a window at its edge may scatter; number of windows by which a rest may grow at each edge
_STILL_FORCE, _STILL_RATE, _CALM, _EDGE = 0.35, 0.06, 1.1, 4
GYRO_DELAY, MAG_DELAY, ACCEL_POLE, GYRO_POLE = (NAMES.index(name) for name in ("gyro_delay", "mag_delay", "accel_pole", "gyro_pole"))


class Windows(eqx.Module):
    """K windows of m steps of h seconds each. Readings are raw.

    Rates are interpolated to the instants of the accelerometer's samples, for the delay of the gyroscope. The fields also contain the
    derivatives by the delays.
    """

    force: AnyArray  # (K, m + 1, 3) accelerometer
    rate: AnyArray  # (K, m + 1, 3) gyroscope
    slope: AnyArray  # (K, m + 1, 3) its derivative
    curve: AnyArray  # (K, m + 1, 3) its second derivative
    turn: AnyArray  # (K, m, 3) its integral over each step
    field: AnyArray  # (K, m, 3) magnetometer, one reading for each step
    field_turn: AnyArray  # (K, m, 3) gyroscope from the beginning of the step to the reading, integrated
    field_rate: AnyArray  # (K, m, 3) gyroscope at the reading
    field_time: AnyArray  # (K, m) s from the beginning of the step to the reading
    step: AnyArray  # (K,) h


def lagrange(x: float) -> np.ndarray:
    """(8, 8) coefficients of the Lagrange polynomials (one at a tap, zero at the others), in powers of the distance from `x`."""
    return np.linalg.inv(np.vander(TAPS - x, increasing=True)).T


def _filtered(y: np.ndarray, weights: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Weighted sums of the samples at the taps about each index."""
    first, count = int(index.min()), int(index.max()) + 1 - int(index.min())
    return sum(weight * y[first + tap : first + tap + count] for weight, tap in zip(weights, TAPS, strict=True))[index - first]  # type: ignore[index]


def unfiltered(y: np.ndarray, pole: float, step: float) -> np.ndarray:
    """Readings (n, 3) before a first-order low-pass, still with its delay: y + T y' at a time earlier by T, where T^2 / 2 is the pole, s^2.

    A negative pole, which noise can cause, is no low-pass, and continues this to first order.
    """
    if pole == 0:
        return y
    late = math.sqrt(2 * max(pole, 0.0)) / step
    shift = math.floor(-late)
    powers = lagrange(-late - shift)
    weights = powers[:, 0] + late * powers[:, 1] - 2 * min(pole, 0.0) / step**2 * powers[:, 2]
    # at both ends, which only interpolations use, the nearest sample that has all taps
    return _filtered(y, weights, np.clip(np.arange(len(y)) + shift, -TAPS[0], len(y) - 1 - TAPS[-1]))


def derivative_at(y: np.ndarray, x: float, index: np.ndarray, order: int = 0) -> np.ndarray:
    """Readings at index + x, 0 <= x < 1, or a derivative of them, per sample."""
    return _filtered(y, math.factorial(order) * lagrange(x)[:, order], index)


def integral(y: Any, low: float, high: float, index: np.ndarray) -> Any:
    """Integral from index + low to index + high, in samples."""
    power = np.arange(1, len(TAPS) + 1)
    return _filtered(y, lagrange(0.0) @ ((high**power - low**power) / power), index)


@dataclasses.dataclass(frozen=True)
class Grid:
    """Position of the windows: first sample of each, steps per window, and length of a step in s."""

    first: np.ndarray
    steps: int
    step: float

    @staticmethod
    def of(samples: int, rate: float, reach: float) -> "Grid":
        """All windows far enough from the ends of a recording for delays up to `reach` seconds."""
        steps = max(round(WINDOW * rate), 2)
        edge = len(TAPS) + math.ceil(reach * rate)  # only the interpolation uses these samples
        count = (samples - 2 * edge) // steps
        return Grid(edge + steps * np.arange(max(count, 0)), steps, 1 / rate)

    @property
    def inner(self) -> np.ndarray:
        """(K, m + 1) indices of the samples of each window."""
        return self.first[:, None] + np.arange(self.steps + 1)


def windows(
    grid: Grid, accel: Any, gyro: Any, mag: Any, gyro_delay: float, mag_delay: float, back: int | None = None, later: Any = None
) -> Windows:  # fmt: skip
    """Windows of raw readings (n, 3) on one grid, for these delays in s. `back` is the result of `steps_back`, or near to it.

    `later` (n,) says by how much later than its sample a reading of the magnetometer was taken, s: less than a step.
    """
    whole, h = grid.inner, grid.step
    late = gyro_delay / h
    shift = math.floor(late)
    x, index = late - shift, whole + shift
    turn = integral(gyro, x, 1.0, index[:, :-1]) + integral(gyro, 0.0, x, index[:, 1:])
    # reading j of the magnetometer shows the field at j - d, which lies within the step that begins at i = j + back
    early = -mag_delay / h
    back = steps_back(grid, mag_delay) if back is None else back
    part = early - back
    readings = whole[:, :-1] - back
    first, start = index[:, :-1], x
    if x + part < 1:
        to_reading, last = integral(gyro, start, x + part, first), (x + part, first)
    else:
        to_reading, last = integral(gyro, start, 1.0, first) + integral(gyro, 0.0, x + part - 1, first + 1), (x + part - 1, first + 1)
    rate, to_reading, field_time = derivative_at(gyro, *last), h * to_reading, np.full(whole[:, :-1].shape, part * h)
    if later is not None:
        more = later[readings][..., None]
        slope = derivative_at(gyro, *last, 1) / h
        rate, to_reading, field_time = rate + more * slope, to_reading + more * rate + more**2 / 2 * slope, field_time + more[..., 0]
    one, two, three = (derivative_at(gyro, x, index, order) / h**order for order in range(3))
    return Windows(accel[whole], one, two, three, h * turn, mag[readings], to_reading, rate, field_time, np.full(len(whole), h))


def steps_back(grid: Grid, mag_delay: float) -> int:
    """Number of steps between a reading of the magnetometer and the step in which the field had this value."""
    return math.floor(-mag_delay / grid.step)


@dataclasses.dataclass
class Record:
    """Readings (n, 3) with gaps filled, and which of them are missing. The magnetometer is in units of the field."""

    accel: np.ndarray
    gyro: np.ndarray
    mag: np.ndarray
    mag_later: np.ndarray | None  # (n,) s, by how much later than its sample a reading of the magnetometer was taken
    there: np.ndarray  # (n,) whether a reading of the magnetometer exists
    broken: np.ndarray  # (K,) windows in which inertial samples are missing
    grid: Grid
    gravity: float
    earth: np.ndarray  # (3, 3) rotation of the Earth in a window

    @property
    def time(self) -> float:
        """Length of a window, s."""
        return self.grid.steps * self.grid.step

    def back(self, vector: np.ndarray, now: int | None = None) -> int:
        """`steps_back` for these parameters. It stays at `now` while the delay is within a step, so that the cost does not jump."""
        delay = float(vector[MAG_DELAY])
        part = -delay / self.grid.step
        return now if now is not None and now - 1 < part < now + 2 else steps_back(self.grid, delay)

    def kept(self, back: int) -> np.ndarray:
        """(K, m) whether a reading of the magnetometer exists, in a window without missing inertial samples."""
        return self.there[self.grid.inner[:, :-1] - back] & ~self.broken[:, None]

    def windows(self, vector: np.ndarray, back: int) -> Windows:
        """The windows, interpolated for the delays in these parameters, without the low-pass of the gyroscope."""
        delays = float(vector[GYRO_DELAY]), float(vector[MAG_DELAY])
        gyro = unfiltered(self.gyro, float(vector[GYRO_POLE]), self.grid.step)
        return windows(self.grid, self.accel, gyro, self.mag, *delays, back, self.mag_later)

    def resting(self) -> np.ndarray:
        """(K,) windows in which the specific force hardly changes and the device hardly rotates, for at least a second."""
        levels = {"accel": _STILL_FORCE**2, "gyro": _STILL_RATE**2}
        found = Variances({"accel": self.accel, "gyro": self.gyro}, 1 / self.grid.step, levels=levels)
        width = np.ones(2 * found.half + 1)
        rate = np.stack([np.convolve(x, width / len(width), mode="same") for x in self.gyro.T], axis=1)
        quiet = found.still((1.0, 1.0))
        bias = np.median(rate[quiet], axis=0) if quiet.any() else np.zeros(3)
        calm = quiet & (np.linalg.norm(rate - bias, axis=1) < _STILL_RATE)
        still = np.asarray(np.all(calm[self.grid.inner], axis=1))
        # the scatter is computed over a second, which must fit into the rest: extend the rest while single windows are as calm as inside
        force, turns = self.accel[self.grid.inner], self.gyro[self.grid.inner] - bias
        own = np.array([np.ptp(force, axis=1).max(axis=1), np.linalg.norm(turns.mean(axis=1), axis=1), np.ptp(turns, axis=1).max(axis=1)])
        for first, stop in zip(*runs(still), strict=True):
            calm = np.all(own <= _CALM * own[:, first:stop].max(axis=1, keepdims=True), axis=0)
            before, after = (int(np.argmin(np.append(part, False))) for part in (calm[:first][: -_EDGE - 1 : -1], calm[stop:][:_EDGE]))
            still[first - before : stop + after] = True
        return np.asarray(still & ~self.broken)
