"""Refits without one block of residuals at a time, all in one compiled call."""

import dataclasses

import jax
import jax.numpy as jnp

from .._compile import filter_jit
from .._precision import array_module
from .._types import AnyArray, Array
from ._information import information
from ._problem import Problem
from ._result import Fit, to_numpy
from ._search import search


@filter_jit
def _without(problem: Problem, keep: Array) -> tuple[Array, Array]:
    """Parameters of the refits, (m, p), and which of them converged and are determined."""

    def refit(kept: Array) -> tuple[Array, Array]:
        found = search(dataclasses.replace(problem, keep=kept))
        r = found.rows.residuals
        weight = jnp.ones_like(r) if problem.loss is None else problem.loss.weight(r)
        rows = jnp.concatenate([jnp.sqrt(weight)[:, None] * found.rows.jacobian, found.rows.prior_jacobian])
        rank = information(jax.lax.stop_gradient(rows), held=found.held).rank
        return found.x, found.flat & (rank == jnp.sum(~found.held)) & jnp.all(jnp.isfinite(found.x))

    return jax.lax.map(refit, keep)


def refits(fit: Fit, problem: Problem, labels: AnyArray, count: int) -> AnyArray:
    """Jackknife covariance: (m - 1) / m times the sum of squares of the refits' deviations from their mean, for m blocks.

    Every refit starts at the solution. A block of padding alone is none. It is infinite where a refit fails.
    """
    xp = array_module(fit.residuals)
    problem = dataclasses.replace(problem, start=fit.model, starts=None)
    out = labels[None, :] == xp.arange(count)[:, None]
    x, usable = to_numpy(_without(problem, jnp.asarray(~out)))
    real = xp.any(out & xp.asarray(fit.counted)[None, :], axis=1)
    m = xp.sum(real, dtype=x.dtype)
    mean = xp.sum(xp.where(real[:, None], x, 0), axis=0) / m
    deviation = xp.where(real[:, None], x - mean[None, :], 0)
    return xp.where(xp.all(usable | ~real) & (m > 1), (m - 1) / m * (deviation.T @ deviation), xp.inf)
