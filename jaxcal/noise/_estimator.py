r"""Estimators of the squared coefficients from an Allan variance curve, each the fixed point of a least-squares step.

The weights depend on the coefficients sought, so a step solves with the weights at the coefficients of the step before:

.. math:: \theta \leftarrow \arg\min_{\theta \ge 0} (v - A\theta)'\,W(\theta)\,(v - A\theta)
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp

from .._types import Array, Bool, Float
from ..fitting._positive import solve_positive
from ._curve import Curve, inverse

#: relative change of the modelled variance at which the weights have settled
SETTLED = 1e-5


class Estimator(eqx.Module):
    """A way to estimate; it has no data of its own, so that it can be a static argument."""

    @property
    @abc.abstractmethod
    def most(self) -> int:
        """Most steps."""

    @abc.abstractmethod
    def begin(self, curve: Curve) -> Float[Array, " p"]:
        """Where the iteration starts."""

    @abc.abstractmethod
    def step(self, curve: Curve, theta: Float[Array, " p"]) -> Float[Array, " p"]:
        """Coefficients of least squares with the weights at theta."""

    @abc.abstractmethod
    def spread(self, curve: Curve, theta: Float[Array, " p"], independent: Bool[Array, " p"]) -> Float[Array, "p p"]:
        """Covariance of the estimate, of the `independent` coefficients."""


def settle(curve: Curve, estimator: Estimator, start, most: int, enough: float):
    """Iterate until a step changes the modelled variance by no more than `enough` of it; theta and the last change.

    Left alone the steps may swing, or go on at two thirds of the length before. Each is lengthened or shortened by what the last
    two tell (Irons and Tuck, Int. J. Numer. Meth. Eng. 1, 1969): a dozen steps do where halving every step took forty.
    """

    def body(state):
        theta, before, length, _, k = state
        new = estimator.step(curve, theta)
        reached = curve.columns @ new
        change = (reached - curve.columns @ theta) / jnp.where(reached > 0.0, reached, 1.0)
        change = jnp.where(curve.used, change, 0.0)
        bend = before - change
        turn = jnp.sum(bend**2)
        next_length = length * jnp.sum(before * bend) / jnp.where(turn > 0.0, turn, 1.0)
        next_length = jnp.where((k > 1) & (next_length > 0.0), jnp.clip(next_length, 0.3, 4.0), 1.0)
        largest = jnp.max(jnp.abs(change))
        # the last step is a whole one: what goes to zero is zero
        theta = jnp.where(largest > enough, jnp.maximum(theta + next_length * (new - theta), 0.0), new)
        return theta, change, next_length, largest, k + 1

    def going(state):
        return (state[3] > enough) & (state[4] < most)

    one = jnp.ones((), curve.v.dtype)
    theta, _, _, change, _ = jax.lax.while_loop(going, body, (start, jnp.zeros_like(curve.v), one, jnp.inf * one, 0))
    return theta, change


def with_derivative(curve: Curve, estimator: Estimator, theta, change) -> Float[Array, " p"]:
    """The fixed point that `settle` came to, with its derivative with respect to the curve.

    The iteration carries no derivative. One Newton step for theta = step(theta) from its end does, that of the implicit
    function theorem; it also squares what error was left.
    """
    theta, change = jax.lax.stop_gradient((theta, change))
    new, push = jax.linearize(lambda t: estimator.step(curve, t), theta)
    slope = jax.lax.stop_gradient(jax.vmap(push, out_axes=1)(jnp.eye(len(theta), dtype=theta.dtype)))
    size = jnp.max(jnp.where(curve.used[:, None], jnp.abs(curve.columns), 0.0), axis=0)
    size = jnp.where(size > 0.0, size, 1.0)  # in units of these the coefficients are of similar size
    apart = jnp.eye(len(theta), dtype=theta.dtype) - slope * size[:, None] / size[None, :]
    # normal equations, for a step near its fixed point is far from singular; no LAPACK, see `forward`
    move = solve_positive(apart.T @ apart, apart.T @ ((new - theta) * size))[0] / size
    move = jnp.where(jnp.all(jnp.isfinite(move)), move, 0.0)
    ended = jnp.where(new > 0.0, jnp.maximum(theta + move, 0.0), 0.0)
    # where the iteration has not settled the Newton step may lead anywhere
    ended = jnp.where(change <= 10 * SETTLED, ended, theta)
    return jax.lax.stop_gradient(ended) + move - jax.lax.stop_gradient(move)


class Weighted(Estimator):
    """Independent cluster sizes of variance 2 (A theta)^2 / edf, the diagonal of C(theta)."""

    @property
    def most(self) -> int:
        """Thirty; few records need more than eight."""
        return 30

    def begin(self, curve: Curve) -> Float[Array, " p"]:
        """Nothing: the first step then takes relative errors as equal."""
        return jnp.zeros_like(curve.held)

    def step(self, curve: Curve, theta: Float[Array, " p"]) -> Float[Array, " p"]:
        """Weighted least squares."""
        variance = curve.variance(theta)
        return curve.weighted(1.0 / jnp.where(variance > 0.0, variance, curve.v**2))

    def spread(self, curve: Curve, theta: Float[Array, " p"], independent: Bool[Array, " p"]) -> Float[Array, "p p"]:
        """Sandwich G (A' D C D A) G with D = 1/diag C, G = (A' D A)^-1: cluster sizes are far from independent."""
        c = curve.covariance(theta)
        columns = jnp.where(independent[None, :], curve.columns, 0.0)
        rows = columns * jnp.where(curve.used, 1.0 / jnp.diagonal(c), 0.0)[:, None]
        g = inverse(columns.T @ rows)
        return g @ (rows.T @ c @ rows) @ g
