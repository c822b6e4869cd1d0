"""What is known of the parameters before the data."""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._errors import FitError
from .._types import AnyArray, Array
from ._parameters import names_of, vector_of


class AbstractPrior(eqx.Module):
    """Knowledge of a model that does not come from the data, as residuals with standard deviation one.

    The fit minimises half their sum of squares beside that of the data. No robust loss acts on them, and they are no data: they have no
    degree of freedom and belong to no block, and a reduced chi-square does not scale them.
    """

    @abc.abstractmethod
    def residuals(self, model: Any) -> Array:
        """Residuals of any shape at a model."""


class Gaussian(AbstractPrior):
    """Independent normal priors: residuals (value - mean) / sigma.

    Parameters
    ----------
    where
        Name of one parameter, such as "bias[2]", or of all of a leaf, such as "bias"; or a function of the model that returns what is
        known, an array or a tree of them. Define it once: a new function object is compiled anew.
    mean, sigma
        Mean and standard deviation in the unit of the parameter, one for all or one for each value.

    Raises
    ------
    FitError
        When it is used, if the model has no parameter of that name.

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

    def residuals(self, model: Any) -> Array:
        if callable(self.where):
            value = jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(self.where(model))])
        else:
            names = names_of(model)
            chosen = [i for i, name in enumerate(names) if name == self.where or name.startswith((f"{self.where}[", f"{self.where}."))]
            if not chosen:
                raise FitError(f"The prior is of {self.where!r}, which is no parameter; the model has {', '.join(names)}.")
            value = vector_of(model)[0][np.array(chosen)]
        mean, sigma = (jnp.broadcast_to(jnp.ravel(jnp.asarray(part, dtype=value.dtype)), value.shape) for part in (self.mean, self.sigma))
        return (value - mean) / sigma
