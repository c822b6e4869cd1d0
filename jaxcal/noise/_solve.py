"""From the bins of a record to the fit of its noise terms, in the band where the model holds and beside spectral lines."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import runs
from .._errors import DataError
from .._types import AnyArray, Float, Int
from ._likelihood import chance, density, nonnegative, scoring, several_starts
from ._observed import Bins, Observed, beside
from ._terms import Filter, Term

_FILTER = Filter()  # one object: caches compare it at once
FILTER = _FILTER.name
FAST = ("Q", "N", FILTER)  # terms that high frequencies determine, at which nothing else looks like them
_FINE = 1e-12  # gain in log likelihood at which a fit ends
#: most rounds of filling gaps, the change of the density, in standard errors, at which they end, and rounds before the band is looked for
_ROUNDS, SETTLED, _ROUGH = 30, 0.1, 2
#: the goodness of fit compares means over groups of bins with the model: ordinates at which the first groups begin, and the number of
#: groups, of which the later ones are evenly spaced in the logarithm
_FIRST, _GROUPS = (0, 4, 12, 24, 48), 40
#: search for the upper end of the band: relative misfit of the density that is allowed without and with a filter (with 5 %,
#: a filter of the second order at 20 Hz makes N 5 % too large), chance of a worse misfit below which an end is refused, octaves that are
#: looked at, octaves by which the end is then lowered, bins that a band needs in addition to the number of terms
_TOLERANCES, _REFUSED, _OCTAVES, _MARGIN, _FEWEST = (0.01, 0.03), 0.001, 4, 1.0, 20

#: search for lines: farthest neighbour on either side; chance of a false line in the whole spectrum; number of passes
_REACH, _CHANCE, _PASSES = 9, 0.01, 4
#: widest line in bins, including its skirts, of which one of twice the width is none; ratio to the level above which a wider run is a line
#: all the same, and one of half the ratio an error of the first fit; least number of neighbours on each side from which a level is computed
_WIDEST, _TOWERING, _SIDE = 8, 3.0, 4
#: standard deviations below and above the limit of a line between which the share of a bin that is a line grows from 0 to 1; largest
#: chance of a bin that is looked at; the share at the limit
_BELOW, _ABOVE, _NEAR = 0.6, 1.4, 0.01
LINE = _BELOW / (_BELOW + _ABOVE)


class Solved(NamedTuple):
    """Fits of channels: bins, terms, one for each column of the bins; the share of each bin that is a spectral line, and the number of
    ordinates in the fit, zero outside the band and in lines, (channels, bins); coefficients (channels, p) in units of `Bins.unit`; cost.

    misfit : deviance of the spectrum over its degrees of freedom. goodness : chance of a worse deviance. cut : whether high frequencies are
    left out. off : by how many standard errors the last round of filling gaps changed the fit.
    """

    bins: Bins
    columns: tuple[Term, ...]
    lines: AnyArray
    weight: AnyArray
    theta: AnyArray
    cost: AnyArray
    misfit: AnyArray
    goodness: AnyArray
    cut: AnyArray
    off: AnyArray

    def of(self, rows: Any) -> "Solved":
        """Those of some channels."""
        return Solved(self.bins.of(rows), self.columns, *(values[rows] for values in self[2:]))

    def put(self, rows: Any, others: "Solved") -> None:
        """Replace those of some channels."""
        for values, new in zip((*self.bins[:3], *self[2:]), (*others.bins[:3], *others[2:]), strict=True):
            values[rows] = new

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(term.name for term in self.columns)

    @property
    def among(self) -> AnyArray:
        """(channels, p) which columns take part: the filter where high frequencies are left out, and Q, of the same shape, elsewhere."""
        return np.array(self.names) != np.where(self.cut, "Q", FILTER)[:, None]

    @property
    def own(self) -> AnyArray:
        """(channels, p) whether the record determines a coefficient."""
        return self.among & (np.array(self.names) != FILTER)

    @property
    def level(self) -> AnyArray:
        """(channels, bins) density of the model, in units of `Bins.unit`."""
        return density(self.bins.columns, self.theta)

    @property
    def end(self) -> AnyArray:
        """(channels,) highest frequency of the band in Hz; infinite if the fit uses all frequencies."""
        return np.where(self.cut, np.max(np.where(self.weight > 0, self.bins.frequency, 0.0), axis=1), np.inf)


def solve(observed: Sequence[Observed], columns: tuple[Term, ...], band, begun: Solved | None = None) -> Solved:
    """Fit the samples observed of channels of one length, all at once.

    If some are missing, the fit is repeated until the density that fills the gaps no longer changes. `begun` are fits without regressors
    that the records now have.
    """
    columns, rough, k = (*columns, _FILTER), -1 if begun else _ROUGH, 0
    whole = np.array([one.complete for one in observed])
    solved = begun or _solved(beside([one.bins(columns) for one in observed]), columns, band, whole & (band is None))
    rows = np.flatnonzero(~whole)
    while len(rows) and k < _ROUNDS:
        before, k = _level(solved.of(rows)), k + 1
        bins = beside([observed[i].bins(columns, level) for i, level in zip(rows.tolist(), before, strict=True)])
        start = solved.theta[rows] * (solved.bins.unit[rows] / bins.unit)[:, None] if k > 1 else None
        found = _solved(bins, columns, band, band is None and k >= rough, start)
        change = np.log(_level(found) / before)
        solved.put(rows, found._replace(off=np.sqrt(0.5 * np.vecdot(found.weight, change**2))))
        rows = rows[(solved.off[rows] >= SETTLED) | (k <= rough + 1)]
    return solved


def _level(solved: Solved) -> AnyArray:
    """Density at the bins: that of the model, and the ordinates themselves as far as a bin is a spectral line or outside of the band."""
    bins, model = solved.bins, solved.level
    own = 1.0 - solved.weight / np.where(bins.weight > 0.0, bins.weight, np.inf)
    there = (bins.weight > 0.0) & (bins.density > 0.0)
    return np.where(there, model + own * (bins.density - model), model) * bins.unit[:, None]


def _solved(whole: Bins, columns: tuple[Term, ...], band, automatic: Any, start: AnyArray | None = None) -> Solved:
    bins = inside(whole, band)
    count = int(np.min(np.sum(bins.weight > 0, axis=1)))
    if count <= len(columns):
        more = "record longer without gaps, widen the band, or ask for fewer terms"
        raise DataError(f"{count} frequency bins are left for {len(columns)} terms; {more}")
    group, none = groups_of(whole.weight), np.zeros(len(bins.weight))
    solved = _fitted(Solved(bins, columns, none, bins.weight.copy(), none, none, none, none, none > 0.0, none.copy()), group, start)
    solved = solved._replace(lines=find_lines(bins, solved.level))
    if len(rows := np.flatnonzero(solved.lines.any(axis=1))):
        part = solved.of(rows)
        solved.put(rows, _fitted(part._replace(weight=part.weight * (1.0 - part.lines)), group[rows]))
    rows = np.flatnonzero(automatic & (solved.goodness < _REFUSED))
    ends = np.array([_search(bins.frequency, bins.density[i], solved.weight[i], len(columns)) for i in rows])
    if len(rows := rows[ends < np.inf]):
        part, below = solved.of(rows), bins.frequency <= ends[ends < np.inf, None] * (1 + 1e-6)
        solved.put(rows, _fitted(part._replace(weight=part.weight * below, cut=np.ones(len(rows), dtype=bool)), group[rows]))
    return solved


def _fitted(solved: Solved, group: AnyArray, start: AnyArray | None = None) -> Solved:
    """Fit from several starting points or a given one, (channels, p), keep the highest likelihood, and judge the fit.

    `group` comes from `groups_of`.
    """
    (target, _, _, columns, _), weight, held, count = solved.bins, solved.weight, ~solved.among, len(group)
    starts = several_starts(columns, target, weight, ~held) if start is None else np.where(held, 0.0, start)[:, None]
    each = np.repeat(np.arange(count), starts.shape[1])
    theta, cost = scoring(columns, target[each], weight[each], starts.reshape(len(each), -1), held=held[each])
    best = np.argmin(cost.reshape(count, -1), axis=1) + np.arange(0, len(each), starts.shape[1])
    theta, cost = scoring(columns, target, weight, theta[best], held=held, enough=_FINE)  # only one needs many steps
    place = (group + _GROUPS * np.arange(count)[:, None]).ravel()
    sums = (weight, weight * target / density(columns, theta))
    there, total = (np.bincount(place, one.ravel(), _GROUPS * count).reshape(count, -1) for one in sums)
    ratio = np.where(there > 0.0, total, 1.0) / np.where(there > 0.0, there, 1.0)
    deviance = np.vecdot(there, ratio - 1.0 - np.log(ratio))
    freedom = np.maximum(np.sum(there > 0.0, axis=1) - np.sum(theta != 0.0, axis=1), 1.0)
    return solved._replace(theta=theta, cost=cost, misfit=deviance / freedom, goodness=chance(deviance, freedom))


def _search(frequency: AnyArray, density: AnyArray, weight: AnyArray, count: int) -> float:
    """Find the upper end of the widest band in Hz that no filter spoils; infinite if white noise is level up to the highest frequency.

    A filter or a resonance of the sensor spoils high frequencies. The upper end is therefore lowered by thirds of octaves until the four
    octaves below it are smooth, and then by another octave, because they only just are.

    Below its corner a low-pass filter turns white noise into N^2 (1 - c f^2) with c of either sign. In a band whose high frequencies are
    cut off, the column `FILTER` describes this, so that it does not bias N. The column has the shape of Q and replaces it.

    It is the highest end below which the spectrum of four octaves is N^2 + c s^2 + b/s + k/s^2, first with c of quantisation noise and to
    1 %, then with c of either sign and to 3 %, since a filter is rarely of the second order. Means over thirds of octaves are compared,
    without the third that fits worst.
    """
    used = weight > 0
    frequency, density, weight = frequency[used], density[used], weight[used]
    third = np.floor(3.0 * np.log2(frequency.max() / frequency) + 1e-9).astype(int)  # counted from the top
    total = np.bincount(third, weight)
    there = np.flatnonzero(total)
    level, at = (np.bincount(third, weight * values)[there] / total[there] for values in (density, frequency))
    s = np.sin(0.5 * np.pi * at / frequency.max())
    columns = np.stack([np.ones_like(s), s**2, 1.0 / s, 1.0 / s**2], axis=1) / level[:, None]
    width, ends = 3 * _OCTAVES, frequency.max() * 2.0 ** (-there / 3.0)
    below = np.cumsum(np.bincount(third)[there][::-1])[::-1]  # bins below the end
    either = np.array([False, True, False, False])
    for i in range(len(there) - width + 1):
        part = slice(i, i + width)
        for free, tolerance in zip((~either & either, either), _TOLERANCES, strict=True):
            root = 1.0 / np.sqrt(2.0 / total[there[part]] + tolerance**2)
            rows = columns[part] * root[:, None]
            rest = root - rows @ nonnegative(rows.T @ rows, rows.T @ root, free, np.ones(4, dtype=bool))[0]
            misfit = float(np.sum(rest**2) - np.max(rest**2))
            if chance(misfit, width - 5.0) >= _REFUSED:
                lower = ends[i] * 2.0**-_MARGIN
                enough = i > 0 and np.sum(frequency <= lower) >= count + _FEWEST
                return float(lower if enough else ends[i]) if i or free.any() else np.inf
        if below[i] < count + _FEWEST:
            break
    return np.inf


def groups_of(weight: AnyArray) -> Int[np.ndarray, "channels bins"]:
    """The group to which each bin belongs in the test of the goodness of fit."""
    total, middle = np.sum(weight, axis=1), np.cumsum(weight, axis=1) - 0.5 * weight
    later = [np.geomspace(_FIRST[-1], max(int(one), _FIRST[-1] + 1), _GROUPS - len(_FIRST) + 1)[1:-1] for one in total]
    return np.array([np.searchsorted(np.append(_FIRST[1:], edges), one) for edges, one in zip(later, middle, strict=True)])


def inside(bins: Bins, band) -> Bins:
    """The bins with a weight of zero outside of the band; cluster time tau corresponds to the frequency 1/(2 tau)."""
    if band is None:
        return bins
    within = (bins.frequency >= 0.5 / band[1] * (1 - 1e-9)) & (bins.frequency <= 0.5 / band[0] * (1 + 1e-9))
    return bins._replace(weight=bins.weight * within)


def _median(values, there) -> np.ndarray:
    """Median of the last axis, of those values that are `there`; `numpy.nanmedian` takes ten times as long for so few."""
    ordered, count = np.sort(np.where(there, values, np.inf), axis=-1), np.maximum(there.sum(axis=-1, keepdims=True), 1)
    middle = [np.take_along_axis(ordered, place, axis=-1)[..., 0] for place in ((count - 1) // 2, count // 2)]
    return 0.5 * (middle[0] + middle[1])


def find_lines(bins: Bins, model) -> Float[np.ndarray, "channels bins"]:
    """Find the bins that spectral lines occupy: the share of each bin that is a line, 1 in a line and 0 elsewhere.

    The ordinates P are divided by a first fit, `model`, which is smooth even where it is wrong. In a bin of nu ordinates, nu P/S follows
    a chi-square law of nu degrees of freedom. The level S is the geometric mean of the medians of the neighbours on either side, raised
    by twice its uncertainty. A bin is part of a line if the chance of its value is below 1 %, divided by the number of bins. The search
    runs in several passes, because a line raises the level next to it. At the end one more bin on each side is added for the skirts. The
    wider a low rise beyond eight bins, the less of it is a line.

    A bin whose chance is close to the limit has a share between 0 and 1, so that a small change of the record changes the fit little. From
    the share `LINE` on the bin is reported as a line. The share grows evenly with the normal value of the same chance, like a weight that
    falls to zero gradually in a robust fit (F. R. Hampel, J. Am. Stat. Assoc. 69, 1974).
    """
    weight, density = bins.weight, bins.density / model
    used, count = weight > 0, weight.shape[1]
    limit = _CHANCE / np.maximum(used.sum(axis=1), 1)
    taken, share = np.zeros(weight.shape, dtype=bool), np.zeros(weight.shape)
    places = [np.arange(count)[:, None] + side * np.arange(2, _REACH + 1) for side in (-1, 1)]
    inside, places = [(place >= 0) & (place < count) for place in places], [np.clip(place, 0, count - 1) for place in places]
    # median of chi-square over nu by Wilson and Hilferty; the standard error of a median of k values is 1.25 sd/sqrt(k)
    middle = density / (1.0 - 2.0 / (9.0 * np.maximum(weight, 1.0))) ** 3
    for _ in range(_PASSES):
        sides = [own & (used & ~taken)[:, place] for own, place in zip(inside, places, strict=True)]
        known = used & np.logical_and.reduce([side.sum(axis=-1) >= _SIDE for side in sides])
        # a slope of the spectrum cancels in the geometric mean of the two sides
        medians = [_median(middle[:, place], side) for place, side in zip(places, sides, strict=True)]
        level = np.sqrt(np.where(known, medians[0], 1.0) * np.where(known, medians[1], 1.0))
        ordinates = sum(np.where(side, weight[:, place], 0.0).sum(axis=-1) for place, side in zip(places, sides, strict=True))
        level *= 1.0 + 2.0 * 1.25 * np.sqrt(2.0 / np.maximum(ordinates, 1.0))
        chance = np.ones(weight.shape)
        high = known & (density > level)
        chance[high] = scipy.special.gammaincc(weight[high] / 2.0, (weight * density)[high] / level[high] / 2.0)
        new, near = chance < limit[:, None], chance < _NEAR
        apart = scipy.special.ndtri(limit)[np.nonzero(near)[0]] - scipy.special.ndtri(np.maximum(chance[near], np.finfo(float).tiny))
        share[near] = np.maximum(share[near], np.clip((apart + _BELOW) / (_BELOW + _ABOVE), 0.0, 1.0))
        if not (new & ~taken).any():
            break
        taken |= new
    # the skirts of a line are too low to be detected one by one
    share = np.where(used, scipy.ndimage.maximum_filter1d(share, 3), 0.0)
    for i in np.flatnonzero((share >= LINE).any(axis=1)):
        for a, b in zip(*runs(share[i] >= LINE), strict=True):
            wide, high = np.sum(share[i, a:b]) / _WIDEST, np.max(density[i, a:b] / level[i, a:b]) / _TOWERING
            share[i, a:b] *= np.clip(max(2.0 - wide, 2.0 * high - 1.0), 0.0, 1.0)
    return share


def amplitudes(solved: Solved, i: int, duration: float) -> list[tuple[float, float]]:
    """(amplitude, frequency in Hz) of each spectral line in the band of a channel, in a record of `duration` s, strongest first.

    An amplitude A has the power A^2/2 above the model of its bins.
    """
    bins, model, lines = solved.bins.of(i), solved.level[i], []
    for a, b in zip(*runs(solved.lines[i] >= LINE), strict=True):
        excess = bins.weight[a:b] * (bins.density[a:b] - model[a:b])
        power, above = excess.sum() * float(bins.unit) / duration, np.maximum(excess, 0.0)
        frequency = float(np.dot(above, bins.frequency[a:b]) / max(above.sum(), np.finfo(float).tiny))
        if power > 0 and frequency <= solved.end[i]:
            lines.append((float(np.sqrt(2.0 * power)), frequency))
    return sorted(lines, reverse=True)
