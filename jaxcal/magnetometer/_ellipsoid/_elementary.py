"""Min/max and axis-aligned scaling: the thesis's methods, corrected (host, NumPy)."""

import numpy as np

from .._design._coverage import bins
from ._algebraic import NOT_ELLIPSOID, NotEllipsoid


def minmax(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre and semi-axes along x, y and z from the extremes (thesis 6.1 to 6.4)."""
    low, high = u.min(axis=0), u.max(axis=0)
    return _diagonal((high - low) / 2), (high + low) / 2


def axes(u: np.ndarray, vectors: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Rotate to the principal axes, divide by the semi-axes, rotate back (thesis 6.5 to 6.9; it stops before the last step).

    The rotation is that of the covariance's eigenvectors: the thesis's plane angles are these where one plane alone is tilted.
    Every direction counts the same, however many readings it has: uneven chance alone turns the axes of 4000 readings by degrees.
    Other axes can be given as the columns of `vectors`.
    """
    centre = (u.max(axis=0) + u.min(axis=0)) / 2
    z = u - centre
    if vectors is None:
        cell = bins(z / np.maximum(np.linalg.norm(z, axis=1, keepdims=True), 1e-300))
        vectors = np.linalg.eigh(z.T @ (z / np.bincount(cell)[cell][:, None]))[1]
    turned = z @ vectors
    return vectors @ _diagonal((turned.max(axis=0) - turned.min(axis=0)) / 2) @ vectors.T, centre


def _diagonal(radii: np.ndarray) -> np.ndarray:
    if not radii.min() > 0:
        raise NotEllipsoid(NOT_ELLIPSOID.format("flat one: the readings do not vary along one axis"))
    return np.diag(1 / radii**2)
