r"""Fit of binned ordinates in the band where the model holds, with intervals: pure functions for `jit`."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._types import AnyArray, Array, Bool, Float, Int
from ._likelihood import Minimum, beginning, density, fisher, inverse, minimise, with_derivative
from ._limits import Limits, find_limits
from ._ordinates import FILTER, Bins

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


class Fitted(eqx.Module):
    """The best fit in its band.

    theta : squared coefficients in units of `Bins.unit`. nll : its negative log-likelihood. step : last step. bins : the bins,
    with weight only in the band. cut : whether high frequencies were left out. holds : whether the model holds in the band.
    goodness : chance of a worse deviance. inflation : deviance over its degrees of freedom where that is needed, else 1.
    """

    theta: Float[Array, " p"]
    nll: Float[Array, ""]
    step: Float[Array, ""]
    bins: Bins
    cut: Bool[Array, ""]
    holds: Bool[Array, ""]
    goodness: Float[Array, ""]
    inflation: Float[Array, ""]


def groups_of(weight, ordinates: int) -> Int[np.ndarray, " bins"]:
    """Group of each bin for the goodness of fit."""
    edges = np.append(_FIRST[1:], np.geomspace(_FIRST[-1], max(ordinates, _FIRST[-1] + 1), _GROUPS - len(_FIRST) + 1)[1:-1])
    return np.searchsorted(edges, np.cumsum(weight) - 0.5 * np.asarray(weight))


def best(bins: Bins, terms: tuple[str, ...]) -> Minimum:
    """The least of the minima reached from several starts."""
    first = beginning(bins)
    factors = np.array([[start.get(term, 1.0) for term in terms] for start in _STARTS])
    found = jax.vmap(lambda factor: minimise(bins, first * factor))(jnp.asarray(factors, dtype=first.dtype))
    return jax.tree.map(lambda leaf: leaf[jnp.argmin(found.nll)], found)


@functools.partial(jax.jit, static_argnames="terms")
def first_model(bins: Bins, terms: tuple[str, ...]) -> Float[Array, " bins"]:
    """Density of the best fit of all bins."""
    return density(bins, best(_plain(bins, terms), terms).theta)


def _plain(bins: Bins, terms: tuple[str, ...]) -> Bins:
    """The bins without the column of a filter, whose coefficient then is zero."""
    return _without(bins, terms, FILTER)


def _without(bins: Bins, terms: tuple[str, ...], term: str) -> Bins:
    if term not in terms:
        return bins
    return eqx.tree_at(lambda b: b.columns, bins, jnp.asarray(bins.columns).at[:, terms.index(term)].set(0.0))


def deviance(bins: Bins, theta, group, tolerance):
    """Deviance of the groups' mean ratios to the model, its degrees of freedom, and the chance of a worse one."""
    number = functools.partial(jax.ops.segment_sum, segment_ids=group, num_segments=_GROUPS + 2)
    count = number(bins.weight)
    there = count > 0
    ratio = number(bins.weight * bins.density / density(bins, theta)) / jnp.where(there, count, 1.0)
    ratio = jnp.where(there, ratio, 1.0)
    informed = 2.0 / (2.0 / jnp.where(there, count, 1.0) + tolerance**2)
    total = jnp.sum(jnp.where(there, informed * (ratio - 1.0 - jnp.log(ratio)), 0.0))
    freedom = (jnp.sum(there) - jnp.sum(theta > 0)).astype(total.dtype)
    freedom = jnp.maximum(freedom, 1.0)
    return total, freedom, jax.scipy.special.gammaincc(freedom / 2.0, total / 2.0)


