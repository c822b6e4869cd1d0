"""Find what neighbouring residuals of a log have in common: a field magnitude that varies, or an offset that moves."""

from typing import NamedTuple

import numpy as np

_TURNING = 12  # number of lags at which products of residuals are examined
_CLOSE = range(3, 7)  # lags of close neighbours
_ALONE = 4.0  # ratio of the variance along one direction to that across it


class Shared(NamedTuple):
    """What neighbouring residuals have in common.

    alone : (3,) standard deviation of an offset along the one direction in which it varies, as with a current; None if there is none.
    swing : standard deviation, along any direction, of an offset that would explain what neighbours share.
    """

    alone: np.ndarray | None
    swing: float


def shared(residuals: np.ndarray, normals: np.ndarray) -> Shared:
    """Fit products of residuals at some lags: a variance of the magnitude, plus n'Sn of their normals with an offset's covariance S."""
    n = len(residuals)
    lags = np.unique(np.round(np.geomspace(1, max(n // _TURNING, 2), _TURNING)).astype(int))
    first, second = (np.concatenate([part(k) for k in lags]) for part in (lambda k: normals[k:], lambda k: normals[:-k]))
    products = np.concatenate([residuals[k:] * residuals[:-k] for k in lags])
    norm, offset = np.linalg.lstsq(np.stack([np.ones(len(first)), np.sum(first * second, axis=1)], axis=1), products, rcond=None)[0]
    # use close neighbours, which have most in common, but not the closest, because a log may repeat readings
    near = np.concatenate([residuals[k:] * residuals[:-k] for k in _CLOSE])
    turned = np.concatenate([np.sum(normals[k:] * normals[:-k], axis=1) for k in _CLOSE])
    swing = float(np.sqrt(max(np.sum(turned * near) / max(np.sum(turned**2), 1e-300), 0.0)))
    if norm > offset:
        return Shared(None, swing)
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    columns = [first[:, i] * second[:, j] + (i != j) * first[:, j] * second[:, i] for i, j in pairs]
    entries = np.linalg.lstsq(np.stack([np.ones(len(first)), *columns], axis=1), products, rcond=None)[0][1:]
    matrix = np.zeros((3, 3))
    for (i, j), value in zip(pairs, entries, strict=True):
        matrix[i, j] = matrix[j, i] = value
    values, vectors = np.linalg.eigh(matrix)
    if not values[2] > _ALONE * np.abs(values[:2]).max():
        return Shared(None, swing)
    along = normals @ vectors[:, 2]
    cosines = np.concatenate([along[k:] * along[:-k] for k in _CLOSE])
    variance = np.sum(cosines * near) / max(np.sum(cosines**2), 1e-300)
    return Shared(vectors[:, 2] * np.sqrt(max(variance, 0.0)), swing)
