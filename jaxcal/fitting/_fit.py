"""`solve`: fit any model to residuals; `solve_many`: the same fit for many data sets."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._errors import FitError
from .._frozen import made
from .._precision import array_module, is_traced
from .._types import Array, Tree
from ._loss_and_prior import AbstractLoss, AbstractPrior
from ._problem import Problem, check, common_dtype, define, to_floats
from ._result import Fit, M, Outcome, ended, known_of, to_numpy
from ._search import cost, search


def solve(
    residuals: Callable[[Any, Any], Array], start: M, data: Tree = None, *, free: Tree = None, bounds: tuple[Any, Any] | None = None,
    loss: AbstractLoss | None = None, priors: AbstractPrior | Sequence[AbstractPrior] = (), starts: Tree = None, max_steps: int = 128,
    rtol: float | Array | None = None,
) -> Fit[M]:  # fmt: skip
    """Fit a model by minimising 1/2 sum_i c^2 rho(r_i^2 / c^2) over its parameters (half the sum of squares without a loss).

    The fit can be differentiated with respect to `data`, bounds, held parameters, and the numbers in priors and loss (implicit function
    theorem). It runs under `jit` and `vmap`. Calls with the same residual function and the same shapes reuse the compiled program.

    Parameters
    ----------
    residuals
        Function of (model, data) that returns an array of any shape, with each entry divided by its standard deviation. Define it
        once, at module level: each new function object is compiled again. Entries that are zero with zero derivative are padding.
    start
        Model to start from: an Equinox module or any other tree. Its floating-point leaves are the parameters.
    data
        Second argument of `residuals`: any tree.
    free
        True for the parameters to fit and False for those to hold fixed: one value, or a tree like `start` (or a prefix of it)
        whose leaves may be arrays.
    bounds
        (lower, upper), each a number or a tree like `start`. A parameter may start and end on its bound. If it ends there, the outcome
        is `Outcome.at_bound`, and the parameter counts as fixed for covariance and degrees of freedom.
    loss
        Robust loss, such as `Huber()`.
    priors
        Prior knowledge of the parameters: one prior such as `Gaussian("bias[2]", 0.0, 0.01)`, or several.
    starts
        Tree like `start` with one more leading axis in every leaf: fit from each start and keep the lowest cost.
    max_steps
        Largest number of evaluations of the residuals from one start.
    rtol
        Remaining step, relative to the statistical uncertainty, at which the fit has converged.

    Returns
    -------
    Fit. A fit that does not converge raises no error; its `outcome` tells (`fit.checked()` raises).

    Raises
    ------
    FitError
        Before compiling, if a start is not finite or outside the bounds, or if residuals are too few or not finite.

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
        residuals, start, data, free=free, bounds=bounds, loss=loss, priors=priors, starts=starts, max_steps=max_steps,
        rtol=rtol,
    )  # fmt: skip
    check(problem)
    fit = run(problem)
    _check_residuals(problem, fit)
    return fit


@filter_jit
def _run(problem: Problem) -> dict[str, Any]:
    """Solve the problem and return the fields of `Fit`, except for the rank."""
    found = search(problem)
    x, rows, r = found.x, found.rows, found.rows.residuals
    outcome = Outcome.where(jnp.any(found.held), Outcome.at_bound, Outcome.converged)
    unfinished = Outcome.where(found.steps >= problem.max_steps, Outcome.step_limit, Outcome.stalled)
    outcome = Outcome.where(found.flat, outcome, unfinished)
    finite = jnp.all(jnp.array([jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(rows)]))
    weight = jnp.ones_like if problem.loss is None else problem.loss.weight
    return {
        "model": problem.model(x), "outcome": Outcome.where(finite, outcome, Outcome.not_finite), "cost": cost(problem, r, rows.prior),
        "parameters": x, "residuals": r, "jacobian": rows.jacobian, "weights": weight(r),
        "curvature": jax.jvp(lambda r: weight(r) * r, (r,), (jnp.ones_like(r),))[1],
        "prior_residuals": rows.prior, "prior_jacobian": rows.prior_jacobian, "at_bound": found.held, "steps": found.steps,
        "flat": found.flat, "effective": jnp.sum(~found.held, dtype=r.dtype),
    }  # fmt: skip


