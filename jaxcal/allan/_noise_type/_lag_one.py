"""Lag-1 autocorrelation of a series less its straight line, from six sums over the series as it is.

With residuals :math:`e_i = z_i - a - b t_i`, t counted from the middle, every sum over e expands into sums over z and t z, the
squares, the products of neighbours, and the two ends. One pass takes the place of twenty; where the line holds nearly all of the
squares, the digits are lost and the residuals have to be formed.
"""

import numpy as np

from ..._types import Any, Float
from ._segments import Segments, followed

_LOST = 1e-6  # share of the squares that must be left, for nine digits of r1


def moments_of(z: Float[np.ndarray, " points"], series: Segments) -> Float[np.ndarray, "series 6"]:
    """Sums of z, of t z, of z^2, of neighbours' products, and the first and last z, of each series."""
    index = np.arange(float(len(z)))
    middle = series.starts + (series.points - 1) / 2.0
    sums = series.sums(z)
    products = series.shorter().sums(followed(z, np))
    ends = z[series.starts], z[series.starts + series.points - 1]
    return np.stack([sums, series.sums(index * z) - middle * sums, series.sums(z * z), products, *ends], axis=1)


def moments_of_rows(z: Float[np.ndarray, "series points"]) -> Float[np.ndarray, "series 6"]:
    """The same of series of one length, a row each."""
    time = np.arange(float(z.shape[1])) - (z.shape[1] - 1) / 2.0
    return np.stack([z.sum(axis=1), z @ time, np.vecdot(z, z), np.vecdot(z[:, 1:], z[:, :-1]), z[:, 0], z[:, -1]], axis=1)


def lag_one(moments: Float[np.ndarray, "series 6"], count: Any) -> tuple[np.ndarray, np.ndarray]:
    """The autocorrelation of each series of `count` points, and where it has lost its digits."""
    total, slope, square, product, first, last = moments.T
    n = count.astype(np.float64)
    spread = n * (n**2 - 1.0) / 12.0
    a, b = total / n, slope / spread
    low, high = a - b * (n - 1.0) / 2.0, a + b * (n - 1.0) / 2.0  # the line at both ends
    line = n * a**2 + b**2 * spread
    left = square - line
    crossed = 2.0 * (a * total + b * slope) - last * (high + b) - first * (low - b)
    pairs = product - crossed + line - high**2 + b * (n * a - high)
    lost = ~(left > _LOST * square)
    return pairs * (n / (n - 1.0)) / np.where(lost, 1.0, left), lost
