r"""Fit of binned ordinates in the band where the model holds, with intervals: pure functions for `jit`."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.special

from .._types import AnyArray, Array, Int
from ._curve import inverse
from ._likelihood import beginning, density, fisher, minimise, with_derivative
from ._limits import Limits, find_limits
from ._ordinates import Bins
from ._terms import Filter

FILTER = Filter.name
#: groups of bins whose mean ratio to the model is tested: the first ordinates, then log-spaced
_FIRST = (0, 4, 12, 24, 48)
_GROUPS = 40
#: misfit of the density that does not count against a model, and the chance of a worse deviance at which a band is refused
_TOLERANCE = 0.01
_REFUSED = 0.001
#: chance below which the intervals are widened to the scatter seen
_WIDENED = 0.01
#: scatter in units of that of the model above which the model is said not to hold
_TOO_WIDE = 4.0
#: upper ends of the band that are tried, half an octave apart, and by how many octaves more the first that passes comes down
_ENDS = 24
_OCTAVES = 6  # half octaves below its end against which a band is tested
_MARGIN = 1.0
#: standard errors at which 95 % of records show a coefficient that 1 % show by chance
_DECIDED = 2.326 + 1.645
#: bins beyond the number of terms that a band needs
_FEWEST = 20
#: where the search for the minimum starts besides the weighted fit, for the likelihood has local minima
_STARTS = ({}, {"B": 0.01, "K": 3.0}, {"Q": 0.0, "B": 3.0, "K": 0.01})


class Attempt(eqx.Module):
    """A fit of the bins as they are, its deviance and degrees of freedom, and those with the tolerated misfit allowed."""

    theta: AnyArray
    nll: AnyArray
    step: AnyArray
    deviance: AnyArray
    allowed: AnyArray
    freedom: AnyArray


class Fitted(eqx.Module):
    """The best fit in its band.

    theta : squared coefficients in units of `Bins.unit`. nll : its negative log-likelihood. step : last step. bins : the bins,
    with weight only in the band. cut : whether high frequencies were left out. holds : whether the model holds in the band.
    goodness : chance of a worse deviance. inflation : deviance over its degrees of freedom where that is needed, else 1.
    alone : squared coefficients and negative log-likelihood of the fit without the column `FILTER`, by which Q is judged.
    """

    theta: AnyArray
    nll: AnyArray
    step: AnyArray
    bins: Bins
    cut: AnyArray
    holds: AnyArray
    goodness: AnyArray
    inflation: AnyArray
    alone: tuple[AnyArray, AnyArray]


def groups_of(weight, ordinates: int) -> Int[np.ndarray, " bins"]:
    """Group of each bin for the goodness of fit."""
    edges = np.append(_FIRST[1:], np.geomspace(_FIRST[-1], max(ordinates, _FIRST[-1] + 1), _GROUPS - len(_FIRST) + 1)[1:-1])
    return np.searchsorted(edges, np.cumsum(weight) - 0.5 * np.asarray(weight))


@functools.partial(jax.jit, static_argnames="terms")
def attempt(bins: Bins, group: AnyArray, terms: tuple[str, ...]) -> Attempt:
    """The least of the minima reached from several starts, and how well it describes the bins.

    Parameters
    ----------
    bins : the bins.
    group : (bins,) group of each for the goodness of fit, `groups_of`.
    terms : names of the columns.
    """
    first = beginning(bins)
    factors = np.array([[start.get(term, 1.0) for term in terms] for start in _STARTS])
    tried = jax.vmap(lambda factor: minimise(bins, first * factor))(jnp.asarray(factors, dtype=first.dtype))
    found = jax.tree.map(lambda leaf: leaf[jnp.argmin(tried.nll)], tried)
    strict, freedom = deviance(bins, found.theta, group, 0.0)
    allowed, _ = deviance(bins, found.theta, group, _TOLERANCE)
    return Attempt(found.theta, found.nll, found.step, strict, allowed, freedom)


def first_model(bins: Bins, group, terms: tuple[str, ...]) -> np.ndarray:
    """Density of the best fit of all bins (host only)."""
    plain = _without(bins, terms, FILTER)
    return np.asarray(density(plain, np.asarray(attempt(plain, group, terms).theta)))


def deviance(bins: Bins, theta, group, tolerance):
    """Deviance of the groups' mean ratios to the model, and its degrees of freedom; a relative misfit of `tolerance` is allowed."""
    number = functools.partial(jax.ops.segment_sum, segment_ids=group, num_segments=_GROUPS + 2)
    count = number(bins.weight)
    there = count > 0
    ratio = number(bins.weight * bins.density / density(bins, theta)) / jnp.where(there, count, 1.0)
    ratio = jnp.where(there, ratio, 1.0)
    informed = 2.0 / (2.0 / jnp.where(there, count, 1.0) + tolerance**2)
    total = jnp.sum(jnp.where(there, informed * (ratio - 1.0 - jnp.log(ratio)), 0.0))
    return total, jnp.maximum((jnp.sum(there) - jnp.sum(theta > 0)).astype(total.dtype), 1.0)


