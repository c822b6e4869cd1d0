"""A record's bins and their fit."""

from typing import NamedTuple

import numpy as np

from .._errors import DataError
from .._types import AnyArray
from ._likelihood import density
from ._observed import Observed
from ._ordinates import LINE, Bins, find_lines
from ._spectral import FILTER, Fitted, attempt, fit_bins, groups_of, without
from ._terms import Filter, Term

#: most rounds of filling gaps, and the relative change of the density at which they end; number of rounds in which groups of more ordinates
#: than this scale the model; lowest ordinates at which changes of the mean are searched
_ROUNDS, _SETTLED, _ROUGH, _MANY, _ORDINATES = 30, 2e-3, 2, 100.0, 512


class Solved(NamedTuple):
    """Bins of a record, the share of each that is a spectral line, their fit, and its terms, one for each column of the bins."""

    bins: Bins
    lines: AnyArray
    fitted: Fitted
    columns: tuple[Term, ...]

    @property
    def taken(self) -> AnyArray:
        """Whether each bin is reported as a spectral line."""
        return self.lines >= LINE

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
        return float(np.max(np.where(bins.weight > 0, bins.frequency, 0.0))) if bool(self.fitted.cut) else np.inf


class Lowest(NamedTuple):
    """Density of the first ordinates of a record: (ordinates, p) per squared coefficient, and (ordinates,) of the fit."""

    columns: AnyArray
    density: AnyArray


def solve(observed: Observed, columns: tuple[Term, ...], band, lines: AnyArray | None = None) -> Solved:
    """Fit the samples observed. If some are missing, the fit is repeated until the density that fills the gaps no longer changes.

    `lines` are the spectral lines of an earlier fit of the record; they are found first if none is given.
    """
    columns, level = (*columns, Filter()), np.ones(1)
    solved = _solved(observed.bins(columns), columns, band, band is None and observed.complete, lines)
    for k in range(0 if observed.complete else _ROUNDS):
        before, level = level, _level(solved, k < _ROUGH)
        if k > _ROUGH and np.max(np.abs(np.log(level / before))) < _SETTLED:
            break
        solved = _solved(observed.bins(columns, level), columns, band, band is None and k + 1 >= _ROUGH, lines)
    return solved


def observed_bins(y, dt: float, terms: tuple[Term, ...]) -> Bins:
    """Bins of a record with gaps, with a column for each term; the fitted model of these terms fills the gaps."""
    bins = solve(Observed(y, dt), terms, None).bins
    return bins._replace(columns=bins.columns[:, : len(terms)])


def _level(solved: Solved, rough: bool):
    """Density at the bins: that of the model in the band, and the ordinates themselves in spectral lines and outside of the band.

    In the first, `rough` rounds of filling gaps, the model may fit badly. It is then scaled to the ordinates in large groups.
    """
    bins, model = solved.bins, density(solved.fitted.bins.columns, solved.fitted.theta)
    if rough:
        group = groups_of(bins.weight, int(bins.weight.sum()))
        count, total = (np.bincount(group, bins.weight * values) for values in (np.ones(len(model)), bins.density / model))
        model = model * np.where(count > _MANY, total / np.maximum(count, 1.0), 1.0)[group]
    own = (solved.fitted.bins.weight == 0.0) & (bins.weight > 0.0) & (bins.density > 0.0)
    return np.where(own, bins.density, model) * bins.unit


def _solved(whole: Bins, columns: tuple[Term, ...], band, automatic: bool, lines: AnyArray | None) -> Solved:
    bins = inside(whole, band)
    count = int(np.sum(bins.weight > 0))
    if count <= len(columns):
        raise DataError(
            f"{count} frequency bins are left for {len(columns)} terms; record longer without gaps, widen the band, or ask for fewer terms"
        )
    names = tuple(term.name for term in columns)
    group = groups_of(whole.weight, int(np.sum(whole.weight)))
    first = None
    if lines is None:
        plain = without(bins, names, FILTER)
        first = attempt(plain, group)
        lines = find_lines(bins, density(plain.columns, first.theta))
    clear = bins._replace(weight=bins.weight * (1.0 - lines))
    return Solved(bins, lines, fit_bins(clear, group, automatic, names, None if lines.any() else first), columns)


def lowest_of(observed: Observed, solved: Solved) -> Lowest:
    n = len(observed.y)
    k = np.arange(1, min(_ORDINATES, n - 1) + 1)
    columns = np.stack([term.ordinates(k, n, observed.dt) for term in solved.columns], axis=1)
    # a filter acts at high frequencies only, and its negative column must not make the density negative here
    theta = np.where([name != FILTER for name in solved.names], solved.fitted.theta, 0.0)
    # if every other coefficient is zero, the density vanishes here
    least = np.finfo(float).eps * np.max(density(solved.fitted.bins.columns, solved.fitted.theta))
    return Lowest(columns, np.maximum(columns @ theta, least) * solved.bins.unit)


def inside(bins: Bins, band) -> Bins:
    """The bins with a weight of zero outside of the band; cluster time tau corresponds to the frequency 1/(2 tau)."""
    if band is None:
        return bins
    within = (bins.frequency >= 0.5 / band[1] * (1 - 1e-9)) & (bins.frequency <= 0.5 / band[0] * (1 + 1e-9))
    return bins._replace(weight=bins.weight * within)
