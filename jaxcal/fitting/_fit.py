"""`solve`: fit any model to residuals."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from .._errors import FitError
from .._precision import array_module, is_traced
from .._types import Array
from ._loss import AbstractLoss
from ._outcome import Outcome
from ._problem import Problem, check, define
from ._rank import rank_of
from ._result import Fit, to_numpy
from ._search import search, transformed


def solve(
    residuals: Callable[[Any, Any], Array],
    start: Any,
    data: Any = None,
    *,
    free: Any = None,
    bounds: tuple[Any, Any] | None = None,
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
        residuals, start, data, free=free, bounds=bounds, loss=loss, solver=solver, starts=starts, max_steps=max_steps, rtol=rtol
    )
    check(problem)
    fit = run(problem)
    _check_residuals(problem, fit)
    return dataclasses.replace(fit, problem=problem)


@eqx.filter_jit
def _run(problem: Problem) -> Fit:
    """Solve and describe the solution, but for its rank."""
    found = search(problem)
    x, r, jacobian = found.x, found.residuals, found.jacobian
    outcome = Outcome.where(jnp.any(found.held), Outcome.at_bound, Outcome.converged)
    unfinished = Outcome.where(found.steps >= problem.max_steps, Outcome.step_limit, Outcome.stalled)
    outcome = Outcome.where(found.flat, outcome, unfinished)
    finite = jnp.all(jnp.isfinite(r)) & jnp.all(jnp.isfinite(jacobian))
    influence = lambda r: (jnp.ones_like(r) if problem.loss is None else problem.loss.weight(r)) * r  # noqa: E731
    return Fit(
        model=problem.model(x),
        outcome=Outcome.where(finite, outcome, Outcome.not_finite),
        cost=0.5 * jnp.sum(transformed(problem, r)[0] ** 2),
        parameters=x,
        residuals=r,
        jacobian=jacobian,
        weights=jnp.ones_like(r) if problem.loss is None else problem.loss.weight(r),
        curvature=jax.jvp(influence, (r,), (jnp.ones_like(r),))[1],
        at_bound=found.held,
        steps=found.steps,
        names=problem.names,
        robust=problem.loss is not None,
    )


def run(problem: Problem) -> Fit:
    """Solve, and say where the data do not determine every parameter.

    Outside of a trace what describes the model is arrays of NumPy, with which the host computes without compiling.
    """
    found = _run(problem)
    fit = dataclasses.replace(to_numpy(found), model=found.model)
    lost = array_module(fit).logical_and(rank_of(fit) < fit.parameters.size, fit.outcome != Outcome.not_finite)
    if is_traced(lost):
        return dataclasses.replace(fit, outcome=Outcome.where(lost, Outcome.unidentifiable, fit.outcome))
    return dataclasses.replace(fit, outcome=to_numpy(Outcome.unidentifiable)) if lost else fit


def _check_residuals(problem: Problem, fit: Fit) -> None:
    """Refuse residuals that are not finite at the start, and say which (host only)."""
    if is_traced(fit) or fit.outcome != Outcome.not_finite:
        return
    bad = np.flatnonzero(~np.isfinite(np.asarray(eqx.filter_jit(problem.residual)(problem.values()))))
    if bad.size:
        raise FitError(
            f"{bad.size} of {fit.residuals.size} residuals are not finite at the start, the first at {bad[:5].tolist()}; "
            "remove NaN and infinite data, or start where the model is defined."
        )
