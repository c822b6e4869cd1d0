r"""`sample_hierarchy`: draw the parameters of many items, and of the population that they come from, from their joint posterior.

Item i has parameters :math:`x_i` (p,) and a likelihood of its own. Levels group the items, nested or crossed, such as devices,
recordings and axes:

.. math:: x_i = Z_i\beta + \sum_l u^{(l)}_{g_l(i)} + e_i,\qquad u^{(1)} \sim t_\nu(0, s_1^2),\quad u^{(l)} \sim N(0, s_l^2),\quad
    e_i \sim N(0, s_e^2)

Without levels, e has the t distribution. Its heavy tails let an odd unit stay where its own data put it. Its degrees of freedom are
drawn too, from 3 to 50, which is nearly normal. One sweep draws the items by Metropolis steps, or exactly if their likelihoods are
normal. Everything else is drawn from its conditional distribution: the effects of a level together with the coefficients from a normal
one, the variances from inverse gamma ones (their priors are mixtures, see below), and the weights of the t distribution from gamma
ones. If the items carry little information, drawing population and items in turn mixes slowly. So each sweep also moves the mean and
the standard deviation of each level together with all items ("interweaving"). All sweeps are one compiled program.

The prior of the variance of the first level is :math:`(1 + s^2/A^2)^{-2}`, flat below a standard deviation of A. A prior that is flat
in the standard deviation itself would let it vanish too often if there are few groups, and the intervals of the items would then cover
too seldom. The other levels, whose variances may well be zero, have such a prior, the half-Cauchy one.

M.-E. Perez, L. R. Pericchi and I. C. Ramirez, Bayesian Analysis 12, 2017 (the scaled F as a prior); A. Gelman, Bayesian Analysis
1, 2006 (half-Cauchy); A. Gelman et al., Bayesian Data Analysis, 2013, chapters 5, 11 and 17; Y. Yu
and X.-L. Meng, J. Comput. Graph. Stat. 20, 2011 (interweaving).
"""

import functools
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import scipy  # loads its parts when they are first used

from .._types import Array

FREEDOMS = (3.0, 5.0, 8.0, 15.0, 50.0)  # degrees of freedom of the t distribution of the first level, with equal prior probabilities
_STEPS = 4  # Metropolis steps of the items in one sweep
_SHAPE, _SHAPE_WITHIN = 1.0, 0.5  # shape of the priors of variances: for the first level, and for the others
_WANTED = 0.3  # target acceptance rate of the steps


class Hierarchy(NamedTuple):
    """Draws: parameters of the items (draws, n, p), effects of each level (draws, g, p), coefficients (draws, c, p), standard deviations
    of the levels and, last, of the items (draws, levels + 1, p); scale and degrees of freedom of the t distribution, (draws, p); acceptance
    rate of the steps. The standard deviation of the t distribution is that of the normal distribution which it fits best.
    """

    items: Array
    effects: tuple[Array, ...]
    coefficients: Array
    deviations: Array
    scale: Array
    freedom: Array
    accepted: Array


class _Problem(NamedTuple):
    log_likelihood: Callable[..., Array] | None  # None for normal likelihoods, with `data` = (values, roots of covariances)
    data: Any
    design: Array
    members: tuple[Array, ...]
    prior: Array
    cores: Array  # `core` of each entry of `FREEDOMS`


class _State(NamedTuple):
    x: Array
    ll: Array
    effects: tuple[Array, ...]
    beta: Array
    weight: Array
    law: Array  # index into `FREEDOMS`, (p,)
    variance: Array  # of the levels and of the items, (levels + 1, p)
    step: Array
    scale: Array
    stride: Array  # step sizes for moving a level with all items, (levels + 1, p)


