"""`Motion`: what the sensors feel while the errors grow, and its means over cells of time."""

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import from_vector, skew, to_vector, windowed_variance
from .._errors import DataError
from .._log import Log
from .._types import Checked, Float
from .._units import STANDARD_GRAVITY

UP = np.array([0.0, 0.0, STANDARD_GRAVITY])
_STEP = 0.01  # s between the samples of a motion that is made here
#: what drives the errors of a sensor, and its number of components: an error is a matrix times these. `lever` is [turn]x + [rate]x^2
DRIVERS = {"one": 1, "time": 1, "rate": 3, "force": 3, "field": 3, "turn": 3, "jerk": 3, "lever": 9}

#: driver -> its columns among all
PLACES = dict(zip(DRIVERS, np.split(np.arange(sum(DRIVERS.values())), np.cumsum(list(DRIVERS.values()))[:-1]), strict=True))


class Motion(eqx.Module):
    """Motion of a device: sampled attitude, angular rate and specific force. It begins at rest, in the attitude of its first sample.

    The level frame has x to the east, y to magnetic north and z up; a motion without a known heading begins with heading zero.

    Attributes
    ----------
    step : s between samples.
    attitude : (n, 3, 3) from the body to the level frame.
    rate : (n, 3) rad/s, in the body.
    force : (n, 3) m/s^2, specific force in the body: gravity points up.
    name : for tables.

    Examples
    --------
    >>> from jaxcal.budget import Motion
    >>> circle = Motion.circle(20.0, radius=5.0, period=10.0)
    >>> round(circle.duration), [round(x, 1) for x in circle.force[0].tolist()], round(float(circle.rate[0, 2]), 3)
    (20, [0.0, 2.0, 9.8], 0.628)
    """

    step: float
    attitude: Float[np.ndarray, "n 3 3"]
    rate: Float[np.ndarray, "n 3"]
    force: Float[np.ndarray, "n 3"]
    name: str = eqx.field(static=True, default="motion")

    @property
    def duration(self) -> float:
        """Length in s."""
        return self.step * len(self.rate)

    @classmethod
    def rest(cls, duration: float) -> "Motion":
        """A level device at rest."""
        return cls(duration, np.eye(3)[None], np.zeros((1, 3)), UP[None], "rest")

    @classmethod
    def circle(cls, duration: float, radius: float = 10.0, period: float = 20.0) -> "Motion":
        """A vehicle on a level circle, to the left: its x axis is ahead, at first to the east."""
        turn = 2 * np.pi / period
        heading = turn * _STEP * (np.arange(round(duration / _STEP) + 1))
        attitude = from_vector(heading[:, None] * np.array([0.0, 0.0, 1.0]))
        return cls.of_path(attitude, (attitude @ np.array([0.0, radius * turn**2, 0.0]))[:-1], _STEP, "circle")

    @classmethod
    def hand(cls, duration: float, seed: int = 0, turn: float = 0.5, shake: float = 1.0) -> "Motion":
        """A device in the hand: waves of 0.1 to 1.5 Hz in attitude (rms `turn` in rad and axis) and acceleration (rms `shake`, m/s^2)."""
        random, time = np.random.default_rng(seed), _STEP * np.arange(round(duration / _STEP) + 1)
        frequency, phase = random.uniform(0.1, 1.5, (2, 6, 3)), random.uniform(0, 2 * np.pi, (2, 6, 3))
        waves = [np.sin(2 * np.pi * f * time[:, None, None] + p) for f, p in zip(frequency, phase, strict=True)]
        vector, acceleration = (size * np.sum(wave, axis=1) / np.sqrt(3) for size, wave in zip((turn, shake), waves, strict=True))
        return cls.of_path(from_vector(vector), acceleration[:-1], _STEP, "hand")

    @classmethod
    def of_path(cls, attitude: Checked[np.ndarray], acceleration: Checked[np.ndarray], step: float, name: str = "motion") -> "Motion":
        """From attitudes (n + 1, 3, 3) at the ends of the steps, and the mean acceleration (n, 3) in the level frame in each."""
        turned = np.swapaxes(attitude[:-1], 1, 2)
        rate = to_vector(turned @ attitude[1:]) / step
        middle = attitude[:-1] @ from_vector(rate * step / 2)
        return cls(step, middle, rate, (np.swapaxes(middle, 1, 2) @ (acceleration + UP)[..., None])[..., 0], name)

    @classmethod
    def of(cls, log: Log) -> "Motion":
        """The motion in a log with a gyroscope and an accelerometer, by integration.

        The level at the start, and the bias of the gyroscope, are those of the quietest second. A log of raw readings should be corrected
        first (`Calibration.correct`).

        Raises
        ------
        DataError
            If one of the two sensors is missing.
        """
        if log.gyro is None or log.accel is None:
            raise DataError("a motion needs a gyroscope and an accelerometer in one log", code="no_sensor")
        clock, known = np.arange(len(log.gyro)), np.isfinite(np.concatenate([log.gyro, log.accel], axis=1)).all(axis=1)
        rate, force = (np.stack([np.interp(clock, clock[known], x[known]) for x in one.T], axis=1) for one in (log.gyro, log.accel))
        width = min(max(round(log.rate), 2), len(rate))
        quiet = slice(first := int(np.argmin(windowed_variance(rate, width))), first + width)
        rate = rate - rate[quiet].mean(axis=0)
        ends = from_vector(rate / log.rate)
        for step in 1 << np.arange(len(ends).bit_length()):  # each product then spans twice as many samples
            ends = np.concatenate([ends[:step], ends[:-step] @ ends[step:]])
        attitude = np.concatenate([np.eye(3)[None], ends[:-1]]) @ from_vector(rate / log.rate / 2)
        up = np.mean(attitude[quiet] @ force[quiet][..., None], axis=0)[:, 0]
        level = scipy.spatial.transform.Rotation.align_vectors(UP, up)[0].as_matrix()
        return cls(1.0 / log.rate, level @ attitude, rate, force, "log")

    def table(self, shape: np.ndarray, field: Checked[float | np.ndarray] = 0.0) -> np.ndarray:
        """(n, 9 + k) entries of the attitude, and what drives errors (..., k): of the drivers the first four, if no error needs more.

        field : (3,) T, in the level frame.
        """
        parts = [self.attitude.reshape(-1, 9), np.ones(len(self.rate)), np.zeros(len(self.rate)), self.rate, self.force]
        if np.any(shape[..., PLACES["force"][-1] + 1 :]):
            # the derivatives of a motion of one sample are zero
            turn, jerk = (np.gradient(x, self.step, axis=0) if len(x) > 1 else np.zeros_like(x) for x in (self.rate, self.force))
            lever = skew(turn) + skew(self.rate) @ skew(self.rate)
            parts += [(field * np.ones(3)) @ self.attitude, turn, jerk, lever.reshape(-1, 9)]
        return np.column_stack(parts)

    def cells(self, start: float, stop: float, count: int, table: np.ndarray, first: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Means over `count` cells of time: attitude times each driver, outer products of its columns, specific force; and of the drivers.

        Parameters
        ----------
        start, stop : s.
        table : from `table`.
        first : (3, 3) rotation that is applied to the level frame; None for none.
        """
        parts = max(1, round((stop - start) / count / self.step))
        time = start + (np.arange(count * parts) + 0.5) * (stop - start) / (count * parts)
        rows = table.take(np.minimum((time / self.step).astype(int), len(table) - 1), axis=0).reshape(count, parts, -1)
        rows[..., 9 + PLACES["time"][0]] = time.reshape(count, parts)
        turned = (np.swapaxes(rows[..., :9], 1, 2) @ rows / parts).reshape(count, 3, 3, -1)
        outer = np.moveaxis(np.diagonal(turned[..., :9].reshape(count, 3, 3, 3, 3), axis1=2, axis2=4), -1, 1)
        driven = turned[..., 9:]
        if first is not None:
            driven, outer = np.einsum("ab,jbck->jack", first, driven), first @ outer @ first.T
        force = np.trace(driven[..., PLACES["force"]], axis1=2, axis2=3)
        return {"driven": driven, "outer": outer, "force": force, "mean": rows[..., 9:].mean(axis=(0, 1))}
