r"""Fit the noise terms to binned ordinates, in the band where the model holds, and compute intervals.

`attempt`, `deviance`, `fit_whole` and `uncertainty` compute coefficients, covariance and limits from bins, on the host and in a trace.
`fit_bins` chooses the bins to use, on the host only.
"""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._arrays import namespace
from .._types import Any, AnyArray, Int
from ._likelihood import density, information, inverse, minimise, nonnegative, scoring, several_starts
from ._limits import Limits, chance, find_limits
from ._ordinates import Bins
from ._terms import Filter

FILTER = Filter.name
#: the goodness of fit compares means over groups of bins with the model: ordinates at which the first groups begin, and the number of
#: groups, of which the later ones are evenly spaced in the logarithm
_FIRST, _GROUPS = (0, 4, 12, 24, 48), 40
#: search for the upper end of the band: relative misfit of the density that is allowed without and with a filter (with 5 %,
#: a filter of the second order at 20 Hz makes N 5 % too large), chance of a worse misfit below which an end is refused, octaves that are
#: looked at, octaves by which the end is then lowered, bins that a band needs in addition to the number of terms
_EXACT = 1e-14  # gain in log likelihood at which the fit of the coefficients ends
_TOLERANCES, _REFUSED, _OCTAVES, _MARGIN, _FEWEST = (0.01, 0.03), 0.001, 4, 1.0, 20


class Attempt(NamedTuple):
    """A fit of all given bins: fields of `Minima`, deviance and its degrees of freedom."""

    theta: AnyArray
    cost: Any
    settled: Any
    deviance: Any
    freedom: Any


class Fitted(NamedTuple):
    """The best fit of `bins`, which have zero weight outside the band: coefficients in units of `Bins.unit`, cost, whether it converged.

    cut : whether high frequencies were left out. misfit : deviance of the spectrum over its degrees of freedom. goodness : chance of a
    worse deviance.
    """

    theta: AnyArray
    cost: Any
    settled: Any
    bins: Bins
    cut: Any
    misfit: Any
    goodness: Any


def groups_of(weight, ordinates: int) -> Int[np.ndarray, " bins"]:
    """The group to which each bin belongs in the test of the goodness of fit."""
    edges = np.append(_FIRST[1:], np.geomspace(_FIRST[-1], max(ordinates, _FIRST[-1] + 1), _GROUPS - len(_FIRST) + 1)[1:-1])
    return np.searchsorted(edges, np.cumsum(weight) - 0.5 * np.asarray(weight))


def attempt(bins: Bins, group: AnyArray) -> Attempt:
    """Fit from several starting points, keep the lowest minimum, and compute its deviance; `group` comes from `groups_of`."""
    if namespace(bins) is jnp:
        tried = minimise(bins.columns, bins.density, bins.weight, several_starts(jax.lax.stop_gradient(bins)))
        best = jnp.argmin(tried.cost)
        theta, cost, settled = (leaf[best] for leaf in tried)
    else:  # only the lowest minimum needs many steps
        search = functools.partial(scoring, bins.columns, bins.density, bins.weight)
        theta, _ = min((search(start) for start in several_starts(bins)), key=lambda one: one[1])
        theta, cost = search(theta, enough=_EXACT)
        settled = True
    return Attempt(theta, cost, settled, *deviance(bins, theta, group))


def deviance(bins: Bins, theta, group) -> tuple[Any, Any]:
    """Deviance of the ratio of measurement to model, averaged in groups, and its degrees of freedom."""
    xp = namespace(bins, theta)
    member = (np.arange(_GROUPS + 2)[:, None] == np.asarray(group)[None, :]).astype(bins.density.dtype)
    count = member @ bins.weight
    there = count > 0
    count = xp.where(there, count, 1.0)
    ratio = xp.where(there, member @ (bins.weight * bins.density / density(bins.columns, theta)) / count, 1.0)
    ratio = xp.maximum(ratio, np.finfo(bins.density.dtype).tiny ** 0.5)  # the ordinates of a record without noise are zero
    total = xp.sum(xp.where(there, count * (ratio - 1.0 - xp.log(ratio)), 0.0))
    return total, xp.maximum((xp.sum(there) - xp.sum(theta != 0)).astype(total.dtype), 1.0)