@functools.cache
def core(freedom: float) -> float:
    """Standard deviation of a normal distribution over the scale of the t that fits it best: E[(nu + 1) z^2 / (nu s^2 + z^2)] = 1."""

    def excess(scale):
        mean = scipy.integrate.quad(lambda z: (freedom + 1) * z**2 / (freedom * scale**2 + z**2) * scipy.stats.norm.pdf(z), -9, 9)[0]
        return mean - 1.0

    scale: float = scipy.optimize.brentq(excess, 0.3, 1.5)  # pyright: ignore[reportAssignmentType]
    return 1.0 / scale


def log_density(z: Any, scale: Any, freedom: Any) -> Any:
    """Logarithm of the density of the t distribution."""
    constant = jax.scipy.special.gammaln((freedom + 1.0) / 2.0) - jax.scipy.special.gammaln(freedom / 2.0) - 0.5 * jnp.log(freedom * jnp.pi)
    return constant - jnp.log(scale) - (freedom + 1.0) / 2.0 * jnp.log1p((z / scale) ** 2 / freedom)


def _variance(key: Array, squares: Array, count: int, now: Array, prior: Array, shape: float) -> Array:
    """Draw a variance from the sum of squares of `count` effects; its prior is a mixture over an auxiliary variable."""
    first, second = jax.random.split(key)
    auxiliary = jax.random.gamma(first, 2.0 * shape, now.shape, now.dtype) / (1.0 / now + 1.0 / prior**2)
    rate = auxiliary + squares / 2.0
    # below the root of the rounding error sums of precisions would lose their digits
    least = jnp.finfo(now.dtype).eps ** 0.5 * prior**2
    return jnp.maximum(rate / jax.random.gamma(second, count / 2.0 + shape, now.shape, now.dtype), least)


def _normal(key: Array, precision: Array, pull: Array) -> Array:
    """Draw from N(precision^-1 pull, precision^-1), with shapes (..., c, c) and (..., c)."""
    root = jnp.linalg.cholesky(precision)
    noise = jax.random.normal(key, pull.shape, pull.dtype)
    middle = jax.scipy.linalg.cho_solve((root, True), pull[..., None])[..., 0]
    return middle + jax.scipy.linalg.solve_triangular(jnp.swapaxes(root, -1, -2), noise[..., None], lower=False)[..., 0]


def _offsets(problem: _Problem, effects: tuple[Array, ...]) -> Any:
    """Sum of the effects of all levels, for each item."""
    shape = (problem.design.shape[0], problem.prior.shape[0])
    return sum((effect[member] for effect, member in zip(effects, problem.members, strict=True)), jnp.zeros(shape))


def _item_variance(problem: _Problem, state: _State) -> Array:
    own = state.variance[-1]
    return own[None, :] / state.weight if not problem.members else jnp.broadcast_to(own[None, :], state.x.shape)


def _items(problem: _Problem, state: _State, key: Array) -> tuple[_State, Array]:
    """Draw the parameters of the items given the population."""
    mean = problem.design @ state.beta + _offsets(problem, state.effects)
    variance = _item_variance(problem, state)
    likelihood = problem.log_likelihood
    n, p = state.x.shape
    if likelihood is None:
        # draw everything, then correct by the observed values: also valid for a covariance of zero
        value, root = problem.data
        one, two = jax.random.split(key)
        x = mean + jnp.sqrt(variance) * jax.random.normal(one, (n, p), mean.dtype)
        seen = x + jnp.einsum("nij,nj->ni", root, jax.random.normal(two, (n, p), mean.dtype))
        total = jnp.einsum("nij,nkj->nik", root, root) + variance[..., None] * jnp.eye(p, dtype=mean.dtype)[None]
        return state._replace(x=x + variance * jnp.linalg.solve(total, (value - seen)[..., None])[..., 0]), jnp.ones(())

    def move(carry, key):
        x, ll = carry
        one, two = jax.random.split(key)
        tried = x + state.scale * jnp.einsum("nij,nj->ni", state.step, jax.random.normal(one, x.shape, x.dtype))
        new = jax.vmap(likelihood)(tried, problem.data)
        change = new - ll - 0.5 * jnp.sum(((tried - mean) ** 2 - (x - mean) ** 2) / variance, axis=1)
        keep = jnp.log(jax.random.uniform(two, (n,), x.dtype)) < change
        return (jnp.where(keep[:, None], tried, x), jnp.where(keep, new, ll)), jnp.mean(keep.astype(x.dtype))

    (x, ll), accepted = jax.lax.scan(move, (state.x, state.ll), jax.random.split(key, _STEPS))
    return state._replace(x=x, ll=ll), jnp.mean(accepted)


