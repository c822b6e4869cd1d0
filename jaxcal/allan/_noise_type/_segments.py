"""Many series of different lengths, joined end to end in one array, so that a handful of operations serves all of them."""

import functools

import numpy as np

from ..._types import Any, Float

_LOST = 1e-6  # smallest share of the squares that must remain, for nine digits of r1


class Segments:
    """Positions of the series in the array; the last `less` points of each series are not used.

    Differencing the whole array differences every series, and makes the last point of each invalid; `shorter` leaves it out.
    """

    def __init__(self, lengths: np.ndarray, less: int = 0):
        self.lengths, self.less = lengths, less
        self.stops = np.cumsum(lengths)
        self.starts = self.stops - lengths

    @property
    def points(self) -> np.ndarray:
        """Number of used points of each series."""
        return self.lengths - self.less

    @functools.cached_property
    def shorter(self) -> "Segments":
        """The same series without their last points."""
        return Segments(self.lengths, self.less + 1)

    def sums(self, values: Any) -> Any:
        """Sum over each series, (series,)."""
        return np.add.reduceat(values, self._edges)[::2]

    def spread(self, each: Any) -> Any:
        """One value per series, repeated for all its points."""
        return np.repeat(each, self.lengths)

    @functools.cached_property
    def _edges(self) -> np.ndarray:
        """Begin and end of each series in turn; sums between an end and the next begin are not used."""
        edges = np.empty(2 * len(self.lengths), dtype=np.int64)
        edges[::2], edges[1::2] = self.starts, self.stops - self.less
        return edges if self.less else edges[:-1]  # the end of the array cannot begin a sum

    def time(self) -> np.ndarray:
        """Position of each point, counted from the middle of its series."""
        return np.arange(float(self.stops[-1])) - np.repeat(self.starts + (self.points - 1) / 2.0, self.lengths)


def steps(values: np.ndarray) -> np.ndarray:
    """Difference from each point of the array to the next; 0 for the last point."""
    out = np.empty_like(values)
    np.subtract(values[1:], values[:-1], out=out[:-1])
    out[-1:] = 0
    return out


def followed(values: np.ndarray) -> np.ndarray:
    """Product of each point of the array with the next; 0 for the last point."""
    out = np.empty_like(values)
    np.multiply(values[1:], values[:-1], out=out[:-1])
    out[-1:] = 0
    return out


def moments_of(parts: list[np.ndarray], series: Segments) -> tuple[np.ndarray, Float[np.ndarray, "6 series"]]:
    """Differences z of each series of phase points, and sums of z, of t z, of z^2, of neighbours' products, first and last z.

    A 0 follows the last z of each series, so that the series of z have the positions of those of the points. The first two sums telescope.
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
    """Lag-1 autocorrelation of each series of `count` points minus its straight line, and whether it has lost its digits.

    With residuals :math:`e_i = z_i - a - b t_i`, t counted from the middle, every sum over e expands into the moments. One pass replaces
    twenty. If the line contains nearly all of the squares, the residuals must be formed.
    """
    total, slope, square, product, first, last = moments
    n = count.astype(np.float64)
    a, b = total / n, slope / (n * (n * n - 1.0) / 12.0)
    rise = b * ((n - 1.0) / 2.0)
    low, high = a - rise, a + rise  # values of the line at both ends
    line = a * total + b * slope
    left = square - line
    pairs = product - line + b * total + (last - high) * (high + b) + first * (low - b)
    lost = ~(left > _LOST * square)
    return pairs * (n / (n - 1.0)) / np.where(lost, 1.0, left), lost
