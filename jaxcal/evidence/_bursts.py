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

from .._arrays import quantile, runs
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
#: looks in a lag, where it has as many samples
_STEPS = 4
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
    for h in (1 << k for k in range(record.longest.bit_length())):
        new = record.events(h)
        if new.any():
            out |= new
            _fill(out, record.longest)
            record.drop(out)
    if not out.any():
        return []
    rows = np.flatnonzero(record.present)  # a gap inside is part of a stretch, one beside it is not
    starts, stops = runs(out[rows])
    found = list(zip(rows[starts].tolist(), (rows[stops - 1] + 1).tolist(), strict=True))
    following = itertools.pairwise([*found, (len(known), 0)])
    return [(first, _carried(known, first, last, after, rate)) for (first, last), (after, _) in following]


class _Record:
    """The readings that are still in, as one column for each axis without gaps, and the rows of the record that they come from."""

    def __init__(self, values: np.ndarray, rate: float):
        columns = np.ascontiguousarray(values.T)
        known = np.isfinite(columns)
        count = [np.count_nonzero(one) for one in known]
        enough = 0.5 * max(1, *count)  # an axis that stopped costs the others nothing
        alive = [i for i, column in enumerate(columns) if count[i] >= enough and np.fmin.reduce(column) < np.fmax.reduce(column)]
        self.size = len(values)
        self.present = functools.reduce(np.logical_and, known[alive]) if alive else np.zeros(self.size, bool)
        self.columns = [columns[i] if self.present.all() else columns[i, self.present] for i in alive]
        self.columns = [_levelled(column) for column in self.columns if len(column)]
        self.count = len(self.columns[0]) if self.columns else 0
        self.steps = np.array([resolution(column) for column in self.columns])
        self.hidden = np.array([_hidden(column) for column in self.columns])
        self.longest = min(round(LONGEST * rate * self.count / max(self.size, 1)), self.count // (2 * _PAIRS))
        self.sums, self.summed = self.columns, 1  # of so many samples in a row
        self.room = np.empty((len(self.columns), self.count))  # for the looks of any lag
        self.tails = False  # whether single outliers are tails of the noise
        self.lags = max(self.longest, 1).bit_length()

    @functools.cached_property
    def index(self) -> np.ndarray:
        """The row of each reading."""
        return np.flatnonzero(self.present)

    @functools.cached_property
    def slow(self) -> np.ndarray:
        """Robust spread of the looks of each axis at the longest lag."""
        lag = min(self.longest, _STEPS)
        step = self.longest // lag
        whole = np.arange(self.count // step) * step
        means = [np.convolve(np.add.reduceat(column[: len(whole) * step], whole), np.ones(lag), "valid") for column in self.columns]
        return self._spread(np.array([(one[lag:] - one[:-lag]) ** 2 for one in means]), lag * step) / (lag * step)

    def looks(self, h: int) -> np.ndarray:
        """(axes, looks) squares of h times the looks d, h a power of two, the first at sample h, at every sample or `_STEPS` in a lag.

        Sums over h are those of two halves; they are computed in parts that fit a cache.
        """
        step = max(h // _STEPS, 1)
        while self.summed < step:
            self.sums, self.summed = [c[: len(c) // 2 * 2 : 2] + c[1::2] for c in self.sums], 2 * self.summed
        lag = h // step
        out = self.room[:, : max(self.count // step - 2 * lag + 1, 0)]
        for row, c in zip(out, self.sums, strict=True):
            for first in range(0, len(row), SAMPLE):
                d = row[first : first + SAMPLE]
                total, width = c[first : first + len(d) + 2 * lag - 1], 1
                while width < lag:
                    total, width = total[width:] + total[:-width], 2 * width
                np.subtract(total[lag:], total[:-lag], out=d)
                d *= d
        return out

    def _spread(self, looks: np.ndarray, h: int) -> np.ndarray:
        """Robust spread of h times the looks of each axis, where means are known to half a step of the values."""
        sizes = np.sqrt(quantile(looks[:, :: looks.shape[1] // SAMPLE + 1], *_SPREADS)) / list(_SPREADS.values())
        return sizes.max(axis=1) + np.maximum(0.5 * self.steps, self.hidden * np.sqrt(h))

    def events(self, h: int) -> np.ndarray:
        """(size,) whether a reading belongs to an event at lag h."""
        out = np.zeros(self.size, bool)
        step = max(h // _STEPS, 1)
        looks = self.looks(h)  # none, if events have taken most of the record
        axes, count = looks.shape
        if count < 2 * _PAIRS:
            return out
        energy = np.einsum("abk->ab", _blocks(looks)) / _BLOCK
        gross = np.any(energy > _GROSS * (quantile(energy, 0.25) + (h * self.hidden) ** 2)[:, None], axis=0)
        chance = 0.5 * CHANCE / self.lags  # half for single looks, half for the energy of blocks of looks
        limit = _limit(axes, self.count / h, chance / count)
        if axes == 1 and not gross.any() and _surely_below(looks, limit) and not _loud(energy[0], chance).any():
            return out
        still = looks
        if gross.any() and (quiet := np.append(np.repeat(~gross, _BLOCK), np.ones(count % _BLOCK, bool))).any():
            still = looks[:, quiet]
        spread = self._spread(still, h)
        if not spread.all():
            return out
        z = functools.partial(np.matmul, spread**-2)
        # where the largest looks of several blocks stay below the limit together, none exceeds it
        wide = _STEPS * _BLOCK
        high = np.flatnonzero(z(np.maximum.reduceat(looks, np.arange(0, count, wide), axis=1)) > limit)
        near = (high[:, None] * wide + np.arange(wide)).ravel()
        near = near[near < count]
        size, total = z(looks[:, near]), z(energy)
        whole = near[near < len(total) * _BLOCK][::_BLOCK] // _BLOCK
        total[whole] = _blocks(np.minimum(size, limit))[: len(whole)].mean(axis=1)
        loud = gross | (_loud(total, chance) & (total > axes))
        found = np.zeros(count, bool)
        found[near] = size > limit
        if not found.any() and not loud.any():
            return out
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
        last = np.minimum(h + (stops - 1) * step + grown, self.count - 1)
        for a, b in zip(self.index[first], self.index[last], strict=True):
            out[a : b + 1] = True
        return out

    def drop(self, out: np.ndarray) -> None:
        """Take the rows of events out, and join the levels before and after."""
        slow, kept = self.slow if self.longest else None, ~out[self.index]
        self.columns = [column[kept] for column in self.columns]
        self.index = self.index[kept]
        self.count = len(self.index)
        if slow is not None and slow.all():
            self._level(slow)
        self.sums, self.summed = self.columns, 1

    def _level(self, slow: np.ndarray) -> None:
        """Take out steps of the mean between parts of the record that are as long as the longest lag; shorter parts are events."""
        h = self.longest
        joints = np.flatnonzero(np.diff(self.index) > 1) + 1
        apart = np.diff(np.concatenate([[0], joints, [len(self.index)]]))
        joints = joints[(apart[1:] >= h) & (apart[:-1] >= h)]
        if not len(joints):
            return
        shift = np.array([[c[at : at + h].mean() - c[at - h : at].mean() for at in joints.tolist()] for c in self.columns])
        real = np.sum((shift / slow[:, None]) ** 2, axis=0) > _limit(len(self.columns), 2 * _PAIRS, CHANCE / len(joints))
        for column, moved in zip(self.columns, shift * real, strict=True):
            step = np.zeros(len(column))
            step[joints] = moved
            column -= np.cumsum(step)


def _levelled(column: np.ndarray) -> np.ndarray:
    """Readings about a level near them, so that sums keep their digits; the given ones where they are near zero."""
    part = column[:: len(column) // _BLOCK + 1]
    level = quantile(part, 0.5)
    near = column.flags.c_contiguous and column.dtype == float and abs(level) <= part.max() - part.min()
    return column if near else column - level


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


def _surely_below(looks: np.ndarray, limit: float) -> bool:
    """Whether no look (1, looks) of one axis can exceed the limit, found without the spread: half of them are too large for that."""
    sample = looks[0, :: looks.shape[1] // SAMPLE + 1]
    return bool(2 * np.count_nonzero(sample > _SPREADS[0.5] ** 2 / limit * looks.max()) > len(sample) + 1)


def _loud(energy: np.ndarray, chance: float) -> np.ndarray:
    """Blocks whose energy exceeds the running median; the cube root of an energy is nearly normal (Wilson and Hilferty, 1931)."""
    total = np.cbrt(energy)
    if len(total) < _RUNNING:
        return np.zeros(len(total), bool)
    # of every half window: the level changes little within one, and a long record takes half the time
    half, count = _RUNNING // 2, len(total)
    places = np.arange(half // 2, count + half // 2, half)[:, None] + np.arange(-half, half + 1)
    middle = quantile(total.take(places, mode="clip"), 0.5)
    over = total - np.repeat(middle, half)[:count]
    scatter = 1.4826 * quantile(np.abs(over), 0.5)
    limit = -_HEAVIER * scatter * scipy.special.stdtrit(EFFICIENCY * len(total), chance / len(total))
    return over > limit


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
        share = np.count_nonzero(equal) / max(n - 1, 1)
        if not 0.0 < 1.5 * share < 1.0:
            continue
        longest = max(np.log(1e-4 / n) / np.log(1.5 * share), 8.0)
        starts, stops = runs(equal)
        long = stops - starts >= longest
        for a, b in zip(starts[long], stops[long], strict=True):
            out[a : b + 1] = True
    return out
