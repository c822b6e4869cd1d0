"""Robust losses, written so that Gauss-Newton and its derivatives stay valid."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp

from .._types import Array


class AbstractLoss(eqx.Module):
    """How much a whitened residual counts: the cost is 1/2 sum_i c^2 rho(r_i^2 / c^2), with c = `scale`.

    The solver sees the residual f(r) = r sqrt(rho(z) / z), z = r^2 / c^2, whose half sum of squares is that cost. So least
    squares on f has exactly the optimum of the loss, and the implicit derivative of the solution is that of the loss.

    The default scales have 95 % efficiency on Gaussian residuals (P. J. Huber and E. M. Ronchetti, Robust Statistics, 2009).
    """

    scale: eqx.AbstractVar[float | Array]

    @abc.abstractmethod
    def ratio(self, z: Array) -> Array:
        """rho(z) / z, which is one at zero."""

    def _squared(self, residual: Array) -> Array:
        return (residual / jnp.asarray(self.scale, dtype=residual.dtype)) ** 2

    def __call__(self, residual: Array) -> Array:
        """Residual whose square is the loss."""
        return residual * jnp.sqrt(self.ratio(self._squared(residual)))

    def weight(self, residual: Array) -> Array:
        """Slope d rho / d z: the weight between one and zero that the residual has in the gradient."""
        z = self._squared(residual)
        return jnp.clip(jax.jvp(lambda x: x * self.ratio(x), (z,), (jnp.ones_like(z),))[1], 0, 1)


class Huber(AbstractLoss):
    """Quadratic up to `scale`, linear beyond it: rho = z, then 2 sqrt(z) - 1."""

    scale: float | Array = 1.345

    def ratio(self, z: Array) -> Array:
        # Double where: the derivative of the branch not taken must be finite at zero.
        large = jnp.where(z > 1, z, 1)
        return jnp.where(z > 1, 2 / jnp.sqrt(large) - 1 / large, 1)


class SoftL1(AbstractLoss):
    """A smooth Huber: rho = 2 (sqrt(1 + z) - 1)."""

    scale: float | Array = 1.2871

    def ratio(self, z: Array) -> Array:
        return 2 / (1 + jnp.sqrt(1 + z))


class Cauchy(AbstractLoss):
    """Weight 1 / (1 + z), for heavy tails: rho = ln(1 + z)."""

    scale: float | Array = 2.385

    def ratio(self, z: Array) -> Array:
        # Double where: 0 / 0 at zero; the series is exact to rounding below the switch.
        small = z < jnp.finfo(z.dtype).eps ** 0.5
        safe = jnp.where(small, 1, z)
        return jnp.where(small, 1 - z / 2, jnp.log1p(safe) / safe)


class Tukey(AbstractLoss):
    """No weight beyond `scale`: rho = (1 - (1 - z)^3) / 3, then 1/3. It has many minima; start from a robust fit."""

    scale: float | Array = 4.685

    def ratio(self, z: Array) -> Array:
        large = jnp.where(z > 1, z, 1)
        return jnp.where(z > 1, 1 / (3 * large), 1 - z + z**2 / 3)
