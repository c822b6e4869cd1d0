r"""Fit of binned ordinates in the band where the model holds, with intervals.

`attempt`, `deviance`, `fit_whole` and `uncertainty` map bins to coefficients, covariance and limits, on the host and in a trace;
`fit_bins` decides on the host which bins take part.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._types import Any, AnyArray, Int
from ._lanes import inverse, namespace
from ._likelihood import ROUGH, density, flat_start, information, minimise, several_starts
from ._limits import Limits, chance, find_limits
from ._ordinates import Bins
from ._terms import Filter

FILTER = Filter.name
#: groups of bins whose mean ratio to the model is tested: the first ordinates, then log-spaced
_FIRST, _GROUPS = (0, 4, 12, 24, 48), 40
#: misfit of the density that does not count against a model, and the chances of a worse deviance at which a band is refused and
#: below which the intervals are widened to the scatter seen; in units of that of the model, above which it is said not to hold
_TOLERANCE, _REFUSED, _WIDENED, _TOO_WIDE = 0.01, 0.001, 0.01, 4.0
#: upper ends of the band that are tried, half an octave apart; half octaves below its end against which a band is tested; by how
#: many octaves more the first that passes comes down; bins beyond the number of terms that a band needs
_ENDS, _OCTAVES, _MARGIN, _FEWEST = 24, 6, 1.0, 20
#: standard errors at which 95 % of records show a coefficient that 1 % show by chance
_DECIDED = 2.326 + 1.645


class Attempt(NamedTuple):
    """A fit of the bins as they are: its `Minima`, its deviance, also with the tolerated misfit allowed, and degrees of freedom."""

    theta: AnyArray
    cost: Any
    settled: Any
    deviance: Any
    allowed: Any
    freedom: Any


class Fitted(NamedTuple):
    """The best fit of `bins`, which have weight only in the band: coefficients in units of `Bins.unit`, cost, whether it settled.

    cut : whether high frequencies were left out. holds : whether the model holds in the band. goodness : chance of a worse deviance.
    inflation : variance factor, the deviance over its degrees of freedom where that is needed, else 1. plain, alone : the bins of the
    band with the terms' columns alone, without `FILTER`, by which Q is judged, and their fit.
    """

    theta: AnyArray
    cost: Any
    settled: Any
    bins: Bins
    cut: Any
    holds: Any
    goodness: Any
    inflation: Any
    plain: Bins
    alone: Attempt


def groups_of(weight, ordinates: int) -> Int[np.ndarray, " bins"]:
    """Group of each bin for the goodness of fit."""
    edges = np.append(_FIRST[1:], np.geomspace(_FIRST[-1], max(ordinates, _FIRST[-1] + 1), _GROUPS - len(_FIRST) + 1)[1:-1])
    return np.searchsorted(edges, np.cumsum(weight) - 0.5 * np.asarray(weight))


def attempt(bins: Bins, group: AnyArray) -> Attempt:
    """The least of the minima reached from several starts, and how well it describes the bins; `group` from `groups_of`."""
    xp = namespace(bins)
    tried = minimise(bins.columns, bins.density, bins.weight, several_starts(jax.lax.stop_gradient(bins) if xp is jnp else bins))
    best = xp.argmin(tried.cost)
    theta, cost, settled = (leaf[best] for leaf in tried)
    (strict, freedom), (allowed, _) = (deviance(bins, theta, group, tolerance) for tolerance in (0.0, _TOLERANCE))
    return Attempt(theta, cost, settled, strict, allowed, freedom)


def deviance(bins: Bins, theta, group, tolerance) -> tuple[Any, Any]:
    """Deviance of the groups' mean ratios to the model, and its degrees of freedom; a relative misfit of `tolerance` is allowed."""
    xp = namespace(bins, theta)
    member = (np.arange(_GROUPS + 2)[:, None] == np.asarray(group)[None, :]).astype(bins.density.dtype)
    count = member @ bins.weight
    there = count > 0
    count = xp.where(there, count, 1.0)
    ratio = xp.where(there, member @ (bins.weight * bins.density / density(bins.columns, theta)) / count, 1.0)
    ratio = xp.maximum(ratio, np.finfo(bins.density.dtype).tiny ** 0.5)  # a record without noise has ordinates of zero
    informed = 2.0 / (2.0 / count + tolerance**2)
    total = xp.sum(xp.where(there, informed * (ratio - 1.0 - xp.log(ratio)), 0.0))
    return total, xp.maximum((xp.sum(there) - xp.sum(theta != 0)).astype(total.dtype), 1.0)


