r"""An Allan variance curve and the linear algebra of its fit: pure functions for `jit`, `vmap` and `grad`.

The exact Allan variances of the terms are the columns of A, so that E v = A theta with theta the squared coefficients, and
the covariance of v is C(theta) = sum_ij theta_i theta_j T_ij (`covariance_tensor`).
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from .._types import Any, Array, Bool, Float
from ..fitting import nonnegative
from ..fitting._positive import solve_positive


class Curve(eqx.Module):
    """An Allan variance curve with what its fit needs.

    v : measured variances. columns : A. tensor : T. share : full count over count of differences, 1 without gaps.
    octave : base-2 logarithm of the cluster size. used : which cluster sizes take part. free : which coefficients are fitted.
    held : values of the others, zero where free.
    """

    v: Float[Array, " clusters"]
    columns: Float[Array, "clusters p"]
    tensor: Float[Array, "p p clusters clusters"]
    share: Float[Array, " clusters"]
    octave: Float[Array, " clusters"]
    used: Bool[Array, " clusters"]
    free: Bool[Array, " p"]
    held: Float[Array, " p"]

    def covariance(self, theta: Float[Array, " p"]) -> Float[Array, "clusters clusters"]:
        """C(theta); gaps leave fewer differences, unused cluster sizes become independent of the rest."""
        loss = jnp.sqrt(self.share)
        pairs = (theta[:, None] * theta[None, :]).ravel()
        # one product of matrices, for a batch of theta too
        c = (pairs @ self.tensor.reshape(len(pairs), -1)).reshape(self.tensor.shape[2:]) * loss[:, None] * loss[None, :]
        return jnp.where(self.used[:, None] & self.used[None, :], c, jnp.diag(jnp.where(self.used, 0.0, 1.0)))

    def variance(self, theta: Float[Array, " p"]) -> Float[Array, " clusters"]:
        """The diagonal of C(theta), which is 2 (A theta)^2 / edf."""
        squares = jnp.diagonal(self.tensor, axis1=2, axis2=3)
        pairs = (theta[:, None] * theta[None, :]).ravel()
        return jnp.where(self.used, (pairs @ squares.reshape(len(pairs), -1)) * self.share, 1.0)

    def only(self, terms) -> "Curve":
        """The curve with the coefficients of the other terms kept where they are held, at zero as a rule."""
        return eqx.tree_at(lambda c: c.free, self, self.free & terms)

    def fixed(self, index, value) -> "Curve":
        """The curve with coefficient `index` held at `value`."""
        here = jnp.arange(self.free.shape[0]) == index
        return eqx.tree_at(lambda c: (c.free, c.held), self, (self.free & ~here, jnp.where(here, value, self.held)))

    def solve(self, gram: Float[Array, "p p"], moment: Float[Array, " p"]) -> Float[Array, " p"]:
        """Coefficients of the normal equations of all columns: free ones least squares and not negative, the others as held."""
        moment = jnp.where(self.free, moment - gram @ self.held, 0.0)
        gram = jnp.where(self.free[:, None] & self.free[None, :], gram, 0.0)
        return self.held + nonnegative(gram, moment).value

    def weighted(self, inverse) -> Float[Array, " p"]:
        """Coefficients of least squares with independent variances 1/`inverse`."""
        rows = self.columns * jnp.where(self.used, inverse, 0.0)[:, None]
        return self.solve(self.columns.T @ rows, rows.T @ self.v)


class Whitened(eqx.Module):
    """Columns and variances of unit covariance: rows (clusters, p), target (clusters,)."""

    rows: Float[Array, "clusters p"]
    target: Float[Array, " clusters"]

    def solve(self, curve: Curve) -> Float[Array, " p"]:
        """Coefficients of least chi-square among those `curve` leaves free."""
        return curve.solve(self.rows.T @ self.rows, self.rows.T @ self.target)

    def solve_each(self, curve: Curve, free, held) -> Float[Array, "sets p"]:
        """The same for several sets of free coefficients, (sets, p), and of values of the others."""
        return jax.vmap(lambda f, h: self.solve(eqx.tree_at(lambda c: (c.free, c.held), curve, (f, h))))(free, held)

    def chi_square(self, theta) -> Float[Array, ""]:
        """(v - A theta)' C^-1 (v - A theta)."""
        return jnp.sum((self.target - self.rows @ theta) ** 2)


def correlation(curve: Curve, at: Float[Array, " p"], extra: Any = 0.0) -> tuple[Array, Array]:
    """Correlation matrix and standard deviations of v, with C taken at theta = `at` (plus independent variances `extra`)."""
    c = curve.covariance(at) + jnp.diag(jnp.where(curve.used, extra, 0.0))
    scale = jnp.sqrt(jnp.diagonal(c))
    scale = jnp.where(scale > 0.0, scale, 1.0)
    # smallest eigenvalues are about 1e-3; the addition keeps them above zero in any precision
    ridge = max(1e-8, 64 * float(jnp.finfo(c.dtype).eps)) * jnp.eye(len(scale), dtype=c.dtype)
    return c / scale[:, None] / scale[None, :] + ridge, scale


def whitened(curve: Curve, at: Float[Array, " p"], extra: Any = 0.0) -> Whitened:
    """A and v of unit covariance (see `correlation`), zero where unused."""
    matrix, scale = correlation(curve, at, extra)
    rows = jnp.concatenate([curve.columns, curve.v[:, None]], axis=1) / scale[:, None]
    rows = forward(matrix, jnp.where(curve.used[:, None], rows, 0.0))
    return Whitened(rows[:, :-1], rows[:, -1])


def forward(matrix, rows):
    """L^-1 rows, with L L' = matrix, by elimination. Batches of LAPACK calls wait for one another for ever (jaxlib 0.10, CPU)."""
    size = matrix.shape[0]

    def eliminate(k, table):
        row = table[k]
        below = jnp.where(jnp.arange(size) > k, table[:, k], 0.0) / row[k]
        return table - below[:, None] * row[None, :]

    table = jax.lax.fori_loop(0, size, eliminate, jnp.concatenate([matrix, rows], axis=1))
    return table[:, size:] / jnp.sqrt(jnp.diagonal(table))[:, None]


def inverse(matrix: Float[Array, "p p"]) -> Float[Array, "p p"]:
    """Inverse of a positive semidefinite matrix whose rows differ by many powers of ten; rows of zeros stay zero."""
    diagonal = jnp.diagonal(matrix)
    there = diagonal > 0.0
    scale = jnp.sqrt(jnp.where(there, diagonal, 1.0))
    unit = matrix / scale[:, None] / scale[None, :] + jnp.diag(jnp.where(there, 0.0, 1.0))
    found = jax.vmap(lambda side: solve_positive(unit, side)[0])(jnp.eye(len(scale), dtype=unit.dtype)) / scale[:, None] / scale[None, :]
    return jnp.where(there[:, None] & there[None, :], found, 0.0)


def chi_square(curve: Curve, at, extra: Any = 0.0) -> Float[Array, ""]:
    """Least (v - A theta)' C^-1 (v - A theta) over theta >= 0, with C at theta = `at`."""
    white = whitened(curve, at, extra)
    return white.chi_square(white.solve(curve))
