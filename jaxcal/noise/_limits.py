"""Intervals and limits by inversion of a test: where the rise of an objective, with one coefficient held, reaches a level."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from .._types import AnyArray, Array, Float

_SEARCH = 12
_FAR = 8.0


class Limits(eqx.Module):
    """Per term: interval ends, one-sided upper limit (squared coefficients), and the rise at zero."""

    low: Float[AnyArray, " p"]
    high: Float[AnyArray, " p"]
    upper: Float[AnyArray, " p"]
    significance: Float[AnyArray, " p"]


def find_limits(rise: Callable[[Array, Array, Any], tuple[Array, Any]], theta, reach, start, two_sided, one_sided) -> Limits:
    """Where the rise reaches the levels `two_sided` (both ends) and `one_sided` (upper limit).

    The square root of the rise is nearly linear in the coefficient itself, so its crossing is found by false position
    (Illinois) on these; all searches run together. A low end is 0 where zero cannot be excluded; an end that is not found
    within 2^11 times `reach` is infinite.

    Parameters
    ----------
    rise : (index, squared coefficient, state) -> rise of the objective at the best values of all others, and the next state.
    theta : (p,) squared coefficients at the optimum.
    reach : (p,) their standard errors.
    start : state for the first evaluation, the same for all searches.
    two_sided, one_sided : levels, for all terms or one each.
    """
    p = theta.shape[0]
    lane = jnp.tile(jnp.arange(p), 3)
    below = jnp.arange(3 * p) < p
    both, one = (jnp.broadcast_to(level, (p,)) for level in (two_sided, one_sided))
    level = jnp.sqrt(jnp.concatenate([both, both, one])).astype(theta.dtype)
    best, reach = theta[lane], jnp.maximum(reach, jnp.finfo(theta.dtype).tiny ** 0.5)[lane]
    states = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (3 * p, *jnp.shape(leaf))), start)

    def step(carry, k):
        (a, ga), (b, gb), found, last, states = carry
        outward = jnp.sqrt(best + 1.5 * reach * jnp.exp2(k))
        outward = jnp.where(below, 0.0, outward)
        slope = jnp.where(found, gb - ga, 1.0)
        u = jnp.where(found, (a * gb - b * ga) / jnp.where(slope > 0, slope, 1.0), outward)
        values, states = jax.vmap(rise)(lane, u**2, states)
        # capped, for false position would creep up from a value far away
        g = jnp.minimum(jnp.sqrt(jnp.maximum(values, 0.0)) - level, _FAR * level)
        inside = g <= 0
        # a side that stays twice counts half, so that both ends close in
        ga, gb = jnp.where(found & ~inside & (last == 1), 0.5 * ga, ga), jnp.where(found & inside & (last == -1), 0.5 * gb, gb)
        a, ga = jnp.where(inside, u, a), jnp.where(inside, g, ga)
        b, gb = jnp.where(inside, b, u), jnp.where(inside, gb, g)
        # a downward search that finds zero inside is over
        done = below & inside & (u == 0)
        found = found | ~inside | done
        b, gb = jnp.where(done, 0.0, b), jnp.where(done, 1.0, gb)
        return ((a, ga), (b, gb), found, jnp.where(inside, -1, 1).astype(jnp.int32), states), values[:p]

    zero = jnp.zeros_like(best)
    first = ((jnp.sqrt(best), -level), (zero, zero), jnp.zeros_like(below), jnp.zeros(3 * p, jnp.int32), states)
    ((a, ga), (b, gb), found, _, _), rises = jax.lax.scan(step, first, jnp.arange(_SEARCH, dtype=theta.dtype))
    width = jnp.where(gb > ga, gb - ga, 1.0)
    end = jnp.where(gb > ga, (a * gb - b * ga) / width, b)
    ends = jnp.where(found, end**2, jnp.inf)
    return Limits(ends[:p], ends[p : 2 * p], ends[2 * p :], rises[0])
