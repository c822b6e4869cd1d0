r"""Changes of the mean that look like slow noise: an event, a ramp, a warm-up, a slow sinusoid, the temperature.

They act on all axes of a sensor, are searched in all of them together, and enter the likelihood as regressors with a size for each axis.
The search uses the lowest ordinates of the records and the likelihood ratio at a fixed density of the noise,

.. math:: \lambda = \sum_\mathrm{axes}\frac{(\sum x_k y_k/S_k)^2}{\sum x_k^2/S_k}

once under the fitted density, in which B and K may already describe the change as noise, and once under the density of N and Q alone. The
slow noise is then fitted again beside the best shape of each family. The likelihood ratio of the fits with and without it decides. One
change after another is added, as long as the ratio exceeds a level that at most one in 300 records of noise alone reaches.
"""

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._types import AnyArray
from ..spectrum._average import log_groups
from ._likelihood import scoring

#: block means of a record, which have the same lowest ordinates; ordinates that the search uses; rounds of the regression and the
#: fit of the noise; changes of one record
_BLOCKS, _ORDINATES, _ROUNDS, _MOST = 4096, 512, 2, 3
_STARTS = 192  # times at which an event may begin
#: time constants of an event over the length of the record; 0 is a step; time constants over the length of the record with which a sensor
#: follows its temperature
_RESPONSES, _LAGS = (0.0, 1 / 64, 1 / 16, 1 / 4), (0.0, 0.003, 0.01, 0.03, 0.1)
_DECAYS = 2.0 ** -np.arange(1, 8)  # time constants of a warm-up over the length of the record
_CYCLES = np.arange(0.5, 10.01, 0.25)  # cycles of a sinusoid in the record
#: likelihood ratio for one axis that one in 300 records of noise alone reaches in the search of a family; a shift has a known place, and
#: 2.6 standard errors suffice
LEVELS = {"shift": 6.8, "step": 18.5, "ramp": 11.0, "warm_up": 16.0, "sinusoid": 20.0, "temperature": 12.0}
#: twice the log likelihood by which a change without K must be better than K for K to be a hint at most: 5 % of records with K reach it
_DOUBTED = 14.0


class Change(NamedTuple):
    """A change: its family, its place (s, s or Hz), a time constant in s, and its regressors, (n, columns), at given times."""

    family: str
    at: float
    time: float
    columns: Callable[[AnyArray], AnyArray]


class Changes(NamedTuple):
    """The changes that are fitted, and one that describes the record so well without K that K is a hint at most, or None."""

    fitted: tuple[Change, ...] = ()
    instead: Change | None = None


class Axis(NamedTuple):
    """One axis for the search: record without gaps, expected first ordinates per squared coefficient (ordinates, p), the coefficients,
    which of them are fitted again, and which of these is K.
    """

    record: AnyArray
    columns: AnyArray
    theta: AnyArray
    slow: AnyArray
    walk: AnyArray


class _Low(NamedTuple):
    """Times at the middles of the blocks of a record, and factors that turn a DCT-II of block means into the lowest ordinates."""

    times: AnyArray
    factor: AnyArray

    def transform(self, x: AnyArray) -> AnyArray:
        """Ordinates of functions given at `times`, the first axis."""
        return (self.factor * np.asarray(scipy.fft.dct(x, norm="ortho", axis=0))[1 : len(self.factor) + 1].T).T


