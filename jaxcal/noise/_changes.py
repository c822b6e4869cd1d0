r"""Changes of the mean that look like slow noise: an event, a warm-up, a slow sinusoid, the temperature.

They act on all axes of a sensor, are searched in all of them together, and enter the likelihood as regressors with a size for each axis.
An event is a relaxation

.. math:: x(t) \propto 1 - e^{-(t - t_0)/T},\qquad t > t_0

which is a step at T = 0, a line at T = \infty, and a warm-up where it begins with the record; a warm-up may have two time constants, which
also describe a creep. The search uses the lowest ordinates of the records and the likelihood ratio at a fixed density of the noise,

.. math:: \lambda = \sum_\mathrm{axes}\frac{(\sum x_k y_k/S_k)^2}{\sum x_k^2/S_k}

once under the fitted density, in which B and K may already describe the change as noise, and once under the density of N and Q alone. The
slow noise is then fitted again beside the best shape of each family, and the likelihood ratio of the fits with and without it compared with
a level that at most one in 300 records of noise alone reaches. A change is real with a probability, its share, of

.. math:: 1/(1 + e^{(\mathrm{level} - \mathrm{ratio})/2})

which are the likelihoods of both, with even odds at the level. One change after another is added, until one has a share below a half. The
fit takes the expected ordinates over changes of these shares, so that a small change of the record never switches one on or off.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import decaying_sum, product
from .._types import AnyArray
from ..spectrum._average import log_groups
from ._likelihood import scoring
from ._terms import Term

#: block means of a record, which have the same lowest ordinates; ordinates that the search uses; rounds of the regression and the fit of
#: the noise; changes of one record; halvings of the distance in which the place of an event is sought beside those of the grid
_BLOCKS, _ORDINATES, _ROUNDS, _MOST, _HALVINGS = 1024, 256, 2, 3, 3
_NEAR = np.array([[0, 0, 0, -1, -1, -1, 1, 1, 1], [0, -1, 1] * 3])  # starts and times beside one
#: over the length of the record: times at which an event may begin, its time constants, and those with which a sensor follows its
#: temperature; cycles of a sinusoid in the record
_STARTS = np.arange(96) / 96
_TIMES = np.array([0.0, *2.0 ** np.arange(-7, 1), np.inf])
_LAGS, _CYCLES = np.array([0.0, 0.003, 0.01, 0.03, 0.1]), np.arange(0.5, 10.01, 0.25)
#: likelihood ratio for one axis that one in 300 records of noise alone reaches in the search of a family; a shift has a known place, and
#: 2.6 standard errors suffice. By how much less a change without K must be better than K to be named "beside" K: of records of 22 minutes,
#: K alone reaches it in 30 %, and one event in twenty-five does not; the exact Bayes factor does little better (`benchmarks/real_noise.py`)
_LEVELS = {"shift": 6.8, "event": 20.0, "edge": 13.0, "edges": 18.0, "sinusoid": 20.0, "temperature": 12.0, "beside": 13.25}
_EVIDENT = 0.1  # share of the likelihood ratio of K itself by which the change must be better, too
_FAINT = 0.05  # a change of a smaller share is left out, which moves no coefficient by a tenth of its error


class Change(NamedTuple):
    """A change: its family, when it begins, its time constant or period, both in s, and its regressors, (n, columns), at given times."""

    family: str
    start: float
    time: float
    columns: Callable[[AnyArray], AnyArray]


class Changes(NamedTuple):
    """The changes that are fitted and the share of each, and one that describes the record about as well as K does, or None."""

    fitted: tuple[Change, ...] = ()
    shares: tuple[float, ...] = ()
    instead: Change | None = None

    @property
    def likely(self) -> tuple[Change, ...]:
        """Those that are more likely than not."""
        return tuple(one for one, share in zip(self.fitted, self.shares, strict=True) if share > 0.5)


class Sensor(NamedTuple):
    """A sensor for the search: the records (n,) of its axes without gaps, and their coefficients, (axes, p); times in s at which it may
    have moved, so that any shift of the mean is one; its temperature at the samples, without NaN, or None.
    """

    records: Sequence[AnyArray]
    theta: AnyArray
    joints: Sequence[float] = ()
    temperature: AnyArray | None = None


class _Low(NamedTuple):
    """Times at the middles of the blocks of a record, and factors that turn a DCT-II of block means into the lowest ordinates."""

    times: AnyArray
    factor: AnyArray

    def transform(self, x: AnyArray) -> AnyArray:
        """Ordinates of functions given at `times`, the first axis."""
        return (self.factor * np.asarray(scipy.fft.dct(x, norm="ortho", axis=0))[1 : len(self.factor) + 1].T).T

    def family(self, changes: list[Change]) -> tuple[list[Change], AnyArray, AnyArray]:
        """Changes, the ordinates of their regressors, (ordinates, changes, columns), and the products of these."""
        x = self.transform(np.stack([change.columns(self.times) for change in changes], axis=1))
        return changes, x, x[:, :, :, None] * x[:, :, None, :]


@functools.lru_cache(maxsize=8)
def _low(n: int, most: int, dt: float) -> tuple[_Low, int]:
    size = max(n // _BLOCKS, 1)
    count = n // size
    k = np.arange(1, min(_ORDINATES, most, max(count // 4, 8)) + 1)
    # a mean over a block attenuates the ordinates
    attenuated = np.sin(np.pi * k / (2 * count)) / (size * np.sin(np.pi * k / (2 * count * size)))
    return _Low((np.arange(count) + 0.5) * size * dt, np.sqrt(size * dt) / attenuated), size


def _means(record: AnyArray, low: _Low, size: int) -> AnyArray:
    return record[: len(low.times) * size].reshape(-1, size).mean(axis=1)


def _event(start: float, *times: float) -> Change:
    """Relaxations from a start with these time constants."""
    return Change("step" if start else "warm_up", start, times[0], functools.partial(_relaxations, start, times))


def _relaxations(start: Any, times: Any, t: AnyArray) -> AnyArray:
    """(n, times), each from its start or all from one; each changes by one over the record."""
    times, t, size = np.asarray(times), np.asarray(t)[:, None], round(len(t) ** 0.5) + 1
    finite, line = np.where(times > 0.0, times, np.inf), times == np.inf
    # exponentials at evenly spaced times, as products
    left = np.exp((start - t[::size]) / finite)[:, None] * np.exp((t[0] - t[:size]) / finite)
    shapes = left.reshape(-1, len(times))[: len(t)]
    np.subtract(1.0, shapes, out=shapes)
    shapes[:, times == 0.0] = 1.0
    if line.any():
        shapes[:, line] = (t - start + np.zeros(len(times)))[:, line]
    shapes *= t > start
    shapes /= np.maximum(shapes[-1], np.finfo(float).tiny)
    return shapes


def _wave(frequency: float, t: AnyArray) -> AnyArray:
    """(n, 2) cosine and sine at evenly spaced times, by the sums of the angles at the first of some times and after it."""
    angle, size = 2 * np.pi * frequency * np.asarray(t), round(len(t) ** 0.5) + 1
    turns = np.exp(1j * angle[::size])[:, None] * np.exp(1j * (angle[:size] - angle[0]))
    return turns.ravel()[: len(t), None].view(float)


def _lagged(times: AnyArray, values: AnyArray, lag: float, t: AnyArray) -> AnyArray:
    """The temperature after a first-order lag in s."""
    if lag:
        keep = float(np.exp(-(times[1] - times[0]) / lag))
        values = values[0] + (1.0 - keep) * decaying_sum(np.asarray(values - values[0]), keep)
    return np.asarray(np.interp(t, times, values))[:, None]


@functools.lru_cache(maxsize=8)
def _shapes(n: int, most: int, dt: float) -> dict[str, tuple[list[Change], AnyArray, AnyArray]]:
    """Family -> its changes with their ordinates."""
    low, _ = _low(n, most, dt)
    length = n * dt
    families = {
        "event": [_event(start * length, time * length) for time in _TIMES for start in _STARTS[1:]],
        "edge": [_event(0.0, time * length) for time in _TIMES[1:]],
        "edges": [_event(0.0, one * length, other * length) for i, other in enumerate(_TIMES[:-1]) for one in _TIMES[1:i]],
        "sinusoid": [Change("sinusoid", 0.0, length / c, functools.partial(_wave, c / length)) for c in _CYCLES],
    }
    return {family: low.family(listed) for family, listed in families.items()}


def _ratios(rests: AnyArray, densities: AnyArray, x: AnyArray, products: AnyArray) -> AnyArray:
    """Likelihood ratio (..., changes) of each change over the records of all axes, (..., axes, ordinates), of these densities."""
    _, count, p = x.shape
    # one product for all records of all densities
    score = product((rests / densities).reshape(-1, len(x)), x.reshape(len(x), -1)).reshape(*rests.shape[:-1], count, p)
    size = product((1.0 / densities).reshape(-1, len(x)), products.reshape(len(x), -1)).reshape(*score.shape, p)
    if p == 1:
        return np.sum(score**2 / np.maximum(size[..., 0], np.finfo(float).tiny), axis=(-3, -1))
    return np.sum(score * np.linalg.solve(size, score[..., None])[..., 0], axis=(-3, -1))


def _sharpened(events: Sequence[Change], low: _Low, rests: AnyArray, densities: AnyArray) -> list[tuple[Change, AnyArray]]:
    """The events between those of the grid, and their ordinates (ordinates, 1), that describe the rests (events, axes, ordinates) best."""
    starts, times = np.array([[one.start, one.time] for one in events]).T[:, :, None]
    away, apart = 0.5 * (low.times[-1] + low.times[0]) * _STARTS[1] * (starts > 0.0), 0.5 * ((times > 0.0) & (times < np.inf))
    white, precision, each = rests / densities, 1.0 / densities, np.arange(len(events))
    moves = _NEAR[:, : None if starts.any() else 3]
    for _ in range(_HALVINGS):
        starts, times = starts + away * moves[0], times * 2.0 ** (apart * moves[1])
        near = low.transform(_relaxations(starts.ravel(), times.ravel(), low.times)).reshape(-1, *starts.shape).swapaxes(0, 1)
        ratios = np.sum((white @ near) ** 2 / np.maximum(precision @ near**2, np.finfo(float).tiny), axis=1)
        best = np.argmax(ratios, axis=1)
        starts, times, away, apart = starts[each, best, None], times[each, best, None], away / 2.0, apart / 2.0
    return [(_event(float(starts[i, 0]), float(times[i, 0])), near[i, :, [k]].T) for i, k in enumerate(best)]


@functools.cache
def _level(family: str, axes: int, looks: int = 1) -> float:
    """Likelihood ratio that so many axes together reach in any of several looks as often as one axis reaches its level in one."""
    degrees = 1.0 if family in ("sinusoid", "edges") else 0.5
    rare = scipy.special.gammaincc(degrees, _LEVELS[family] / 2.0) / looks
    return 2.0 * float(scipy.special.gammainccinv(degrees * axes, rare))


@functools.lru_cache(maxsize=8)
def lowest_of(n: int, dt: float, columns: tuple[Term, ...]) -> AnyArray:
    """Expected lowest ordinates of n samples per squared coefficient, (ordinates, p), at which changes of the mean are searched."""
    k = np.arange(1, min(_ORDINATES, n - 1) + 1)
    return np.stack([term.ordinates(k, n, dt) for term in columns], axis=1)


def find_changes(sensors: Sequence[Sensor], columns: AnyArray, slow: AnyArray, walk: AnyArray, dt: float) -> list[Changes]:
    """The changes of the mean that explain the records of each sensor better than slow noise alone does; all have equally many axes.

    `columns`, (ordinates, p), are the expected first ordinates per squared coefficient, of which the `slow` ones are fitted again, and of
    these the `walk` is K.
    """
    n = len(sensors[0].records[0])
    (low, size), shapes = _low(n, len(columns), dt), _shapes(n, len(columns), dt)
    kept, theta = len(low.factor), np.array([one.theta for one in sensors])
    records = low.transform(np.array([[_means(x, low, size) for x in one.records] for one in sensors]).T).T
    bases, columns, axes = theta[..., ~slow] @ columns[:kept, ~slow].T, columns[:kept, slow], records.shape[1]
    warm = {i: _warmth(_means(one.temperature, low, size), low, n * dt) for i, one in enumerate(sensors) if one.temperature is not None}
    levels = {family: _level(family, axes) for family in (*shapes, "temperature")}
    found: list[list[tuple[Change, float]]] = [[] for _ in sensors]  # with their shares
    held: list[AnyArray] = [np.zeros((kept, 0)) for _ in sensors]
    none = (-_LEVELS["beside"], None)
    instead: list[tuple[float, Change | None]] = [none for _ in sensors]
    on = np.flatnonzero(np.all(bases > 0.0, axis=(1, 2)))
    fitted, cost = theta[..., slow], np.zeros(len(sensors))

    def refit(places: AnyArray) -> None:
        fitted[places], cost[places] = _refitted(records[places], columns, bases[places], [held[i] for i in places], fitted[places])

    if len(on):
        refit(on)
    for i in on.tolist():
        if shifts := [_event(at, 0.0)._replace(family="shift") for at in sensors[i].joints if 0.0 < at < n * dt]:
            _, x, products = low.family(shifts)
            ratios = _ratios(records[i], bases[i] + fitted[i] @ columns.T, x, products)
            shares = scipy.special.expit(0.5 * (ratios - _level("shift", axes, len(shifts))))
            found[i] = [(shifts[k], float(shares[k])) for k in np.flatnonzero(shares > _FAINT)]
            held[i] = x[:, shares > 0.5, 0]
            refit(np.array([i]))
    while len(on):
        both = np.stack([bases[on] + fitted[on] @ columns.T, bases[on]], axis=1)
        rests = _residuals(records[on, None], _padded([held[i] for i in on])[:, None], both)
        families = [(slice(None), *one) for one in shapes.items()]
        families += [(slice(k, k + 1), "temperature", warm[i]) for k, i in enumerate(on.tolist()) if i in warm]
        tried = _candidates(rests, both, families, levels, low)
        if not tried:
            break
        # each with K and without, and no change without K
        places = on[np.array([place for place, *_ in tried])]
        designs = [np.column_stack([held[i], x]) for i, (*_, x) in zip(places, tried, strict=True)]
        every, several = np.concatenate([places, places, on]), [*designs, *designs, *(held[i] for i in on)]
        without = np.broadcast_to(walk & (np.arange(len(every)) >= len(places))[:, None, None], fitted[every].shape)
        thetas, costs = _refitted(records[every], columns, bases[every], several, np.where(without, 0.0, fitted[every]), without)
        mine, others, alone = np.split(costs, [len(places), 2 * len(places)])
        before = cost[places] - [levels[one[1]] for one in tried]
        gains, others = before - mine, before - others
        others -= _EVIDENT * (alone - cost[on])[np.searchsorted(on, places)]
        going = []
        for i in np.unique(places).tolist():
            own = np.flatnonzero(places == i)
            best, other = int(own[np.argmax(gains[own])]), int(own[np.argmax(others[own])])
            if np.any(fitted[i][:, walk] > 0.0):
                instead[i] = max(instead[i], (float(others[other]), tried[other][2]), key=lambda one: one[0])
            if (share := float(scipy.special.expit(0.5 * gains[best]))) > _FAINT:
                found[i].append((_at_its_instant(tried[best][2], sensors[i].records, dt, size), share))
            if share > 0.5:
                held[i], fitted[i], cost[i], instead[i] = designs[best], thetas[best], costs[best], none
                going += [i] if sum(one.family != "shift" for one, _ in found[i]) < _MOST else []
        on = np.array(going, dtype=int)
    parts = zip(found, instead, strict=True)
    return [Changes(tuple(one for one, _ in own), tuple(share for _, share in own), other) for own, (_, other) in parts]


def _warmth(means: AnyArray, low: _Low, duration: float) -> tuple[list[Change], AnyArray, AnyArray]:
    """The family of changes that follow a temperature."""
    course = functools.partial(_lagged, low.times, means - means.mean())
    return low.family([Change("temperature", 0.0, lag, functools.partial(course, lag)) for lag in (duration * _LAGS).tolist()])


def _candidates(rests, both, families, levels, low: _Low) -> list[tuple[int, str, Change, AnyArray]]:
    """(place of the sensor, family, change, its ordinates) of the best shape of each of the `families`, which belong to a part of the
    sensors, under each density, (sensors, densities, axes, ordinates), if it could reach its level.
    """
    tried: list[Any] = []
    for part, family, (listed, x, products) in families:
        ratios = _ratios(rests[part], both[part], x, products)
        at = np.nonzero(np.max(ratios, axis=-1) > levels[family] - _LEVELS["beside"])
        found = [(listed[k], x[:, k]) for k in np.argmax(ratios, axis=-1)[at]]
        if found and family in ("event", "edge"):
            found = _sharpened([one for one, _ in found], low, rests[part][at], both[part][at])
        tried += [(place, family, *one) for place, one in zip((at[0] + (part.start or 0)).tolist(), found, strict=True)]
    return tried


def _at_its_instant(change: Change, records: Sequence[AnyArray], dt: float, size: int) -> Change:
    """A step, at the sample between which and the next the means of the records beside it differ most."""
    if change.family != "step" or change.time:
        return change
    first = max(round(change.start / dt) - 2 * size, 0)
    near = np.stack([record[first : first + 4 * size] for record in records])
    count = np.arange(1, near.shape[1])
    rise = np.cumsum(near - near.mean(axis=1, keepdims=True), axis=1)[:, :-1]
    spread = np.maximum(np.var(near, axis=1, keepdims=True), np.finfo(float).tiny)  # an axis may be constant here
    best = int(np.argmax(np.sum(rise**2 / spread, axis=0) / (count * (near.shape[1] - count))))
    return _event((first + best + 0.5) * dt, 0.0)


def _padded(designs: Sequence[AnyArray]) -> AnyArray:
    """Designs (ordinates, columns) in one table, with columns of zeros where they have fewer."""
    found = np.zeros((len(designs), len(designs[0]), max(design.shape[1] for design in designs)))
    for own, design in zip(found, designs, strict=True):
        own[:, : design.shape[1]] = design
    return found


def _residuals(records: AnyArray, held: AnyArray, densities: AnyArray) -> AnyArray:
    """The records (..., axes, ordinates) less their regression on the columns `held`, (..., ordinates, columns), weighted by densities."""
    if not held.shape[-1]:
        return np.broadcast_to(records, densities.shape)
    x = held[..., None, :, :] / np.sqrt(densities)[..., None]
    x = x / np.maximum(np.sqrt(np.sum(x**2, axis=-2, keepdims=True)), np.finfo(float).tiny)
    white, turned = (records / np.sqrt(densities))[..., None], np.swapaxes(x, -1, -2)
    # columns of zeros, and equal ones, have no inverse
    back = np.linalg.solve(turned @ x + x.shape[-2] * np.finfo(float).eps * np.eye(x.shape[-1]), turned @ white)
    return np.sqrt(densities) * (white - x @ back)[..., 0]


def _refitted(records, columns, bases, designs, begun, held: Any = False) -> tuple[AnyArray, AnyArray]:
    """Slow coefficients beside the columns of each design, (designs, axes, p), of records (designs, axes, ordinates), and -2 log likelihood
    of all axes. `begun` are those of a last fit, of which some are `held`.
    """
    starts, count = log_groups(len(columns), keep_tail=True)

    def means(values):
        return np.add.reduceat(values, starts, axis=-1) / count

    columns_of, levels, theta = means(columns.T).T, means(bases), begun
    padded = _padded(designs)
    for _ in range(_ROUNDS if padded.shape[-1] else 1):
        target = means(_residuals(records, padded, bases + theta @ columns.T) ** 2)
        if columns.shape[1]:
            searches = (target, theta, levels, np.broadcast_to(held, theta.shape))
            goal, start, own, stays = (values.reshape(-1, values.shape[-1]) for values in searches)
            theta = scoring(columns_of, goal, count, start, own, stays)[0].reshape(theta.shape)
    s = levels + theta @ columns_of.T
    return theta, np.sum(count * (np.log(s) + target / s), axis=(1, 2))
