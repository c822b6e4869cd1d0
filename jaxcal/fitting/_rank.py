"""Which parameters the data determine, from the singular values of the scaled Jacobian."""

import equinox as eqx
import numpy as np

from .._precision import array_module
from .._types import AnyArray, Value
from ._result import Fit


def decompose(jacobian: AnyArray, held: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Singular values (those at rounding level are zero) and right singular vectors, columns scaled to unit length.

    A held column is replaced by one that is orthogonal to all others. NumPy does it outside of a trace, and compiles nothing.
    """
    xp = array_module(jacobian, held)
    jacobian = xp.where(held[None, :] | ~xp.isfinite(jacobian), 0, jacobian)
    column = xp.linalg.norm(jacobian, axis=0)
    triangle = xp.linalg.qr(jacobian / xp.where(column > 0, column, 1)[None, :], mode="r")
    _, s, vectors = xp.linalg.svd(xp.concatenate([triangle, xp.diag(held.astype(triangle.dtype))]), full_matrices=False)
    return xp.where(s > 10 * s.size * xp.finfo(s.dtype).eps, s, 0), vectors


def decomposed(fit: Fit) -> tuple[AnyArray, AnyArray]:
    """Singular values and vectors of the Jacobian of a fit under its weights."""
    root = array_module(fit).sqrt(fit.weights)
    return decompose(root[:, None] * fit.jacobian, fit.at_bound)


def rank_of(fit: Fit) -> Value:
    """Combinations of the parameters that data or bounds determine."""
    return (decomposed(fit)[0] > 0).sum()


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

    rank: Value
    singular_values: AnyArray
    condition: Value
    direction: AnyArray
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
    xp, (s, vectors) = array_module(fit), decomposed(fit)
    return Identifiability(
        rank=xp.sum(s > 0) - xp.sum(fit.at_bound),
        singular_values=s,
        condition=xp.where(s[-1] > 0, s[0] / xp.where(s[-1] > 0, s[-1], 1), xp.inf),
        direction=vectors[-1],
        at_bound=fit.at_bound,
        names=fit.names,
    )
