"""The default solver: Levenberg-Marquardt on scaled normal equations, with bounds.

It is an optimistix solver with its own step, for two reasons. `optimistix.least_squares` has no bounds. And this step evaluates the
residuals only once, together with their Jacobian, so that the compiled loop contains them once.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx

from .._types import Array

#: Damping of the first step relative to the unit diagonal: nearly a Gauss-Newton step, but never a singular matrix.
FIRST_DAMPING = 1e-2
#: Shares of the predicted decrease: above the first a step is accepted, above the second the next step is longer.
ACCEPTED, GOOD = 0.01, 0.75
SHORTER, LONGER = 0.25, 3.5


class Linear(eqx.Module):
    """Residuals linearised at `y`: normal equations with columns scaled to unit length, and the undamped step.

    Parameters at a bound (`held`) do not move.
    """

    y: Array
    gram: Array
    gradient: Array
    column: Array
    held: Array
    total: Array

    def steps(self, damping: Array) -> tuple[Array, Array]:
        """Gauss-Newton steps of the scaled parameters: damped (one damping value per parameter), and undamped."""
        damped, newton = self._solved(jnp.stack([damping, jnp.zeros_like(damping)]), ~self.held, -self.gradient)
        return damped, newton

    def _solved(self, damping: Array, free: Array, side: Array) -> Array:
        """Solutions of the normal equations of the `free` parameters, one for each row of damping values; zero for the others."""
        p, dtype = side.size, side.dtype
        matrix = jnp.where(free[:, None] & free[None, :], self.gram, jnp.eye(p, dtype=dtype))
        # The floor keeps the pivots positive if columns are dependent or zero.
        floor = jnp.maximum(damping, 10 * p * jnp.finfo(dtype).eps)
        return _eliminated(matrix[None] + floor[:, :, None] * jnp.eye(p, dtype=dtype)[None], jnp.where(free, side, 0))

    def trial(self, damped: Array, damping: Array, lower: Array, upper: Array) -> Array:
        """The point at the end of a damped step. Parameters that would cross a bound stop there, and the step of the others allows for it.

        Without this, the others would make up for a change that does not take place.
        """
        aim = self.y + damped / self.column
        stopped = (aim < lower) | (aim > upper)
        way = jnp.where(stopped, (jnp.clip(aim, lower, upper) - self.y) * self.column, 0)
        (rest,) = self._solved(damping[None], ~self.held & ~stopped, -self.gradient - self.gram @ way)
        return jnp.clip(self.y + (way + rest) / self.column, lower, upper)

    def predicted(self, y: Array) -> Array:
        """Change of the cost from here to `y`, predicted by the linearised residuals."""
        way = self.column * (y - self.y)
        return way @ (self.gradient + 0.5 * (self.gram @ way))

    def offset(self, newton: Array) -> Array:
        """Squared length of the residuals' projection on the tangent space, relative to the residuals.

        Its root is the convergence measure of D. M. Bates and D. G. Watts, Technometrics 23 (1981) 179: the remaining step in units of the
        statistical uncertainty.
        """
        return -(self.gradient @ newton) / jnp.where(self.total > 0, self.total, 1)

    def shorter(self, step: Array, power: float) -> Array:
        """Whether a step of the scaled parameters is at rounding level: eps^power of their size."""
        return jnp.linalg.norm(step) <= jnp.finfo(step.dtype).eps ** power * jnp.linalg.norm(self.column * self.y)

    def flat(self, newton: Array) -> Array:
        """Whether the cost has no slope left; the second test covers residuals that vanish, for which the offset is meaningless."""
        return (self.offset(newton) <= 1e-6) | self.shorter(newton, 0.5)


def _eliminated(matrix: Array, side: Array) -> Array:
    """Solutions of small symmetric positive definite systems, (k, p, p), with one right-hand side.

    Elimination without pivoting is stable here. It is written out because batched LAPACK factorisations that run side by side can hang
    on a CPU (jaxlib 0.10), and are slower for a handful of unknowns.
    """
    k, p = len(matrix), side.size
    rows = jnp.arange(p)[None, :, None]

    def eliminate(i: Array, table: Array) -> Array:
        row = table[:, i, None] / table[:, i, i][:, None, None]
        return jnp.where(rows == i, row, table - table[:, :, i][:, :, None] * row)

    return jax.lax.fori_loop(0, p, eliminate, jnp.concatenate([matrix, jnp.broadcast_to(side[None, :, None], (k, p, 1))], axis=2))[:, :, p]


def held_at(y: Array, gradient: Array, lower: Array, upper: Array) -> Array:
    """Whether each parameter lies on a bound and the cost falls only beyond it."""
    return ((y <= lower) & (gradient >= 0)) | ((y >= upper) & (gradient <= 0))


def linear_problem(table: Array, y: Array, lower: Array, upper: Array) -> Linear:
    """The normal equations of a table, (p + 1, n), of the Jacobian's columns as rows, and of the residuals as the last row.

    J'J, J'r and r'r are one product, in full precision, because accelerators would round it to ten bits. Then the columns are scaled.
    """
    p = y.size
    product = jnp.matmul(table, table.T, precision=jax.lax.Precision.HIGHEST)
    column = jnp.sqrt(jnp.diagonal(product)[:p])
    column = jnp.where(column > 0, column, 1)
    gram, gradient = product[:p, :p] / column[:, None] / column[None, :], product[:p, p] / column
    return Linear(y, gram, gradient, column, held_at(y, gradient, lower, upper), product[p, p])


class State(eqx.Module):
    """The best point so far (`linear`, and the extra output of the residual function there) and the next point to try."""

    linear: Linear
    seen: Any
    trial: Array
    newton: Array
    longest: Array
    size: Array
    first: Array


class BoundedLevenbergMarquardt(optx.AbstractLeastSquaresSolver):
    """Levenberg-Marquardt on scaled normal equations. Parameters stop at their bounds.

    The function must return residuals and (the table for `linear_problem`, anything to keep of the best point). From a good start the
    solver is Gauss-Newton. Dependent columns cannot make it fail, and the units of the parameters do not matter. It ends when the
    remaining step is `rtol` of the statistical uncertainty, or no longer changes the parameters.
    """

    rtol: float | Array
    lower: Array
    upper: Array
    atol: float = 0.0
    norm: Callable = optx.max_norm

    def init(self, fn, y, args, options, f_struct, aux_struct, tags):
        zero = jnp.zeros((), dtype=y.dtype)
        linear = Linear(y, jnp.zeros((y.size, y.size), dtype=y.dtype), y, y, jnp.zeros(y.shape, dtype=bool), zero)
        seen = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), aux_struct[1])
        return State(linear, seen, y, y, jnp.zeros_like(y), zero + 1, jnp.array(True))

    def step(self, fn, y, args, options, state, tags):
        _, (table, seen) = fn(state.trial, args)
        here = linear_problem(table, state.trial, self.lower, self.upper)
        change, predicted = (here.total - state.linear.total) / 2, state.linear.predicted(state.trial)
        # So near the solution that the cost only changes by rounding, the linearised residuals are right, and the cost cannot judge them.
        rounding = 10 * y.size * jnp.finfo(y.dtype).eps
        near = (state.linear.offset(state.newton) <= rounding) & (change <= rounding * state.linear.total)
        accept = state.first | (change <= ACCEPTED * predicted) | near
        good = ~state.first & (predicted < 0) & (change < GOOD * predicted)
        size = state.size * jnp.where(accept, jnp.where(good, LONGER, 1.0), SHORTER).astype(y.dtype)
        linear, seen = jax.tree.map(lambda new, old: jnp.where(accept, new, old), (here, seen), (state.linear, state.seen))
        # Damp a parameter by its longest column so far (More, 1978); otherwise it could diverge where it has no effect.
        longest = jnp.where(accept, jnp.maximum(state.longest, here.column), state.longest)
        damping = FIRST_DAMPING / size * (longest / linear.column) ** 2
        damped, newton = linear.steps(damping)
        trial = linear.trial(damped, damping, self.lower, self.upper)
        return linear.y, State(linear, seen, trial, newton, longest, size, jnp.array(False)), (table, seen)

    def terminate(self, fn, y, args, options, state, tags):
        linear = state.linear
        done = (linear.offset(state.newton) <= self.rtol**2) | linear.shorter(linear.column * (state.trial - linear.y), 0.75)
        return ~state.first & done, optx.RESULTS.successful

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        return y, None, {}
