"""`solve`: fit any model to residuals."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx

from .._types import Array
from ._loss import AbstractLoss
from ._normal import BoundedLevenbergMarquardt, Normal, held_at, normal_equations
from ._outcome import Outcome
from ._problem import Problem, check, check_residuals, define
from ._rank import decompose
from ._result import Fit


def solve(
    residuals: Callable[[Any, Any], Array],
    start: Any,
    data: Any = None,
    *,
    free: Any = None,
    bounds: tuple[Any, Any] | None = None,
    scale: Any = None,
    loss: AbstractLoss | None = None,
    solver: optx.AbstractLeastSquaresSolver | None = None,
    starts: Any = None,
    max_steps: int = 128,
    rtol: float | None = None,
) -> Fit:
    """Fit a model by minimising 1/2 sum_i c^2 rho(r_i^2 / c^2) over its parameters (half the sum of squares without a loss).

    The fit is differentiable in `data`, in the bounds and in the parameters held fixed (implicit function theorem), and runs
    under `jit` and `vmap`. Repeated calls with the same residual function and the same shapes do not recompile.

    Parameters
    ----------
    residuals
        Function of (model, data) that returns an array of any shape, each entry divided by its standard deviation. Define it
        once, at module level: a new function object is compiled anew. Entries that are zero with zero derivative are padding.
    start
        Model to start from: an Equinox module or any other tree. Its floating-point leaves are the parameters.
    data
        Second argument of `residuals`: any tree.
    free
        True for the parameters to fit and False for those to hold: one value, or a tree like `start` (or a prefix of it)
        whose leaves may be arrays.
    bounds
        (lower, upper), each a number or a tree like `start`. A parameter may start and end on its bound; there the fit ends
        with `Outcome.at_bound`, and the parameter counts as fixed for covariance and degrees of freedom.
    scale
        Typical size of each parameter, for a `solver` of your own; by default what moves the residuals by one at the start.
        The default solver scales by itself.
    loss
        Robust loss, such as `Huber()`.
    solver
        Any least-squares solver of optimistix instead of the default one; without bounds.
    starts
        Tree like `start` with one more axis in front of every leaf: fit from each and keep the lowest cost.
    max_steps
        Most evaluations of the residuals from one start.
    rtol
        Step to go, relative to the statistical uncertainty, at which the fit has converged.

    Returns
    -------
    Fit; it is not raised but said in `outcome` where the fit did not converge (`fit.checked()` raises).

    Raises
    ------
    FitError
        Before compiling, for a start that is not finite or outside the bounds, and for too few or non-finite residuals.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting import solve
    >>> def residuals(line, data):
    ...     return (line["offset"] + line["slope"] * data["x"] - data["y"]) / 0.1
    >>> x = jnp.arange(4.0)
    >>> fit = solve(residuals, {"offset": 0.0, "slope": 0.0}, {"x": x, "y": 2 * x + 1})
    >>> print(fit.names, fit.parameters.round(6), fit.message)
    ('offset', 'slope') [1. 2.] The fit converged.
    """
    problem = define(
        residuals, start, data, free=free, bounds=bounds, scale=scale, loss=loss, solver=solver, starts=starts,
        max_steps=max_steps, rtol=rtol,
    )  # fmt: skip
    check(problem)
    fit, at_start = run(problem)
    check_residuals(at_start)
    return dataclasses.replace(fit, problem=problem)


def _transformed(problem: Problem, x: Array) -> Array:
    r = problem.residual(x)
    return r if problem.loss is None else problem.loss(r)


def _linearise(function: Callable[[Array], Array], x: Array) -> tuple[Array, Array]:
    value, push = jax.linearize(function, x)
    return value, jax.vmap(push, out_axes=1)(jnp.eye(x.size, dtype=x.dtype))


def _weights(problem: Problem, r: Array) -> Array:
    return jnp.ones_like(r) if problem.loss is None else problem.loss.weight(r)


def _search(problem: Problem, x: Array) -> tuple[Array, Array]:
    """Lowest point that the solver reaches from `x`, and its number of steps."""
    scale, solver = problem.scale, problem.solver
    if solver is None:
        scale = jnp.ones_like(x)
        solver = BoundedLevenbergMarquardt(problem.rtol, problem.lower, problem.upper)
    elif scale is None:
        column = jnp.linalg.norm(_linearise(problem.residual, x)[1], axis=0)
        scale = jnp.where(column > 0, 1 / jnp.where(column > 0, column, 1), 1)
    found = optx.least_squares(
        lambda u, given: _transformed(given, u * scale), solver, x / scale, problem, max_steps=problem.max_steps, throw=False
    )
    return found.value * scale, found.stats["num_steps"]


def _best(problem: Problem) -> tuple[Array, Array]:
    """Search from every start and keep the lowest cost."""
    if problem.starts is None:
        return _search(problem, problem.values())
    x, steps = jax.lax.map(lambda start: _search(problem, start), problem.starts)
    cost = jnp.sum(jax.vmap(lambda one: _transformed(problem, one))(x) ** 2, axis=1)
    best = jnp.argmin(jnp.where(jnp.isfinite(cost), cost, jnp.inf))
    return x[best], steps[best]


def _slope(problem: Problem, x: Array) -> Array:
    return jax.grad(lambda y: 0.5 * jnp.sum(_transformed(problem, y) ** 2))(x)


def _attach(problem: Problem, x: Array, held: Array) -> Array:
    """The solution `x` as a differentiable function of the problem: a root of the gradient, or a point on a bound."""
    bound = jnp.where(held, jnp.where(x <= problem.lower, problem.lower, problem.upper), 0)

    def stationary(y: Array) -> Array:
        return jnp.where(held, y - bound, _slope(problem, y))

    def solve_tangent(linear: Callable[[Array], Array], y: Array) -> Array:
        hessian = jax.jacobian(linear)(jnp.zeros_like(y))
        size = jnp.sqrt(jnp.abs(jnp.diagonal(hessian)))
        size = jnp.where(size > 0, size, 1)
        return jnp.linalg.solve(hessian / size[:, None] / size[None, :], y / size) / size

    return jax.lax.custom_root(stationary, x, lambda _, found: found, solve_tangent)


def _judge(problem: Problem, normal: Normal, x: Array, rank: Array, finite: Array, steps: Array) -> Outcome:
    """Outcome from the solution itself, whatever the solver said."""
    eps = jnp.finfo(x.dtype).eps
    # The second test is for residuals that vanish at the solution: there the relative offset means nothing.
    flat = (normal.offset() <= 1e-6) | (jnp.linalg.norm(normal.step()) <= eps**0.5 * jnp.linalg.norm(normal.column * x))
    outcome = Outcome.where(jnp.any(normal.held), Outcome.at_bound, Outcome.converged)
    outcome = Outcome.where(flat, outcome, Outcome.where(steps >= problem.max_steps, Outcome.step_limit, Outcome.stalled))
    outcome = Outcome.where(rank < x.size, Outcome.unidentifiable, outcome)
    return Outcome.where(finite, outcome, Outcome.not_finite)


@eqx.filter_jit
def run(problem: Problem) -> tuple[Fit, Array]:
    """Solve, attach the derivative, and describe the solution; the second result is the residuals at the start."""
    fixed = jax.tree.map(lambda leaf: jax.lax.stop_gradient(leaf) if eqx.is_array(leaf) else leaf, problem)
    x, steps = _best(fixed)
    x = _attach(problem, x, held_at(x, _slope(fixed, x), problem.lower, problem.upper))
    r, jacobian = _linearise(problem.residual, x)

    still = jax.lax.stop_gradient
    root = still(jnp.sqrt(_weights(fixed, r)))
    weighted = root[:, None] * still(jacobian)
    normal = normal_equations(weighted, root * still(r), still(x), fixed.lower, fixed.upper)
    rank = jnp.sum(decompose(weighted, normal.held)[0] > 0)
    outcome = _judge(fixed, normal, still(x), rank, jnp.all(jnp.isfinite(r)) & jnp.all(jnp.isfinite(jacobian)), steps)

    influence = lambda r: _weights(problem, r) * r  # noqa: E731
    fit = Fit(
        model=problem.model(x),
        outcome=outcome,
        cost=0.5 * jnp.sum(_transformed(problem, x) ** 2),
        parameters=x,
        residuals=r,
        jacobian=jacobian,
        weights=_weights(problem, r),
        curvature=jax.jvp(influence, (r,), (jnp.ones_like(r),))[1],
        at_bound=normal.held,
        steps=steps,
        names=problem.names,
        robust=problem.loss is not None,
    )
    return fit, fixed.residual(fixed.values())
