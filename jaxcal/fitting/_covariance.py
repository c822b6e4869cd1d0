"""Covariance of fitted parameters: of whitened residuals, of robust losses, and of clustered data."""

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import FitError
from .._precision import array_module, is_traced
from .._types import AnyArray
from ._outcome import Outcome
from ._result import Fit


def covariance(fit: Fit, *, scaled: bool = False, clusters: AnyArray | None = None) -> AnyArray:
    """Covariance of the parameters of a fit.

    Without options the residuals are taken at their word (standard deviation one): C = (J'J)^-1. With `scaled`,
    C = s^2 (J'J)^-1 with s^2 the reduced chi-square. A robust loss is always scaled, and corrected for the finite number of
    residuals (Huber and Ronchetti, Robust Statistics, 2009, section 7.6). With `clusters`, residuals with the same label may be
    correlated and of any variance: C = f B (sum_g s_g s_g') B, where s_g is the sum of the gradients of cluster g, B the inverse
    curvature and f = G/(G-1) (n-1)/(n-p) (A. C. Cameron and D. L. Miller, J. Human Resources 50 (2015) 317, eq. 11-12).

    Parameters
    ----------
    fit
        A fit; a parameter at its bound counts as fixed and has zero covariance.
    scaled
        Multiply by the reduced chi-square: for residuals whose standard deviation was not known.
    clusters
        (n,) label of each residual, in the order of `fit.residuals`.

    Returns
    -------
    (p, p) in the units of the parameters; infinite where the data do not determine every parameter.

    Raises
    ------
    FitError
        For labels that are not one per residual, or fewer clusters than parameters.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.fitting import covariance, solve
    >>> fit = solve(lambda mean, y: (mean - y) / 2, 0.0, jnp.array([1.0, 5.0, 3.0, 3.0]))
    >>> float(covariance(fit)[0, 0].round(6))
    1.0
    """
    bread = _bread(fit)
    if clusters is not None:
        matrix = _sandwich(fit, bread / fit.mean_curvature, clusters)
    elif fit.robust:
        xp = array_module(fit)
        relative = xp.sum(xp.where(fit.counted, (fit.curvature / fit.mean_curvature - 1) ** 2, 0)) / fit.count
        matrix = (1 + fit.free / fit.count * relative) ** 2 * fit.variance * bread
    else:
        matrix = fit.variance * bread if scaled else bread
    return array_module(fit).where(fit.outcome == Outcome.unidentifiable, np.inf, matrix)


def standard_errors(fit: Fit, *, scaled: bool = False, clusters: AnyArray | None = None) -> AnyArray:
    """Square roots of the diagonal of `covariance`, (p,), in the units of the parameters."""
    return array_module(fit).sqrt(array_module(fit).diagonal(covariance(fit, scaled=scaled, clusters=clusters)))


def _bread(fit: Fit) -> AnyArray:
    """Inverse of J'J from the QR factors of J, so that the condition number is not squared; zero for held parameters."""
    xp = array_module(fit)
    jacobian = xp.where(fit.at_bound[None, :], 0, fit.jacobian)
    column = xp.linalg.norm(jacobian, axis=0)
    column = xp.where(column > 0, column, 1)
    triangle = xp.linalg.qr(xp.concatenate([jacobian / column[None, :], xp.diag(fit.at_bound.astype(column.dtype))]), mode="r")
    # a singular factor belongs to a fit that is not identifiable, whose covariance is infinite
    triangle = xp.where(fit.outcome == Outcome.unidentifiable, xp.eye(column.size, dtype=column.dtype), triangle)
    inverse = xp.linalg.inv(triangle) / column[:, None]
    inverse = xp.where(fit.at_bound[:, None], 0, inverse)
    return inverse @ inverse.T


def _sandwich(fit: Fit, bread: AnyArray, clusters: AnyArray) -> AnyArray:
    xp, n = array_module(fit, clusters), fit.residuals.size
    if clusters.shape != fit.residuals.shape:
        raise FitError(f"The cluster labels have shape {clusters.shape}; give one per residual, shape {fit.residuals.shape}.")
    # As many slots as residuals: the number of clusters is data, and empty slots add nothing.
    label = jnp.unique(clusters, return_inverse=True, size=n)[1]
    score = xp.where(fit.at_bound[None, :], 0, fit.jacobian) * (fit.weights * fit.residuals)[:, None]
    total = jax.ops.segment_sum(score, label, num_segments=n)
    groups = jnp.sum(jax.ops.segment_max(fit.counted.astype(jnp.int32), label, num_segments=n) > 0, dtype=bread.dtype)
    if not is_traced(groups) and groups <= fit.free:
        raise FitError(
            f"{int(groups)} clusters cannot give the covariance of {int(fit.free)} parameters; record more, or use finer clusters."
        )
    factor = groups / (groups - 1) * (fit.count - 1) / fit.degrees_of_freedom
    return factor * (bread @ (total.T @ total) @ bread)
