"""Rank, covariance and leverage of the parameters, from one decomposition of a Jacobian."""

import equinox as eqx
import jax
import numpy as np

from .._frozen import made
from .._precision import array_module
from .._types import AnyArray, Value


class Information(eqx.Module):
    """Information about the parameters in residuals with standard deviation one and Jacobian J = U S V' D, D the column lengths.

    Attributes
    ----------
    singular_values : (p,) of the Jacobian with columns of unit length, largest first; zero where they are below the tolerance.
    vectors : (p, p) rows of V', the combinations of the parameters that belong to the singular values, in units of 1 / `column`.
    triangle : (p, p) factor R of the Jacobian with columns of unit length.
    column : (p,) lengths of the columns (one if a column is zero).
    held : (p,) parameters that count as fixed, such as parameters at a bound.
    names : the parameters in order.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.fitting import information
    >>> known = information(np.array([[1.0, 2.0], [2.0, 4.0]]), names=("scale", "gain"))
    >>> int(known.rank), known.sentence[:73]
    (1, 'The data determine 1 of 2 parameters and cannot tell apart scale, gain; h')
    """

    singular_values: AnyArray
    vectors: AnyArray
    triangle: AnyArray
    column: AnyArray
    held: AnyArray
    names: tuple[str, ...] = eqx.field(static=True, default=())

    @property
    def rank(self) -> Value:
        """Number of combinations of the free parameters that the data determine."""
        xp = array_module(self.singular_values)
        return xp.sum(self.singular_values > 0) - xp.sum(self.held)

    @property
    def condition(self) -> Value:
        """Largest singular value over the smallest: an upper bound on the inflation of the weakest combination's standard error."""
        xp, s = array_module(self.singular_values), self.singular_values
        return xp.where(s[-1] > 0, s[0] / xp.where(s[-1] > 0, s[-1], 1), xp.inf)

    @property
    def determined(self) -> AnyArray:
        """(p,) False for parameters that take part in an undetermined combination; True for held ones."""
        xp, s = array_module(self.singular_values), self.singular_values
        return 1 - xp.sum(xp.where(s[:, None] > 0, self.vectors, 0) ** 2, axis=0) < xp.finfo(s.dtype).eps ** 0.75

    @property
    def root(self) -> AnyArray:
        """(p, p) matrix A with A A' = (J'J)^-1, or the pseudo-inverse if the rank is not full; zero rows for held parameters."""
        xp, s = array_module(self.triangle), self.singular_values
        # The triangle has a derivative even where singular values are equal; the singular vectors do not.
        regular = xp.linalg.inv(xp.where(s[-1] > 0, self.triangle, xp.eye(s.size, dtype=s.dtype)))
        singular = self.vectors.T * xp.where(s > 0, 1 / xp.where(s > 0, s, 1), 0)[None, :]
        return xp.where(self.held[:, None], 0, xp.where(s[-1] > 0, regular, singular) / self.column[:, None])

    @property
    def covariance(self) -> AnyArray:
        """(p, p) inverse of J'J: zero for held parameters, infinite variance for undetermined ones."""
        xp, root, lost = array_module(self.singular_values), self.root, ~self.determined
        infinite = xp.where(xp.eye(len(lost), dtype=bool), xp.inf, 0)
        return xp.where(lost[:, None] | lost[None, :], infinite, root @ root.T).astype(root.dtype)

    def leverage(self, rows: AnyArray) -> AnyArray:
        """(n,) share of each row in its own prediction, diag(J (J'J)^-1 J'); the shares of all rows sum to the rank."""
        return ((rows @ self.root) ** 2).sum(axis=1)

    @property
    def weakest(self) -> tuple[str, ...]:
        """Names of the parameters that make up the combination that the data determine least (host only)."""
        share = np.abs(np.asarray(self.vectors[-1]))  # in units of the effect of each parameter on the residuals
        return tuple(name for name, part in zip(self.names, share, strict=True) if part > 0.3 * share.max())

    @property
    def sentence(self) -> str:
        """A sentence: how many parameters the data determine, and the weakest combination by name (host only)."""
        count = len(self.names) - int(np.sum(self.held))
        weakest, one = ", ".join(self.weakest), len(self.weakest) == 1
        if int(self.rank) == count:
            only = f"the least certain is {weakest}" if one else f"the least certain combination is that of {weakest}"
            return f"The data determine all {count} parameters (condition number {float(self.condition):.3g}); {only}."
        return f"The data determine {int(self.rank)} of {count} parameters and " + (
            f"say nothing about {weakest}; hold it fixed, add a prior, or record data that move it."
            if one
            else f"cannot tell apart {weakest}; hold one of them fixed, add a prior, or record data in which they act differently."
        )


def information(
    jacobian: AnyArray, *, held: AnyArray | None = None, tolerance: float | None = None, names: tuple[str, ...] = ()
) -> Information:
    """Rank, covariance and leverage of the parameters from the Jacobian of whitened residuals.

    The columns are scaled to unit length, so that the units of the parameters do not matter. The normal equations are not formed, because
    they would square the condition number. Outside of a trace, NumPy does the work and nothing is compiled.

    Parameters
    ----------
    jacobian
        (n, p) derivative of residuals with standard deviation one. Priors may add rows like any others; entries that are not finite
        count as zero.
    held
        (p,) True for parameters that are fixed; by default none.
    tolerance
        Singular values below it, with columns of unit length, count as zero; by default 10 p times the rounding error.
    names
        Names of the parameters, for `Information.sentence`.

    Returns
    -------
    Information

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.fitting import information
    >>> known = information(np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]]))
    >>> print(int(known.rank), known.covariance.diagonal().round(3))
    2 [0.833 0.5  ]
    """
    xp = array_module(jacobian, held)
    p = jacobian.shape[1]
    fixed = xp.zeros(p, dtype=bool) if held is None else held
    rows = xp.where(fixed[None, :] | ~xp.isfinite(jacobian), 0, jacobian)
    column = xp.linalg.norm(rows, axis=0)
    column = xp.where(column > 0, column, 1)
    # replace a held column by one that is orthogonal to all others
    triangle = xp.linalg.qr(xp.concatenate([rows / column[None, :], xp.diag(fixed.astype(rows.dtype))]), mode="r")
    _, s, vectors = xp.linalg.svd(triangle)
    floor = 10 * p * xp.finfo(s.dtype).eps if tolerance is None else tolerance
    vectors = vectors if xp is np else jax.lax.stop_gradient(vectors)
    values = xp.where(s > floor, s, 0)
    return made(Information, singular_values=values, vectors=vectors, triangle=triangle, column=column, held=fixed, names=names)


def symmetric_inverse(matrix: AnyArray) -> np.ndarray:
    """Pseudo-inverse of a positive matrix: `numpy.linalg.pinv(matrix, hermitian=True)` in a third of the time."""
    values, vectors = np.linalg.eigh(matrix)
    kept = values > 1e-15 * values[-1]
    return (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