def run(problem: Problem) -> Fit:
    """Solve the problem, and report if the data do not determine every parameter.

    Outside of a trace, the fields other than the model are NumPy arrays, so that the host computes with them without compiling.
    """
    found = _run(problem)
    model = found.pop("model")
    found = to_numpy(found)
    fit = made(Fit, model=model, names=problem.names, robust=problem.loss is not None, problem=problem, **found)
    xp, known = array_module(fit.parameters), known_of(fit)
    if problem.priors:
        fit = dataclasses.replace(fit, effective=fit.effective - xp.sum(known.leverage(fit.prior_jacobian)))
    lost = xp.logical_and(known.rank < xp.sum(~fit.at_bound), ~ended(fit, Outcome.not_finite))
    if is_traced(lost):
        return dataclasses.replace(fit, outcome=Outcome.where(lost, Outcome.unidentifiable, fit.outcome))
    return dataclasses.replace(fit, outcome=Outcome.unidentifiable) if lost else fit


def _check_residuals(problem: Problem, fit: Fit) -> None:
    """Refuse residuals that are not finite at the start, and report which (host only)."""
    if is_traced(fit.parameters) or not ended(fit, Outcome.not_finite):
        return
    at_start = np.concatenate([np.asarray(part) for part in filter_jit(lambda given: given.residual(given.values()))(problem)])
    bad = np.flatnonzero(~np.isfinite(at_start))
    if bad.size:
        said = f"{bad.size} of {at_start.size} residuals are not finite at the start, the first at {bad[:5].tolist()}"
        raise FitError(f"{said}; remove such data, or start where the model is defined.", code="not_finite")


def solve_many(
    residuals: Callable[[Any, Any], Array], start: M, data: Tree, *, batched: Tree = (True, True),
    batch: Literal["map", "vmap"] | None = None, **options: Any,
) -> Fit[M]:  # fmt: skip
    """Fit the same model to many data sets in one compiled call.

    One bad data set among many raises no error: check `outcome` or `usable`, which have one value per fit.

    Parameters
    ----------
    residuals
        As for `solve`.
    start, data
        As for `solve`, with one more leading axis in every `batched` leaf.
    batched
        Whether leaves have that axis: True or False for all of `start`, and for all of `data` (or a tree for each).
    batch
        "map" solves one data set after another, each in its own number of steps; "vmap" solves all at once, in as many steps as the
        slowest needs. The default is "map" on a CPU and "vmap" elsewhere.
    options
        Options of `solve`, the same for every fit.

    Returns
    -------
    Fit whose arrays have one more leading axis, one entry per fit.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting import solve_many
    >>> y = jnp.array([[1.0, 2.0, 3.0], [4.0, 4.0, 7.0]])
    >>> fits = solve_many(lambda mean, y: mean - y, 0.0, y, batched=(False, True))
    >>> print(fits.model.round(3))
    [2. 5.]
    """
    start, data = to_floats((start, data), common_dtype(start, data))
    mapped, shared = eqx.partition((start, data), batched)
    first = eqx.combine(jax.tree.map(lambda leaf: leaf[0], mapped), shared)
    template = define(residuals, *first, **options)
    if batch is None:
        batch = "map" if jax.default_backend() == "cpu" else "vmap"
    return _each(template, mapped, shared, batch == "vmap")


@filter_jit
def _each(template: Problem, mapped: Any, shared: Any, together: bool) -> Fit:
    def one(item: Any) -> Fit:
        start, data = eqx.combine(item, shared)
        return dataclasses.replace(run(dataclasses.replace(template, start=start, data=data)), problem=None)

    return jax.vmap(one)(mapped) if together else jax.lax.map(one, mapped)
