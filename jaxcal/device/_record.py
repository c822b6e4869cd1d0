"""Prepare a log for the estimator: readings with gaps filled, which of them are missing, and their noise."""

import dataclasses
import math
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import from_vector
from .._errors import DataError
from ..imu._model import EARTH_RATE
from ._noise_floor import Floor, noise_floor
from ._windows import REACH, Grid, Record

#: readings: longest gap that is interpolated, and fewest that a spline needs; samples: smallest distance between two readings
_SHORT, _FEWEST, _CLOSE = 2, 4, 0.2


@dataclasses.dataclass(frozen=True)
class _Sensor:
    """Readings of a sensor at the samples of the log."""

    filled: np.ndarray  # (n, 3) at the samples
    lost: np.ndarray  # (n,) whether a sample lies in a gap too long for an interpolation
    index: np.ndarray  # (m,) samples that have a reading
    at: np.ndarray  # (m,) when it was taken, in samples
    own: np.ndarray  # (m, 3) the readings

    @staticmethod
    def of(log: Any, name: str) -> "_Sensor":
        """The readings are interpolated in short gaps, and where they were not taken at a sample (`Log.offset`)."""
        # readings at the end of the range stay: they widen the noise of the motion, and without them the trajectory would break there
        y = log.usable(name, keep=("clipped",))
        count, index = len(y), np.flatnonzero(np.isfinite(y).all(axis=1))
        at, moved = index.astype(float), name in log.offset
        if moved:
            at += log.offset[name][index] * log.rate
            apart = np.append(True, np.diff(at) > _CLOSE)
            index, at = index[apart], at[apart]
        if len(index) < _FEWEST:
            return _Sensor(np.zeros_like(y), np.ones(count, dtype=bool), index, at, y[index])
        edges, rows = np.concatenate([[-1], index, [count]]), np.arange(count)
        before, after = edges[np.searchsorted(edges, rows, "right") - 1], edges[np.searchsorted(edges, rows)]
        lost = after - before > (_SHORT + 1) * np.median(np.diff(index))
        filled = scipy.interpolate.CubicSpline(at, y[index])(rows) if moved or len(index) < count else y
        return _Sensor(np.where(lost[:, None], np.median(y[index], axis=0), filled), lost, index, at, y[index])

    def floor(self, rate: float) -> Floor:
        """The noise. It is that of the readings themselves where most samples are interpolated, because interpolation filters noise."""
        step = float(np.median(np.diff(self.at)))
        if np.array_equal(self.at, self.index) and step == 1.0:
            return noise_floor(self.filled, rate, self.lost)
        return noise_floor(self.own, rate / step, np.zeros(len(self.own), dtype=bool))


def recorded(log: Any, gravity: float, latitude: float | None = None) -> tuple[Record, tuple[Floor, Floor], np.ndarray]:
    """The record, the noise of gyroscope and accelerometer, and the readings of the magnetometer in their own unit."""
    for name in ("accel", "gyro", "mag"):
        value = getattr(log, name, None)
        if value is None or np.shape(value)[1:] != (3,):
            raise DataError(
                f"the log has no {name} with three axes; a device is fitted from accelerometer, gyroscope and magnetometer",
                code="no_sensor",
            )
    sensors = {name: _Sensor.of(log, name) for name in ("gyro", "accel")}
    (gyro, no_gyro), (accel, no_accel) = ((sensor.filled, sensor.lost) for sensor in sensors.values())
    mag = log.usable("mag")
    there = np.isfinite(mag).all(axis=1)
    rate = float(log.rate)
    grid = Grid.of(len(accel), rate, REACH)
    wide = math.ceil(REACH * rate) + 4
    lost = no_accel | (np.convolve(no_gyro, np.ones(2 * wide + 1), mode="same") > 0)
    broken = np.asarray(np.any(lost[grid.inner], axis=1))
    spin = np.zeros(3) if latitude is None else EARTH_RATE * np.array([np.cos(latitude), 0.0, np.sin(latitude)])
    earth = from_vector(spin * grid.steps * grid.step)
    for name, values in (("gyro", gyro), ("accel", accel)):
        if not np.ptp(values, axis=0).any():
            raise DataError(f"the readings of {name} never change: the sensor is dead, or its column is wrong", code="dead")
    floors = sensors["gyro"].floor(rate), sensors["accel"].floor(rate)
    later = np.where(there, log.offset["mag"], 0.0) if "mag" in log.offset else None
    return Record(accel, gyro, np.where(there[:, None], mag, 0.0), later, there, broken, grid, gravity, earth), floors, mag
