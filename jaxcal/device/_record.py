"""Prepare a log for the estimator: readings with gaps filled, which of them are missing, and their noise."""

import math
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from ..imu._model import EARTH_RATE
from ._normal import exponential
from ._solve import Noise, Record
from ._windows import WINDOW, Grid

_SHORT = 2  # longest gap, in samples, that is interpolated
_NEAR = 16  # readings on each side on which an interpolated one depends: a spline's weights fall by 0.27 from one to the next
_ORDER = 6  # order of the differences that show the noise: motion slower than an eighth of the rate hardly changes them
#: share of samples that are slower than the fast ones; share of equal neighbours from which a sensor repeats its last reading
_FAST, _HELD = 0.8, 0.05
_TREMOR, _BAND = 15.0, 10.0  # Hz: hands hardly move above the first; width of the band above it that an accelerometer's noise needs
_SEGMENT, _DIFFERENCES = 1.28, 4  # s, segments of a spectrum; order of the differences that keep its low frequencies from leaking
_CORNERS, _REWEIGHTED = 24, 10  # corner frequencies that are tried; rounds of least squares with renewed weights
_COLOURED = 30.0  # likelihood ratio from which noise is not white


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


def white_noise(y: np.ndarray, rate: float, lost: np.ndarray) -> float:
    """Density of the white noise of three axes, from high-order differences, which motion hardly changes.

    It is at least that of the rounding of the readings, which a device at rest may not show. It is 0 if the readings never change.
    """
    high = np.diff(y, _ORDER, axis=0)
    reach = np.convolve(lost, np.ones(_ORDER + 1), mode="valid") == 0
    # the median ignores knocks and stretches with vibration
    power = np.median(high[reach] ** 2) / 0.454936 / math.comb(2 * _ORDER, _ORDER)
    changes = np.abs(np.diff(y, axis=0))
    return float(np.sqrt(max(power, np.min(changes[changes > 0], initial=np.inf) ** 2 / 12 if changes.any() else 0.0) / rate))


def slow_noise(y: np.ndarray, rate: float, white: float) -> float:
    """Density of an accelerometer's noise at the rate of the windows, from its spectrum above the band of a hand.

    Filters, and processes within a sensor, make noise that is stronger at low frequencies. There the hand moves, and hides it from
    the fit. So the spectrum above the hand's band is described by white noise and a Gauss-Markov process whose corner frequency is at
    least that of the windows, by iteratively reweighted least squares. The result is `white` if white noise describes it as well, or if
    the rate leaves no band.
    """
    if rate / 2 < _TREMOR + _BAND:
        return white
    length = round(_SEGMENT * rate)
    window = np.hanning(length + 2)[1:-1]
    high = np.lib.stride_tricks.sliding_window_view(np.diff(y, _DIFFERENCES, axis=0), length, axis=0)[:: length // 2] * window
    power = np.abs(np.fft.rfft(high, axis=-1)) ** 2 / np.sum(window**2) / rate
    angle = 2 * np.pi * np.arange(power.shape[-1]) / length
    band = (angle * rate >= 2 * np.pi * _TREMOR) & (angle < 0.96 * np.pi)
    angle = angle[band]
    # the median ignores knocks and stretches with vibration
    seen = np.median(power[..., band], axis=0).mean(axis=0) / np.log(2) / (2 * np.sin(angle / 2)) ** (2 * _DIFFERENCES)
    seen = np.maximum(seen, 0.01 * white**2)  # coarse readings of a device at rest do not change
    keep = np.exp(-2 * np.pi * np.geomspace(1 / WINDOW, rate / 2, _CORNERS) / rate)[:, None]
    shape = (1 - keep) ** 2 / (1 + keep**2 - 2 * keep * np.cos(angle))
    parts = np.stack([np.ones_like(shape), shape], axis=1)  # (corners, 2, frequencies)
    sizes = np.full((_CORNERS, 2), seen.mean())
    for _ in range(_REWEIGHTED):
        weighted = parts / np.einsum("cp,cpf->cf", sizes, parts)[:, None] ** 2
        normal, right = weighted @ np.swapaxes(parts, 1, 2), weighted @ seen
        sizes = np.linalg.solve(normal, right[..., None])[..., 0]
        # a negative part is zero, and the other part is fitted alone
        alone = right / np.diagonal(normal, axis1=1, axis2=2)
        sizes = np.where(sizes[:, ::-1] < 0, alone, np.maximum(sizes, 0.0))
    misfit = [np.sum(ratio - 1 - np.log(ratio), axis=-1) for ratio in (seen / np.einsum("cp,cpf->cf", sizes, parts), seen / seen.mean())]
    best = int(np.argmin(misfit[0]))
    gain = power.shape[0] * power.shape[1] * (misfit[1] - misfit[0][best])
    return float(np.sqrt(sizes[best].sum())) if gain > _COLOURED else white


def recorded(log: Any, gravity: float, reach: float, latitude: float | None = None) -> tuple[Record, Noise, np.ndarray]:
    """The record, the noise of its inertial sensors, and the readings of the magnetometer in their own unit."""
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
    noise = Noise(white_noise(gyro, rate, no_gyro), white_noise(accel, rate, no_accel), 0.01)
    for name, level in (("gyro", noise.gyro), ("accel", noise.accel)):
        if level == 0:
            raise DataError(f"The readings of {name} never change: the sensor is dead, or its column is wrong; see `jaxcal info`.")
    return Record(accel, gyro, np.where(there[:, None], mag, 0.0), there, broken, grid, gravity, earth), noise, mag