def without(bins: Bins, terms: tuple[str, ...], term: str) -> Bins:
    """The bins with the column of a term zero, whose coefficient then is."""
    keep = np.array([name != term for name in terms])
    return bins._replace(columns=bins.columns * keep.astype(bins.columns.dtype)[None, :])


def _upto(bins: Bins, end) -> Bins:
    return bins._replace(weight=bins.weight * (bins.frequency <= end * (1 + 1e-6)))


def _search(bins: Bins, group, terms: tuple[str, ...]) -> float:
    """Upper end of the band in Hz (host only)."""
    used = bins.frequency[bins.weight > 0]
    ends = used.max() * 2.0 ** (-0.5 * np.arange(_ENDS))
    enough = np.sum(used[None, :] <= ends[:, None] * (1 + 1e-6), axis=1) >= len(terms) + _FEWEST
    parts = [_upto(bins, end) for end in ends]
    starts, weights = np.stack([flat_start(part) for part in parts]), np.stack([part.weight for part in parts])
    found = minimise(bins.columns, bins.density, weights, starts, rtol=ROUGH).theta
    tested = [deviance(part, theta, group, _TOLERANCE) for part, theta in zip(parts, found, strict=True)]
    total, freedom = (np.array(values) for values in zip(*tested, strict=True))
    # what the upper octaves of each band add to the deviance, against the groups that they add
    more, added = total[:, None] - total[None, :], freedom[:, None] - freedom[None, :]
    distance = np.arange(_ENDS)[None, :] - np.arange(_ENDS)[:, None]
    tested = (distance > 0) & (distance <= _OCTAVES) & enough[None, :] & (added > 0)
    likely = chance(np.maximum(more, 0.0), np.maximum(added, 1.0)) >= _REFUSED
    whole = np.where(enough, chance(total, freedom), -1.0)
    fits = enough & (np.all(~tested | likely, axis=1) & np.any(tested, axis=1) | (whole >= _REFUSED))
    index = int(np.argmax(fits)) if fits.any() else int(np.argmax(whole))
    lower = ends[index] * 2.0**-_MARGIN
    if index == 0:
        return float(ends[0])
    return float(lower if np.sum(used <= lower) >= len(terms) + _FEWEST else ends[index])


def fit_bins(bins: Bins, group, automatic: bool, terms: tuple[str, ...], first: Attempt | None = None) -> Fitted:
    """Fit in the widest band from low frequency up in which the model holds; in all of it unless `automatic` (host only).

    A filter or a resonance of the sensor spoils high frequencies: the upper end comes down by half octaves until the deviance
    is no worse than one in a thousand, or what the band's upper three octaves add to it is not; then by an octave more, for
    there the model only just holds. In a band so cut the column `FILTER` takes what a low-pass leaves of white noise below its
    corner, N^2 (1 - c f^2) with c of either sign, so that N is not biased by it; it has the shape of Q and takes its place. A
    misfit of 1 % of the density (0.5 % of the deviation) is allowed. `first` is the attempt on all bins without `FILTER`, if known.
    """
    plain = without(bins, terms, FILTER)
    found = alone = first or attempt(plain, group)
    inside, cut = plain, False
    if automatic and chance(found.allowed, found.freedom) < _REFUSED:
        end = _search(plain, group, terms)
        cut = end < float(np.max(np.where(bins.weight > 0, bins.frequency, 0.0)))
    if cut:
        plain, inside = _upto(plain, end), _upto(without(bins, terms, "Q"), end)
        found, alone = attempt(inside, group), attempt(plain, group)
    return _judged(found, inside, alone, plain, np.asarray(cut))


def fit_whole(bins: Bins, group) -> Fitted:
    """Fit of all bins, differentiable with respect to the ordinates."""
    found = attempt(bins, group)
    return _judged(found, bins, found, bins, jnp.asarray(False))