def without(bins: Bins, terms: tuple[str, ...], term: str) -> Bins:
    """The bins without a term: its column is set to zero, and its coefficient is then zero in a fit."""
    keep = np.array([name != term for name in terms])
    return bins._replace(columns=bins.columns * keep.astype(bins.columns.dtype)[None, :])


def _upto(bins: Bins, end) -> Bins:
    return bins._replace(weight=bins.weight * (bins.frequency <= end * (1 + 1e-6)))


def _search(bins: Bins, count: int) -> tuple[float, bool]:
    """Find the upper end of the band in Hz, and whether white noise is level up to there (host only).

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
    level = np.maximum(level, np.finfo(float).tiny ** 0.5)  # a record without noise
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


def fit_bins(bins: Bins, group, automatic: bool, terms: tuple[str, ...], first: Attempt | None = None) -> Fitted:
    """Fit the widest band, from the lowest frequency up, whose upper end no filter spoils; all bins unless `automatic` (host only).

    A filter or a resonance of the sensor spoils high frequencies. The upper end is therefore lowered by thirds of octaves until the four
    octaves below it are smooth, and then by another octave, because they only just are.

    Below its corner a low-pass filter turns white noise into N^2 (1 - c f^2) with c of either sign. In a band whose high frequencies are
    cut off, the column `FILTER` describes this, so that it does not bias N. The column has the shape of Q and replaces it. `first` is the
    attempt on all bins without `FILTER`, if it is known already.
    """
    plain = without(bins, terms, FILTER)
    found = first or attempt(plain, group)
    inside, cut = plain, False
    if automatic and chance(found.deviance, found.freedom) < _REFUSED:
        end, level = _search(plain, len(terms))
        cut = not level or end < float(np.max(np.where(bins.weight > 0, bins.frequency, 0.0)))
    if cut:
        inside = _upto(without(bins, terms, "Q"), end)
        found = attempt(inside, group)
    return _judged(found, inside, np.asarray(cut))


def fit_whole(bins: Bins, group) -> Fitted:
    """Fit all bins; the result can be differentiated with respect to the ordinates."""
    found = attempt(bins, group)
    return _judged(found, bins, jnp.asarray(False))


def _judged(found: Attempt, bins: Bins, cut) -> Fitted:
    return Fitted(*found[:3], bins, cut, found.deviance / found.freedom, chance(found.deviance, found.freedom))


def uncertainty(fitted: Fitted, widened: AnyArray, two_sided, one_sided, own: Sequence[int]) -> tuple[AnyArray, Limits]:
    """Covariance of the squared coefficients (inverse Fisher information), and profile-likelihood limits of the `own` columns of a fit.

    Every variance is multiplied by `widened`, (p,), and the likelihood ratio of its profile is divided by it.
    """
    covariance, bins, columns = inverse(information(fitted.bins, fitted.theta)), fitted.bins, np.arange(len(fitted.theta))
    last = dict.fromkeys(own, fitted.theta)

    def rise(k: int, value: float) -> float:
        """Twice the rise of the cost when a coefficient is held; each search starts from the one before."""
        index = own[k]
        others, start = (np.where(columns == index, 0.0, values) for values in (bins.columns, last[index]))
        last[index], cost = scoring(others, bins.density, bins.weight, start, bins.columns[:, index] * value)
        return 2.0 * float(cost - fitted.cost)

    levels = ((level * widened)[own] for level in (two_sided, one_sided))
    limits = find_limits(rise, fitted.theta[own], np.diagonal(covariance)[own] ** 0.5, *levels)
    return covariance * np.sqrt(widened[:, None] * widened[None, :]), limits._replace(significance=limits.significance / widened[own])
