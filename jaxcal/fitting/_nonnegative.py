"""Non-negative linear least squares from its normal equations, for a handful of unknowns."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._errors import FitError
from .._types import AnyArray, Array, Bool, Float
from ._positive import solve_positive

_MOST_UNKNOWNS = 8


class Nonnegative(eqx.Module):
    """Solution of a non-negative least-squares problem.

    Attributes
    ----------
    value : (p,) coefficients, each zero or positive.
    active : (p,) True where the coefficient is free, False where the constraint holds it at zero.
    cost : t' G t - 2 b' t at the solution, never above zero (add the data's y' W y for the sum of squared residuals).
    """

    value: Float[Array, " p"]
    active: Bool[Array, " p"]
    cost: Float[Array, ""]


def _subsets(p: int) -> np.ndarray:
    """All 2^p active sets, small ones first, so that of two sets with the same cost the smaller wins."""
    sets = (np.arange(2**p)[:, None] >> np.arange(p)[None, :]) & 1 == 1
    return sets[np.argsort(sets.sum(axis=1), kind="stable")]


def _solve_active(gram: Array, moment: Array, active: Array) -> tuple[Array, Array]:
    """Unconstrained solution on one active set, and the pivots of its normal equations."""
    # Rows and columns outside of the set become those of the identity, so every set has the same shape.
    matrix = jnp.where(active[:, None] & active[None, :], gram, jnp.eye(gram.shape[0], dtype=gram.dtype))
    return solve_positive(matrix, jnp.where(active, moment, 0))


@jax.jit
def nonnegative(gram: Float[AnyArray, "p p"], moment: Float[AnyArray, " p"]) -> Nonnegative:
    """Minimise t' G t - 2 b' t over t >= 0, for at most eight unknowns.

    With a design matrix A, data y and weights W, G = A' W A and b = A' W y make this the weighted least-squares problem with
    non-negative coefficients. Every one of the 2^p active sets is solved at once, on columns scaled to unit length; sets that
    are singular or have a negative coefficient are left out, and the lowest cost wins. Nothing is lost: a solution with
    linearly independent columns always exists. There is no iteration and no branch on data, so `jit`, `vmap` and `grad` apply;
    derivatives are those of the chosen set.

    Parameters
    ----------
    gram
        (p, p) symmetric, positive semidefinite. A column of zeros gives a zero coefficient.
    moment
        (p,) right-hand side, of the same dtype.

    Returns
    -------
    Nonnegative, in the dtype of the inputs; NaN throughout if an input is not finite.

    Raises
    ------
    FitError
        For more than eight unknowns.

    Examples
    --------
    The second unknown would be -1 without the constraint:

    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting import nonnegative
    >>> solution = nonnegative(jnp.diag(jnp.array([2.0, 4.0])), jnp.array([6.0, -4.0]))
    >>> print(solution.value.round(6), solution.active, solution.cost.round(3))
    [3. 0.] [ True False] -18.0
    """
    gram, moment = jnp.asarray(gram), jnp.asarray(moment)
    p = moment.shape[0]
    if p > _MOST_UNKNOWNS:
        raise FitError(f"{p} unknowns were given where every active set is tried; give at most {_MOST_UNKNOWNS}.")
    diagonal = jnp.diagonal(gram)
    # Double where: a zero column has scale 1, and neither it nor its derivative divides by zero.
    scale = jnp.where(diagonal > 0, jnp.sqrt(jnp.where(diagonal > 0, diagonal, 1)), 1)
    # Two divisions, because the product of two small scales may underflow in float32.
    scaled, target = gram / scale[:, None] / scale[None, :], moment / scale

    def cost_of(active: Array) -> Array:
        t, pivots = _solve_active(scaled, target, active)
        regular = jnp.all(pivots > 10 * p * jnp.finfo(pivots.dtype).eps)
        return jnp.where(regular & jnp.all(t >= 0), t @ scaled @ t - 2 * (target @ t), jnp.inf)

    sets = jnp.asarray(_subsets(p))
    # Only the chosen set is differentiated: the singular ones would turn every derivative into NaN.
    active = sets[jnp.argmin(jax.lax.stop_gradient(jax.vmap(cost_of)(sets)))]
    t, _ = _solve_active(scaled, target, active)
    t = jnp.where(active & (t >= 0), t, 0)  # the batched solve above rounds differently
    t = jnp.where(jnp.all(jnp.isfinite(gram)) & jnp.all(jnp.isfinite(moment)), t, jnp.nan)
    return Nonnegative(t / scale, active, t @ scaled @ t - 2 * (target @ t))
