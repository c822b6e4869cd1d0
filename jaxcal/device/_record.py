"""Prepare a log for the estimator: readings with gaps filled, which of them are missing, and their noise."""

import math
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from ..imu._model import EARTH_RATE
from ._noise_floor import Floor, noise_floor
from ._normal import exponential
from ._solve import Record
from ._windows import Grid

_SHORT = 2  # longest gap, in samples, that is interpolated
_NEAR = 16  # readings on each side on which an interpolated one depends: a spline's weights fall by 0.27 from one to the next
#: share of samples that are slower than the fast ones; share of equal neighbours from which a sensor repeats its last reading
_FAST, _HELD = 0.8, 0.05


def _filled(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Readings with short gaps interpolated, and (n,) whether a sample lies in a longer gap."""
    there = np.isfinite(y).all(axis=1)
    if there.all():
        return y, np.zeros(len(y), dtype=bool)
    index = np.flatnonzero(there)
    filled = scipy.interpolate.CubicSpline(index, y[index])(np.arange(len(y)))
    edges = np.flatnonzero(np.diff(np.concatenate([[True], there, [True]]).astype(np.int8)))
    lost = np.zeros(len(y), dtype=bool)
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        lost[start:stop] = stop - start > _SHORT
    usual = np.median(y[index], axis=0)
    return np.where(lost[:, None], usual, filled), lost


def unfilled(by: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Derivative (n, 3) by the readings that exist, from the derivative by the result of `_filled`."""
    there, lost = np.asarray(np.isfinite(y).all(axis=1)), _filled(y)[1]
    index, out = np.flatnonzero(there), np.where(there[:, None], by, 0.0)
    for i in np.flatnonzero(~there & ~lost):
        at = np.searchsorted(index, i)
        near = index[max(at - _NEAR, 0) : at + _NEAR]
        out[near] += np.outer(scipy.interpolate.CubicSpline(near, np.eye(len(near)))(i), by[i])
    return out


def _changed(m: np.ndarray, gyro: np.ndarray) -> np.ndarray:
    """(n,) whether a reading of the magnetometer exists and is new: in many logs a slow magnetometer repeats its last reading.

    A sensor with coarse resolution also repeats readings while it hardly rotates, so the test uses the fastest rotations only.
    """
    there = np.isfinite(m).all(axis=1)
    same = np.concatenate([[False], np.all(m[1:] == m[:-1], axis=1)]) & there
    rate = np.linalg.norm(gyro, axis=1)
    fast = there & (rate >= np.quantile(rate, _FAST))
    return np.asarray(there & ~same if fast.any() and np.mean(same[fast]) > _HELD else there)


def recorded(log: Any, gravity: float, reach: float, latitude: float | None = None) -> tuple[Record, tuple[Floor, Floor], np.ndarray]:
    """The record, the noise of gyroscope and accelerometer, and the readings of the magnetometer in their own unit."""
    for name in ("accel", "gyro", "mag"):
        value = getattr(log, name, None)
        if value is None or np.shape(value)[1:] != (3,):
            raise DataError(f"The log has no {name} with three axes; a device is fitted from accelerometer, gyroscope and magnetometer.")
    accel, no_accel = _filled(np.asarray(log.accel, dtype=float))
    gyro, no_gyro = _filled(np.asarray(log.gyro, dtype=float))
    mag = np.asarray(log.mag, dtype=float)
    there = _changed(mag, gyro)
    rate = float(log.rate)
    grid = Grid.of(len(accel), rate, reach)
    wide = math.ceil(reach * rate) + 4
    lost = no_accel | (np.convolve(no_gyro, np.ones(2 * wide + 1), mode="same") > 0)
    broken = np.asarray(np.any(lost[grid.inner], axis=1))
    spin = np.zeros(3) if latitude is None else EARTH_RATE * np.array([np.cos(latitude), 0.0, np.sin(latitude)])
    earth = exponential(spin * grid.steps * grid.step)
    for name, values in (("gyro", gyro), ("accel", accel)):
        if not np.ptp(values, axis=0).any():
            raise DataError(f"The readings of {name} never change: the sensor is dead, or its column is wrong; see `jaxcal info`.")
    floors = noise_floor(gyro, rate, no_gyro), noise_floor(accel, rate, no_accel)
    return Record(accel, gyro, np.where(there[:, None], mag, 0.0), there, broken, grid, gravity, earth), floors, mag
