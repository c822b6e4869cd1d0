"""Data of a log for the calibration: arrays, means over the rests, and samples of the turns between them (host, NumPy)."""

import dataclasses
import functools
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding
from .._arrays import decaying_sum, padded, power_of_two, runs
from .._errors import DataError
from .._log import as_log
from .._units import units_of
from ..evidence._rests import Ends
from ._findings import FINDINGS
from ._model import LEVEL
from ._residuals import Poses, Turns, Weighted

#: s: longest gap that is interpolated, in which the rate of a turn by hand hardly changes; length of the parts of a rest whose means count
#: as independent, because hand tremor correlates shorter ones; longest rest in which the integrated noise of the gyroscope stays below the
#: motion of a hand
_BRIDGE, _PIECE, _LONGEST = 0.1, 0.25, 10.0
#: steps of every turn, the same in all recordings so that they share one compiled fit. A turn of 5 s has steps of 20 ms; doubling the
#: number changes no parameter by more than a tenth of its standard error.
_STEPS = 252
_CREEP = 15.0  # s: time constant of the creep that is looked for
LEAST_SAMPLES = 8  # of a rest that is given: two in each of the four parts that show its scatter


class Recording(eqx.Module):
    """Arrays of a recording.

    time : (n,) s. accel, gyro : (n, 3) readings; gyro is None without a gyroscope. temperature : mean in degC, or NaN.
    bridged : (n, 6) gyroscope, then accelerometer, with short gaps interpolated, for the turns. band : (3,) half width of the
    gyroscope's dead band, zero without one.
    """

    time: np.ndarray
    accel: np.ndarray
    gyro: np.ndarray | None
    rate: float
    temperature: float
    bridged: np.ndarray | None
    band: np.ndarray

    @property
    def sensors(self) -> dict[str, np.ndarray]:
        """The readings by sensor, for the detector of rests."""
        return {"accel": self.accel} | ({} if self.gyro is None else {"gyro": self.gyro})

    @functools.cached_property
    def whole(self) -> tuple[np.ndarray, np.ndarray]:
        """The accelerometer's readings with all gaps interpolated, and how far those of the last 15 s were from them."""
        known = np.flatnonzero(np.isfinite(self.accel).all(axis=1))
        whole = np.stack([np.interp(np.arange(len(self.accel)), known, column[known]) for column in self.accel.T], axis=1)
        share, moved = -np.expm1(-1 / (_CREEP * self.rate)), whole - whole[0]
        return whole, share * decaying_sum(moved, 1 - share) - moved


def recording(log: Any) -> Recording:
    """Convert a log to arrays, without readings that are no measurement (`Log.usable`)."""
    log = as_log(log)
    if log.accel is None:
        raise DataError("The log has no accelerometer, on which this calibration rests.", code="no_accel")
    for name, values in (("accelerometer", log.accel), ("gyroscope", log.gyro)):
        if values is not None and np.shape(values)[1:] != (3,):
            raise DataError(f"The {name} has {np.shape(values)[1:]} axes; this calibration needs all three.", code="axes")
    stamps, rate = np.asarray(log.time, dtype=float), float(log.rate)
    temperature = float("nan") if log.temperature is None else float(np.nanmean(log.temperature))
    accel, whole = _readings(log, "accel")
    # turns need all three axes of a gyroscope, the poses none
    if log.gyro is None or (np.fmin.reduce(log.gyro) == np.fmax.reduce(log.gyro)).any():
        return Recording(stamps - stamps[0], accel, None, rate, temperature, None, np.zeros(3))
    # the zeros of a dead band stay: they hardly change a turn, and what they say of the bias is known to the width of the band
    gyro, turning = _readings(log, "gyro", ("zeroed",))
    dead = np.isfinite(gyro) & np.isnan(log.usable("gyro"))
    size = np.where(dead.any(axis=0), np.min(np.abs(gyro), axis=0, initial=np.inf, where=np.isfinite(gyro) & ~dead), 0.0)
    return Recording(stamps - stamps[0], accel, gyro, rate, temperature, np.concatenate([turning, whole], axis=1), size)


