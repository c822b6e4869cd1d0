"""Scaled normal equations at one point, and the bounded Levenberg-Marquardt method that stands on them."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx

from .._types import Array
from ._positive import solve_positive

#: Damping of the first step relative to the unit diagonal: nearly a Gauss-Newton step, and never a singular matrix.
_FIRST_DAMPING = 1e-2


class Normal(eqx.Module):
    """Normal equations of the residuals linearised at `y`, columns scaled to unit length.

    Parameters that a bound holds (`held_at`) do not move.
    """

    gram: Array
    gradient: Array
    column: Array
    held: Array
    total: Array

    def step(self, damping: Array | float = 0.0) -> Array:
        """Gauss-Newton step of the scaled parameters, damped (one value, or one per parameter)."""
        p, dtype = self.gradient.size, self.gram.dtype
        free = ~self.held
        matrix = jnp.where(free[:, None] & free[None, :], self.gram, jnp.eye(p, dtype=dtype))
        # The floor keeps the pivots positive where columns are dependent or zero.
        matrix = matrix + jnp.diag(jnp.broadcast_to(jnp.maximum(damping, 10 * p * jnp.finfo(dtype).eps), p).astype(dtype))
        return solve_positive(matrix, jnp.where(free, -self.gradient, 0))[0]

    def offset(self) -> Array:
        """Squared length of the residuals' projection on the tangent space, relative to theirs.

        Its root is the convergence measure of D. M. Bates and D. G. Watts, Technometrics 23 (1981) 179: the step still to go
        in units of the statistical uncertainty.
        """
        return -(self.gradient @ self.step()) / jnp.where(self.total > 0, self.total, 1)


def held_at(y: Array, gradient: Array, lower: Array, upper: Array) -> Array:
    """Where a parameter lies on a bound and the cost falls only beyond it."""
    return ((y <= lower) & (gradient >= 0)) | ((y >= upper) & (gradient <= 0))


def normal_equations(jacobian: Array, residual: Array, y: Array, lower: Array, upper: Array) -> Normal:
    """Scale and form J'J and J'r; full precision, because accelerators would round the products to ten bits."""
    column = jnp.linalg.norm(jacobian, axis=0)
    scaled = jacobian / jnp.where(column > 0, column, 1)[None, :]
    product = lambda a, b: jnp.matmul(a, b, precision=jax.lax.Precision.HIGHEST)  # noqa: E731
    gradient = product(scaled.T, residual)
    held = held_at(y, gradient, lower, upper)
    return Normal(product(scaled.T, scaled), gradient, jnp.where(column > 0, column, 1), held, residual @ residual)


class _State(eqx.Module):
    y: Array
    normal: Normal
    offset: Array
    longest: Array


class _ProjectedDescent(optx.AbstractDescent):
    """Damped Gauss-Newton step on the parameters that no bound holds, cut off at the bounds.

    The larger the damping the closer the step is to a projected gradient step, which always descends.
    """

    lower: Array
    upper: Array

    def init(self, y: Array, f_info_struct: Any) -> _State:
        zero = jnp.zeros((), dtype=y.dtype)
        normal = Normal(jnp.zeros((y.size, y.size), dtype=y.dtype), y, y, jnp.zeros(y.shape, dtype=bool), zero)
        return _State(y, normal, zero, jnp.zeros_like(y))

    def query(self, y: Array, f_info: Any, state: _State) -> _State:
        normal = normal_equations(f_info.jac.as_matrix(), f_info.residual, y, self.lower, self.upper)
        return _State(y, normal, normal.offset(), jnp.maximum(state.longest, normal.column))

    def step(self, step_size: Array, state: _State) -> tuple[Array, optx.RESULTS]:
        y, normal = state.y, state.normal
        # A parameter is damped by its longest column so far (More, 1978), lest it run off where it has no effect.
        damping = _FIRST_DAMPING / jnp.asarray(step_size, dtype=y.dtype) * (state.longest / normal.column) ** 2
        return jnp.clip(y + normal.step(damping) / normal.column, self.lower, self.upper) - y, optx.RESULTS.successful


class BoundedLevenbergMarquardt(optx.AbstractGaussNewton):
    """Levenberg-Marquardt on scaled normal equations, with bounds by projection.

    From a good start it is Gauss-Newton; it cannot fail on dependent columns; it does not depend on the units of the
    parameters. It ends when the step to go is `rtol` of the statistical uncertainty, or no longer moves the parameters.
    """

    rtol: float
    atol: float
    norm: Callable
    descent: _ProjectedDescent
    search: optx.ClassicalTrustRegion
    verbose: Callable

    def __init__(self, rtol: float, lower: Array, upper: Array):
        self.rtol = rtol
        self.atol = 0.0
        self.norm = optx.max_norm
        self.descent = _ProjectedDescent(lower, upper)
        self.search = optx.ClassicalTrustRegion(high_cutoff=0.75)
        self.verbose = lambda **_: None

    def terminate(self, fn, y, args, options, state, tags):
        here = state.descent_state
        still = jnp.linalg.norm(here.normal.column * (state.y_eval - y)) <= jnp.finfo(y.dtype).eps ** 0.75 * jnp.linalg.norm(
            here.normal.column * y
        )
        return ~state.first_step & ((here.offset <= self.rtol**2) | still), state.result
