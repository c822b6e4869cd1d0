r"""Fit the noise terms to binned ordinates, in the band where the model holds, and compute intervals.

`attempt`, `deviance`, `fit_whole` and `uncertainty` compute coefficients, covariance and limits from bins, on the host and in a trace.
`fit_bins` chooses the bins to use, on the host only.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._arrays import namespace
from .._types import Any, AnyArray, Int
from ._lanes import inverse
from ._likelihood import ROUGH, density, flat_start, information, minimise, several_starts
from ._limits import Limits, chance, find_limits
from ._ordinates import Bins
from ._terms import Filter

FILTER = Filter.name
#: the goodness of fit compares means over groups of bins with the model: ordinates at which the first groups begin, and the number of
#: groups, of which the later ones are evenly spaced in the logarithm
_FIRST, _GROUPS = (0, 4, 12, 24, 48), 40
#: relative misfit of the density that is allowed; chance of a worse deviance below which a band is refused; chances between which the
#: variances grow gradually to the observed scatter; ratio of that scatter to the expected one above which the model does not hold
_TOLERANCE, _REFUSED, _WIDENED, _TOO_WIDE = 0.01, 0.001, (0.05, 0.01), 4.0
#: number of upper ends of the band to try, half an octave apart; half octaves below its end with which each band is compared; octaves
#: by which the first band that passes is shortened further; bins that a band needs in addition to the number of terms
_ENDS, _OCTAVES, _MARGIN, _FEWEST = 24, 6, 1.0, 20
#: size of a coefficient in standard errors at which 95 % of records pass the threshold that 1 % pass by chance
_DECIDED = 2.326 + 1.645
_TINY = np.finfo(float).tiny


class Attempt(NamedTuple):
    """A fit of all given bins: fields of `Minima`, deviance, deviance `allowed` with the tolerated misfit, and degrees of freedom."""

    theta: AnyArray
    cost: Any
    settled: Any
    deviance: Any
    allowed: Any
    freedom: Any


class Fitted(NamedTuple):
    """The best fit of `bins`, which have zero weight outside the band: coefficients in units of `Bins.unit`, cost, whether it converged.

    cut : whether high frequencies were left out. holds : whether the model holds in the band. deviance, freedom : misfit of the spectrum,
    and its degrees of freedom. goodness, inflation : chance of a worse deviance, and factor on the variances, `inflation_of`. plain,
    alone : the bins of the band without the column `FILTER`, and their fit; the limits of Q come from these.
    """

    theta: AnyArray
    cost: Any
    settled: Any
    bins: Bins
    cut: Any
    holds: Any
    deviance: Any
    freedom: Any
    goodness: Any
    inflation: Any
    plain: Bins
    alone: Attempt


def groups_of(weight, ordinates: int) -> Int[np.ndarray, " bins"]:
    """The group to which each bin belongs in the test of the goodness of fit."""
    edges = np.append(_FIRST[1:], np.geomspace(_FIRST[-1], max(ordinates, _FIRST[-1] + 1), _GROUPS - len(_FIRST) + 1)[1:-1])
    return np.searchsorted(edges, np.cumsum(weight) - 0.5 * np.asarray(weight))


def attempt(bins: Bins, group: AnyArray) -> Attempt:
    """Fit from several starting points, keep the lowest minimum, and compute its deviance; `group` comes from `groups_of`."""
    xp = namespace(bins)
    search = functools.partial(minimise, bins.columns, bins.density, bins.weight)
    if xp is jnp:
        tried = search(several_starts(jax.lax.stop_gradient(bins)))
    else:  # only the lowest minimum needs many steps
        tried = search(several_starts(bins), rtol=ROUGH)
        tried = search(tried.theta[[np.argmin(tried.cost)]])
    best = xp.argmin(tried.cost)
    theta, cost, settled = (leaf[best] for leaf in tried)
    (strict, freedom), (allowed, _) = (deviance(bins, theta, group, tolerance) for tolerance in (0.0, _TOLERANCE))
    return Attempt(theta, cost, settled, strict, allowed, freedom)


def deviance(bins: Bins, theta, group, tolerance) -> tuple[Any, Any]:
    """Deviance of the ratio of measurement to model, averaged in groups, and its degrees of freedom.

    A relative misfit of `tolerance` in each group is allowed.
    """
    xp = namespace(bins, theta)
    member = (np.arange(_GROUPS + 2)[:, None] == np.asarray(group)[None, :]).astype(bins.density.dtype)
    count = member @ bins.weight
    there = count > 0
    count = xp.where(there, count, 1.0)
    ratio = xp.where(there, member @ (bins.weight * bins.density / density(bins.columns, theta)) / count, 1.0)
    ratio = xp.maximum(ratio, np.finfo(bins.density.dtype).tiny ** 0.5)  # the ordinates of a record without noise are zero
    informed = 2.0 / (2.0 / count + tolerance**2)
    total = xp.sum(xp.where(there, informed * (ratio - 1.0 - xp.log(ratio)), 0.0))
    return total, xp.maximum((xp.sum(there) - xp.sum(theta != 0)).astype(total.dtype), 1.0)


def without(bins: Bins, terms: tuple[str, ...], term: str) -> Bins:
    """The bins without a term: its column is set to zero, and its coefficient is then zero in a fit."""
    keep = np.array([name != term for name in terms])
    return bins._replace(columns=bins.columns * keep.astype(bins.columns.dtype)[None, :])


def _upto(bins: Bins, end) -> Bins:
    return bins._replace(weight=bins.weight * (bins.frequency <= end * (1 + 1e-6)))


def _search(bins: Bins, group, terms: tuple[str, ...]) -> float:
    """Find the upper end of the band in Hz (host only)."""
    used = bins.frequency[bins.weight > 0]
    ends = used.max() * 2.0 ** (-0.5 * np.arange(_ENDS))
    enough = np.sum(used[None, :] <= ends[:, None] * (1 + 1e-6), axis=1) >= len(terms) + _FEWEST
    parts = [_upto(bins, end) for end in ends]
    starts, weights = np.stack([flat_start(part) for part in parts]), np.stack([part.weight for part in parts])
    found = minimise(bins.columns, bins.density, weights, starts, rtol=ROUGH).theta
    tested = [deviance(part, theta, group, _TOLERANCE) for part, theta in zip(parts, found, strict=True)]
    total, freedom = (np.array(values) for values in zip(*tested, strict=True))
    # how much the upper octaves of each band add to the deviance, compared with the number of groups that they add
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
    """Fit the widest band, from the lowest frequency up, in which the model holds; all bins unless `automatic` (host only).

    A filter or a resonance of the sensor spoils high frequencies. The upper end is therefore lowered by half octaves until the chance
    of a worse deviance reaches one in a thousand, either for the whole band or for the part that its upper three octaves add. It is
    then lowered by another octave, because the model only just holds at that end.

    Below its corner a low-pass filter turns white noise into N^2 (1 - c f^2) with c of either sign. In a band whose high frequencies are
    cut off, the column `FILTER` describes this, so that it does not bias N. The column has the shape of Q and replaces it. A misfit of
    1 % of the density (0.5 % of the deviation) is allowed. `first` is the attempt on all bins without `FILTER`, if it is known already.
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
    """Fit all bins; the result can be differentiated with respect to the ordinates."""
    found = attempt(bins, group)
    return _judged(found, bins, found, bins, jnp.asarray(False))


