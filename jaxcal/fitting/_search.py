"""The search for the lowest cost: a solver of optimistix around one evaluation of the residuals and their Jacobian.

Tracing and compiling the residuals is most of the cost of a first call, so the whole program contains them once: `linearised` gives
residuals and Jacobian together, the solver differentiates it by one product with that Jacobian, and the solution keeps both. The
derivative of the solution (implicit function theorem) has its own rule, which is traced only if a fit is differentiated.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from .._types import Array
from ._implicit import root_change
from ._problem import Problem


class Rows(eqx.Module):
    """One row for each parameter with the derivatives of all residuals, and a last row with the residuals, (p + 1, n + m).

    The residuals are those of the `count` data, and then those of the priors. They are one array with their derivatives because XLA would
    compute the Jacobian twice for an iteration: for the normal equations and for the best point. The long axis is the last one, because
    products of such a table with itself take half the time.
    """

    table: Array
    count: int = eqx.field(static=True)

    @property
    def residuals(self) -> Array:
        """(n,) of the data."""
        return self.table[-1, : self.count]

    @property
    def jacobian(self) -> Array:
        """(n, p) of the data."""
        return self.table[:-1, : self.count].T

    @property
    def prior(self) -> Array:
        """(m,) residuals of the priors."""
        return self.table[-1, self.count :]

    @property
    def prior_jacobian(self) -> Array:
        """(m, p) of the priors."""
        return self.table[:-1, self.count :].T


class Found(eqx.Module):
    """End of a search; `flat` tells whether the cost has no slope left there. In a derivative, fields without a derivative are None."""

    x: Array
    rows: Rows
    held: Array | None
    flat: Array | None
    steps: Array | None


@eqx.filter_jit
def linearised(problem: Problem, x: Array) -> Rows:
    """Residuals and their Jacobian."""
    parts, push = jax.linearize(problem.residual, x)
    slopes = jax.vmap(push)(jnp.eye(x.size, dtype=x.dtype))
    return Rows(jnp.concatenate([jnp.concatenate([slope, r[None]]) for slope, r in zip(slopes, parts, strict=True)], axis=1), parts[0].size)


def lossy(problem: Problem, r: Array) -> tuple[Array, Array]:
    """Residuals whose half sum of squares is the loss, and their derivative with respect to the residuals."""
    return (r, jnp.ones_like(r)) if problem.loss is None else jax.jvp(problem.loss, (r,), (jnp.ones_like(r),))


def cost(problem: Problem, r: Array, prior: Array) -> Array:
    """The cost that the fit minimises."""
    return 0.5 * (jnp.sum(lossy(problem, r)[0] ** 2) + jnp.sum(prior**2))


def _from(problem: Problem, x: Array) -> Found:
    """The lowest point that the solver reaches from `x`."""
    import optimistix as optx  # takes a fifth of a second, and only the trace of a fit needs it

    from ._levenberg_marquardt import BoundedLevenbergMarquardt

    def evaluated(x: Array, given: Problem) -> tuple[Array, tuple[Array, Rows]]:
        rows = linearised(given, x)
        if given.loss is None:
            return rows.table[-1], (rows.table, rows)
        value, slope = lossy(given, rows.residuals)
        data = jnp.concatenate([slope[None] * rows.table[:-1, : rows.count], value[None]])
        table = jnp.concatenate([data, rows.table[:, rows.count :]], axis=1)
        return table[-1], (table, rows)

    solver = BoundedLevenbergMarquardt(rtol=problem.rtol, lower=problem.lower, upper=problem.upper)
    end = optx.least_squares(evaluated, solver, x, problem, has_aux=True, max_steps=problem.max_steps, throw=False)
    last, newton, rows = end.state.linear, end.state.newton, end.state.seen
    return Found(end.value, rows, last.held, last.flat(newton), end.stats["num_steps"])


@eqx.filter_custom_jvp
def search(problem: Problem) -> Found:
    """Search from every start and keep the lowest cost; differentiable in the arrays of the problem."""
    if problem.starts is None:
        return _from(problem, problem.values())
    found = jax.lax.map(lambda start: _from(problem, start), problem.starts)
    costs = jax.vmap(lambda rows: cost(problem, rows.residuals, rows.prior))(found.rows)
    best = jnp.argmin(jnp.where(jnp.isfinite(costs), costs, jnp.inf))
    return jax.tree.map(lambda leaf: leaf[best], found)


@search.def_jvp
def _(primals, tangents):
    """Derivative of the solution, which is a root of the gradient or lies on a bound, however the solver found it."""
    (problem,), (change,) = primals, tangents
    still = jax.tree.map(lambda leaf: leaf is None, change, is_leaf=lambda leaf: leaf is None)
    fixed, moving = eqx.partition(problem, still)
    found = search(problem)
    x, held = found.x, found.held

    def gradient(x: Array, moving: Problem) -> Array:
        given = eqx.combine(moving, fixed)
        bound = jnp.where(held, jnp.where(x <= given.lower, given.lower, given.upper), 0)
        slope = jax.grad(lambda x: cost(given, *given.residual(x)))(x)
        return jnp.where(held, x - bound, slope)

    dx = root_change(gradient, x, (moving,), (change,))
    rows, slopes = jax.jvp(lambda x, moving: linearised(eqx.combine(moving, fixed), x), (x, moving), (dx, change))
    return Found(x, rows, held, found.flat, found.steps), Found(dx, slopes, None, None, None)