def _population(problem: _Problem, state: _State, key: Array) -> _State:
    """Draw coefficients, effects, weights and variances given the items."""
    design, levels = problem.design, len(problem.members)
    p = state.x.shape[1]
    dtype = state.x.dtype
    keys = jax.random.split(key, 2 * levels + 5)
    ridge = 1e-9 * jnp.eye(design.shape[1], dtype=dtype)[None] / problem.prior[:, None, None] ** 2  # a flat prior that stays proper
    noise = 1.0 / _item_variance(problem, state)
    beta, effects, variance = state.beta, list(state.effects), state.variance
    if not levels:
        precision = jnp.einsum("nc,np,nd->pcd", design, noise, design)
        beta = _normal(keys[-1], precision + ridge, jnp.einsum("nc,np->pc", design, noise * state.x)).T
    for k, member in enumerate(problem.members):
        groups = effects[k].shape[0]
        total = partial(jax.ops.segment_sum, segment_ids=member, num_segments=groups)
        others = tuple(jnp.zeros_like(effect) if i == k else effect for i, effect in enumerate(effects))
        rest = state.x - _offsets(problem, others)
        own = (state.weight if k == 0 else jnp.ones((1, p), dtype)) / variance[k][None, :]
        exact = total(noise) + own
        # draw the coefficients with the effects of this level integrated out, then the effects
        shared = total(design[:, :, None] * noise[:, None, :])
        precision = jnp.einsum("nc,np,nd->pcd", design, noise, design) - jnp.einsum("gcp,gp,gdp->pcd", shared, 1.0 / exact, shared)
        pull = jnp.einsum("nc,np->pc", design, noise * rest) - jnp.einsum("gcp,gp->pc", shared, total(noise * rest) / exact)
        beta = _normal(keys[2 * k], precision + ridge, pull).T
        draw = jax.random.normal(keys[2 * k + 1], exact.shape, dtype) / jnp.sqrt(exact)
        effects[k] = total(noise * (rest - design @ beta)) / exact + draw
    residual = state.x - design @ beta - _offsets(problem, tuple(effects))
    first = effects[0] if levels else residual
    law, variance = _law(problem, state.law, first, variance, keys[-4])
    freedom = jnp.asarray(FREEDOMS, dtype)[law][None, :]
    weight = 2.0 * jax.random.gamma(keys[-2], jnp.broadcast_to((freedom + 1.0) / 2.0, first.shape), dtype=dtype)
    weight = weight / (freedom + first**2 / variance[0][None, :])
    draws = []
    for k, (one, effect) in enumerate(zip(jax.random.split(keys[-3], levels + 1), (*effects, residual), strict=True)):
        squares = jnp.sum((weight if k == 0 else 1.0) * effect**2, axis=0)
        draws.append(_variance(one, squares, effect.shape[0], variance[k], problem.prior, _SHAPE_WITHIN if k else _SHAPE))
    return state._replace(beta=beta, effects=tuple(effects), weight=weight, law=law, variance=jnp.stack(draws))


