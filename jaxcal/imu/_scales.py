"""Sizes of the errors, from noise coefficients where they are known and from the residuals (host, NumPy)."""

from typing import Any

import numpy as np
import scipy.optimize
import scipy.stats

from .._errors import DataError

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


def whitening(
    turn: np.ndarray, vertical: np.ndarray, tangent: np.ndarray, rotation: np.ndarray, first: np.ndarray, valid: np.ndarray
) -> np.ndarray:
    """Inverse Cholesky factor (2s, 2s) of the covariance of the turns' residuals.

    Parameters
    ----------
    turn : (s,) variance of what the gyroscope adds, rad^2. vertical : (k,) variance of a pose's vertical, rad^2.
    tangent : (s, 3, 2). rotation : (s, 3, 3) from the axes after a turn to those before it. first : (s,) pose before.
    valid : (s,) bool; rows of the others are zero.

    The vertical of a pose closes one turn and opens the next, so that neighbours share its error.
    """
    count = len(turn)
    covariance = np.zeros((count, 2, count, 2))
    for i in range(count):
        covariance[i, :, i, :] = np.eye(2) * (turn[i] + vertical[first[i]] + vertical[first[i] + 1]) if valid[i] else np.eye(2)
        if i + 1 < count and valid[i] and valid[i + 1] and first[i + 1] == first[i] + 1:
            cross = -vertical[first[i + 1]] * tangent[i].T @ rotation[i + 1] @ tangent[i + 1]
            covariance[i, :, i + 1, :], covariance[i + 1, :, i, :] = cross, cross.T
    factor = np.linalg.cholesky(covariance.reshape(2 * count, 2 * count))
    inverse = np.linalg.inv(factor)
    keep = np.repeat(valid, 2)
    return np.where(keep[:, None] & keep[None, :], inverse, 0.0)


def tangents(vertical: np.ndarray) -> np.ndarray:
    """Two unit vectors across each vertical, (s, 3, 2)."""
    aside = np.eye(3)[np.argmin(np.abs(vertical), axis=1)]
    right = np.cross(vertical, aside)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(vertical, right)], axis=2)
