"""The search for the lowest cost: a solver of optimistix around one evaluation of the residuals and their Jacobian.

Tracing and compiling the residuals is most of what a first call costs, so the whole program holds them once: `linearised` gives residuals
and Jacobian together, the solver differentiates it by one product with that Jacobian, and the solution keeps both. The derivative of the
solution (implicit function theorem) is a rule of its own, which is traced only where a fit is differentiated.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx

from .._types import Array
from ._levenberg_marquardt import BoundedLevenbergMarquardt, linear_problem
from ._problem import Problem


class Found(eqx.Module):
    """Where a search ended; `flat` says that the cost has no slope left there. A derivative of it has None for what has none."""

    x: Array
    residuals: Array
    jacobian: Array
    held: Array | None
    flat: Array | None
    steps: Array | None


@eqx.filter_jit
def linearised(problem: Problem, x: Array) -> tuple[Array, Array]:
    """Residuals (n,) and their Jacobian (n, p)."""
    value, push = jax.linearize(problem.residual, x)
    return value, jax.vmap(push, out_axes=1)(jnp.eye(x.size, dtype=x.dtype))


def transformed(problem: Problem, r: Array) -> tuple[Array, Array]:
    """Residuals whose half sum of squares is the cost, and their derivative with respect to the residuals."""
    return (r, jnp.ones_like(r)) if problem.loss is None else jax.jvp(problem.loss, (r,), (jnp.ones_like(r),))


def _from(problem: Problem, x: Array) -> Found:
    """Lowest point that the solver reaches from `x`."""

    def evaluated(x: Array, given: Problem) -> tuple[Array, tuple[Array, tuple[Array, Array]]]:
        r, jacobian = linearised(given, x)
        value, slope = transformed(given, r)
        return value, (slope[:, None] * jacobian, (r, jacobian))

    if problem.solver is None:
        solver = BoundedLevenbergMarquardt(rtol=problem.rtol, lower=problem.lower, upper=problem.upper)
        end = optx.least_squares(evaluated, solver, x, problem, has_aux=True, max_steps=problem.max_steps, throw=False)
        x, last, newton, (r, jacobian) = end.value, end.state.linear, end.state.newton, end.state.seen
    else:  # the default solver scales by itself; another one gets parameters that move the residuals by one
        column = jnp.linalg.norm(linearised(problem, x)[1], axis=0)
        scale = jnp.where(column > 0, 1 / jnp.where(column > 0, column, 1), 1)
        objective = lambda u, given: transformed(given, given.residual(u * scale))[0]  # noqa: E731
        end = optx.least_squares(objective, problem.solver, x / scale, problem, max_steps=problem.max_steps, throw=False)
        x = end.value * scale
        value, (moved, (r, jacobian)) = evaluated(x, problem)
        last = linear_problem(moved, value, x, problem.lower, problem.upper)
        newton = last.steps(jnp.zeros_like(x))[1]
    return Found(x, r, jacobian, last.held, last.flat(newton), end.stats["num_steps"])


@eqx.filter_custom_jvp
def search(problem: Problem) -> Found:
    """Search from every start and keep the lowest cost; differentiable in the arrays of the problem."""
    if problem.starts is None:
        return _from(problem, problem.values())
    found = jax.lax.map(lambda start: _from(problem, start), problem.starts)
    cost = jnp.sum(jax.vmap(lambda r: transformed(problem, r)[0])(found.residuals) ** 2, axis=1)
    best = jnp.argmin(jnp.where(jnp.isfinite(cost), cost, jnp.inf))
    return jax.tree.map(lambda leaf: leaf[best], found)


@search.def_jvp
def _(primals, tangents):
    """The solution is a root of the gradient, or lies on a bound, whatever the solver did to find it."""
    (problem,), (change,) = primals, tangents
    still = jax.tree.map(lambda leaf: leaf is None, change, is_leaf=lambda leaf: leaf is None)
    fixed, moving = eqx.partition(problem, still)
    found = search(problem)
    x, held = found.x, found.held

    def gradient(x: Array, moving: Problem) -> Array:
        given = eqx.combine(moving, fixed)
        bound = jnp.where(held, jnp.where(x <= given.lower, given.lower, given.upper), 0)
        slope = jax.grad(lambda x: 0.5 * jnp.sum(transformed(given, given.residual(x))[0] ** 2))(x)
        return jnp.where(held, x - bound, slope)

    push = jax.jvp(lambda moving: gradient(x, moving), (moving,), (change,))[1]
    hessian = jax.jacfwd(gradient)(x, moving)
    size = jnp.sqrt(jnp.abs(jnp.diagonal(hessian)))
    size = jnp.where(size > 0, size, 1)
    dx = -jnp.linalg.solve(hessian / size[:, None] / size[None, :], push / size) / size
    (r, jacobian), (dr, slope) = jax.jvp(lambda x, moving: linearised(eqx.combine(moving, fixed), x), (x, moving), (dx, change))
    return (
        Found(x, r, jacobian, held, found.flat, found.steps),
        Found(dx, dr, slope, None, None, None),
    )
