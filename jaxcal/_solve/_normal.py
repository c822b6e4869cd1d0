"""Scaled normal equations at one point, and the bounded Levenberg-Marquardt method that stands on them."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx

from .._types import Array

#: Damping of the first step relative to the unit diagonal: nearly a Gauss-Newton step, and never a singular matrix.
_FIRST_DAMPING = 1e-3


class Normal(eqx.Module):
    """Normal equations of the residuals linearised at `y`, columns scaled to unit length.

    A parameter is `held` where it lies on a bound and the cost falls only beyond it.
    """

    gram: Array
    gradient: Array
    column: Array
    held: Array
    total: Array

    def step(self, damping: Array | float = 0.0) -> Array:
        """Gauss-Newton step of the scaled parameters, damped (Marquardt)."""
        p, dtype = self.gradient.size, self.gram.dtype
        free = ~self.held
        identity = jnp.eye(p, dtype=dtype)
        matrix = jnp.where(free[:, None] & free[None, :], self.gram, identity)
        # The floor keeps the Cholesky factor real where columns are dependent or zero.
        matrix = matrix + jnp.maximum(jnp.asarray(damping, dtype=dtype), 10 * p * jnp.finfo(dtype).eps) * identity
        factor = jnp.linalg.cholesky(matrix)
        return jax.scipy.linalg.cho_solve((factor, True), jnp.where(free, -self.gradient, 0))

    def offset(self) -> Array:
        """Squared length of the residuals' projection on the tangent space, relative to theirs.

        Its root is the convergence measure of D. M. Bates and D. G. Watts, Technometrics 23 (1981) 179: the step still to go
        in units of the statistical uncertainty.
        """
        return -(self.gradient @ self.step()) / jnp.where(self.total > 0, self.total, 1)


def normal_equations(jacobian: Array, residual: Array, y: Array, lower: Array, upper: Array) -> Normal:
    """Scale and form J'J and J'r; full precision, because accelerators would round the products to ten bits."""
    column = jnp.linalg.norm(jacobian, axis=0)
    scaled = jacobian / jnp.where(column > 0, column, 1)[None, :]
    product = lambda a, b: jnp.matmul(a, b, precision=jax.lax.Precision.HIGHEST)  # noqa: E731
    gradient = product(scaled.T, residual)
    held = ((y <= lower) & (gradient >= 0)) | ((y >= upper) & (gradient <= 0))
    return Normal(product(scaled.T, scaled), gradient, jnp.where(column > 0, column, 1), held, residual @ residual)


class _State(eqx.Module):
    y: Array
    normal: Normal
    offset: Array


class _ProjectedDescent(optx.AbstractDescent):
    """Damped Gauss-Newton step on the parameters that no bound holds, cut off at the bounds.

    The larger the damping the closer the step is to a projected gradient step, which always descends.
    """

    lower: Array
    upper: Array

    def init(self, y: Array, f_info_struct: Any) -> _State:
        zero = jnp.zeros((), dtype=y.dtype)
        normal = Normal(jnp.zeros((y.size, y.size), dtype=y.dtype), y, y, jnp.zeros(y.shape, dtype=bool), zero)
        return _State(y, normal, zero)

    def query(self, y: Array, f_info: Any, state: _State) -> _State:
        normal = normal_equations(f_info.jac.as_matrix(), f_info.residual, y, self.lower, self.upper)
        return _State(y, normal, normal.offset())

    def step(self, step_size: Array, state: _State) -> tuple[Array, optx.RESULTS]:
        y, normal = state.y, state.normal
        damping = _FIRST_DAMPING / jnp.asarray(step_size, dtype=y.dtype)
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
        self.search = optx.ClassicalTrustRegion()
        self.verbose = lambda **_: None

    def terminate(self, fn, y, args, options, state, tags):
        here = state.descent_state
        still = jnp.linalg.norm(here.normal.column * (state.y_eval - y)) <= jnp.finfo(y.dtype).eps ** 0.75 * jnp.linalg.norm(
            here.normal.column * y
        )
        return ~state.first_step & ((here.offset <= self.rtol**2) | still), state.result
