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
