"""From the bins of a record to the fit of its noise terms, in the band where the model holds and beside spectral lines."""

from typing import NamedTuple

import numpy as np

from .._errors import DataError
from .._types import AnyArray, Int
from ._likelihood import chance, density, nonnegative, scoring, several_starts
from ._observed import Observed
from ._ordinates import Bins, find_lines
from ._terms import Filter, Term

_FILTER = Filter()  # one object: caches compare it at once
FILTER = _FILTER.name
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


class Fitted(NamedTuple):
    """A fit of `bins`, which have zero weight outside the band: coefficients in units of `Bins.unit`, and cost.

    misfit : deviance of the spectrum over its degrees of freedom. goodness : chance of a worse deviance. cut : whether high frequencies
    were left out.
    """

    theta: AnyArray
    cost: float
    bins: Bins
    misfit: float
    goodness: float
    cut: bool = False


class Solved(NamedTuple):
    """Bins of a record, the share of each that is a spectral line, their fit, its terms, one for each column of the bins, and by how many
    standard errors the last round of filling gaps changed it.
    """

    bins: Bins
    lines: AnyArray
    fitted: Fitted
    columns: tuple[Term, ...]
    off: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(term.name for term in self.columns)

    @property
    def own(self) -> list[int]:
        """Columns with a coefficient that the record determines: not the filter, and not Q, of the same shape, where there is a filter."""
        return [i for i, name in enumerate(self.names) if name != FILTER and not (name == "Q" and self.fitted.cut)]

    @property
    def end(self) -> float:
        """Highest frequency of the band in Hz; infinite if the fit uses all frequencies."""
        bins = self.fitted.bins
        return float(np.max(np.where(bins.weight > 0, bins.frequency, 0.0))) if self.fitted.cut else np.inf


def solve(observed: Observed, columns: tuple[Term, ...], band, begun: Solved | None = None) -> Solved:
    """Fit the samples observed. If some are missing, the fit is repeated until the density that fills the gaps no longer changes.

    `begun` is a fit without regressors that the record now has.
    """
    columns, rough = (*columns, _FILTER), 0 if begun else _ROUGH
    solved = begun or _solved(observed.bins(columns), columns, band, band is None and observed.complete)
    for k in range(0 if observed.complete else _ROUNDS):
        before = _level(solved)
        solved = _solved(observed.bins(columns, before), columns, band, band is None and k + 1 >= rough)
        change = np.log(_level(solved) / before)
        solved = solved._replace(off=float(np.sqrt(0.5 * np.dot(solved.fitted.bins.weight, change**2))))
        if k > rough and solved.off < SETTLED:
            break
    return solved


def _level(solved: Solved):
    """Density at the bins: that of the model, and the ordinates themselves as far as a bin is a spectral line or outside of the band."""
    bins, model = solved.bins, density(solved.fitted.bins.columns, solved.fitted.theta)
    own = 1.0 - solved.fitted.bins.weight / np.where(bins.weight > 0.0, bins.weight, np.inf)
    return np.where((bins.weight > 0.0) & (bins.density > 0.0), model + own * (bins.density - model), model) * bins.unit


def _solved(whole: Bins, columns: tuple[Term, ...], band, automatic: bool) -> Solved:
    bins = inside(whole, band)
    count = int(np.sum(bins.weight > 0))
    if count <= len(columns):
        raise DataError(
            f"{count} frequency bins are left for {len(columns)} terms; record longer without gaps, widen the band, or ask for fewer terms"
        )
    group = groups_of(whole.weight, int(np.sum(whole.weight)))
    fitted = _fitted(_without(bins, columns, FILTER), group)
    lines = find_lines(bins, density(fitted.bins.columns, fitted.theta))
    clear = bins._replace(weight=bins.weight * (1.0 - lines))
    fitted = _fitted(_without(clear, columns, FILTER), group) if lines.any() else fitted
    if automatic and fitted.goodness < _REFUSED:
        fitted = _below_filter(clear, fitted, group, columns)
    return Solved(bins, lines, fitted, columns)


