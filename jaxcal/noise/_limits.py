"""Intervals and limits by inversion of a likelihood-ratio test: the values of one coefficient at which the ratio reaches a level."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import namespace
from .._types import AnyArray, Float

#: significance above which a term is a hint, and above which it is present. Without the term, 5 % and 1 % of records exceed these,
#: because a coefficient cannot be negative (S. G. Self and K.-Y. Liang, J. Am. Stat. Assoc. 82, 1987)
HINT, PRESENT = 2.71, 5.41
#: number of steps of a search; times the level at which values of a search are capped; relative distance from the level, in the root of the
#: likelihood ratio, from which one last secant reaches it
_SEARCH, _FAR, _CLOSE = 12, 8.0, 3e-3


class Limits(NamedTuple):
    """Per term: interval ends, one-sided upper limit (squared coefficients), and the likelihood ratio at zero."""

    low: Float[AnyArray, " p"]
    high: Float[AnyArray, " p"]
    upper: Float[AnyArray, " p"]
    significance: Float[AnyArray, " p"]

    def scaled(self, unit) -> "Limits":
        """The limits of squared coefficients in another unit."""
        return Limits(self.low * unit, self.high * unit, self.upper * unit, self.significance)

    def reaching(self, index: int, low: float, high: float, upper: float) -> "Limits":
        """The limits, of which those of one term also contain the given ones."""
        found = [np.array(self.low), np.array(self.high), np.array(self.upper)]
        for ends, value, further in zip(found, (low, high, upper), (min, max, max), strict=True):
            ends[index] = further(ends[index], value)
        return Limits(*found, self.significance)


@functools.cache
def levels_of(confidence: float) -> tuple[float, float]:
    """Likelihood ratio at the ends of a two-sided interval, and at a one-sided upper limit."""
    return 2.0 * float(scipy.special.gammaincinv(0.5, confidence)), float(scipy.special.ndtri(confidence)) ** 2


def chance(rise, freedom) -> Any:
    """Probability of a larger chi-square."""
    tail = scipy.special.gammaincc if namespace(rise, freedom) is np else jax.scipy.special.gammaincc
    return tail(freedom / 2.0, rise / 2.0)


def wald(theta, covariance, two_sided, one_sided) -> Limits:
    """Limits of squared coefficients whose estimates are normal, none below zero."""
    xp = namespace(theta, covariance)
    error = xp.sqrt(xp.diagonal(covariance))
    both, one = error * np.sqrt(two_sided), error * np.sqrt(one_sided)
    ratio = xp.where(error > 0.0, theta / xp.where(error > 0.0, error, 1.0), 0.0)
    return Limits(xp.maximum(theta - both, 0.0), theta + both, theta + one, ratio**2)


def find_limits(ratio: Callable[[Any, Any, Any], tuple[Any, Any]], theta, reach, start, two_sided, one_sided) -> tuple[Limits, Any]:
    """Squared coefficients at which the likelihood ratio reaches a level, and the states at zero.

    The square root of the ratio is nearly linear in the coefficient itself. False position on these two (N. Anderson and A. Bjoerck,
    BIT 13, 1973) therefore finds the crossing in few steps; all searches run together. A low end is 0 if zero cannot be excluded. An end
    that is not found within 2^11 times `reach` is infinite.

    Parameters
    ----------
    ratio : maps (index, squared coefficient, state), one of each per lane, to the ratio at the best values of all other coefficients,
        and to the next state.
    theta, reach : (p,) squared coefficients at the optimum, and their standard errors.
    start : (p, ...) first states.
    two_sided, one_sided : levels of the ratio at both ends and at the upper limit; one for all terms, or one for each.
    """
    p = theta.shape[0]
    lane, below = np.tile(np.arange(p), 3), np.arange(3 * p) < p
    both, one = (np.broadcast_to(np.asarray(level, dtype=theta.dtype), (p,)) for level in (two_sided, one_sided))
    level = np.sqrt(np.concatenate([both, both, one]))
    best, reach = theta[lane], np.maximum(reach, np.finfo(theta.dtype).tiny ** 0.5)[lane]

    def body(state):
        (a, ga), (b, gb), (c, gc), found, last, active, values, states, zero, k = state
        slope = np.where(found, gb - ga, 1.0)
        # the first guess is a little beyond the end of a normal interval; downwards zero is tested before it
        inward, outward = (np.sqrt(np.maximum(best + sign * 1.1 * level * reach * 2.0**k, 0.0)) for sign in (-0.5, 1.0))
        u = np.where(found, (a * gb - b * ga) / np.where(slope > 0, slope, 1.0), np.where(below, 0.0, outward))
        u = np.where(below & (k == 1) & (inward > 0.0), inward, u)
        values, states = values.copy(), states.copy()
        values[active], states[active] = ratio(lane[active], u[active] ** 2, states[active])
        first = k == 0
        zero = (np.where(first, values[:p], zero[0]), np.where(first, states[:p], zero[1]))
        # capped, because false position moves too slowly from a value that is far away
        g = np.minimum(np.sqrt(np.maximum(values, 0.0)) - level, _FAR * level)
        inside = g <= 0
        # a side that stays for two steps gets less weight, so that both ends close in
        halved_a = np.where(found & ~inside & (last == 1), _less(g, gb) * ga, ga)
        halved_b = np.where(found & inside & (last == -1), _less(g, ga) * gb, gb)
        a, ga = np.where(active & inside, u, a), np.where(active & inside, g, np.where(active, halved_a, ga))
        b, gb = np.where(active & ~inside, u, b), np.where(active & ~inside, g, np.where(active, halved_b, gb))
        # a downward search that finds zero inside is over
        done = active & below & inside & (u == 0)
        found = found | (active & ~inside) | done
        b, gb = np.where(done, 0.0, b), np.where(done, 1.0, gb)
        last = np.where(active, np.where(inside, np.int32(-1), np.int32(1)), last)
        hit = active & ~done & (np.abs(g) <= _CLOSE * level)
        # so near to the level, the error of a secant through the last two values is a small part of the distance
        rise = np.where(g == gc, 1.0, g - gc)
        b = np.where(hit, np.maximum(u - g * (u - c) / rise, 0.0), b)
        ga, gb = np.where(hit, 0.0, ga), np.where(hit, 0.0, gb)
        found, active = found | hit, active & ~done & ~hit
        return (a, ga), (b, gb), (u, g), found, last, active, values, states, zero, k + 1

    none, no, states = np.zeros_like(best), np.zeros(3 * p, dtype=bool), start[lane]
    begun = np.sqrt(best), -level
    state = begun, (none, none), begun, no, np.zeros(3 * p, dtype=np.int32), ~no, none, states
    state = (*state, (none[:p], np.zeros_like(start)), np.zeros((), dtype=theta.dtype))

    while np.any(state[5]) and state[-1] < _SEARCH:
        state = body(state)
    (a, ga), (b, gb), _, found, _, _, _, _, zero, _ = state
    width = np.where(gb > ga, gb - ga, 1.0)
    end = np.where(gb > ga, (a * gb - b * ga) / width, b)
    ends = np.where(found, end**2, np.inf)
    return Limits(ends[:p], ends[p : 2 * p], ends[2 * p :], zero[0]), zero[1]


def _less(new, old) -> Any:
    """Weight of the end that stays, from the previous and the present value at the other end."""
    weight = 1.0 - new / np.where(old == 0.0, 1.0, old)
    return np.where((weight > 0.0) & (old != 0.0), weight, 0.5)
