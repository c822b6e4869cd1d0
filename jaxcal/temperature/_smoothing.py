r"""Cubic smoothing spline with the smoothing parameter of generalised cross-validation, O(n).

.. math:: \min_f \sum_j c_j (b_j - f(T_j))^2 + \lambda \int (f'')^2,\qquad
    \mathrm{GCV}(\lambda) = \frac{n \sum_j c_j (b_j - f_j)^2}{(n - \mathrm{tr} H)^2}

With Reinsch's band matrices, f'' = gamma at the inner knots solves (R + lambda Q' C^-1 Q) gamma = Q' b, and f = b - lambda C^-1 Q gamma.
C. H. Reinsch, Numer. Math. 10 (1967) 177; the trace from the band of the inverse: M. F. Hutchinson and F. R. de Hoog, Numer. Math. 47
(1985) 99; GCV: P. Craven and G. Wahba, Numer. Math. 31 (1979) 377. `scipy.interpolate.make_smoothing_spline` searches lambda on a
linear scale between 0 and n, and misses minima far below 1.
"""

import numpy as np
from scipy.linalg import solveh_banded

from .._types import AnyArray
from ._curves import Piecewise
from ._record import Bins

_GRID = 33  # values of lambda tried at once


class _Bands:
    """Reinsch's matrices of one set of knots, each as (3, n - 2): diagonal, first and second off-diagonal."""

    def __init__(self, bins: Bins):
        h = np.diff(bins.t)
        inner = len(h) - 1
        self.h, self.c, self.b = h, bins.count / np.mean(bins.count), bins.b
        up, down = 1 / h[:-1], 1 / h[1:]
        self.q = np.stack([up, -up - down, down])  # rows k, k + 1, k + 2 of column k
        self.second = self._transposed(bins.b)
        self.r, self.a = np.zeros((3, inner)), np.zeros((3, inner))
        self.r[0], self.r[1, : inner - 1] = (h[:-1] + h[1:]) / 3, h[1:-1] / 6
        v = 1 / self.c
        for offset in range(3):
            for i in range(3 - offset):
                size = inner - offset
                self.a[offset, :size] += self.q[i + offset, :size] * self.q[i, offset:] * v[i + offset : i + offset + size]

    def _transposed(self, y: AnyArray) -> AnyArray:
        return self.q[0] * y[:-2] + self.q[1] * y[1:-1] + self.q[2] * y[2:]

    def _times(self, gamma: AnyArray) -> AnyArray:
        total = np.zeros((len(self.c), *gamma.shape[1:]))
        for i in range(3):
            total[i : i + len(gamma)] += self.q[i].reshape(-1, *[1] * (gamma.ndim - 1)) * gamma
        return total

    def smooth(self, lam: float) -> tuple[AnyArray, AnyArray]:
        """Values at the knots, and second derivatives at the inner ones."""
        gamma = solveh_banded(self.r + lam * self.a, self.second, lower=True)
        return self.b - lam * self._times(gamma) / self.c, gamma

    def matrix(self, lam: float) -> AnyArray:
        """H, (n, n): values at the knots for unit data."""
        eye = np.eye(len(self.c))
        rows = self.q[0][:, None] * eye[:-2] + self.q[1][:, None] * eye[1:-1] + self.q[2][:, None] * eye[2:]
        return eye - lam * self._times(solveh_banded(self.r + lam * self.a, rows, lower=True)) / self.c[:, None]

    def scores(self, lam: AnyArray) -> AnyArray:
        """GCV for several lambda at once: one pass down and one up the band for all of them."""
        size, count = self.a.shape[1], len(lam)
        band = self.r[:, :, None] + lam * self.a[:, :, None]
        d, l1, l2 = (np.zeros((size + 2, count)) for _ in range(3))
        z = np.zeros((size + 2, count))
        for k in range(size):  # band = L D L'; l1, l2 of row k stand left of its diagonal
            l2[k] = band[2, k - 2] / d[k - 2] if k > 1 else 0.0
            l1[k] = (band[1, k - 1] - l2[k] * d[k - 2] * l1[k - 1]) / d[k - 1] if k > 0 else 0.0
            d[k] = band[0, k] - l1[k] ** 2 * d[k - 1] - l2[k] ** 2 * d[k - 2]
            z[k] = self.second[k] - l1[k] * z[k - 1] - l2[k] * z[k - 2]
        gamma, inverse = np.zeros((size + 2, count)), np.zeros((3, size + 2, count))
        trace = np.zeros(count)
        for k in range(size - 1, -1, -1):
            one, two = (l1[k + 1], l2[k + 2]) if k + 2 < size else (l1[k + 1] if k + 1 < size else 0.0, 0.0)
            gamma[k] = z[k] / d[k] - one * gamma[k + 1] - two * gamma[k + 2]
            inverse[1, k] = -one * inverse[0, k + 1] - two * inverse[1, k + 1]
            inverse[2, k] = -one * inverse[1, k + 1] - two * inverse[0, k + 2]
            inverse[0, k] = 1 / d[k] - one * inverse[1, k] - two * inverse[2, k]
            trace += self.a[0, k] * inverse[0, k] + 2 * (self.a[1, k] * inverse[1, k] + self.a[2, k] * inverse[2, k])
        residual = lam * self._times(gamma[:size]) / self.c[:, None]
        return len(self.c) * np.sum(self.c[:, None] * residual**2, axis=0) / (lam * trace) ** 2


def spline_curve(bins: Bins) -> Piecewise:
    """The spline of the lowest GCV."""
    bands, lam = _chosen(bins)
    value, gamma = bands.smooth(lam)
    gamma, h = np.concatenate([[0.0], gamma, [0.0]]), bands.h
    slope = np.diff(value) / h - h * (2 * gamma[:-1] + gamma[1:]) / 6
    cubic = np.stack([value[:-1], slope, gamma[:-1] / 2, np.diff(gamma) / (6 * h)], axis=1)
    return Piecewise(bins.t, cubic)


def smoother(bins: Bins) -> AnyArray:
    """H at the chosen lambda, (n, n)."""
    bands, lam = _chosen(bins)
    return bands.matrix(lam)


def _chosen(bins: Bins) -> tuple[_Bands, float]:
    bands = _Bands(bins)
    # the scale at which smoothing begins to matter is that of the two matrices; twelve decades about it hold every curve
    centre = np.log(np.sum(bands.r[0]) / np.sum(bands.a[0]))
    grid = centre + np.linspace(-8, 24, _GRID)
    best = int(np.argmin(bands.scores(np.exp(grid))))
    fine = np.linspace(grid[max(best - 1, 0)], grid[min(best + 1, _GRID - 1)], _GRID)
    return bands, float(np.exp(fine[np.argmin(bands.scores(np.exp(fine)))]))
