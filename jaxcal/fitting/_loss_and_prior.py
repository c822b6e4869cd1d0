"""Robust losses, written so that Gauss-Newton and its derivatives stay valid; and priors, as residuals beside those of the data."""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._errors import FitError
from .._types import AnyArray, Array, Tree
from ._problem import names_of, vector_of


class AbstractLoss(eqx.Module):
    """Robust loss of whitened residuals: the cost is 1/2 sum_i c^2 rho(r_i^2 / c^2), with c = `scale`.

    The solver uses the residual f(r) = r sqrt(rho(z) / z), z = r^2 / c^2, whose half sum of squares is that cost. So least squares on f
    has exactly the optimum of the loss, and the implicit derivative of the solution is that of the loss. Subclasses define `ratio`.

    The default scales of the losses give 95 % efficiency on Gaussian residuals (P. J. Huber and E. M. Ronchetti, Robust Statistics, 2009).

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting import AbstractLoss
    >>> class Inverse(AbstractLoss):
    ...     scale: float = 3.0
    ...
    ...     def ratio(self, z):
    ...         return 1 / (1 + z)
    >>> print(Inverse().weight(jnp.array([0.0, 3.0])).round(3))
    [1.   0.25]
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
        """Slope d rho / d z: the weight, from zero to one, of the residual in the gradient."""
        z = self._squared(residual)
        return jnp.clip(jax.jvp(lambda x: x * self.ratio(x), (z,), (jnp.ones_like(z),))[1], 0, 1)


class Huber(AbstractLoss):
    """Quadratic up to `scale`, linear beyond it: rho = z, then 2 sqrt(z) - 1.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting import Huber
    >>> [round(float(weight), 3) for weight in Huber(scale=2.0).weight(jnp.array([0.0, 1.0, 3.0]))]
    [1.0, 1.0, 0.667]
    """

    scale: float | Array = 1.345

    def ratio(self, z: Array) -> Array:
        # Replace the input as well: the derivative of the branch not taken must be finite at zero.
        large = jnp.where(z > 1, z, 1)
        return jnp.where(z > 1, 2 / jnp.sqrt(large) - 1 / large, 1)


class Cauchy(AbstractLoss):
    """Loss for heavy tails, with weight 1 / (1 + z): rho = ln(1 + z).

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting import Cauchy
    >>> [round(float(weight), 3) for weight in Cauchy(scale=2.0).weight(jnp.array([0.0, 1.0, 3.0]))]
    [1.0, 0.8, 0.308]
    """

    scale: float | Array = 2.385

    def ratio(self, z: Array) -> Array:
        # Replace the input as well, because zero gives 0 / 0; below the switch the series is exact to rounding.
        small = z < jnp.finfo(z.dtype).eps ** 0.5
        safe = jnp.where(small, 1, z)
        return jnp.where(small, 1 - z / 2, jnp.log1p(safe) / safe)


class AbstractPrior(eqx.Module):
    """Prior knowledge of a model, as residuals with standard deviation one.

    The fit minimises half their sum of squares together with that of the data. They are not data: no robust loss acts on them, they add no
    degree of freedom, they belong to no block, and a reduced chi-square does not scale them.

    Examples
    --------
    >>> from jaxcal.fitting import AbstractPrior
    >>> class Half(AbstractPrior):
    ...     def residuals(self, model):
    ...         return (model["a"] - 0.5) / 0.1
    >>> round(Half().residuals({"a": 0.6}), 6)
    1.0
    """

    @abc.abstractmethod
    def residuals(self, model: Tree) -> Array:
        """Residuals of the prior for a model, of any shape."""


class Gaussian(AbstractPrior):
    """Independent normal priors: residuals (value - mean) / sigma.

    Parameters
    ----------
    where
        Name of one parameter, such as "bias[2]", or of a whole leaf, such as "bias"; or a function of the model that returns the known
        quantity, an array or a tree of arrays. Define the function once: each new function object is compiled again.
    mean, sigma
        Mean and standard deviation in the unit of the parameter: one for all values, or one for each value.

    Raises
    ------
    FitError
        When the prior is used, if the model has no parameter of that name.

    Examples
    --------
    A scale factor that the data sheet gives to 1 %:

    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting import Gaussian, covariance, solve
    >>> def residuals(model, y):
    ...     return model["scale"] * (9.81 + model["bias"]) - y
    >>> start, y = {"bias": 0.0, "scale": 1.0}, jnp.array([9.9, 9.8, 10.0])
    >>> fit = solve(residuals, start, y, priors=Gaussian("scale", 1.0, 0.01))
    >>> round(float(fit.model["bias"]), 3), float((covariance(fit)[1, 1] ** 0.5).round(3))
    (0.09, 0.01)
    """

    where: str | Callable[[Any], Any] = eqx.field(static=True)
    mean: float | AnyArray = 0.0
    sigma: float | AnyArray = 1.0

    def residuals(self, model: Tree) -> Array:
        if callable(self.where):
            value = jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(self.where(model))])
        else:
            names = names_of(model)
            chosen = [i for i, name in enumerate(names) if name == self.where or name.startswith((f"{self.where}[", f"{self.where}."))]
            if not chosen:
                raise FitError(f"The prior is of {self.where!r}, no parameter; the model has {', '.join(names)}.", code="no_parameter")
            value = vector_of(model)[0][np.array(chosen)]
        mean, sigma = (jnp.broadcast_to(jnp.ravel(jnp.asarray(part, dtype=value.dtype)), value.shape) for part in (self.mean, self.sigma))
        return (value - mean) / sigma
