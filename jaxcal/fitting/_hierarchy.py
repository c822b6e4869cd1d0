r"""`sample_hierarchy`: parameters of many items and of the population that they come from, drawn from their joint posterior.

Item i has parameters :math:`x_i` (p,), known by its own likelihood. The items nest in groups, such as recordings in devices:

.. math:: x_i = Z_i\beta + u_{g(i)} + e_i,\qquad u_g \sim t_\nu(0, s_1^2),\quad e_i \sim N(0, s_2^2)

Without groups the residual itself has the t law. Its heavy tails let an odd unit stay where its own data put it. One sweep draws
the items by Metropolis steps, each along its own likelihood and the population's spread, and everything else from its conditional
law: the coefficients from a normal one, the variances from inverse gamma ones (half-Cauchy priors as a mixture), the weights of the t
law from gamma ones. All sweeps are one compiled program.

A. Gelman, Bayesian Analysis 1, 2006 (half-Cauchy); A. Gelman et al., Bayesian Data Analysis, 2013, chapters 5, 11 and 17.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from .._types import Array

FREEDOM = 5.0  # of the t law between groups
_PRIOR = 1.0  # scale of the half-Cauchy priors of the standard deviations
_STEPS = 4  # Metropolis steps of the items in a sweep
_WANTED = 0.3  # share of them that is accepted
_FLOOR = 1e-8  # least variance


class Hierarchy(NamedTuple):
    """Draws: parameters of the items (draws, n, p), of the groups (draws, g, p), coefficients (draws, c, p), both standard deviations."""

    items: Array
    groups: Array
    coefficients: Array
    between: Array
    within: Array
    accepted: Array


class _State(NamedTuple):
    x: Array
    ll: Array
    group: Array
    beta: Array
    weight: Array
    between: Array
    within: Array
    scale: Array


def _variance(key: Array, squares: Array, count: Any, now: Array) -> Array:
    """A draw of a variance from the sum of squares of `count` effects: half-Cauchy prior, by an auxiliary variable."""
    first, second = jax.random.split(key)
    auxiliary = (1.0 / now + 1.0 / _PRIOR**2) / jax.random.gamma(first, 1.0, now.shape, now.dtype)
    rate = 1.0 / auxiliary + squares / 2.0
    return jnp.maximum(rate / jax.random.gamma(second, (count + 1.0) / 2.0, now.shape, now.dtype), _FLOOR)


def _normal(key: Array, precision: Array, pull: Array) -> Array:
    """Draws from N(precision^-1 pull, precision^-1), (..., c, c) and (..., c)."""
    root = jnp.linalg.cholesky(precision)
    noise = jax.random.normal(key, pull.shape, pull.dtype)
    middle = jax.scipy.linalg.cho_solve((root, True), pull[..., None])[..., 0]
    return middle + jax.scipy.linalg.solve_triangular(jnp.swapaxes(root, -1, -2), noise[..., None], lower=False)[..., 0]


def _sweep(
    log_likelihood: Callable[..., Array], data: Any, design: Array, member: Array, nested: bool, step: Array, state: _State, key: Array
):
    n, p = state.x.shape
    groups = state.group.shape[0]
    keys = jax.random.split(key, 6)
    mean = design @ state.beta + (state.group[member] if nested else 0.0)
    variance = jnp.broadcast_to(state.within, (n, p)) if nested else state.between[None, :] / state.weight[member]

    def move(carry, key):
        x, ll = carry
        one, two = jax.random.split(key)
        tried = x + state.scale * jnp.einsum("nij,nj->ni", step, jax.random.normal(one, x.shape, x.dtype))
        new = jax.vmap(log_likelihood)(tried, data)
        change = new - ll - 0.5 * jnp.sum(((tried - mean) ** 2 - (x - mean) ** 2) / variance, axis=1)
        keep = jnp.log(jax.random.uniform(two, (n,), x.dtype)) < change
        return (jnp.where(keep[:, None], tried, x), jnp.where(keep, new, ll)), jnp.mean(keep.astype(x.dtype))

    (x, ll), accepted = jax.lax.scan(move, (state.x, state.ll), jax.random.split(keys[0], _STEPS))
    # coefficients of the design, term by term
    inverse = 1.0 / variance
    rest = x - (state.group[member] if nested else 0.0)
    precision = jnp.einsum("nc,np,nd->pcd", design, inverse, design)
    pull = jnp.einsum("nc,np->pc", design, inverse * rest)
    ridge = 1e-6 * jnp.eye(design.shape[1], dtype=x.dtype)  # a flat prior that stays proper
    beta = _normal(keys[1], precision + ridge[None], pull).T
    rest = x - design @ beta
    group, within = state.group, state.within
    if nested:
        held = jax.ops.segment_sum(rest / state.within[None, :], member, groups)
        many = jax.ops.segment_sum(jnp.ones(n, x.dtype), member, groups)[:, None] / state.within[None, :]
        exact = many + state.weight / state.between[None, :]
        group = held / exact + jax.random.normal(keys[2], held.shape, x.dtype) / jnp.sqrt(exact)
        within = _variance(keys[3], jnp.sum((rest - group[member]) ** 2, axis=0), n, state.within)
        effects = group
    else:
        effects = rest
    weight = jax.random.gamma(keys[4], (FREEDOM + 1.0) / 2.0, (groups, p), x.dtype) / (
        (FREEDOM + effects**2 / state.between[None, :]) / 2.0
    )
    between = _variance(keys[5], jnp.sum(weight * effects**2, axis=0), groups, state.between)
    return state._replace(x=x, ll=ll, group=group, beta=beta, weight=weight, between=between, within=within), jnp.mean(accepted)


@partial(eqx.filter_jit)
def sample_hierarchy(
    log_likelihood: Callable[[Array, Any], Array], start: Array, data: Any, step: Array, design: Array, member: Array, groups: int,
    nested: bool, key: Array, warm: int, draws: int, thin: int,
) -> Hierarchy:  # fmt: skip
    """Draws from the joint posterior.

    Parameters
    ----------
    log_likelihood : (parameters (p,), data of one item) -> scalar.
    start : (n, p) parameters of the items to start from. step : (n, p, p) roots of the covariances of their proposals.
    data : a tree whose leaves have the items first.
    design : (n, c) of the coefficients; a column of ones for the mean. member : (n,) group of each item.
    groups : how many there are. nested : whether groups hold several items; otherwise each item is its own group.
    key : of `jax.random`. warm, draws, thin : sweeps that are thrown away, draws that are kept, and sweeps for each of them.
    """
    p = start.shape[1]
    dtype = start.dtype
    spread = jnp.var(start, axis=0) + 0.01
    beta = jnp.linalg.lstsq(design, start)[0]
    state = _State(
        start, jax.vmap(log_likelihood)(start, data), jnp.zeros((groups, p), dtype), beta, jnp.ones((groups, p), dtype), spread, spread,
        jnp.asarray(2.4 / p**0.5, dtype),
    )  # fmt: skip
    sweep = partial(_sweep, log_likelihood, data, design, member, nested, step)

    def warmed(state, inputs):
        key, gain = inputs
        state, accepted = sweep(state, key)
        return state._replace(scale=state.scale * jnp.exp(gain * (accepted - _WANTED))), None

    first, second = jax.random.split(key)
    gains = jnp.asarray(2.0, dtype) / jnp.sqrt(1.0 + jnp.arange(warm, dtype=dtype))
    state, _ = jax.lax.scan(warmed, state, (jax.random.split(first, warm), gains))

    def drawn(state, keys):
        state, accepted = jax.lax.scan(sweep, state, keys)
        kept = (state.x, state.group, state.beta, jnp.sqrt(state.between), jnp.sqrt(state.within), jnp.mean(accepted))
        return state, kept

    keys = jax.random.split(second, draws * thin)
    _, found = jax.lax.scan(drawn, state, keys.reshape(draws, thin, *keys.shape[1:]))
    return Hierarchy(*found)
