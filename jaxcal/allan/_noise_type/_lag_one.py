"""Lag-1 autocorrelation of a series less its straight line, from six sums over the series as it is.

With residuals :math:`e_i = z_i - a - b t_i`, t counted from the middle, every sum over e expands into sums over z and t z, the
squares, the products of neighbours, and the two ends. One pass takes the place of twenty; where the line holds nearly all of the
squares, the digits are lost and the residuals have to be formed.
"""

import numpy as np

from ..._types import Any, Float
from ._segments import Segments

_LOST = 1e-6  # share of the squares that must be left, for nine digits of r1


def moments_of(parts: list[np.ndarray], series: Segments) -> tuple[np.ndarray, Float[np.ndarray, "6 series"]]:
    """The differences z of each series of phase points, and sums of z, of t z, of z^2, of neighbours' products, first and last z.

    After the last z of a series stands a 0, so that the series of z lie as those of the points. The first two sums telescope.
    """
    held = np.empty((4, series.stops[-1]))
    points, square, product, z = held
    np.concatenate(parts, out=points)
    np.subtract(points[1:], points[:-1], out=z[:-1])
    z[series.stops - 1] = product[-1] = 0.0
    np.multiply(z, z, out=square)
    np.multiply(z[1:], z[:-1], out=product[:-1])
    first, last = points[series.starts], points[series.stops - 1]
    total, square, product = np.add.reduceat(held[:3], series.starts, axis=1)
    slope = series.points / 2.0 * (first + last) - total
    return z, np.array([last - first, slope, square, product, z[series.starts], z[series.stops - 2]])


def lag_one(moments: Float[np.ndarray, "6 series"], count: Any) -> tuple[np.ndarray, np.ndarray]:
    """The autocorrelation of each series of `count` points, and where it has lost its digits."""
    total, slope, square, product, first, last = moments
    n = count.astype(np.float64)
    a, b = total / n, slope / (n * (n * n - 1.0) / 12.0)
    rise = b * ((n - 1.0) / 2.0)
    low, high = a - rise, a + rise  # the line at both ends
    line = a * total + b * slope
    left = square - line
    pairs = product - line + b * total + (last - high) * (high + b) + first * (low - b)
    lost = ~(left > _LOST * square)
    return pairs * (n / (n - 1.0)) / np.where(lost, 1.0, left), lost