@functools.partial(jax.jit, static_argnames="terms")
def fit_bins(bins: Bins, group: AnyArray, automatic: AnyArray, terms: tuple[str, ...]) -> Fitted:
    """Fit in the widest band from low frequency up in which the model holds; in all of it unless `automatic`.

    A filter or a resonance of the sensor spoils high frequencies: the upper end comes down by half octaves until the deviance
    is no worse than one in a thousand, or what the band's upper three octaves add to it is not; then by an octave more,
    for there the model only just holds. In a band so cut the column `FILTER` takes what a low-pass leaves of white noise below its
    corner, N^2 (1 - c f^2), so that N is not biased by it; it has the shape of Q, which is then not estimated. A misfit of 1 %
    of the density (0.5 % of the deviation) is allowed.
    """
    bins = jax.tree.map(jnp.asarray, bins)
    fixed = jax.lax.stop_gradient(bins)
    still = _plain(fixed, terms)
    there = still.weight > 0
    top = jnp.max(jnp.where(there, still.frequency, 0.0))

    def upto(b, end):
        return eqx.tree_at(lambda x: x.weight, b, jnp.where(b.frequency <= end * (1 + 1e-6), b.weight, 0.0))

    def trial(end):
        part = upto(still, end)
        found = minimise(part, beginning(part))
        enough = jnp.sum(part.weight > 0) >= len(terms) + _FEWEST
        return (*deviance(part, found.theta, group, _TOLERANCE), enough)

    whole = best(still, terms)
    passes = deviance(still, whole.theta, group, _TOLERANCE)[2] >= _REFUSED

    def search(_):
        ends = top * jnp.exp2(-0.5 * jnp.arange(_ENDS, dtype=top.dtype))
        total, freedom, chance, enough = jax.lax.map(trial, ends)
        # what the upper octaves of each band add to the deviance, against the groups that they add
        rise, added = total[:, None] - total[None, :], freedom[:, None] - freedom[None, :]
        distance = jnp.arange(_ENDS)[None, :] - jnp.arange(_ENDS)[:, None]
        tested = (distance > 0) & (distance <= _OCTAVES) & enough[None, :] & (added > 0)
        likely = jax.scipy.special.gammaincc(jnp.maximum(added, 1.0) / 2.0, jnp.maximum(rise, 0.0) / 2.0)
        fits = enough & (jnp.all(~tested | (likely >= _REFUSED), axis=1) & jnp.any(tested, axis=1) | (chance >= _REFUSED))
        index = jnp.where(jnp.any(fits), jnp.argmax(fits), jnp.argmax(jnp.where(enough, chance, -1.0)))
        lower = ends[index] * 2.0**-_MARGIN
        possible = jnp.sum((still.weight > 0) & (still.frequency <= lower)) >= len(terms) + _FEWEST
        return jnp.where(index == 0, top, jnp.where(possible, lower, ends[index]))

    end = jax.lax.cond(passes | ~automatic, lambda _: top, search, None)
    cut = end < top
    inside = jax.tree.map(lambda a, b: jnp.where(cut, a, b), upto(fixed, end), still)
    found = jax.lax.cond(cut, lambda: best(inside, terms), lambda: whole)
    total, freedom, goodness = deviance(inside, found.theta, group, 0.0)
    inflation = jnp.where(goodness < _WIDENED, jnp.maximum(total / freedom, 1.0), 1.0)
    holds = inflation <= _TOO_WIDE
    theta = with_derivative(jax.tree.map(lambda a, b: jnp.where(cut, a, b), upto(bins, end), _plain(bins, terms)), found)
    return Fitted(theta, found.nll, found.step, inside, cut, holds, goodness, inflation)


@functools.partial(jax.jit, static_argnames="terms")
def uncertainty(fitted: Fitted, two_sided: AnyArray, one_sided: AnyArray, terms: tuple[str, ...]) -> tuple[Array, Limits, Array]:
    """Covariance of the squared coefficients (inverse Fisher information), profile-likelihood limits, and by which factor the
    record must be longer to decide whether a coefficient at its upper limit is there: to tell it from zero in 95 % of records,
    and call it present without it in 1 %.

    In a cut band Q is left out of the information, and its own limits are found without the filter, whose shape it has.
    """
    bins, theta = jax.tree.map(jnp.asarray, jax.lax.stop_gradient((fitted.bins, fitted.theta)))
    cut = jnp.asarray(fitted.cut) if FILTER in terms else jnp.asarray(False)
    informed = jax.tree.map(lambda a, b: jnp.where(cut, a, b), _without(bins, terms, "Q"), bins)
    spread = inverse(fisher(informed, theta))
    alone = _plain(bins, terms)
    apart = best(alone, terms) if FILTER in terms and "Q" in terms else Minimum(theta, fitted.nll, fitted.step)
    short = jnp.asarray([term == "Q" for term in terms]) & cut
    negative = jnp.asarray([term == FILTER for term in terms])

    def rise(index, value, state):
        here = jnp.arange(theta.shape[0]) == index
        least = jnp.where(short[index], apart.nll, fitted.nll)
        seen = jax.tree.map(lambda a, b: jnp.where(short[index], a, b), alone, bins)
        # the filter's column is negative: starting without it keeps the density positive when another term goes
        found = minimise(seen, jnp.where(here, value, jnp.where(negative, 0.0, state)), (index, value))
        return 2.0 * (found.nll - least), found.theta

    scale = fitted.inflation
    levels = [jnp.asarray(level, theta.dtype) * scale for level in (two_sided, one_sided)]
    middle = jnp.where(short, apart.theta, theta)
    reach = jnp.sqrt(jnp.diagonal(spread))
    reach = jnp.where(short, jnp.sqrt(jnp.diagonal(inverse(fisher(alone, apart.theta)))), reach)
    limits = find_limits(rise, middle, reach, theta, *levels)

    def longer(index, upper):
        at = jnp.where(jnp.arange(theta.shape[0]) == index, upper, theta)
        return inverse(fisher(informed, at))[index, index] * scale * (_DECIDED / upper) ** 2

    decides = jax.vmap(longer)(jnp.arange(theta.shape[0]), jnp.maximum(limits.upper, jnp.finfo(theta.dtype).tiny ** 0.25))
    return spread * scale, eqx.tree_at(lambda found: found.significance, limits, limits.significance / scale), decides