def _law(problem: _Problem, now: Array, first: Array, variance: Array, key: Array) -> tuple[Array, Array]:
    """Draw the degrees of freedom of the t distribution, at constant standard deviation, with the weights integrated out."""
    freedom, cores = jnp.asarray(FREEDOMS, first.dtype)[:, None], problem.cores[:, None]
    scale = jnp.sqrt(variance[0])[None, :] * problem.cores[now][None, :] / cores
    likelihood = jnp.sum(log_density(first[None], scale[:, None, :], freedom[:, :, None]), axis=1)
    prior = (2.0 * _SHAPE - 1.0) * jnp.log(scale) - jnp.log(cores) - 2.0 * _SHAPE * jnp.log1p((scale / problem.prior[None, :]) ** 2)
    law = jax.random.categorical(key, likelihood + prior, axis=0)
    return law, variance.at[0].set(scale[law, jnp.arange(first.shape[1])] ** 2)


def _interweave(problem: _Problem, state: _State, key: Array) -> tuple[_State, Array]:
    """Move the mean and the standard deviation of each level with all items, parameter by parameter; acceptance rates (levels + 1, p)."""
    likelihood: Any = problem.log_likelihood
    p, dtype = state.x.shape[1], state.x.dtype
    sizes = [effect.shape[0] for effect in state.effects] + [state.x.shape[0]]
    base = state.x - problem.design @ state.beta - _offsets(problem, state.effects)
    shown = jnp.stack([*(effect[member] for effect, member in zip(state.effects, problem.members, strict=True)), base])
    count = jnp.asarray(sizes, dtype)

    def move(carry, inputs):
        x, ll, beta, variance, shown = carry
        index, key = inputs
        k, j = index // p, index % p
        shape = jnp.where(k > 0, _SHAPE_WITHIN, _SHAPE)
        one, two = jax.random.split(key)
        first, second = state.stride[k, j] * jax.random.normal(one, (2,), dtype) / jnp.sqrt(count[k])
        ratio, shift = jnp.exp(first / 2.0**0.5), second * jnp.sqrt(variance[k, j])
        only = (jnp.arange(p) == j).astype(dtype)
        tried = x + only[None, :] * (shift + (ratio - 1.0) * shown[k])
        new = jax.vmap(likelihood)(tried, problem.data)
        before, after = variance[k, j] / problem.prior[j] ** 2, variance[k, j] * ratio**2 / problem.prior[j] ** 2
        change = jnp.sum(new - ll) + 2.0 * shape * (jnp.log1p(before) - jnp.log1p(after) + jnp.log(ratio))
        keep = (jnp.log(jax.random.uniform(two, (), dtype)) < change) & (after > jnp.finfo(dtype).eps ** 0.5)
        x, ll = jnp.where(keep, tried, x), jnp.where(keep, new, ll)
        beta = beta.at[0].add(jnp.where(keep, only * shift, 0.0))
        factor = jnp.where(keep & (only > 0), ratio, 1.0)
        return (x, ll, beta, variance.at[k].multiply(factor**2), shown.at[k].multiply(factor[None, :])), keep.astype(dtype)

    moves = (len(sizes)) * p
    start = (state.x, state.ll, state.beta, state.variance, shown)
    (x, ll, beta, variance, shown), kept = jax.lax.scan(move, start, (jnp.arange(moves), jax.random.split(key, moves)))
    grown = jnp.sqrt(variance / state.variance)
    effects = tuple(effect * grown[k][None, :] for k, effect in enumerate(state.effects))
    return state._replace(x=x, ll=ll, beta=beta, variance=variance, effects=effects), kept.reshape(-1, p)


def _sweep(problem: _Problem, together: bool, state: _State, key: Array) -> tuple[_State, tuple[Array, Array]]:
    one, two, three = jax.random.split(key, 3)
    state, accepted = _items(problem, state, one)
    state = _population(problem, state, two)
    moved = jnp.full_like(state.variance, _WANTED)
    if together and problem.log_likelihood is not None:
        state, moved = _interweave(problem, state, three)
    return state, (accepted, moved)