def _readings(log: Any, sensor: str, keep: tuple[str, ...] = ()) -> tuple[np.ndarray, np.ndarray]:
    """Usable readings of a sensor, and the same with short gaps interpolated, but not at the end of the range."""
    values, whole = (np.ascontiguousarray(log.usable(sensor, keep=(*keep, *kinds))) for kinds in ((), ("clipped",)))
    return values, np.where(np.isnan(values) & np.isfinite(whole), np.nan, bridged(whole, float(log.rate)))


def wrong_units(accel: np.ndarray, gravity: float) -> Finding | None:
    """The finding that the readings cannot be in m/s^2, or None if they can."""
    size = float(np.nanmedian(np.linalg.norm(accel, axis=1)))
    if 0.5 * gravity <= size <= 2 * gravity:
        return None
    size = max(size, np.finfo(float).tiny)  # all zero
    off = {unit: abs(np.log(size * factor / gravity)) for unit, factor in units_of("accel").items()}
    unit, facts = min(off, key=lambda name: off[name]), dict[str, Any](size=size, gravity=gravity)
    return FINDINGS("unit", "accel", unit=unit, **facts) if off[unit] < np.log(1.25) else FINDINGS("unit_unknown", "accel", **facts)


def bridged(readings: np.ndarray, rate: float) -> np.ndarray:
    """Interpolate short gaps; longer gaps stay NaN."""
    missing = ~np.all(np.isfinite(readings), axis=1)
    if not missing.any():
        return readings
    first, last = runs(missing)
    short = (last - first <= max(_BRIDGE * rate, 1)) & (first > 0) & (last < len(readings))
    filled, there = readings.copy(), np.flatnonzero(~missing)
    index = np.concatenate([np.arange(i, j) for i, j in zip(first[short], last[short], strict=True)] or [np.zeros(0, dtype=int)])
    filled[index] = np.stack([np.interp(index, there, column[there]) for column in readings.T], axis=1)
    return filled


class Rests(eqx.Module):
    """Means over k still intervals.

    accel, gyro : (k, 3) mean readings; time : (k,) middle, s from the middle of the record; duration : (k,) s without missing samples.
    accel_scatter : (k, 3, 3) covariance of the mean of accel; gyro_scatter : (k, 3) variance of the mean of gyro; both are estimated
        from the scatter within the interval, between `pieces` (k,) independent parts.
    past : "creep", "hysteresis" -> (k, 3) what a sensor remembers: how far the readings of the last 15 s were from the present ones; how
        much an axis with a play of 1e-3 of gravity lags behind, from 1 to -1 for a reading that came from above or below (`remembering`).
    short : (k,) m/s^2 by which the mean vector is shorter than the force, because a hand rotated a little; zero until a model is known.
    slots : number of rows after padding. ends : first sample of each interval, and the one after its last.
    """

    accel: np.ndarray
    gyro: np.ndarray
    time: np.ndarray
    duration: np.ndarray
    accel_scatter: np.ndarray
    gyro_scatter: np.ndarray
    pieces: np.ndarray
    past: dict[str, np.ndarray]
    slots: int
    short: np.ndarray
    ends: Ends

    def poses(self, sigma: np.ndarray, gyro_sigma: np.ndarray) -> Poses:
        """Padded poses with the given standard deviations, (k,) and (k, 3)."""
        shown = (self.accel, self.gyro, self.time, self.short, self.past["creep"])
        accel, gyro, time, short, past = (padded(x, self.slots) for x in shown)
        return Poses(accel, padded(sigma, self.slots, np.inf), gyro, padded(gyro_sigma, self.slots, np.inf), time, short, past)

    def shortened(self, correction: np.ndarray, vertical: np.ndarray, size: np.ndarray) -> "Rests":
        """Fill in `short`: if a vector rotates to and fro, half the variance of the angle is the relative loss of length of its mean.

        `correction` (3, 3) converts readings to m/s^2; `vertical` (k, 3) and `size` (k,) are direction and size of the mean force.
        """
        scatter = np.einsum("ij,kjl,ml->kim", correction, self.accel_scatter * self.pieces[:, None, None], correction)
        along = np.einsum("ki,kij,kj->k", vertical, scatter, vertical)
        return dataclasses.replace(self, short=(np.trace(scatter, axis1=1, axis2=2) - along) / (2 * size))

    def remembering(self, recording: Recording) -> "Rests":
        """The rests with how much a play lags behind."""
        # noise does not move a play: not within a rest, which begins and ends outside of its interval, and little of it is left
        # in a mean over a quarter of a second
        whole, edge = recording.whole[0].copy(), round(_PIECE * recording.rate)
        for i, j in zip(*self.ends, strict=True):
            whole[max(i - edge, 0) : j + edge] = whole[i:j].mean(axis=0)
        step = max(round(_PIECE * recording.rate / 2), 1)
        smooth = scipy.ndimage.uniform_filter1d(whole, 2 * step, axis=0)[::step]
        play, held = 1e-3 * np.linalg.norm(np.ptp(smooth, axis=0)) / 12**0.5, [smooth[0]]
        for now in smooth[1:]:
            held.append(np.minimum(np.maximum(held[-1], now - play), now + play))
        lag = np.repeat((np.array(held) - smooth) / play, step, axis=0)[: len(whole)]
        return dataclasses.replace(self, past=self.past | {"hysteresis": means(lag, *self.ends)})

    def norm_variance(self, across: np.ndarray) -> np.ndarray:
        """(k,) variance of the magnitude that the scatter within the rests explains; `across` (k, 3) is its derivative by the readings."""
        return self._shared(np.einsum("ki,kij,kj->k", across, self.accel_scatter, across))

    def gyro_variance(self) -> np.ndarray:
        """(k, 3) variance of the mean rate that the scatter within the rests explains."""
        return np.stack([self._shared(column) for column in self.gyro_scatter.T], axis=1)

    def _shared(self, variance: np.ndarray) -> np.ndarray:
        """Pool the noise over all rests, because one rest is too short to estimate it; a significantly different rest keeps its own."""
        freedom, density = self.pieces - 1, variance * self.duration
        common = np.median(density / (2 * scipy.special.gammaincinv(freedom / 2, 0.5)) * freedom)
        low, high = (common * 2 * scipy.special.gammaincinv(freedom / 2, part) / freedom for part in (LEVEL, 1 - LEVEL))
        return np.where((density > high) | (density < low), density, common) / self.duration