@functools.lru_cache(maxsize=8)
def _low(n: int, most: int, dt: float) -> tuple[_Low, int]:
    size = max(n // _BLOCKS, 1)
    count = n // size
    k = np.arange(1, min(_ORDINATES, most, max(count // 4, 8)) + 1)
    # a mean over a block attenuates the ordinates
    attenuated = np.sin(np.pi * k / (2 * count)) / (size * np.sin(np.pi * k / (2 * count * size)))
    return _Low((np.arange(count) + 0.5) * size * dt, np.sqrt(size * dt) / attenuated), size


def _event(start: float, time: float, t: AnyArray) -> AnyArray:
    late = np.maximum(np.asarray(t) - start, 0.0)
    return (late > 0.0).astype(float)[:, None] if time == 0.0 else -np.expm1(-late / time)[:, None]


def _line(t: AnyArray) -> AnyArray:
    return (np.asarray(t) / t[-1])[:, None]


def _decay(time: float, t: AnyArray) -> AnyArray:
    return np.exp(-np.asarray(t) / time)[:, None]


def _wave(frequency: float, t: AnyArray) -> AnyArray:
    angle = 2 * np.pi * frequency * np.asarray(t)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _lagged(times: AnyArray, values: AnyArray, lag: float, t: AnyArray) -> AnyArray:
    """The temperature after a first-order lag in s."""
    if lag:
        keep = np.exp(-(times[1] - times[0]) / lag)
        state = values[0]
        followed = np.empty(len(values))
        for i, value in enumerate(values):
            state = keep * state + (1.0 - keep) * value
            followed[i] = state
        values = followed
    return np.asarray(np.interp(t, times, values))[:, None]


@functools.lru_cache(maxsize=8)
def _shapes(n: int, most: int, dt: float) -> dict[str, tuple[list[Change], AnyArray]]:
    """Family -> its changes, and their ordinates (changes, ordinates, columns)."""
    low, _ = _low(n, most, dt)
    length = n * dt
    starts = (np.arange(_STARTS) + 0.5) / _STARTS * length
    events = [(at, part * length) for part in _RESPONSES for at in starts[2:-2]]
    families = {
        "step": [Change("step", at, time, functools.partial(_event, at, time)) for at, time in events],
        "ramp": [Change("ramp", 0.0, 0.0, _line)],
        "warm_up": [Change("warm_up", part * length, part * length, functools.partial(_decay, part * length)) for part in _DECAYS],
        "sinusoid": [Change("sinusoid", c / length, 0.0, functools.partial(_wave, c / length)) for c in _CYCLES],
    }
    return {family: (listed, _ordinates_of(low, listed)) for family, listed in families.items()}


def _ordinates_of(low: _Low, changes: Sequence[Change]) -> AnyArray:
    values = np.stack([change.columns(low.times) for change in changes], axis=1)
    return np.moveaxis(np.asarray(low.transform(values)), 0, 1)


def _ratios(record: AnyArray, density: AnyArray, x: AnyArray) -> AnyArray:
    """Likelihood ratio (changes,) of each change; x are their ordinates, (changes, ordinates, columns)."""
    score = np.einsum("k,ckq->cq", record / density, x, optimize=True)
    if x.shape[2] == 1:
        size = (x[:, :, 0] ** 2) @ (1.0 / density)
        return np.where(size > 0.0, score[:, 0] ** 2 / np.where(size > 0.0, size, 1.0), 0.0)
    gram = np.einsum("ckq,ckr->cqr", x, x / density[:, None], optimize=True)
    return np.einsum("cq,cq->c", score, np.linalg.solve(gram, score[:, :, None])[:, :, 0])


@functools.cache
def _level(family: str, axes: int) -> float:
    """Likelihood ratio that so many axes together reach as often as one axis reaches its level."""
    degrees = 1.0 if family == "sinusoid" else 0.5
    rare = scipy.special.gammaincc(degrees, LEVELS.get(family, _DOUBTED) / 2.0)
    return 2.0 * float(scipy.special.gammainccinv(degrees * axes, rare))


def slope_of(record: AnyArray, density: AnyArray, dt: float) -> tuple[float, float]:
    """Slope of a record per second and its standard error; `density` is that of the noise at the lowest ordinates."""
    low, size = _low(len(record), len(density), dt)
    means = record[: len(low.times) * size].reshape(-1, size).mean(axis=1)
    x, level = low.transform(low.times), density[: len(low.factor)]
    information = float(np.sum(x**2 / level))
    return float(np.sum(low.transform(means) * x / level)) / information, information**-0.5


def find_changes(
    axes: Sequence[Axis], dt: float, joints: Sequence[float] = (), temperature: AnyArray | None = None
) -> Changes:  # fmt: skip
    """The changes of the mean that explain the records of a sensor better than slow noise alone does.

    `joints` are times in s at which the sensor may have moved, so that any shift of the mean is one. `temperature`, (n,), is that at the
    samples, without NaN.
    """
    n, most = len(axes[0].record), min(len(axis.columns) for axis in axes)
    (low, size), shapes = _low(n, most, dt), dict(_shapes(n, most, dt))
    if temperature is not None:
        means = temperature[: len(low.times) * size].reshape(-1, size).mean(axis=1)
        lags = [lag * n * dt for lag in _LAGS]
        listed = [Change("temperature", lag, lag, functools.partial(_lagged, low.times, means - means.mean(), lag)) for lag in lags]
        shapes["temperature"] = listed, _ordinates_of(low, listed)
    kept = len(low.factor)
    records = [low.transform(axis.record[: len(low.times) * size].reshape(-1, size).mean(axis=1)) for axis in axes]
    bases = [axis.columns[:kept, ~axis.slow] @ axis.theta[~axis.slow] for axis in axes]
    slows = [axis.columns[:kept, axis.slow] for axis in axes]
    if not all(np.all(base > 0.0) for base in bases):
        return Changes()
    levels = {family: _level(family, len(axes)) for family in shapes}
    found: list[Change] = []
    held = np.zeros((kept, 0))
    fitted, cost = _refitted(records, held, slows, bases, [axis.theta[axis.slow] for axis in axes])
    shifts = [Change("shift", at, 0.0, functools.partial(_event, at, 0.0)) for at in joints if 0.0 < at < n * dt]
    if shifts:
        x = _ordinates_of(low, shifts)
        level = _densities(bases, slows, fitted)
        ratios = sum(_ratios(record, one, x) for record, one in zip(records, level, strict=True))
        sure = np.flatnonzero(ratios > _level("shift", len(axes)))
        found = [shifts[i] for i in sure]
        held = x[sure, :, 0].T
        fitted, cost = _refitted(records, held, slows, bases, fitted)
    instead: tuple[float, Change | None] = _level("K", len(axes)), None
    plain = [slow[:, ~axis.walk] for slow, axis in zip(slows, axes, strict=True)]
    while sum(one.family != "shift" for one in found) < _MOST:
        tried: dict[tuple[str, int], float] = {}
        for level in (_densities(bases, slows, fitted), bases):
            rests = [_residual(record, held, one) for record, one in zip(records, level, strict=True)]
            for family, (_, x) in shapes.items():
                ratios = np.sum([_ratios(rest, one, x) for rest, one in zip(rests, level, strict=True)], axis=0)
                best = int(np.argmax(ratios))
                if ratios[best] > min(levels[family], instead[0]):
                    tried[family, best] = levels[family]
        best = None
        for (family, index), level in tried.items():
            design = np.column_stack([held, shapes[family][1][index]])
            theta, less = _refitted(records, design, slows, bases, fitted)
            gain = cost - less - level
            if gain > 0.0 and (best is None or gain > best[0]):
                best = gain, shapes[family][0][index], design, theta, less
            if not any(np.any(one[axis.walk] > 0.0) for one, axis in zip(fitted, axes, strict=True)):
                continue  # there is no K that could be something else
            less_alone = _refitted(records, design, plain, bases, [one[~axis.walk] for one, axis in zip(fitted, axes, strict=True)])[1]
            instead = max(instead, (cost - less_alone, shapes[family][0][index]), key=lambda one: one[0])
        if best is None:
            break
        _, change, held, fitted, cost = best
        found.append(change)
        instead = _level("K", len(axes)), None
    return Changes(tuple(found), instead[1])


def _densities(bases: Sequence[AnyArray], slows: Sequence[AnyArray], fitted: Sequence[AnyArray]) -> list[AnyArray]:
    return [base + slow @ theta for base, slow, theta in zip(bases, slows, fitted, strict=True)]


def _residual(record: AnyArray, held: AnyArray, density: AnyArray) -> AnyArray:
    """The record less its regression on the columns in `held`, weighted by a density."""
    if not held.shape[1]:
        return record
    x = held / np.sqrt(density)[:, None]
    return record - held @ np.linalg.lstsq(x, record / np.sqrt(density), rcond=None)[0]


def _refitted(records, design, slows, bases, begun) -> tuple[list[AnyArray], float]:
    """Slow coefficients of each axis beside the columns of a design, and -2 log likelihood of all axes."""
    starts, count = log_groups(len(records[0]), keep_tail=True)
    count = count.astype(float)

    def means(values):
        return np.add.reduceat(values, starts, axis=0) / count.reshape(-1, *(1,) * (values.ndim - 1))

    fits, total = [], 0.0
    for record, slow, base, theta in zip(records, slows, bases, begun, strict=True):
        columns, level = means(slow), means(base)
        for _ in range(_ROUNDS if design.shape[1] else 1):
            target = means(_residual(record, design, base + slow @ theta) ** 2)
            if slow.shape[1]:
                # the likelihood has local maxima: one start is the last fit, the other has little of every term
                flat = np.median(target / level) * (level[:, None] / columns).min(axis=0)
                tried, costs = scoring(columns, target, count, np.stack([theta, np.maximum(flat, 1e-6 * theta)]), level)
                theta = tried[np.argmin(costs)]
        s = level + columns @ theta
        fits.append(theta)
        total += float(np.sum(count * (np.log(s) + target / s)))
    return fits, total
