"""Which parameters the data determine, from the singular values of the scaled Jacobian."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._types import AnyArray, Array
from ._result import Fit


def decompose(jacobian: Array, held: AnyArray) -> tuple[Array, Array]:
    """Singular values (those at rounding level are zero) and right singular vectors, columns scaled to unit length.

    A held column is replaced by one that is orthogonal to all others.
    """
    jacobian = jnp.where(held[None, :], 0, jacobian)
    column = jnp.linalg.norm(jacobian, axis=0)
    triangle = jnp.linalg.qr(jacobian / jnp.where(column > 0, column, 1)[None, :], mode="r")
    _, s, vectors = jnp.linalg.svd(jnp.concatenate([triangle, jnp.diag(held.astype(triangle.dtype))]), full_matrices=False)
    return jnp.where(s > 10 * s.size * jnp.finfo(s.dtype).eps, s, 0), vectors


class Identifiability(eqx.Module):
    """How well the data determine the parameters, each in units of its own effect on the residuals.

    Attributes
    ----------
    rank : number of combinations of the free parameters that the data determine.
    singular_values : (p,) of the Jacobian with unit columns, largest first; zero where it is at rounding level.
    condition : largest over smallest; the standard error of the weakest combination is inflated by up to this factor.
    direction : (p,) the weakest combination, of unit length.
    at_bound : (p,) True where a bound holds the parameter, which then counts as fixed.
    names : parameters, in order.
    """

    rank: Array
    singular_values: Array
    condition: Array
    direction: Array
    at_bound: AnyArray
    names: tuple[str, ...] = eqx.field(static=True)

    @property
    def sentence(self) -> str:
        """What the data determine, with the weakest combination by name (host only)."""
        count = len(self.names) - int(np.sum(self.at_bound))
        share = np.abs(np.asarray(self.direction))
        weak = [name for name, part in zip(self.names, share, strict=True) if part > 0.3 * share.max()]
        weakest = ", ".join(weak)
        if int(self.rank) == count:
            only = f"the least certain is {weakest}" if len(weak) == 1 else f"the least certain combination is that of {weakest}"
            return f"The data determine all {count} parameters (condition number {float(self.condition):.3g}); {only}."
        if len(weak) == 1:
            return (
                f"The data determine {int(self.rank)} of {count} parameters and say nothing about {weakest}; "
                "hold it fixed, add a prior as a residual, or record data that move it."
            )
        return (
            f"The data determine {int(self.rank)} of {count} parameters and cannot tell apart {weakest}; "
            "hold one of them fixed, add a prior as a residual, or record data in which they act differently."
        )


def identifiability(fit: Fit) -> Identifiability:
    """Which parameters of a fit the data determine, and which combination they determine least.

    Parameters
    ----------
    fit
        Any fit, converged or not.

    Returns
    -------
    Identifiability; its `sentence` names the parameters.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting import identifiability, solve
    >>> def residuals(model, y):
    ...     return model["scale"] * (9.81 + model["bias"]) - y
    >>> fit = solve(residuals, {"bias": 0.0, "scale": 1.0}, jnp.array([9.9, 9.8, 9.9]))
    >>> print(identifiability(fit).sentence.split(";")[0])
    The data determine 1 of 2 parameters and cannot tell apart bias, scale
    """
    s, vectors = eqx.filter_jit(decompose)(jnp.sqrt(fit.weights)[:, None] * fit.jacobian, fit.at_bound)
    return Identifiability(
        rank=jnp.sum(s > 0) - jnp.sum(fit.at_bound),
        singular_values=s,
        condition=jnp.where(s[-1] > 0, s[0] / jnp.where(s[-1] > 0, s[-1], 1), jnp.inf),
        direction=vectors[-1],
        at_bound=fit.at_bound,
        names=fit.names,
    )