def _chance(total, freedom, xp=jnp):
    """Chance of a larger chi-square."""
    tail = scipy.special.gammaincc if xp is np else jax.scipy.special.gammaincc
    return tail(freedom / 2.0, total / 2.0)


def _without(bins: Bins, terms: tuple[str, ...], term: str) -> Bins:
    """The bins with the column of a term zero, whose coefficient then is."""
    keep = np.array([name != term for name in terms])
    return eqx.tree_at(lambda b: b.columns, bins, bins.columns * keep.astype(bins.columns.dtype)[None, :])


def _upto(bins: Bins, end) -> Bins:
    below = bins.frequency <= end * (1 + 1e-6)
    return eqx.tree_at(lambda b: b.weight, bins, bins.weight * below.astype(bins.weight.dtype))


@functools.partial(jax.jit, static_argnames="terms")
def _trials(bins: Bins, group: AnyArray, ends: AnyArray, terms: tuple[str, ...]) -> tuple[Array, Array]:
    """Deviance and degrees of freedom of the fit of the bins up to each end."""

    def trial(end):
        part = _upto(bins, end)
        return deviance(part, minimise(part, beginning(part)).theta, group, _TOLERANCE)

    return jax.lax.map(trial, ends)


def _search(bins: Bins, group, terms: tuple[str, ...]) -> float:
    """Upper end of the band in Hz (host only)."""
    used = bins.frequency[bins.weight > 0]
    ends = used.max() * 2.0 ** (-0.5 * np.arange(_ENDS))
    enough = np.sum(used[None, :] <= ends[:, None] * (1 + 1e-6), axis=1) >= len(terms) + _FEWEST
    total, freedom = (np.asarray(values) for values in _trials(bins, group, ends, terms))
    # what the upper octaves of each band add to the deviance, against the groups that they add
    rise, added = total[:, None] - total[None, :], freedom[:, None] - freedom[None, :]
    distance = np.arange(_ENDS)[None, :] - np.arange(_ENDS)[:, None]
    tested = (distance > 0) & (distance <= _OCTAVES) & enough[None, :] & (added > 0)
    likely = _chance(np.maximum(rise, 0.0), np.maximum(added, 1.0), np) >= _REFUSED
    chance = np.where(enough, _chance(total, freedom, np), -1.0)
    fits = enough & (np.all(~tested | likely, axis=1) & np.any(tested, axis=1) | (chance >= _REFUSED))
    index = int(np.argmax(fits)) if fits.any() else int(np.argmax(chance))
    lower = ends[index] * 2.0**-_MARGIN
    if index == 0:
        return float(ends[0])
    return float(lower if np.sum(used <= lower) >= len(terms) + _FEWEST else ends[index])


def fit_bins(bins: Bins, group, automatic: bool, terms: tuple[str, ...]) -> Fitted:
    """Fit in the widest band from low frequency up in which the model holds; in all of it unless `automatic` (host only).

    A filter or a resonance of the sensor spoils high frequencies: the upper end comes down by half octaves until the deviance
    is no worse than one in a thousand, or what the band's upper three octaves add to it is not; then by an octave more, for
    there the model only just holds. In a band so cut the column `FILTER` takes what a low-pass leaves of white noise below its
    corner, N^2 (1 - c f^2), so that N is not biased by it; it has the shape of Q, which is then not estimated. A misfit of 1 %
    of the density (0.5 % of the deviation) is allowed.
    """
    plain = _without(bins, terms, FILTER)
    found = alone = attempt(plain, group, terms)
    inside, cut = plain, False
    if automatic and _chance(float(found.allowed), float(found.freedom), np) < _REFUSED:
        end = _search(plain, group, terms)
        cut = end < float(np.max(np.where(bins.weight > 0, bins.frequency, 0.0)))
    if cut:
        inside = _upto(bins, end)
        found, alone = attempt(inside, group, terms), attempt(_upto(plain, end), group, terms)
    goodness = float(_chance(float(found.deviance), float(found.freedom), np))
    inflation = max(float(found.deviance) / float(found.freedom), 1.0) if goodness < _WIDENED else 1.0
    fit, plain_fit = ([np.asarray(value) for value in (one.theta, one.nll, one.step)] for one in (found, alone))
    cut, holds, goodness, inflation = (np.asarray(value) for value in (cut, inflation <= _TOO_WIDE, goodness, inflation))
    return Fitted(fit[0], fit[1], fit[2], inside, cut, holds, goodness, inflation, (plain_fit[0], plain_fit[1]))


