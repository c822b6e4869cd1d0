r"""Fit of the noise terms to an Allan variance curve, with intervals: `fit_curve` on the host and in a trace, the band on the host."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._types import AnyArray
from ._curve import GUESSED, Curve, Lanes, estimate, fixed_point, least_squares, whitened
from ._limits import Limits, chance, find_limits
from ._minimise import inverse, namespace
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


def alone(curve: Curve, used, cut) -> Lanes:
    """One fit to the cluster sizes used: of all terms, or where short ones are cut of the tail in place of its term."""
    xp = namespace(curve, used, cut)
    free = xp.append(~(cut & (curve.short > 0)), cut)
    return Lanes(used[None], free[None], xp.zeros((1, len(free)), dtype=curve.v.dtype))


def chi_square(curve: Curve, lanes: Lanes, theta, extra: Any = None) -> Any:
    """Least (v - A theta)' C^-1 (v - A theta) per lane, with C at the theta given."""
    return least_squares(whitened(curve, lanes.used, theta, True, extra), lanes, theta)[1]


def freedom(used, theta) -> Any:
    """Degrees of freedom of the chi-square."""
    xp = namespace(used, theta)
    return (xp.sum(used, axis=-1) - xp.sum(theta != 0.0, axis=-1)).astype(theta.dtype)


def choose_band(curve: Curve, used, full: bool) -> tuple[AnyArray, bool, bool]:
    """Cluster sizes from the first start whose chi-square passes, an octave on, or which comes nearest where none does (host only).

    Filters and output averaging in a sensor spoil short cluster times, so these are left out one by one until the chi-square
    of the rest, with a misfit of 0.25 % of the deviation allowed, is no worse than one in a thousand; then an octave more.

    Returns
    -------
    (clusters,) cluster sizes used, whether short ones were cut off, and whether the model holds.
    """

    def chances(lanes: Lanes):
        theta, _ = estimate(curve, lanes, full)
        found = chance(chi_square(curve, lanes, theta, (2.0 * _TOLERANCE * curve.v) ** 2), freedom(lanes.used, theta))
        return np.where(np.isfinite(found), found, -1.0)

    whole = float(chances(alone(curve, used, np.asarray(False)))[0])
    ranked = np.sort(curve.octave[used])
    last = max(len(ranked) - len(curve.short) - 5, 0)  # the latest start that leaves enough to fit
    if whole >= _REFUSED or not last:
        return used, False, whole >= _REFUSED
    tried = [alone(curve, used & (curve.octave >= start), np.asarray(True)) for start in ranked[1 : last + 1]]
    found = np.append(whole, chances(jax.tree.map(lambda *leaves: np.concatenate(leaves), *tried)))
    passed = found >= _REFUSED
    best = int(np.argmax(passed)) if passed.any() else int(np.argmax(found))
    if best == 0:
        return used, False, False
    return used & (curve.octave >= min(ranked[best] + _MARGIN, ranked[last])), True, bool(passed.any())


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


def covariance_of(curve: Curve, lanes: Lanes, theta, full: bool) -> Any:
    """Covariance of the estimate of one lane: (A' C^-1 A)^-1, or the sandwich G (A' D C D A) G, D = 1/diag C, G = (A' D A)^-1.

    The sandwich allows for cluster sizes that are far from independent.
    """
    xp = namespace(curve, lanes, theta)
    rows = xp.where(lanes.free[0][None, :], whitened(curve, lanes.used, theta, full)[0][0], 0.0)
    bread = inverse(rows.T @ rows)
    if full:
        return bread
    c = curve.covariance(theta)[0]
    scale = xp.sqrt(xp.where(lanes.used[0], xp.diagonal(c), 1.0))
    return bread @ (rows.T @ (c / scale[:, None] / scale[None, :]) @ rows) @ bread