def norms(accel: np.ndarray, slots: int, gravity: float, sigma: float = 1.0) -> Weighted:
    """Padded data of readings at rest, for a fit of the accelerometer alone to their magnitudes."""
    return Weighted(Poses(padded(accel, slots), padded(np.full(len(accel), sigma), slots, np.inf)), None, gravity)


def _means(readings: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Mean of the finite samples between successive edges, which increase; NaN between edges without a finite sample."""
    there = np.isfinite(readings)
    # subtract the mean of the record first, so that sums of large counts do not lose digits
    middle = np.nanmean(readings, axis=0)
    filled = np.where(there, readings - middle, 0.0)
    sums, count = (np.add.reduceat(part, edges[:-1], axis=0, dtype=float) for part in (filled[: edges[-1]], there[: edges[-1]]))
    return np.where(count > 0, sums / np.maximum(count, 1), np.nan) + middle


def means(readings: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """Mean of the finite samples of each interval."""
    return _means(readings, np.stack([start, stop], axis=1).reshape(-1))[::2]


def rests_of(recording: Recording, start: np.ndarray, stop: np.ndarray) -> Rests:
    """Means over the intervals, and the uncertainty of each mean from the scatter within its interval."""
    both = np.concatenate(list(recording.sensors.values()), axis=1)
    mean = np.pad(means(both, start, stop), [(0, 0), (0, 6 - both.shape[1])])
    middle = (recording.time[start] + recording.time[stop - 1]) / 2 - recording.time[-1] / 2
    there = np.asarray(np.isfinite(recording.accel).all(axis=1))
    duration = np.array([there[i:j].sum() for i, j in zip(start, stop, strict=True)]) / recording.rate
    count = np.maximum(np.floor(duration / _PIECE), 4).astype(int)
    edges = [i + np.linspace(0, j - i, pieces + 1).astype(int) for i, j, pieces in zip(start, stop, count, strict=True)]
    parts = np.split(_means(both, np.concatenate(edges)), np.cumsum(count + 1)[:-1])
    scatter = np.zeros((len(start), 6, 6))
    for k, (part, pieces) in enumerate(zip(parts, count, strict=True)):
        part = part[:pieces]  # the last one lies behind the interval
        scatter[k, : both.shape[1], : both.shape[1]] = np.cov(part[np.isfinite(part).all(axis=1)], rowvar=False) / pieces
    past = {"creep": means(recording.whole[1], start, stop)}
    return Rests(
        mean[:, :3], mean[:, 3:], middle, duration, scatter[:, :3, :3], np.diagonal(scatter, axis1=1, axis2=2)[:, 3:], count, past,
        power_of_two(len(start) + 1, 32), np.zeros(len(start)), (start, stop),
    )  # fmt: skip


def turns_of(recording: Recording, start: np.ndarray, stop: np.ndarray, slots: int, whole: bool = False) -> Turns:
    """Turns between rests, with sigma one, or infinite for a turn with too many missing samples.

    A turn starts at the last sample of a rest and ends at the first sample of the next one. With `whole`, it starts and ends at the mean
    attitudes of the rests instead, because a hand moves a little even when it holds still. The angle from the mean attitude of a rest
    of length T to its end is the integral of the rate weighted by t / T: one step of length T / 2 with the weighted mean of the rate.
    """
    readings = np.asarray(recording.bridged)
    number, count = len(start) - 1, _STEPS + 5
    nodes, steps = np.zeros((slots - 1, count, 6)), np.zeros((slots - 1, count - 1))
    length = (stop - start) / recording.rate
    for k, (i, j) in enumerate(zip(stop[:-1] - 1, start[1:], strict=True)):
        nodes[k, 2:-2], steps[k, 2:-2] = _resampled(recording.time[i : j + 1], readings[i : j + 1])
        for rest, here, step, ramp in ((k, slice(0, 2), 0, 0.0), (k + 1, slice(-2, None), -1, 1.0)):
            part = readings[start[rest] : stop[rest]]
            weight = np.abs(ramp - (np.arange(len(part)) + 0.5) / len(part)) * np.isfinite(part).all(axis=1)
            nodes[k, here] = weight @ np.nan_to_num(part) / weight.sum()
            steps[k, step] = length[rest] / 2 if whole and length[rest] <= _LONGEST else 0.0
    good = np.asarray(np.isfinite(nodes).all(axis=(1, 2)))
    sigma = np.where(good & (np.arange(slots - 1) < number), 1.0, np.inf)
    nodes = np.where(good[:, None, None], nodes, 0.0)
    nodes[number:] = nodes[:1]
    return Turns(nodes[..., :3], nodes[..., 3:], steps, sigma)


def _resampled(time: np.ndarray, readings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Resample a turn to `_STEPS` + 1 nodes; return the nodes and the steps between them.

    A turn with fewer samples repeats its last sample with steps of length zero. In a longer turn, each node is the triangularly weighted
    mean of the samples around it, which preserves the sum over the steps, that is the angle.
    """
    if len(time) <= _STEPS + 1:
        index = np.minimum(np.arange(_STEPS + 1), len(time) - 1)
        return readings[index], np.diff(time[index])
    place = (time - time[0]) / (time[-1] - time[0]) * _STEPS
    low = np.minimum(place.astype(int), _STEPS - 1)
    right = place - low
    index, weight = np.concatenate([low, low + 1]), np.concatenate([1 - right, right])
    total = np.bincount(index, weight, _STEPS + 1)
    sums = [np.bincount(index, weight * np.concatenate([column, column]), _STEPS + 1) for column in readings.T]
    return np.stack(sums, axis=1) / total[:, None], np.full(_STEPS, (time[-1] - time[0]) / _STEPS)


def given_rests(rests: Any, samples: int) -> Ends:
    """Check the rests given by the caller, and sort them."""
    ends = np.asarray(rests)
    if ends.ndim != 2 or ends.shape[1] != 2:
        said = f"rests has shape {ends.shape}; expected (k, 2): the first sample of each rest, and the one after its last"
        raise DataError(said, code="rests")
    ends = ends[np.argsort(ends[:, 0])].astype(int)
    bad = (ends[:, 1] - ends[:, 0] < LEAST_SAMPLES) | (ends[:, 0] < 0) | (ends[:, 1] > samples)
    bad[1:] |= ends[1:, 0] < ends[:-1, 1] + 2
    if bad.any():
        first, last = ends[np.argmax(bad)]
        said = f"the rest from sample {first} to {last} is outside of the log, shorter than {LEAST_SAMPLES} samples, or meets another"
        raise DataError(said, code="rests")
    return ends[:, 0], ends[:, 1]