def fit_whole(bins: Bins, group, terms: tuple[str, ...]) -> Fitted:
    """Fit of all bins, differentiable with respect to the ordinates."""
    found = attempt(jax.lax.stop_gradient(bins), group, terms)
    goodness = _chance(found.deviance, found.freedom)
    inflation = jnp.where(goodness < _WIDENED, jnp.maximum(found.deviance / found.freedom, 1.0), 1.0)
    theta = with_derivative(bins, found.theta)
    return Fitted(
        theta, found.nll, found.step, bins, jnp.asarray(False), inflation <= _TOO_WIDE, goodness, inflation, (found.theta, found.nll)
    )


@functools.partial(jax.jit, static_argnames="terms")
def uncertainty(
    fitted: Fitted, widened: AnyArray, two_sided: AnyArray, one_sided: AnyArray, terms: tuple[str, ...]
) -> tuple[Array, Limits, Array]:
    """Covariance of the squared coefficients (inverse Fisher information), profile-likelihood limits, and by which factor the
    record must be longer to decide whether a coefficient at its upper limit is there: to tell it from zero in 95 % of records,
    and call it present without it in 1 %.

    Every variance is `widened`, (p,), beside what the misfit of the spectrum makes of it.
    In a cut band Q is left out of the information, and its own limits are found without the filter, whose shape it has.
    """
    bins, theta, nll, apart = jax.tree.map(jnp.asarray, jax.lax.stop_gradient((fitted.bins, fitted.theta, fitted.nll, fitted.alone)))
    cut = jnp.asarray(fitted.cut)
    informed = jax.tree.map(lambda a, b: jnp.where(cut, a, b), _without(bins, terms, "Q"), bins)
    spread = inverse(fisher(informed, theta))
    alone = _without(bins, terms, FILTER)
    short = jnp.asarray([term == "Q" for term in terms]) & cut
    negative = jnp.asarray([term == FILTER for term in terms])

    def rise(index, value, state):
        here = jnp.arange(theta.shape[0]) == index
        least = jnp.where(short[index], apart[1], nll)
        seen = jax.tree.map(lambda a, b: jnp.where(short[index], a, b), alone, bins)
        # the filter's column is negative: starting without it keeps the density positive when another term goes
        first = jnp.where(here, value, jnp.where(negative, 0.0, state))
        # with the only term held at zero there would be no density to begin with: the others begin at their standard errors
        dark = jnp.any((seen.weight > 0) & (seen.columns @ first <= 0.0))
        found = minimise(seen, jnp.where(dark & ~here & ~negative, jnp.maximum(state, reach), first), (index, value))
        return 2.0 * (found.nll - least), found.theta

    scale = jnp.asarray(fitted.inflation, theta.dtype) * jnp.asarray(widened, theta.dtype)
    levels = [jnp.asarray(level, theta.dtype) * scale for level in (two_sided, one_sided)]
    middle = jnp.where(short, apart[0], theta)
    reach = jnp.sqrt(jnp.diagonal(spread))
    reach = jnp.where(short, jnp.sqrt(jnp.diagonal(inverse(fisher(alone, apart[0])))), reach)
    limits = find_limits(rise, middle, reach, theta, *levels)

    def longer(index, upper):
        at = jnp.where(jnp.arange(theta.shape[0]) == index, upper, theta)
        return inverse(fisher(informed, at))[index, index] * scale[index] * (_DECIDED / upper) ** 2

    decides = jax.vmap(longer)(jnp.arange(theta.shape[0]), jnp.maximum(limits.upper, jnp.finfo(theta.dtype).tiny ** 0.25))
    spread = spread * jnp.sqrt(scale[:, None] * scale[None, :])
    return spread, eqx.tree_at(lambda found: found.significance, limits, limits.significance / scale), decides
