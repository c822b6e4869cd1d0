"""Linear least squares of a triad from known inputs, one axis beside the other (host, NumPy)."""

import equinox as eqx
import numpy as np
import scipy.stats

from .._errors import DataError
from .._types import Any, AnyArray
from ._triad import Triad

_RANK = 1e-8


class TriadFit(eqx.Module):
    """A triad from known inputs.

    Attributes
    ----------
    triad : `Triad`.
    covariance : (p, p) of the parameters named by `names`, in the units of the readings per SI.
    interval : (p, 2) limits of the intervals of 95 %, in the order of `names`.
    residual : (k, 3) readings less the fitted ones.
    sigma : (3,) standard deviation of a mean reading, as given or from the residuals.
    degrees_of_freedom : of the residuals of one axis.
    names : of the parameters: matrix by rows, bias, g-sensitivity by rows where it was fitted.
    warnings : sentences.
    """

    triad: Triad
    covariance: AnyArray
    interval: AnyArray
    residual: AnyArray
    sigma: AnyArray
    degrees_of_freedom: int
    names: tuple[str, ...] = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True)


class Least(eqx.Module):
    """Coefficients (c, 3) of Y = X beta, their covariance (c, c) for readings of variance one, residuals (k, 3)."""

    beta: np.ndarray
    unit: np.ndarray
    residual: np.ndarray


def least_squares(x: np.ndarray, y: np.ndarray, weight: np.ndarray | None = None) -> Least:
    """Weighted least squares by QR of columns of unit length; the columns must be independent."""
    root = np.ones(len(x)) if weight is None else np.sqrt(weight)
    size = np.linalg.norm(x * root[:, None], axis=0)
    q, r = np.linalg.qr(x * root[:, None] / size)
    inverse = np.linalg.inv(r) / size[:, None]
    beta = inverse @ (q.T @ (y * root[:, None]))
    return Least(beta, inverse @ inverse.T, y - x @ beta)


def dependent(x: np.ndarray) -> np.ndarray:
    """Columns, as shares from 0 to 1, that take part in what the rows leave open; none if they are independent."""
    size = np.linalg.norm(x, axis=0)
    values, vectors = np.linalg.svd(x / np.where(size > 0, size, 1), full_matrices=True)[1:]
    values = np.concatenate([values, np.zeros(x.shape[1] - len(values))])
    return np.sqrt(np.sum(vectors[values < _RANK * values[0]] ** 2, axis=0))


def names_of(columns: int) -> tuple[str, ...]:
    """Parameter names, for 4 or 7 columns of an input and a bias."""
    names = [f"matrix[{i},{j}]" for i in range(3) for j in range(3)] + [f"bias[{i}]" for i in range(3)]
    return (*names, *(f"g_sensitivity[{i},{j}]" for i in range(3) for j in range(3) if columns == 7))


def triad_of(x: np.ndarray, y: np.ndarray, sigma: Any, warnings: tuple[str, ...] = (), servo: float = 0.0) -> TriadFit:
    """Fit of columns [input, 1] or [input, 1, specific force]; `sigma` of a mean reading, or None to take it from the residuals."""
    found = least_squares(x, y)
    columns = x.shape[1]
    freedom = len(x) - columns
    if sigma is None:
        if freedom < 1:
            raise DataError(
                f"{len(x)} readings leave nothing to tell their noise from; give sigma=, the standard deviation of a mean reading"
            )
        # one noise for the three axes of a triad: three times the degrees of freedom
        sigma = np.full(3, np.sqrt(np.sum(found.residual**2) / (3 * freedom)))
        quantile = scipy.stats.t.ppf(0.975, 3 * freedom)
    else:
        sigma = np.broadcast_to(np.asarray(sigma, dtype=float), (3,))
        if not (np.isfinite(sigma).all() and (sigma > 0).all()):
            raise DataError(f"sigma={sigma.tolist()} must be positive, in the unit of the readings")
        quantile = scipy.stats.norm.ppf(0.975)
        noise = np.sqrt(np.sum(found.residual**2, axis=0) / max(freedom, 1))
        limit = np.sqrt(scipy.stats.chi2.ppf(0.999, max(freedom, 1)) / max(freedom, 1))
        if freedom > 0 and np.any(noise > limit * sigma):
            warnings = (
                *warnings,
                f"The readings scatter by {np.max(noise / sigma):.2g} times the noise given: levelling, repeatability or the model. The "
                "intervals are too narrow; leave out sigma= to take it from the scatter.",
            )
    # beta holds the input's columns, the bias, the force's: parameter (row i of the triad, column c) -> names
    order = [(c, i) for i in range(3) for c in range(3)] + [(3, i) for i in range(3)]
    order += [(c, i) for i in range(3) for c in range(4, 7)] if columns == 7 else []
    column, axis = np.array(order).T
    covariance = np.where(axis[:, None] == axis[None, :], found.unit[np.ix_(column, column)] * np.outer(sigma[axis], sigma[axis]), 0.0)
    value = found.beta[column, axis]
    scale = np.where(column < 3, value, 0.0)
    covariance = covariance + servo**2 * np.outer(scale, scale)
    half = quantile * np.sqrt(np.diag(covariance))
    triad = Triad(found.beta[:3].T, found.beta[3], found.beta[4:].T if columns == 7 else np.zeros((3, 3)))
    interval = np.stack([value - half, value + half], axis=1)
    return TriadFit(triad, covariance, interval, found.residual, np.asarray(sigma), freedom, names_of(columns), warnings)


def readings_of(values: Any, name: str) -> np.ndarray:
    """(k, 3) finite numbers."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"{name} does not hold numbers; give an array of shape (k, 3)") from error
    if array.ndim != 2 or array.shape[1] != 3 or not len(array):
        raise DataError(f"{name} has shape {array.shape}; expected (k, 3), one row a position")
    if not np.isfinite(array).all():
        raise DataError(f"{name} holds {np.sum(~np.isfinite(array))} values that are not finite; leave those positions out")
    return array
