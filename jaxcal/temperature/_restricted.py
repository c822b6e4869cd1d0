r"""Restricted likelihood of a curve with sensor noise N, B, K, and averages over the uncertainty of the hyperparameters.

The orthonormal DCT-II of each record makes the noise independent: ordinate k has the variance
:math:`S_k = N^2 a_k + B^2 b_k + K^2 c_k`. The mean of the record, which cannot be separated from the noise, drops out. The curve is
linear in its coefficients,

.. math:: b = X \beta + n,\qquad \beta \sim N(0, \sigma^2 F F^T)

with F from `_prior.factor` and a flat prior of the slope. Integration over the coefficients gives the restricted likelihood of the noise
and the variances, which accounts for the degrees of freedom of the curve (H. D. Patterson and R. Thompson, Biometrika 58 (1971) 545).
Ordinates of nearly equal frequency share S. Products of columns are therefore summed once over bands of frequency, and an evaluation of
the likelihood needs no pass over the record.
"""

import functools
import itertools
from typing import Any, NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._types import AnyArray
from ..noise import Noise
from ._prior import DEGREE, LONGEST, SHORTEST, factor

TERMS = ("N", "B", "K")
_BANDS_PER_OCTAVE = 8
#: exponent of a variance in its prior density over the logarithm; limits of the logarithms of the variances below and above their units
_FLAT, _DEEP, _HIGH = 0.2, 25.0, 15.0
#: starts of the search: N^2, B^2, K^2, sigma^2 over their units, and the length
_STARTS = ((1.0, 0.1, 0.01, 0.1, 0.5), (1.0, 1e-3, 1e-5, 0.01, 1.5))
#: importance sampling: draws in the two rounds, degrees of freedom, least curvature, least variance
_DRAWS, _FREEDOM, _FLATTEST, _LEAST = (128, 256), 6, 0.08, 1e-4


class Bands(NamedTuple):
    """Bands of frequency of one or several records.

    sizes : number of samples of each record. dt : sampling interval, s. index : (ordinates,) band of each ordinate, for the concatenated
    records. count : (bands,) number of ordinates. columns : (bands, 3) variance of an ordinate per N^2, B^2, K^2.
    """

    sizes: tuple[int, ...]
    dt: float
    index: AnyArray
    count: AnyArray
    columns: AnyArray

    def transform(self, x: AnyArray) -> AnyArray:
        """Transform columns (samples, ...) to ordinates (ordinates, ...), without the means of the records."""
        edges = np.cumsum((0, *self.sizes))
        return np.concatenate([np.asarray(scipy.fft.dct(x[a:b], norm="ortho", axis=0))[1:] for a, b in itertools.pairwise(edges)])

    def restore(self, ordinates: AnyArray) -> AnyArray:
        """Transform ordinates (ordinates, ...) to columns (samples, ...): the transpose of `transform`."""
        edges = np.cumsum((0, *(n - 1 for n in self.sizes)))
        padded = [np.concatenate([np.zeros((1, *ordinates.shape[1:])), ordinates[a:b]]) for a, b in itertools.pairwise(edges)]
        return np.concatenate([np.asarray(scipy.fft.idct(x, norm="ortho", axis=0)) for x in padded])

    def density(self, theta: AnyArray) -> AnyArray:
        """Variance S of an ordinate in each band, for the squared noise coefficients `theta`."""
        return self.columns @ theta

    def spread(self, gain: AnyArray, theta: AnyArray) -> AnyArray:
        """Covariance of `gain` (m, samples) times the noise; each row of `gain` must cancel the means of the records."""
        ordinates = self.transform(np.asarray(gain).T) * np.sqrt(self.density(theta))[self.index, None]
        return np.asarray(ordinates.T @ ordinates)


@functools.lru_cache(maxsize=64)
def bands(sizes: tuple[int, ...], dt: float) -> Bands:
    """Make the bands for records with the given numbers of samples."""
    index, count, columns, last = [], [], [], 0
    terms = [Noise(**{name: 1.0}).part(name)[2] for name in TERMS]
    for n in sizes:
        k = np.arange(1, n)
        label = np.unique(np.floor(_BANDS_PER_OCTAVE * np.log2(k)), return_inverse=True)[1]
        held = np.bincount(label)
        expected = np.stack([np.asarray(term.ordinates(k, n, dt)) for term in terms], axis=1) / dt
        columns.append(np.stack([np.bincount(label, column) / held for column in expected.T], axis=1))
        index.append(label + last)
        count.append(held)
        last += len(held)
    return Bands(sizes, dt, np.concatenate(index), np.concatenate(count).astype(float), np.concatenate(columns))


class Solved(NamedTuple):
    """Coefficients (p,), their covariance (p, p), and intermediate results for the likelihood."""

    beta: AnyArray
    covariance: AnyArray
    scaled: AnyArray
    factor: AnyArray
    gram: AnyArray
    density: AnyArray
    misfit: float