def _judged(found: Attempt, bins: Bins, alone: Attempt, plain: Bins, cut) -> Fitted:
    goodness, inflation = inflation_of(found.deviance, found.freedom)
    return Fitted(*found[:3], bins, cut, inflation <= _TOO_WIDE, found.deviance, found.freedom, goodness, inflation, plain, alone)


def inflation_of(deviance, freedom) -> tuple[Any, Any]:
    """Chance of a worse deviance, and factor on the variances: 1 if the deviance may be chance, else deviance over degrees of freedom.

    The factor is continuous, so that a small change of the record cannot change intervals and likelihood ratios by a large factor.
    """
    xp, likely = namespace(deviance, freedom), chance(deviance, freedom)
    none, full = np.log(_WIDENED)
    share = xp.clip((xp.log(xp.maximum(likely, _TINY)) - none) / (full - none), 0.0, 1.0)
    return likely, 1.0 + share * xp.maximum(deviance / freedom - 1.0, 0.0)


def uncertainty(
    fitted: Fitted, widened: AnyArray, two_sided, one_sided, terms: tuple[str, ...], only: tuple[str, ...] | None = None
) -> tuple[AnyArray, Limits, AnyArray]:
    """Covariance of the squared coefficients (inverse Fisher information), profile-likelihood limits, and factors of record length.

    The factor of a term says how much longer a record must be to show a coefficient as large as its upper limit: to call the term
    present in 95 % of such records, and in only 1 % of records without it. Limits and factors are computed for all terms except
    `FILTER`, or for those named in `only`.

    Every variance is multiplied by `widened`, (p,), in addition to the inflation for a misfit of the spectrum. If high frequencies are
    cut off, the limits of Q are found without the filter, which has the same shape and replaces Q in the fit.
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
        # the column of the filter is negative: a start without it keeps the density positive when another coefficient is lowered
        first = xp.where(here, value, xp.where(terms_alone, state, 0.0))
        # if the only positive term is held at zero, the density would be zero at the start: the others start at their standard errors
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