@partial(eqx.filter_jit)
def sample_hierarchy(
    log_likelihood: Callable[[Array, Any], Array] | None, start: Array, data: Any, step: Array, design: Array, members: tuple[Array, ...],
    groups: tuple[int, ...], prior: Array, key: Array, warm: int, draws: int, thin: int,
    together: bool = True,
) -> Hierarchy:  # fmt: skip
    """Draw from the joint posterior.

    Parameters
    ----------
    log_likelihood : (parameters (p,), data of one item) -> scalar. None for a normal one; `data` are then values (n, p) and roots of
        covariances (n, p, p), which may be zero.
    start : (n, p) parameters of the items to start from. step : (n, p, p) roots of the covariances of their first proposals.
    data : a tree whose leaves have the items as leading axis.
    design : (n, c) regressors of the coefficients; the first column is one, for the mean.
    members, groups : for each level, the group of each item (n,), and the number of groups. The first level has the t distribution.
    prior : (p,) scale A of the priors of the standard deviations.
    key : key of `jax.random`. warm, draws, thin : sweeps to discard, draws to keep, and sweeps per draw.
    together : whether to move the population together with all items; for thousands of items this costs much and helps little.
    """
    n, p = start.shape
    dtype = start.dtype
    levels = len(groups)
    problem = _Problem(log_likelihood, data, design, members, prior, jnp.asarray([core(freedom) for freedom in FREEDOMS], dtype))
    spread = jnp.var(start, axis=0) / (levels + 1.0) + 1e-4 * prior**2
    ll = jnp.zeros(n, dtype) if log_likelihood is None else jax.vmap(log_likelihood)(start, data)
    usual = jnp.asarray(2.4 / p**0.5, dtype)
    state = _State(
        start, ll, tuple(jnp.zeros((g, p), dtype) for g in groups), jnp.linalg.lstsq(design, start)[0],
        jnp.ones((groups[0] if groups else n, p), dtype), jnp.full(p, 1), jnp.broadcast_to(spread[None, :], (levels + 1, p)), step, usual,
        jnp.full((levels + 1, p), 2.0, dtype),
    )  # fmt: skip
    blocks, half = warm // thin, warm // thin // 2
    number = jnp.arange(blocks + draws)
    within = jnp.where(number < half, number, number - half)
    gains = jnp.where(number < blocks, 2.0 / jnp.sqrt(1.0 + within.astype(dtype)), 0.0)
    counted = ((number >= half // 2) & (number < half)).astype(dtype) / (half - half // 2)

    # one body for the warm-up and the draws, because it takes long to compile
    def block(carry, inputs):
        state, mean, squares = carry
        keys, gain, share, renewed = inputs
        state, (accepted, moved) = jax.lax.scan(partial(_sweep, problem, together), state, keys)
        accepted = jnp.mean(accepted)
        scale = state.scale * jnp.exp(gain * (accepted - _WANTED))
        state = state._replace(scale=scale, stride=state.stride * jnp.exp(gain * (jnp.mean(moved, axis=0) - _WANTED)))
        if log_likelihood is not None:
            apart = state.x - start
            mean = mean + share * apart
            squares = squares + share * apart[:, :, None] * apart[:, None, :]
            covariance = squares - mean[:, :, None] * mean[:, None, :] + 0.05 * jnp.einsum("nij,nkj->nik", step, step)
            own = jax.lax.cond(renewed, lambda: jnp.linalg.cholesky(covariance), lambda: state.step)
            state = state._replace(step=own, scale=jnp.where(renewed, usual, state.scale))
        deviations = jnp.sqrt(state.variance)
        normal = deviations.at[0].multiply(problem.cores[state.law])
        freedom = jnp.asarray(FREEDOMS, dtype)[state.law]
        return (state, mean, squares), (state.x, state.effects, state.beta, normal, deviations[0], freedom, accepted)

    keys = jax.random.split(key, (blocks + draws, thin))
    _, found = jax.lax.scan(block, (state, jnp.zeros_like(start), jnp.zeros_like(step)), (keys, gains, counted, number == half - 1))
    return Hierarchy(*jax.tree.map(lambda values: values[blocks:], found))
