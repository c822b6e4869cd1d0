r"""Find stretches of a record that are no noise of a sensor at rest: knocks, movement, steps of the mean, single outliers.

At lags of h = 1, 2, 4 ... samples, finest first, a look compares the means of h samples after and before an instant,

.. math:: d(t) = \frac1h\sum_{i=t}^{t+h-1} x_i - \frac1h\sum_{i=t-h}^{t-1} x_i,\qquad z(t) = \sum_{axes} (d/s)^2

with s the robust spread of d at this lag. So K and B, which spread the looks at long lags, raise s there and are no event. What is found
leaves the record before the next lag, and the levels before and after it are joined where they differ.
"""

import functools
import itertools

import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import running_sum, runs
from .._types import Samples
from ._values import CHANCE, EFFICIENCY, FEW, HIDDEN, SAMPLE, columns_of, resolution

#: overlapping looks are few independent ones: the tail of a block's energy is that much longer than the normal one of its cube root
_HEAVIER = 1.25
#: s: the longest lag; what takes longer is movement, which shorter lags find
LONGEST = 5.0
#: independent pairs of means that a record must hold at a lag, so that their spread is known to 10 %
_PAIRS = 32
#: looks in a block, and blocks in the running median of their energies: slow changes of the noise are no event
_BLOCK, _RUNNING = 64, 65
#: a block whose mean square is this many times that of the quietest quarter moves; levels of noise differ less
_GROSS = 16.0
#: mean of z over the axes above which a look belongs to an event whose blocks are loud; noise has 1
_EVENT = 3.0
#: energies of a decaying event, over that at which noise hides it, between which its decay is measured; and means a second for that
_LOUD, _MEANS = (8.0, 256.0), 50.0
#: s: looks name the end of a swing that dies away within this time (1,210 put-downs: 0.9 s); what ends farther off does not decay
_OPEN = 1.0
#: quantiles of |d| -> those of a normal law: the larger of the two spreads counts, so that tails and coarse values are no events
_SPREADS = {0.5: 0.6745, 0.9: 1.6449}


def bursts(values: Samples, rate: float | int) -> list[tuple[int, int]]:
    """Stretches that are no noise of a sensor at rest: knocks, movement, steps of the mean, outliers, and runs of stuck readings.

    Parameters
    ----------
    values : (n,) or (n, axes) readings of one sensor, whose axes are looked at together; NaN where missing.
    rate : Hz.

    Returns
    -------
    list of (first, last)
        Ranges of samples to set aside, `last` not included, in order and disjoint. At most 1 % of records of noise alone have one.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.evidence import bursts
    >>> y = np.random.default_rng(0).normal(size=(20_000, 3))
    >>> bursts(y, 100.0)
    []
    >>> y[5_000:5_100, 0] += 12 * np.sin(np.linspace(0, np.pi, 100))
    >>> [(first, last)] = bursts(y, 100.0)
    >>> 4_950 < first < 5_020, 5_080 < last < 5_150
    (True, True)
    """
    known = columns_of(values)
    record = _Record(known, rate)
    out = np.zeros(record.size, bool)
    if (held := stuck(record.columns)).any():
        out[record.index] = held
        record.drop(out)
    h = 1
    while h <= record.longest:
        new = record.events(h)
        if new.any():
            out |= new
            _fill(out, record.longest)
            record.drop(out)
        h *= 2
    rows = np.flatnonzero(record.present)  # a gap inside is part of a stretch, one beside it is not
    starts, stops = runs(out[rows])
    found = list(zip(rows[starts].tolist(), (rows[stops - 1] + 1).tolist(), strict=True))
    following = itertools.pairwise([*found, (len(known), 0)])
    return [(first, _carried(known, first, last, after, rate)) for (first, last), (after, _) in following]


