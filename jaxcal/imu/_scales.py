"""Sizes of the errors, from noise coefficients where they are known and from the residuals (host, NumPy)."""

from typing import Any

import numpy as np
import scipy.optimize
import scipy.stats

from .._errors import DataError
from ..fitting import Fit

_CLIP = 2.5
_KEPT = float(scipy.stats.chi2.cdf(_CLIP**2, 3) + _CLIP**2 * scipy.stats.chi2.sf(_CLIP**2, 1))


def excess(residual: np.ndarray, base: np.ndarray, parameters: Any) -> float:
    """Variance to add to `base` so that the residuals, those beyond 2.5 standard deviations cut, have the size it says.

    Each of n residuals counts for 1 - p/n, because the fit took p of them.
    """
    residual, base = np.ravel(residual), np.ravel(base)
    freedom = max(len(residual) - parameters, 1.0)

    def surplus(extra: float) -> float:
        return float(np.sum(np.minimum(residual**2 / (base + extra), _CLIP**2)) / _KEPT - freedom)

    top = float(np.sum(residual**2))
    floor = 1e-16 * top + 1e-300
    if surplus(floor) <= 0:
        return floor if not np.all(base > 0) else 0.0
    return float(scipy.optimize.brentq(surplus, floor, max(2 * top, 2 * floor), xtol=1e-18 * top, rtol=1e-10))  # type: ignore[arg-type]


def coefficients(noise: Any, sensor: str) -> tuple[float, float]:
    """White noise N and flicker B of a sensor, largest axis, in SI; zero where nothing is known."""
    if noise is None:
        return 0.0, 0.0
    if not hasattr(noise, "get") and not hasattr(noise, sensor):
        raise DataError('noise must be {"accel": ..., "gyro": ...} with a Noise, or a dictionary of N and B, for each sensor')
    one = noise.get(sensor) if hasattr(noise, "get") else getattr(noise, sensor)
    if one is None:
        return 0.0, 0.0
    found = []
    for term in ("N", "B"):
        value = one.get(term, 0.0) if hasattr(one, "get") else getattr(one, term, 0.0)
        size = float(np.max(np.nan_to_num(np.asarray(0.0 if value is None else value, dtype=float))))
        if not (np.isfinite(size) and size >= 0):
            raise DataError(f"noise of {sensor}: {term} is {value!r}; expected a number that is not negative")
        found.append(size)
    return found[0], found[1]


def mean_variance(noise: tuple[float, float], duration: np.ndarray) -> np.ndarray:
    """Variance of a mean over so many seconds: N^2/t, and the flat part of the Allan variance."""
    white, flicker = noise
    return white**2 / duration + 2 * np.log(2) / np.pi * flicker**2


def _hat(fit: Fit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Orthonormal rows q of the weighted Jacobian, the inverse of its triangle in units of the parameters, and the weighted residuals."""
    root = np.sqrt(np.asarray(fit.weights))
    jacobian = np.asarray(fit.jacobian) * root[:, None]
    size = np.linalg.norm(jacobian, axis=0)
    size = np.where(size > 0, size, 1)
    q, r = np.linalg.qr(jacobian / size)
    return q, np.linalg.pinv(r) / size[:, None], np.asarray(fit.residuals) * root


def leverage(fit: Fit) -> np.ndarray:
    """(n,) diagonal of the hat matrix: what each residual pays for the parameters."""
    return np.sum(_hat(fit)[0] ** 2, axis=1)


def sandwich(fit: Fit, clusters: np.ndarray) -> np.ndarray:
    """Cluster-robust covariance whose clusters are freed of their own leverage, which a fit of few clusters needs.

    R. M. Bell and D. F. McCaffrey, Survey Methodology 28 (2002) 169: residuals of a cluster times (1 - H)^-1/2, H its part of the
    hat matrix; unbiased where the errors are alike.
    """
    q, inverse, residual = _hat(fit)
    counted = np.asarray(fit.counted)
    meat = np.zeros((q.shape[1],) * 2)
    for label in np.unique(clusters):
        rows = np.flatnonzero((clusters == label) & counted)
        if len(rows):
            part = q[rows]
            values, vectors = np.linalg.eigh(np.eye(len(rows)) - part @ part.T)
            score = part.T @ (vectors @ ((vectors.T @ residual[rows]) / np.sqrt(np.maximum(values, 1e-6))))
            meat += np.outer(score, score)
    return inverse @ meat @ inverse.T