class Averaged(NamedTuple):
    """Coefficients (p,) and their covariance (p, p), and draws (m, 3) of N^2, B^2, K^2 with their weights (m,)."""

    beta: AnyArray
    covariance: AnyArray
    theta: AnyArray
    weight: AnyArray

    @property
    def noise(self) -> Noise:
        """Noise with the mean of each coefficient over the draws."""
        return Noise(**dict(zip(TERMS, (self.weight @ np.sqrt(self.theta)).tolist(), strict=True)))

    def quantile(self, variance: AnyArray, confidence: float) -> AnyArray:
        """Standard deviation s for which +-z s holds the mixture of normals with variances (m, ...) with probability `confidence`.

        The mean variance would give too wide an interval, because K has a long tail.
        """
        tail = scipy.special.ndtri(0.5 + confidence / 2)
        spread = np.sqrt(np.maximum(variance, np.finfo(float).tiny))
        low, high = spread.min(axis=0), spread.max(axis=0)
        for _ in range(40):
            middle = (low + high) / 2
            inside = np.tensordot(self.weight, 2 * scipy.special.ndtr(tail * middle / spread) - 1, 1)
            low, high = np.where(inside < confidence, middle, low), np.where(inside < confidence, high, middle)
        return np.asarray(high)


class Restricted:
    """Restricted likelihood of one design.

    Parameters
    ----------
    held : the bands.
    design : (ordinates, p) transformed columns, those of the curve first. The others have no prior and no part in the determinant: their
        parameters are profiled, so that designs with different numbers of them can be compared.
    y : (ordinates,) transformed readings.
    least : rounding noise of a reading.
    doubtful : True if columns may be linearly dependent.

    The hyperparameters phi are the logarithms of N^2, B^2, K^2, sigma^2 and of the length.
    """

    def __init__(self, held: Bands, design: AnyArray, y: AnyArray, *, least: float = 1e-150, doubtful: bool = False):
        self.held, self.doubtful, self.size, self.least = held, doubtful, design.shape[1], least
        whole = np.column_stack([design, y])
        edges = np.concatenate([[0], np.flatnonzero(np.diff(held.index)) + 1, [len(held.index)]])
        products = np.stack([whole[a:b].T @ whole[a:b] for a, b in itertools.pairwise(edges)])
        self.products = products.reshape(len(products), -1)
        self.total = products[:, -1, -1]
        # columns with a prior: all but the slope of the curve and the profiled columns
        self.random = np.isin(np.arange(self.size), np.arange(1, DEGREE))

    def solved(self, phi: AnyArray) -> Solved:
        """Coefficients for given hyperparameters."""
        density = self.held.density(np.exp(phi[:3]))
        gram = ((1 / density) @ self.products).reshape(self.size + 1, -1)
        whole = np.diag(1 / np.sqrt(np.maximum(np.diag(gram)[:-1], np.finfo(float).tiny)))
        whole[1:DEGREE, :DEGREE] = np.exp(0.5 * phi[3]) * factor(float(phi[4]))[0][1:]
        scaled = whole.T @ gram[:-1, :-1] @ whole + np.diag(self.random.astype(float))
        inverse = np.linalg.pinv(scaled, rcond=1e-13, hermitian=True) if self.doubtful else np.linalg.inv(scaled)
        right = whole.T @ gram[:-1, -1]
        z = inverse @ right
        return Solved(whole @ z, whole @ inverse @ whole.T, scaled, whole, gram, density, float(gram[-1, -1] - right @ z))

    def cost(self, phi: AnyArray) -> tuple[float, AnyArray]:
        """-2 log restricted likelihood, and its gradient."""
        at, curve = self.solved(phi), DEGREE
        random, whole = self.random[:curve], at.factor[:curve, :curve]
        root = np.linalg.cholesky(at.scaled[:curve, :curve])
        half = scipy.linalg.solve_triangular(root, np.eye(curve), lower=True)
        inverse = half.T @ half
        value = np.sum(self.held.count * np.log(at.density)) + 2 * np.sum(np.log(np.diag(root))) + at.misfit
        value -= 2 * np.sum(np.log(np.diag(whole)[~random]))
        rest = np.append(-at.beta, 1.0)
        share = np.outer(rest, rest)
        share[:curve, :curve] += whole @ inverse @ whole.T
        slope = self.held.count / at.density - self.products @ share.ravel() / at.density**2
        z = scipy.linalg.solve_triangular(whole, at.beta[:curve], lower=True)
        size = np.sum(np.where(random, 1 - np.diag(inverse) - z**2, 0.0))
        # derivative of the factor by the length; the slope without prior does not depend on it
        change = np.where(random[:, None], np.exp(0.5 * phi[3]) * factor(float(phi[4]))[1], 0.0)
        length = 2 * np.sum((inverse @ whole.T @ at.gram[:curve, :curve]).T * change) - 2 * (change @ z) @ (at.gram[:curve] @ rest)
        return value, np.concatenate([(self.held.columns.T @ slope) * np.exp(phi[:3]), [size, length]])

    def posterior(self, phi: AnyArray) -> tuple[float, AnyArray]:
        r"""-log posterior density of the hyperparameters, and its gradient.

        The prior of every standard deviation s is :math:`s^{-0.6}`, because a prior flat in s allows too large a K, and one flat in log s
        is improper towards 0. The prior of the logarithm of the length is normal in
        the middle of its range, with the standard deviation 1.
        """
        value, gradient = self.cost(phi)
        slope = np.full(len(phi), -_FLAT)
        slope[4] = 0.0
        off = np.eye(len(phi))[4] * (phi[4] - 0.5 * np.log(SHORTEST * LONGEST))
        return 0.5 * value + slope @ phi + 0.5 * off @ off, 0.5 * gradient + slope + off

    def bounds(self) -> tuple[AnyArray, AnyArray, AnyArray]:
        """Logarithms of the units of the hyperparameters, and their lower and upper bounds."""
        level = np.maximum(self.total / self.held.count, self.least**2)
        quick = np.argsort(self.held.columns[:, 2])[: max(len(level) // 4, 1)]
        white = float(np.median(level[quick] / self.held.columns[quick, 0]))
        last = self.held.columns[np.argmin(self.held.columns[:, 2])]
        curve = float(np.average(level, weights=self.held.count))
        unit = np.log(np.array([white, *(white * last[0] / last[1:]), curve, 1.0]))
        low, high = unit - _DEEP, unit + _HIGH
        low[4], high[4] = np.log(SHORTEST), np.log(LONGEST)
        return unit, low, high

    def fitted(self, start: AnyArray | None = None, *, near: bool = False) -> tuple[AnyArray, float]:
        """The most probable hyperparameters and -log density there; unless `near`, from several starts because of local minima."""
        unit, low, high = self.bounds()
        starts = [unit + np.log(one) for one in _STARTS]
        best: Any = None
        for begin in starts if start is None else [start] if near else [*starts, start]:
            found = scipy.optimize.minimize(
                self.posterior, np.clip(begin, low, high), jac=True, method="L-BFGS-B", bounds=list(zip(low, high, strict=True)),
                options={"maxiter": 200, "ftol": 1e-9, "gtol": 1e-3},
            )  # fmt: skip
            best = found if best is None or found.fun < best.fun else best
        return best.x, float(best.fun)

    def averaged(self, phi: AnyArray) -> Averaged:
        """Coefficients and noise, averaged over the hyperparameters.

        One record determines B, K and the roughness of the curve poorly, so intervals at their most probable values would be too narrow.
        The average uses importance sampling from a multivariate t at points of a Sobol sequence: first around `phi` with the curvature
        there, then with mean and covariance of the first draws, which represent long tails better.
        """
        size, step = len(phi), 0.05
        hessian = np.stack([(self.posterior(phi + e)[1] - self.posterior(phi - e)[1]) / (2 * step) for e in step * np.eye(size)])
        curvature, axes = np.linalg.eigh((hessian + hessian.T) / 2)
        draws, weight = self._drawn(phi, axes / np.sqrt(np.maximum(curvature, _FLATTEST)), _DRAWS[0])
        middle = weight @ draws
        spread = ((draws - middle) * weight[:, None]).T @ (draws - middle) + _LEAST * np.eye(size)
        draws, weight = self._drawn(middle, np.linalg.cholesky(spread), _DRAWS[1])
        kept = np.flatnonzero(weight > 1e-4 * weight.max())
        weight = weight[kept] / weight[kept].sum()
        each = [self.solved(draws[i]) for i in kept]
        beta = np.stack([one.beta for one in each])
        mean = weight @ beta
        within, off = sum(w * one.covariance for w, one in zip(weight, each, strict=True)), beta - mean
        return Averaged(mean, np.asarray(within + off.T @ (off * weight[:, None])), np.exp(draws[kept, :3]), weight)

    def _drawn(self, middle: AnyArray, root: AnyArray, count: int) -> tuple[AnyArray, AnyArray]:
        """Draws (count, p) of the hyperparameters from a multivariate t, and their weights (count,)."""
        from scipy.stats import qmc  # imported here, because it takes 0.6 s that other commands need not spend

        size = len(middle)
        uniform = qmc.Sobol(size + 1, rng=np.random.default_rng(0)).random(count)
        chi = scipy.special.chdtri(_FREEDOM, 1.0 - uniform[:, -1]) / _FREEDOM
        t = scipy.special.ndtri(uniform[:, :-1]) / np.sqrt(chi)[:, None]
        t[0] = 0.0  # the middle, so that at least one draw is within the bounds
        _, low, high = self.bounds()
        draws = middle + t @ root.T
        logs = np.full(count, -np.inf)
        for i in np.flatnonzero(((draws >= low) & (draws <= high)).all(axis=1)):
            logs[i] = -self.posterior(draws[i])[0] + 0.5 * (_FREEDOM + size) * np.log1p(np.sum(t[i] ** 2) / _FREEDOM)
        weight = np.exp(logs - logs.max())
        return draws, weight / weight.sum()
