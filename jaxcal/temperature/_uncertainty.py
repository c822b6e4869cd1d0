r"""Covariance of a curve: white errors of the readings and of the thermometer, and a bias that walks while the record is taken.

.. math:: V_{jk} = \delta_{jk} (\sigma^2 + f'(T_j)^2 \sigma_T^2)/c_j + K^2\,\mathrm{cov}(\bar W_j, \bar W_k)

with W a random walk in time less its mean over the record, averaged over the samples of each bin. sigma and K come from the residuals
by restricted likelihood, which knows what the curve has taken from them (H. D. Patterson and R. Thompson, Biometrika 58 (1971)
545). Blocks of temperature drawn with replacement would tear holes at a step and not see the walk.
"""

from typing import Any

import equinox as eqx
import numpy as np

from .._types import AnyArray
from ..fitting import Fit
from . import _steps
from ._curves import AbstractCurve, Chebyshev, Steps
from ._linear import basis
from ._record import COARSE, FINE, Bins, binned, number
from ._smoothing import smoother

_SEGMENTS = 60  # of the record, in time, over which residuals are averaged


class Errors(eqx.Module):
    """V of the bins: variances of the `white` part (bins,), and the covariance of the `walk` (bins, bins)."""

    white: AnyArray
    walk: AnyArray

    def through(self, gain: AnyArray) -> AnyArray:
        """Gain V gain'."""
        return (gain * self.white) @ gain.T + gain @ self.walk @ gain.T


def uncertainty(
    kind: str, curve: Any, t: AnyArray, b: AnyArray, bins: Bins, thermometer: float, own: Fit | None
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Temperatures, standard errors of the curve there, and the covariance of its parameters (empty where it has none).

    Of `Steps` the parameters are q, p, and then centre and width of each step; of a curve of one's own those of its fit.
    """
    v = _bins_covariance(curve, t, b, bins, thermometer)
    root = np.sqrt(bins.count)
    if own is not None or isinstance(curve, (Chebyshev, Steps)):
        design = _design(curve, bins.t, t) if own is None else own.jacobian / root[:, None]
        covariance = v.through(np.linalg.pinv(design * root[:, None]) * root)
        return bins.t, standard_error(design, covariance), covariance
    if kind == "spline":  # with the share of the smoothing's own bias: G. Wahba, J. R. Stat. Soc. B 45 (1983) 133
        matrix = smoother(bins)
        variance = v.white * np.diag(matrix) + np.einsum("ij,jk,ik->i", matrix, v.walk, matrix)
        return bins.t, np.sqrt(np.maximum(variance, 0)), np.zeros((0, 0))
    # a node is the mean of the bins that it joins
    nodes = binned(t, b, COARSE)
    nearest = np.abs(bins.t[:, None] - nodes.t).argmin(axis=1)
    gain = (nearest[:, None] == np.arange(len(nodes.t))) * bins.count[:, None]
    variance = np.diag(v.through((gain / np.maximum(gain.sum(axis=0), 1)).T))
    return nodes.t, np.sqrt(np.maximum(variance, 0)), np.zeros((0, 0))


def standard_error(design: AnyArray, covariance: AnyArray) -> AnyArray:
    """Standard error of each row of `design` times the parameters."""
    return np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", design, covariance, design), 0))


def _bins_covariance(curve: AbstractCurve, t: AnyArray, b: AnyArray, bins: Bins, thermometer: float) -> "Errors":
    """V of the bins, from the samples `t`, `b` in time order."""
    count = min(_SEGMENTS, max(len(t) // 10, 2))
    segment = np.arange(len(t)) * count // len(t)
    size = np.bincount(segment).astype(float)
    # what a table or a spline has taken from the noise cannot be counted: steps stand for it
    model: Any = curve if type(curve) in (Chebyshev, Steps) else _steps.steps_curve(t, b, float(t.min()), float(t.max()))
    residual = np.bincount(segment, b - np.asarray(model.value(t))) / size
    design = _design(model, t, t)
    design = np.stack([np.bincount(segment, column) / size for column in design.T], axis=1)
    middle = np.cumsum(size) - size / 2
    walk = np.minimum(middle[:, None], middle)
    white, wander = _components(residual, design, walk)
    centred = walk - walk.mean(axis=0) - walk.mean(axis=1, keepdims=True) + walk.mean()
    place = np.unique(number(t, FINE, float(t.min())), return_inverse=True)[1]
    share = np.zeros((len(bins.t), count))
    np.add.at(share, (place, segment), 1.0)
    share /= bins.count[:, None]
    white = white * len(t) / count + (steepness(curve, bins.t) * thermometer) ** 2
    return Errors(white / bins.count, wander * share @ centred @ share.T)


def _components(residual: AnyArray, design: AnyArray, walk: AnyArray) -> tuple[float, float]:
    """Variance of a segment's white error, and K^2 per sample: means over the restricted likelihood, which is often highest at K = 0."""
    basis, singular, _ = np.linalg.svd(design)
    rank = int(np.sum(singular > 1e-10 * singular[0]))
    null = basis[:, rank:]
    size, vectors = np.linalg.eigh(null.T @ walk @ null)
    square = (vectors.T @ (null.T @ residual)) ** 2
    if not len(square) or not square.max() > 0:
        return 0.0, 0.0
    # evenly in K, up to a walk beside which the white part is nothing
    ratio = np.linspace(0, 100, 401) ** 2 / np.max(size)
    spread = 1 + ratio[:, None] * np.maximum(size, 0)
    white = np.mean(square / spread, axis=1)
    likelihood = -0.5 * (len(size) * np.log(white) + np.sum(np.log(spread), axis=1))
    weight = np.exp(likelihood - likelihood.max())
    weight /= weight.sum()
    return float(weight @ white), float(weight @ (white * ratio))


def steepness(curve: AbstractCurve, t: AnyArray, step: float = 1e-3) -> AnyArray:
    """df/dT, by central differences."""
    return (np.asarray(curve.value(t + step)) - np.asarray(curve.value(t - step))) / (2 * step)


def _design(curve: Chebyshev | Steps, t: AnyArray, samples: AnyArray) -> AnyArray:
    """(n, parameters) derivative of a curve over the range of the samples."""
    low, high = float(samples.min()), float(samples.max())
    return _steps.jacobian(curve, t, low, high) if isinstance(curve, Steps) else basis(t, low, high, len(curve.coefficients) - 1)
