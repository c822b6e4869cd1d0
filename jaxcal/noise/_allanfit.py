r"""Fit of the noise terms to an Allan variance curve in the band where the model holds: pure functions for `jit`, `vmap` and `grad`."""

import equinox as eqx
import jax
import jax.numpy as jnp

from .._types import Array, Bool, Float
from ._curve import Curve, chi_square, whitened
from ._estimator import SETTLED, Estimator, settle, with_derivative
from ._limits import Limits, find_limits
from ._skewness import Response, as_normal, skewness

#: misfit of the deviation that does not count against a model, and the chance of a worse chi-square at which a band is refused
_TOLERANCE = 0.0025
_REFUSED = 0.001
#: chance below which the intervals are widened to the scatter seen
_WIDENED = 0.01
#: octaves left out beyond the first cluster time at which the model passes, for there it only just does
_MARGIN = 1.0
#: change of the modelled variance at which the fit under a held coefficient has settled, and its most steps
_SETTLED = 1e-3
_MOST = 15


def drop(curve: Curve, estimator: Estimator, index, value) -> Float[Array, ""]:
    """Rise of the chi-square when coefficient `index` (squared) is held at `value`, C taken at the fit so restricted.

    That fit begins afresh for each value: from the unrestricted one, whose C is far too small at cluster times where the
    coefficient held at zero had been, the iteration swings between two ends.
    """
    restricted = curve.fixed(index, value)
    at, _ = settle(restricted, estimator, estimator.begin(restricted), _MOST, _SETTLED)
    white = whitened(restricted, at)
    both = white.solve_each(curve, jnp.stack([restricted.free, curve.free]), jnp.stack([restricted.held, curve.held]))
    return jnp.maximum(white.chi_square(both[0]) - white.chi_square(both[1]), 0.0)


class Band(eqx.Module):
    """Where a fit starts, and the fit there.

    start : base-2 logarithm of the shortest cluster size. cut : whether short cluster times are left out. holds : whether the
    model holds. theta, change : from `settle`.
    """

    start: Float[Array, ""]
    cut: Bool[Array, ""]
    holds: Bool[Array, ""]
    theta: Float[Array, " p"]
    change: Float[Array, ""]


def part(curve: Curve, start, cut) -> Curve:
    """The curve from `start` on, with the tail, its last column, where short cluster times are cut off."""
    longer = eqx.tree_at(lambda c: c.used, curve, curve.used & (curve.octave >= start))
    return longer.only((jnp.arange(curve.free.shape[0]) < curve.free.shape[0] - 1) | cut)


def freedom(curve: Curve, theta) -> Float[Array, ""]:
    """Degrees of freedom of the chi-square."""
    return (jnp.sum(curve.used) - jnp.sum(theta > 0.0)).astype(curve.v.dtype)


def choose_band(curve: Curve, estimator: Estimator, automatic) -> Band:
    """The first start whose chi-square passes, an octave on; where none does, that which comes nearest."""
    last = jnp.maximum(jnp.sum(curve.used) - curve.free.shape[0] - 4, 0)  # the latest start that leaves enough to fit
    ranked = jnp.sort(jnp.where(curve.used, curve.octave, jnp.inf))

    def fitted(start, cut):
        rest = part(curve, start, cut)
        theta, change = settle(rest, estimator, estimator.begin(rest), estimator.most, SETTLED)
        least = chi_square(rest, theta, (2.0 * _TOLERANCE * rest.v) ** 2)
        chance = jax.scipy.stats.chi2.sf(least, freedom(rest, theta))
        return theta, change, jnp.where(jnp.isfinite(chance), chance, -1.0)

    def body(state):
        _, best, highest, tried, chosen, _ = state
        cut = jnp.where(chosen, best, tried) > 0
        start = jnp.where(chosen & cut, jnp.minimum(ranked[best] + _MARGIN, ranked[last]), ranked[tried])
        start = jnp.where(cut, start, ranked[0])
        theta, change, chance = fitted(start, cut)
        best, highest = jnp.where(~chosen & (chance > highest), tried, best), jnp.where(chosen, highest, jnp.maximum(highest, chance))
        passes = highest >= _REFUSED
        over = chosen | (passes & (tried == 0))  # the whole curve needs no second fit
        ended = passes | jnp.logical_not(automatic) | (tried >= last)
        return Band(start, cut, passes, theta, change), best, highest, tried + 1, ended, over

    none, one, false = jnp.zeros((), last.dtype), jnp.ones((), curve.v.dtype), jnp.zeros((), bool)
    first = Band(0 * one, false, false, jnp.zeros_like(curve.held), 0 * one)
    return jax.lax.while_loop(lambda state: ~state[-1], body, (first, none, -2.0 * one, none, false, false))[0]