def _fitted(bins: Bins, group: AnyArray) -> Fitted:
    """Fit from several starting points, keep the highest likelihood, and judge the fit; `group` comes from `groups_of`."""
    theta, cost = scoring(bins.columns, bins.density, bins.weight, several_starts(bins))
    theta, cost = scoring(bins.columns, bins.density, bins.weight, theta[np.argmin(cost)], enough=_FINE)  # only one needs many steps
    count, total = (
        np.bincount(group, bins.weight * values) for values in (np.ones(len(group)), bins.density / density(bins.columns, theta))
    )
    there = count > 0.0
    ratio = total[there] / count[there]
    deviance = np.sum(count[there] * (ratio - 1.0 - np.log(ratio)))
    freedom = max(float(np.sum(there) - np.sum(theta != 0.0)), 1.0)
    return Fitted(theta, cost, bins, float(deviance / freedom), float(chance(deviance, freedom)))


def _below_filter(bins: Bins, whole: Fitted, group: AnyArray, columns: tuple[Term, ...]) -> Fitted:
    """Fit the widest band, from the lowest frequency up, whose upper end no filter spoils; the fit of the `whole` band if that is all.

    A filter or a resonance of the sensor spoils high frequencies. The upper end is therefore lowered by thirds of octaves until the four
    octaves below it are smooth, and then by another octave, because they only just are.

    Below its corner a low-pass filter turns white noise into N^2 (1 - c f^2) with c of either sign. In a band whose high frequencies are
    cut off, the column `FILTER` describes this, so that it does not bias N. The column has the shape of Q and replaces it.
    """
    end, level = _search(whole.bins, len(columns))
    if level and end >= np.max(bins.frequency[bins.weight > 0.0]):
        return whole
    weight = bins.weight * (bins.frequency <= end * (1 + 1e-6))
    return _fitted(_without(bins._replace(weight=weight), columns, "Q"), group)._replace(cut=True)


def _search(bins: Bins, count: int) -> tuple[float, bool]:
    """Find the upper end of the band in Hz, and whether white noise is level up to there.

    It is the highest end below which the spectrum of four octaves is N^2 + c s^2 + b/s + k/s^2, first with c of quantisation noise and to
    1 %, then with c of either sign and to 3 %, since a filter is rarely of the second order. Means over thirds of octaves are compared,
    without the third that fits worst.
    """
    used = bins.weight > 0
    frequency, weight = bins.frequency[used], bins.weight[used]
    third = np.floor(3.0 * np.log2(frequency.max() / frequency) + 1e-9).astype(int)  # counted from the top
    total = np.bincount(third, weight)
    there = np.flatnonzero(total)
    level, at = (np.bincount(third, weight * values[used])[there] / total[there] for values in (bins.density, bins.frequency))
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
                return float(lower if enough else ends[i]), not free.any()
        if below[i] < count + _FEWEST:
            break
    return float(frequency.max()), True


def groups_of(weight: AnyArray, ordinates: int) -> Int[np.ndarray, " bins"]:
    """The group to which each bin belongs in the test of the goodness of fit."""
    edges = np.append(_FIRST[1:], np.geomspace(_FIRST[-1], max(ordinates, _FIRST[-1] + 1), _GROUPS - len(_FIRST) + 1)[1:-1])
    return np.searchsorted(edges, np.cumsum(weight) - 0.5 * np.asarray(weight))


def _without(bins: Bins, columns: tuple[Term, ...], name: str) -> Bins:
    """The bins without a term: its column is set to zero, and its coefficient is then zero in a fit."""
    return bins._replace(columns=bins.columns * np.array([term.name != name for term in columns]))


def inside(bins: Bins, band) -> Bins:
    """The bins with a weight of zero outside of the band; cluster time tau corresponds to the frequency 1/(2 tau)."""
    if band is None:
        return bins
    within = (bins.frequency >= 0.5 / band[1] * (1 - 1e-9)) & (bins.frequency <= 0.5 / band[0] * (1 + 1e-9))
    return bins._replace(weight=bins.weight * within)