def fit_curve(curve: Curve, used, cut, full: bool, heard: Response, two_sided, one_sided) -> Fitted:
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
    """
    xp = namespace(curve, used, cut)
    p = len(curve.short)
    lanes = alone(curve, used, cut)
    fitted, change = estimate(curve, lanes, full)
    reported = lanes.free[0, :p]
    spread = covariance_of(curve, lanes, fitted, full)
    theta, covariance = xp.where(reported, fitted[0, :p], 0.0), spread[:p, :p]
    modelled = curve.columns[:, :p] @ theta

    # the intervals carry no derivative
    curve, fitted, spread = jax.lax.stop_gradient((curve, fitted, spread)) if xp is jnp else (curve, fitted, spread)
    # the term that the tail replaces is tested without it, for it has its slope and no sign and would leave it without a limit
    own = np.eye(p, p + 1, dtype=bool)
    admitted = xp.where(reported[:, None], lanes.free[0][None, :], own | xp.append(reported, False)[None, :])

    def lanes_of(free, held):
        return Lanes(xp.broadcast_to(used, (len(free), len(used))), free, held)

    several = lanes_of(xp.concatenate([admitted, lanes.free]), xp.zeros((p + 1, p + 1), dtype=curve.v.dtype))
    rows, target = whitened(curve, lanes.used, fitted, True)
    white = xp.broadcast_to(rows, (p + 1, *rows.shape[1:])), xp.broadcast_to(target, (p + 1, *target.shape[1:]))
    least, chi = least_squares(white, several, xp.broadcast_to(fitted, (p + 1, p + 1)))
    number = freedom(used, fitted[0])
    goodness = chance(chi[p], number)
    inflation = xp.where(goodness < _WIDENED, xp.maximum(chi[p] / number, 1.0), 1.0)

    def ratio(index, value, state):
        """Rise of the chi-square when a coefficient is held, C taken at the fit so restricted, and that fit."""
        here, held = own[index], xp.where(own[index], value[:, None], 0.0)
        restricted = lanes_of(admitted[index] & ~here, held)
        at, _ = fixed_point(curve, restricted, xp.where(here, held, state), full, _SETTLED, _MOST)
        rows, target = whitened(curve, restricted.used, at, True)
        both = lanes_of(xp.concatenate([restricted.free, admitted[index]]), xp.concatenate([held, xp.zeros_like(held)]))
        white = xp.concatenate([rows, rows]), xp.concatenate([target, target])
        _, chi = least_squares(white, both, xp.concatenate([at, at]))
        return xp.maximum(chi[: len(here)] - chi[len(here) :], 0.0), at

    # the fit under a held coefficient begins afresh: from the unrestricted one, whose C is far too small at cluster times where
    # the coefficient held at zero had been, the iteration swings between two ends
    absent = lanes_of(admitted & ~own, xp.zeros((p, p + 1), dtype=curve.v.dtype))
    begun, _ = fixed_point(curve, absent, absent.held, False, GUESSED)
    # the search starts where the chi-square is least, near theta but for generalised least squares not at it
    reach = xp.sqrt(xp.where(reported, xp.diagonal(spread)[:p], spread[p, p]))
    middle = xp.diagonal(least[:p, :p])
    ends, without = find_limits(ratio, middle, reach, begun, two_sided * inflation, one_sided * inflation)
    skew = xp.stack([skewness(curve, used, heard, without[index], index) for index in range(p)])
    inside = xp.where(reported, fitted[0, :p], 0.0)
    limits = Limits(
        low=xp.where(reported, xp.minimum(ends.low, inside), 0.0),
        high=xp.maximum(ends.high, inside),
        upper=xp.maximum(ends.upper, inside),
        significance=xp.where(reported, as_normal(ends.significance / inflation, skew), 0.0),
    )
    variance = xp.diagonal(curve.covariance(xp.append(theta, 0.0)[None])[0])
    edf = 2.0 * modelled**2 / xp.where(used & (variance > 0.0), variance, 1.0)
    return Fitted(theta, covariance * inflation, limits, goodness, inflation, xp.max(change), modelled, edf)
