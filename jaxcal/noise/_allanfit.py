r"""Fit of the noise terms to an Allan variance curve, with intervals: `fit_curve` on the host and in a trace, the band on the host."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._types import AnyArray
from ._curve import GUESSED, Curve, Lane, estimate, settle, whitened
from ._lanes import inverse, namespace
from ._limits import Limits, chance, find_limits
from ._skewness import Response, as_normal, skewness

#: misfit of the deviation that does not count against a model, and the chance of a worse chi-square at which a band is refused
_TOLERANCE = 0.0025
_REFUSED = 0.001
#: chance below which the intervals are widened to the scatter seen
_WIDENED = 0.01
#: octaves left out beyond the first cluster time at which the model passes, for there it only just does
_MARGIN = 1.0
#: change of the modelled variance at which the fit under a held coefficient has settled, and its most steps
_SETTLED, _MOST = 1e-3, 15


def alone(curve: Curve, used, cut) -> Lane:
    """One fit to the cluster sizes used: of all terms, or where short ones are cut of the tail in place of its term."""
    xp = namespace(curve, used, cut)
    free = xp.append(~(cut & (curve.short > 0)), cut)
    return Lane(used[None], free[None], xp.zeros((1, len(free)), dtype=curve.v.dtype), None)


def freedom(used, theta) -> Any:
    """Degrees of freedom of the chi-square."""
    xp = namespace(used, theta)
    return (xp.sum(used, axis=-1) - xp.sum(theta != 0.0, axis=-1)).astype(theta.dtype)


def choose_band(curve: Curve, used, full: bool) -> tuple[AnyArray, bool, bool, Any]:
    """Cluster sizes from the first start whose chi-square passes, an octave on, or which comes nearest where none does (host only).

    Filters and output averaging in a sensor spoil short cluster times, so these are left out one by one until the chi-square
    of the rest, with a misfit of 0.25 % of the deviation allowed, is no worse than one in a thousand; then an octave more.

    Returns
    -------
    (clusters,) cluster sizes used, whether short ones were cut off, whether the model holds, and the estimate where none were.
    """

    def chances(lanes: Lane):
        theta, change = estimate(curve, lanes, full)
        chi = settle(curve, lanes, theta, full, most=0, extra=(2.0 * _TOLERANCE * curve.v) ** 2).held
        found = chance(chi, freedom(lanes.used, theta))
        return np.where(np.isfinite(found), found, -1.0), (theta, change)

    (whole,), estimated = chances(alone(curve, used, np.asarray(False)))
    ranked = np.sort(curve.octave[used])
    last = max(len(ranked) - len(curve.short) - 5, 0)  # the latest start that leaves enough to fit
    if whole >= _REFUSED or not last:
        return used, False, bool(whole >= _REFUSED), estimated
    tried = [alone(curve, used & (curve.octave >= start), np.asarray(True)) for start in ranked[1 : last + 1]]
    found = np.append(whole, chances(jax.tree.map(lambda *leaves: np.concatenate(leaves), *tried))[0])
    passed = found >= _REFUSED
    best = int(np.argmax(passed)) if passed.any() else int(np.argmax(found))
    if best == 0:
        return used, False, False, estimated
    return used & (curve.octave >= min(ranked[best] + _MARGIN, ranked[last])), True, bool(passed.any()), None


class Fitted(eqx.Module):
    """A fit of the curve.

    theta : squared coefficients of the terms. covariance : theirs. limits : their limits. goodness : p value of the chi-square.
    inflation : variance factor on the covariance and on every level, above 1 where the curve scatters more than the noise model
    says. step : last change of the weights. modelled, edf : variance of the fitted terms, and its degrees of freedom.
    """

    theta: AnyArray
    covariance: AnyArray
    limits: Limits
    goodness: Any
    inflation: Any
    step: Any
    modelled: AnyArray
    edf: AnyArray


def covariance_of(curve: Curve, lanes: Lane, theta, full: bool) -> Any:
    """Covariance of the estimate of the first lane: (A' C^-1 A)^-1, or the sandwich G (A' D C D A) G, D = 1/diag C, G = (A' D A)^-1.

    The sandwich allows for cluster sizes that are far from independent.
    """
    xp = namespace(curve, lanes, theta)
    rows = xp.where(lanes.free[0][None, :], whitened(curve, lanes.used[0], theta, full)[0], 0.0)
    bread = inverse(rows.T @ rows)
    if full:
        return bread
    c = curve.covariance(theta)
    scale = xp.sqrt(xp.where(lanes.used[0], xp.diagonal(c), 1.0))
    return bread @ (rows.T @ (c / scale[:, None] / scale[None, :]) @ rows) @ bread


def fit_curve(curve: Curve, used, cut, full: bool, heard: Response, two_sided, one_sided, estimated: Any = None) -> Fitted:
    r"""Fit the cluster sizes used.

    What a filter of white noise, or a line of the spectrum, leaves at cluster times well above its own is N^2/tau + c/tau^2 with c
    of either sign. So with a `cut` band a tail of that slope is fitted beside the terms; it takes the place of that which only
    short cluster times show (Q), which is then not estimated.

    Parameters
    ----------
    curve : the curve.
    used, cut : (clusters,) cluster sizes that take part, and whether short ones are cut off.
    full : weights from the whole covariance, or from its diagonal.
    heard : what the cluster sizes make of each frequency, for the test of absent terms.
    two_sided, one_sided : rise of the chi-square at the ends of intervals and at upper limits.
    estimated : what `estimate` gives, where it is known.
    """
    xp = namespace(curve, used, cut)
    p = len(curve.short)
    lanes = alone(curve, used, cut)
    fitted, change = (found[0] for found in estimated or estimate(curve, lanes, full))
    reported = lanes.free[0, :p]
    spread = covariance_of(curve, lanes, fitted, full)
    theta, covariance = xp.where(reported, fitted[:p], 0.0), spread[:p, :p]
    modelled = curve.columns[:, :p] @ theta

    # the intervals carry no derivative
    curve, fitted, spread = jax.lax.stop_gradient((curve, fitted, spread)) if xp is jnp else (curve, fitted, spread)
    # the term that the tail replaces is tested without it, for it has its slope and no sign and would leave it without a limit
    own = np.eye(p, p + 1, dtype=bool)
    admitted = xp.where(reported[:, None], lanes.free[0][None, :], own | xp.append(reported, False)[None, :])

    def lanes_of(free, held, wider=None):
        return Lane(xp.broadcast_to(used, (len(free), len(used))), free, held, wider)

    several = xp.concatenate([admitted, lanes.free])
    again, none = xp.broadcast_to(fitted, several.shape), xp.zeros(several.shape, dtype=curve.v.dtype)
    least = settle(curve, lanes_of(several, none, several), again, full, most=0)
    number = freedom(used, fitted)
    goodness = chance(least.least[p], number)
    inflation = xp.where(goodness < _WIDENED, xp.maximum(least.least[p] / number, 1.0), 1.0)

    def ratio(index, value, state):
        """Rise of the chi-square when a coefficient is held, C taken at the fit so restricted, and that fit."""
        here, held = own[index], xp.where(own[index], value[:, None], 0.0)
        restricted = lanes_of(admitted[index] & ~here, held, admitted[index])
        found = settle(curve, restricted, xp.where(here, held, state), full, _SETTLED, _MOST)
        return xp.maximum(found.held - found.least, 0.0), found.theta

    # the fit under a held coefficient begins afresh: from the unrestricted one, whose C is far too small at cluster times where
    # the coefficient held at zero had been, the iteration swings between two ends
    absent = lanes_of(admitted & ~own, xp.zeros((p, p + 1), dtype=curve.v.dtype))
    begun = settle(curve, absent, absent.held, False, GUESSED).theta
    # the search starts where the chi-square is least, near theta but for generalised least squares not at it
    reach = xp.sqrt(xp.where(reported, xp.diagonal(spread)[:p], spread[p, p]))
    middle = xp.diagonal(least.best[:p, :p])
    ends, without = find_limits(ratio, middle, reach, begun, two_sided * inflation, one_sided * inflation)
    skew = xp.stack([skewness(curve, used, heard, without[index], index) for index in range(p)])
    inside = xp.where(reported, fitted[:p], 0.0)
    limits = Limits(
        low=xp.where(reported, xp.minimum(ends.low, inside), 0.0),
        high=xp.maximum(ends.high, inside),
        upper=xp.maximum(ends.upper, inside),
        significance=xp.where(reported, as_normal(ends.significance / inflation, skew), 0.0),
    )
    variance = xp.diagonal(curve.covariance(xp.append(theta, 0.0)))
    edf = 2.0 * modelled**2 / xp.where(used & (variance > 0.0), variance, 1.0)
    return Fitted(theta, covariance * inflation, limits, goodness, inflation, change, modelled, edf)