class _Record:
    """The readings that are still in, as one column for each axis without gaps, and the rows of the record that they come from."""

    def __init__(self, values: np.ndarray, rate: float):
        known = np.isfinite(values)
        count = [np.count_nonzero(column) for column in known.T]
        enough = 0.5 * max(1, *count)  # an axis that stopped costs the others nothing
        alive = [i for i, column in enumerate(values.T) if count[i] >= enough and np.fmin.reduce(column) < np.fmax.reduce(column)]
        self.size = len(values)
        self.present = np.logical_and.reduce([known[:, i] for i in alive]) if alive else np.zeros(self.size, bool)
        self.index = np.flatnonzero(self.present)
        self.columns = [values[:, i] if len(self.index) == self.size else values[self.index, i] for i in alive]
        self.columns = [column - _quantile(column[:: len(column) // SAMPLE + 1], 0.5) for column in self.columns if len(column)]
        self.steps = [resolution(column) for column in self.columns]
        self.hidden = np.array([_hidden(column) for column in self.columns])
        self.longest = min(round(LONGEST * rate * len(self.index) / max(self.size, 1)), len(self.index) // (2 * _PAIRS))
        self._sum()
        self.room = np.empty((len(self.columns), len(self.index)))  # for the looks of any lag
        self.tails = False  # whether single outliers are tails of the noise
        self.lags = max(self.longest, 1).bit_length()
        step = max(self.longest // 4, 1)
        h = self.longest // step * step
        self.slow = self._spread(self.looks(h, step), h) if h else np.ones(0)

    def _sum(self) -> None:
        self.sums = np.zeros((len(self.columns), len(self.index) + 1))
        for row, column in zip(self.sums, self.columns, strict=True):
            row[1:] = column
            running_sum(row[1:])

    def looks(self, h: int, step: int) -> np.ndarray:
        """(axes, looks) squares of the looks d at every `step` samples, the first at sample h, a multiple of the step; in parts that fit a
        cache.
        """
        out = self.room[:, : max((len(self.index) - 2 * h) // step + 1, 0)]
        lag = h // step
        for row, c in zip(out, self.sums, strict=True):
            for first in range(0, len(row), SAMPLE):
                d = row[first : first + SAMPLE]
                before, after = (c[i : i + step * (len(d) + lag - 1) + 1 : step] for i in (first * step, first * step + h))
                means = after - before
                means *= 1.0 / h
                np.subtract(means[lag:], means[:-lag], out=d)
                d *= d
        return out

    def _spread(self, looks: np.ndarray, h: int) -> np.ndarray:
        """Robust spread of the looks of each axis, which is known to half the step of a mean."""
        found = []
        for squares, step, hidden in zip(looks, self.steps, self.hidden, strict=True):
            sizes = np.sqrt(_quantile(squares[:: len(squares) // SAMPLE + 1], *_SPREADS))
            found.append(np.max(sizes / list(_SPREADS.values())) + max(0.5 * step / h, hidden / np.sqrt(h)))
        return np.array(found)

    def events(self, h: int) -> np.ndarray:
        """(size,) whether a reading belongs to an event at lag h."""
        out = np.zeros(self.size, bool)
        step = max(h // 4, 1)
        looks = self.looks(h, step)  # none, if events have taken most of the record
        axes, count = looks.shape
        if count < 2 * _PAIRS:
            return out
        energy = np.einsum("abk->ab", _blocks(looks)) / _BLOCK
        gross = np.any(energy > _GROSS * (_quantile(energy, 0.25) + self.hidden**2)[:, None], axis=0)
        still = looks
        if gross.any() and (quiet := np.append(np.repeat(~gross, _BLOCK), np.ones(count % _BLOCK, bool))).any():
            still = looks[:, quiet]
        spread = self._spread(still, h)
        if not spread.all():
            return out
        z = functools.partial(np.matmul, spread**-2)
        chance = 0.5 * CHANCE / self.lags  # half for single looks, half for the energy of blocks of looks
        limit = _limit(axes, len(self.index) / h, chance / count)
        # in a block whose largest looks stay below the limit together, none exceeds it
        high = np.flatnonzero(z(np.maximum.reduceat(looks, np.arange(0, count, _BLOCK), axis=1)) > limit)
        near = (high[:, None] * _BLOCK + np.arange(_BLOCK)).ravel()
        near = near[near < count]
        size, total = z(looks[:, near]), z(energy)
        whole = high[high < len(total)]
        total[whole] = _blocks(np.minimum(size, limit))[: len(whole)].mean(axis=1)
        loud = gross | _loud(total, axes, chance)
        if not len(near) and not loud.any():
            return out
        found = np.zeros(count, bool)
        found[near] = size > limit
        starts, stops = runs(found)
        single = stops - starts <= 2 * h // step
        # single outliers at one lag, anywhere in the record: the swings of one event are near one another
        apart = len(np.unique(starts[single] * step // self.longest)) > FEW // 2
        self.tails = self.tails or (apart and np.count_nonzero(single) > FEW)
        if self.tails:
            for start, stop in zip(starts[single], stops[single], strict=True):
                found[start:stop] = False
        for start, stop in zip(*runs(loud), strict=True):
            # the event may be shorter than its blocks of looks: it ends where the first and the last of them have their energy
            ends = start * _BLOCK, (stop - 1) * _BLOCK
            first, last = (_loudest(z(looks[:, at : at + _BLOCK]) - _EVENT * axes) for at in ends)
            found[ends[0] + first[0] : ends[1] + last[1]] = True
        starts, stops = runs(found)
        grown = h // 4 + 2
        first = np.maximum(h + starts * step - grown, 0)
        last = np.minimum(h + (stops - 1) * step + grown, len(self.index) - 1)
        for a, b in zip(self.index[first], self.index[last], strict=True):
            out[a : b + 1] = True
        return out

    def drop(self, out: np.ndarray) -> None:
        """Take the rows of events out, and join the levels before and after."""
        kept = ~out[self.index]
        self.columns = [column[kept] for column in self.columns]
        self.index = self.index[kept]
        self._sum()
        self._level()

    def _level(self) -> None:
        """Take out steps of the mean between parts of the record that are as long as the longest lag; shorter parts are events."""
        h = self.longest
        joints = np.flatnonzero(np.diff(self.index) > 1) + 1
        apart = np.diff(np.concatenate([[0], joints, [len(self.index)]]))
        joints = joints[(apart[1:] >= h) & (apart[:-1] >= h)]
        if not len(joints) or not self.slow.all():
            return
        shift = np.array([(c[joints + h] - 2.0 * c[joints] + c[joints - h]) / h for c in self.sums])
        real = np.sum((shift / self.slow[:, None]) ** 2, axis=0) > _limit(len(self.columns), 2 * _PAIRS, CHANCE / len(joints))
        if not real.any():
            return
        for column, moved in zip(self.columns, shift, strict=True):
            step = np.zeros(len(column))
            step[joints[real]] = moved[real]
            column -= np.cumsum(step)
        self._sum()


def _hidden(column: np.ndarray) -> float:
    """The smallest change, if most readings equal the one before: the step of the values hides the noise, and nothing smaller is an event.

    The step itself is not known where changes are few.
    """
    if np.count_nonzero(column[1:] != column[:-1]) >= (1.0 - HIDDEN) * (len(column) - 1):
        return 0.0
    size = np.abs(np.diff(column))
    return float(np.min(size, where=size > 0.0, initial=np.inf))


def _blocks(values: np.ndarray) -> np.ndarray:
    """(..., blocks, looks in a block) a view of the values, without the rest behind the last block."""
    count = values.shape[-1] // _BLOCK
    return values[..., : count * _BLOCK].reshape(*values.shape[:-1], count, _BLOCK)


def _quantile(values: np.ndarray, *shares: float) -> np.ndarray:
    """Of the last axis, (..., shares) or (...) of a single one, ascending; the nearest values, much faster than `numpy.quantile`."""
    found, first, count = [], 0, values.shape[-1]
    for place in (round(share * (count - 1)) for share in shares):  # two places at once take several times as long
        values = np.partition(values, place - first)[..., place - first :]  # a larger quantile lies among these
        found.append(values[..., 0])
        first = place
    return np.stack(found, axis=-1) if len(shares) > 1 else found[0]


def _loud(energy: np.ndarray, axes: int, chance: float) -> np.ndarray:
    """Blocks whose energy exceeds the running median; the cube root of an energy is nearly normal (Wilson and Hilferty, 1931)."""
    total = np.cbrt(energy)
    if len(total) < _RUNNING:
        return np.zeros(len(total), bool)
    over = total - scipy.ndimage.median_filter(total, _RUNNING, mode="nearest")
    scatter = 1.4826 * _quantile(np.abs(over), 0.5)
    limit = -_HEAVIER * scatter * scipy.special.stdtrit(EFFICIENCY * len(total), chance / len(total))
    return (over > limit) & (total > np.cbrt(axes))


def _loudest(excess: np.ndarray) -> tuple[int, int]:
    """First and last of the consecutive values with the largest sum, the last not included."""
    total = np.concatenate([[0.0], np.cumsum(excess)])
    last = int(np.argmax(total - np.minimum.accumulate(total)))
    return int(np.argmin(total[: last + 1])), last


def _limit(axes: int, pairs: float | int, chance: float) -> float:
    """What z exceeds by chance: F, since the spread is found from so many pairs of means."""
    return float(axes * scipy.special.fdtri(axes, EFFICIENCY * pairs, 1.0 - chance))


def _carried(values: np.ndarray, first: int, last: int, most: int, rate: float) -> int:
    """The end of an event. If its energy decays, that is carried on: where noise hides a swing is a matter of chance, and of the lag."""
    rest = values[last : min(last + round(LONGEST * rate), most)]
    rest = rest[np.isfinite(rest).all(axis=1)]
    if len(rest) < rate:
        return last
    step, spread = max(round(rate / _MEANS), 1), np.var(rest, axis=0)
    event = values[first : min(last + (last - first) // 2, most)] - np.mean(rest, axis=0)
    event = np.nan_to_num(event[: len(event) // step * step]).reshape(-1, step, values.shape[1]).mean(axis=1)
    left = np.cumsum((event**2 * step / np.where(spread > 0.0, spread, np.inf)).sum(axis=1)[::-1] - np.count_nonzero(spread))[::-1]
    limit = _limit(values.shape[1], len(rest), CHANCE / (2 * len(values)))
    late, early = (np.flatnonzero(left > times * limit) for times in _LOUD)
    if not len(early):
        return last
    ends = first + (late[-1] + 1) * step, first + (early[-1] + 1) * step
    end = round(ends[0] + (ends[0] - ends[1]) * np.log(_LOUD[0]) / np.log(_LOUD[1] / _LOUD[0]))
    return end if abs(end - last) < _OPEN * rate and first < end <= most else last


def _fill(out: np.ndarray, longest: int) -> None:
    """Fill, in place, what lies between two stretches and is shorter than both together and than the longest lag: the top of a knock."""
    starts, stops = runs(out)
    length = stops - starts
    close = starts[1:] - stops[:-1] < np.minimum(length[1:] + length[:-1], longest)
    for a, b in zip(stops[:-1][close], starts[1:][close], strict=True):
        out[a:b] = True


def stuck(columns: list[np.ndarray]) -> np.ndarray:
    """(n,) whether a reading stands in a run of equal ones of an axis, longer than chance makes in one of 10,000 records."""
    n = len(columns[0]) if columns else 0
    out = np.zeros(n, bool)
    for column in columns:
        equal = column[1:] == column[:-1]
        share = float(np.mean(equal)) if n > 1 else 0.0
        if not 0.0 < 1.5 * share < 1.0:
            continue
        longest = max(np.log(1e-4 / n) / np.log(1.5 * share), 8.0)
        starts, stops = runs(equal)
        long = stops - starts >= longest
        for a, b in zip(starts[long], stops[long], strict=True):
            out[a : b + 1] = True
    return out