class Banded(eqx.Module):
    """The fit in the band where the model holds.

    theta : squared coefficients of the terms. covariance : theirs. limits : their limits. used : cluster sizes in the band.
    cut : whether short cluster times were left out. holds : whether the model holds. goodness : p value of the chi-square.
    inflation : factor on the covariance and on every level, above 1 where the curve scatters more than the noise model says.
    step : last step of the weights. modelled, edf : variance of the fitted terms, and its degrees of freedom.
    """

    theta: Float[Array, " p"]
    covariance: Float[Array, "p p"]
    limits: Limits
    used: Bool[Array, " clusters"]
    cut: Bool[Array, ""]
    holds: Bool[Array, ""]
    goodness: Float[Array, ""]
    inflation: Float[Array, ""]
    step: Float[Array, ""]
    modelled: Float[Array, " clusters"]
    edf: Float[Array, " clusters"]


def fit_band(curve: Curve, estimator: Estimator, heard: Response, short, automatic, two_sided, one_sided) -> Banded:
    r"""Fit the curve from the shortest cluster time on from which the model holds; all of it unless `automatic`.

    Filters and output averaging in a sensor spoil short cluster times, so these are left out one by one until the chi-square
    of the rest, with a misfit of 0.25 % of the deviation allowed, is no worse than one in a thousand; then an octave more.
    What a filter of white noise, or a line of the spectrum, leaves at cluster times well above its own is N^2/tau + c/tau^2
    with c of either sign. So with a cut band a tail of that slope, the last column, is fitted beside the terms; it takes the
    place of those that only `short` cluster times show (Q), which are then not estimated.

    Parameters
    ----------
    curve : the curve; its last column is that of the tail, of negative sign.
    estimator : how the coefficients follow from the curve.
    heard : what the cluster sizes make of each frequency, for the test of absent terms.
    short : (p,) which terms only short cluster times show.
    automatic : whether to choose the band.
    two_sided, one_sided : rise of the chi-square at the ends of intervals and at upper limits.
    """
    p = len(short)
    is_tail = jnp.arange(p + 1) == p
    # neither the choice of the band nor the interval carries a derivative
    band = choose_band(jax.lax.stop_gradient(curve), estimator, automatic)
    inside = part(curve, band.start, band.cut)
    everything = with_derivative(inside, estimator, band.theta, band.change)
    reported = ~(short & band.cut)
    theta = jnp.where(reported, everything[:p], 0.0)
    spread = estimator.spread(inside, everything, jnp.append(reported, band.cut))

    still, fitted, spread_now = jax.lax.stop_gradient((inside, everything, spread))
    # a short term is tested without the tail, which has its slope and no sign and would leave it without a limit
    own = jnp.arange(p)[:, None] == jnp.arange(p + 1)[None, :]
    admitted = jnp.where(reported[:, None], ~is_tail[None, :] | band.cut, own | jnp.append(reported, False)[None, :])
    white = whitened(still, fitted)
    least = white.solve_each(still, jnp.concatenate([admitted, still.free[None, :]]), jnp.zeros((p + 1, p + 1), curve.v.dtype))

    strict, number = white.chi_square(least[p]), freedom(still, fitted)
    goodness = jax.scipy.stats.chi2.sf(strict, number)
    inflation = jnp.where(goodness < _WIDENED, jnp.maximum(strict / number, 1.0), 1.0)

    def rise(index, value, state):
        return drop(eqx.tree_at(lambda c: c.free, still, admitted[index]), estimator, index, value), state

    def skew(index):
        absent = eqx.tree_at(lambda c: c.free, still, admitted[index]).fixed(index, 0.0)
        return skewness(absent, heard, settle(absent, estimator, estimator.begin(absent), _MOST, _SETTLED)[0], index)

    # the search starts where the chi-square is least, near theta but for generalised least squares not at it
    reach = jnp.sqrt(jnp.where(reported, jnp.diagonal(spread_now)[:p], spread_now[p, p]))
    ends = find_limits(rise, jnp.diagonal(least[:p, :p]), reach, (), two_sided * inflation, one_sided * inflation)
    middle = jnp.where(reported, fitted[:p], 0.0)
    ends = Limits(
        low=jnp.where(reported, jnp.minimum(ends.low, middle), 0.0),
        high=jnp.maximum(ends.high, middle),
        upper=jnp.maximum(ends.upper, middle),
        significance=jnp.where(reported, as_normal(ends.significance / inflation, jax.vmap(skew)(jnp.arange(p))), 0.0),
    )
    spread = spread[:p, :p] * inflation
    modelled = curve.columns[:, :p] @ theta
    variance = inside.variance(jnp.append(theta, 0.0))
    edf = 2.0 * modelled**2 / jnp.where(inside.used & (variance > 0.0), variance, 1.0)
    return Banded(theta, spread, ends, inside.used, band.cut, band.holds, goodness, inflation, band.change, modelled, edf)
