"""Intervals and limits by inversion of a likelihood-ratio test: the values of one coefficient at which the ratio reaches a level."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import namespace
from .._types import AnyArray, Float

#: significance above which a term is a hint, and above which it is present. Without the term, 5 % and 1 % of records exceed these,
#: because a coefficient cannot be negative (S. G. Self and K.-Y. Liang, J. Am. Stat. Assoc. 82, 1987)
HINT, PRESENT = 2.71, 5.41
_SEARCH = 12  # number of steps of a search
_FAR = 8.0  # times the level at which values of a search are capped
_CLOSE = 3e-3  # relative distance from the level, in the root of the likelihood ratio, from which one last secant reaches it


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
    xp = namespace(theta, reach, start, two_sided, one_sided)
    p = theta.shape[0]
    lane, below = np.tile(np.arange(p), 3), np.arange(3 * p) < p
    both, one = (xp.broadcast_to(xp.asarray(level, dtype=theta.dtype), (p,)) for level in (two_sided, one_sided))
    level = xp.sqrt(xp.concatenate([both, both, one]))
    best, reach = theta[lane], xp.maximum(reach, np.finfo(theta.dtype).tiny ** 0.5)[lane]

    def body(state):
        (a, ga), (b, gb), (c, gc), found, last, active, values, states, zero, k = state
        slope = xp.where(found, gb - ga, 1.0)
        # the first guess is a little beyond the end of a normal interval; downwards zero is tested before it
        inward, outward = (xp.sqrt(xp.maximum(best + sign * 1.1 * level * reach * 2.0**k, 0.0)) for sign in (-0.5, 1.0))
        u = xp.where(found, (a * gb - b * ga) / xp.where(slope > 0, slope, 1.0), xp.where(below, 0.0, outward))
        u = xp.where(below & (k == 1) & (inward > 0.0), inward, u)
        if xp is np:  # on the host, only searches that have not ended cost time
            values, states = values.copy(), states.copy()
            values[active], states[active] = ratio(lane[active], u[active] ** 2, states[active])
        else:
            new = ratio(lane, u**2, states)
            values, states = xp.where(active, new[0], values), xp.where(active[:, None], new[1], states)
        first = k == 0
        zero = (xp.where(first, values[:p], zero[0]), xp.where(first, states[:p], zero[1]))
        # capped, because false position moves too slowly from a value that is far away
        g = xp.minimum(xp.sqrt(xp.maximum(values, 0.0)) - level, _FAR * level)
        inside = g <= 0
        # a side that stays for two steps gets less weight, so that both ends close in
        halved_a = xp.where(found & ~inside & (last == 1), _less(g, gb, xp) * ga, ga)
        halved_b = xp.where(found & inside & (last == -1), _less(g, ga, xp) * gb, gb)
        a, ga = xp.where(active & inside, u, a), xp.where(active & inside, g, xp.where(active, halved_a, ga))
        b, gb = xp.where(active & ~inside, u, b), xp.where(active & ~inside, g, xp.where(active, halved_b, gb))
        # a downward search that finds zero inside is over
        done = active & below & inside & (u == 0)
        found = found | (active & ~inside) | done
        b, gb = xp.where(done, 0.0, b), xp.where(done, 1.0, gb)
        last = xp.where(active, xp.where(inside, np.int32(-1), np.int32(1)), last)
        hit = active & ~done & (xp.abs(g) <= _CLOSE * level)
        # so near to the level, the error of a secant through the last two values is a small part of the distance
        rise = xp.where(g == gc, 1.0, g - gc)
        b = xp.where(hit, xp.maximum(u - g * (u - c) / rise, 0.0), b)
        ga, gb = xp.where(hit, 0.0, ga), xp.where(hit, 0.0, gb)
        found, active = found | hit, active & ~done & ~hit
        return (a, ga), (b, gb), (u, g), found, last, active, values, states, zero, k + 1

    # in a traced loop every leaf must keep its type
    none, no, states = xp.zeros_like(best), xp.zeros(3 * p, dtype=bool), start[lane]
    begun = xp.sqrt(best), -level
    state = begun, (none, none), begun, no, xp.zeros(3 * p, dtype=np.int32), ~no, none, states
    state = (*state, (none[:p], xp.zeros_like(start)), xp.zeros((), dtype=theta.dtype))

    def going(state):
        return xp.any(state[5]) & (state[-1] < _SEARCH)

    if xp is jnp:
        state = jax.lax.while_loop(going, body, state)
    while xp is np and going(state):
        state = body(state)
    (a, ga), (b, gb), _, found, _, _, _, _, zero, _ = state
    width = xp.where(gb > ga, gb - ga, 1.0)
    end = xp.where(gb > ga, (a * gb - b * ga) / width, b)
    ends = xp.where(found, end**2, np.inf)
    return Limits(ends[:p], ends[p : 2 * p], ends[2 * p :], zero[0]), zero[1]


def _less(new, old, xp) -> Any:
    """Weight of the end that stays, from the previous and the present value at the other end."""
    weight = 1.0 - new / xp.where(old == 0.0, 1.0, old)
    return xp.where((weight > 0.0) & (old != 0.0), weight, 0.5)