def _judged(found: Attempt, bins: Bins, alone: Attempt, plain: Bins, cut) -> Fitted:
    goodness = chance(found.deviance, found.freedom)
    xp, scatter = namespace(found), found.deviance / found.freedom
    inflation = xp.where(goodness < _WIDENED, xp.maximum(scatter, 1.0), 1.0)
    return Fitted(*found[:3], bins, cut, inflation <= _TOO_WIDE, goodness, inflation, plain, alone)


def uncertainty(
    fitted: Fitted, widened: AnyArray, two_sided, one_sided, terms: tuple[str, ...], only: tuple[str, ...] | None = None
) -> tuple[AnyArray, Limits, AnyArray]:
    """Covariance of the squared coefficients (inverse Fisher information), profile-likelihood limits, and by which factor the
    record must be longer to decide whether a coefficient at its upper limit is there: to tell it from zero in 95 % of records,
    and call it present without it in 1 %. Limits and factors are those of the terms, without `FILTER`, or of some of them `only`.

    Every variance is `widened`, (p,), beside what the misfit of the spectrum makes of it.
    In a cut band the limits of Q are found without the filter, whose shape it has and by which it is replaced elsewhere.
    """
    xp = namespace(fitted)
    covariance = inverse(information(fitted.bins, fitted.theta))
    scale = fitted.inflation * xp.asarray(widened, dtype=fitted.theta.dtype)
    fitted = jax.lax.stop_gradient(fitted) if xp is jnp else fitted
    bins, plain, theta, theta_alone, cost_alone = fitted.bins, fitted.plain, fitted.theta, fitted.alone.theta, fitted.alone.cost
    own = np.flatnonzero([term != FILTER and (only is None or term in only) for term in terms])
    named = np.eye(len(terms), dtype=bool)
    terms_alone = np.array([term != FILTER for term in terms])[None, :]
    short = np.array([term == "Q" for term in terms]) & fitted.cut

    def ratio(lane, value, state):
        index, value = own[lane], value[:, None]
        here, without_filter = named[index], short[index]
        seen = xp.where(without_filter[:, None, None], plain.columns, bins.columns)
        # the filter's column is negative: starting without it keeps the density positive when another term goes
        first = xp.where(here, value, xp.where(terms_alone, state, 0.0))
        # with the only term held at zero there would be no density to begin with: the others begin at their standard errors
        dark = xp.any((bins.weight > 0)[None, :] & (xp.sum(seen * first[:, None, :], axis=-1) <= 0.0), axis=1)[:, None]
        first = xp.where(dark & ~here & terms_alone, xp.maximum(state, reach[None, :]), first)
        base = xp.sum(xp.where(here[:, None, :], seen, 0.0), axis=-1) * value
        others = xp.where(here[:, None, :], 0.0, seen)
        found = minimise(others, bins.density, bins.weight, xp.where(here, 0.0, first), base=base, rtol=ROUGH)
        least = xp.where(without_filter, cost_alone, fitted.cost)
        return 2.0 * (xp.where(xp.isfinite(found.cost), found.cost, np.inf) - least), xp.where(here, value, found.theta)

    spread = jax.lax.stop_gradient(covariance) if xp is jnp else covariance
    reach = xp.where(short, xp.diagonal(inverse(information(plain, theta_alone))), xp.diagonal(spread)) ** 0.5
    middle = xp.where(short, theta_alone, theta)[own]
    begun = xp.maximum(xp.broadcast_to(theta, (len(own), len(terms))), 0.0)
    limits, _ = find_limits(ratio, middle, reach[own], begun, *((level * scale)[own] for level in (two_sided, one_sided)))

    def longer(k, index):
        at = xp.where(named[index], upper[k], theta)
        return inverse(information(bins, at))[index, index] * scale[index] * (_DECIDED / upper[k]) ** 2

    upper = xp.maximum(limits.upper, np.finfo(theta.dtype).tiny ** 0.25)
    decides = xp.stack([longer(k, index) for k, index in enumerate(own)])
    limits = limits._replace(significance=limits.significance / scale[own])
    return covariance * xp.sqrt(scale[:, None] * scale[None, :]), limits, decides
