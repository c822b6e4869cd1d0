r"""Variances that resist outliers: an M-estimate of scale in place of the mean of squares.

For the differences d_k of one cluster size, s is the scale that solves

.. math:: \frac1M \sum_k w(d_k/s)\, d_k^2 = a\, s^2,\qquad w(z) = (1 - z^2/c^2)^4 \text{ for } |z| < c,\ 0 \text{ beyond}

(Tukey's biweight), with a = E w(Z) Z^2 for a normal Z, so that Gaussian noise gives the same value as the mean. c = 7 keeps 92 %
of the degrees of freedom, and even arbitrary values of a fifth of the differences cannot make s grow without bound (P. J. Huber and E. M.
Ronchetti, Robust Statistics, 2009, chapter 5; for the variances of inertial sensors S. Guerrier and R. Molinari, "Robust inference
for time series models: a wavelet-based framework", 2016).
"""

import functools
import itertools

import numpy as np
import scipy  # loads its parts when they are first used

from ..._errors import DataError
from ..._message import Message
from ..._types import Float, Int
from .._kinds import Kind

_CUT = 7.0
_STARTS = 16  # starting points per cluster; closer ones add less than 1 % to the degrees of freedom
_MOST = 60
_ENOUGH = 1e-10


def _weight(square):
    return np.maximum(1.0 - square / _CUT**2, 0.0) ** 4


def _of_normal(function) -> float:
    """Expectation, over a standard normal variable, of a function that is zero beyond the cut."""
    nodes, weights = np.polynomial.legendre.leggauss(128)
    z = _CUT * nodes
    return float(_CUT * (weights * np.exp(-0.5 * z**2)) @ function(z) / np.sqrt(2.0 * np.pi))


@functools.cache
def _level() -> float:
    """The constant a."""
    return _of_normal(lambda z: _weight(z**2) * z**2)


@functools.cache
def _slope() -> float:
    """Slope of E w(Z/s) (Z/s)^2 with respect to ln s."""
    return _of_normal(lambda z: 2.0 * z**2 * _weight(z**2) - 8.0 * (z / _CUT) ** 2 * z**2 * np.maximum(1.0 - (z / _CUT) ** 2, 0.0) ** 3)


@functools.cache
def efficiency() -> float:
    """Degrees of freedom relative to those of the mean of squares."""
    level = _level()
    # E (w z^2 - a)^2, including the part beyond the cut
    scatter = _of_normal(lambda z: (_weight(z**2) * z**2 - level) ** 2) + level**2 * 2.0 * float(scipy.special.ndtr(-_CUT))
    return float(0.5 * _slope() ** 2 / scatter)


def refuse_robust(kind: Kind, robust: bool) -> None:
    """Raise a clear error for a statistic without a robust form."""
    if robust and (kind.modified or kind.family != "difference" or kind.interval_error):
        raise DataError(
            Message(
                "{option.robust:True} is for adev, oadev, hdev and ohdev; got {kind}, whose terms mix outliers with all else",
                kind=kind.name,
            )
        )


def robust_squares(theta, missing, m: Int[np.ndarray, " clusters"], kind: Kind, samples: int, data: str) -> tuple:
    """Robust mean square of the differences at each cluster size, and number of differences free of gaps.

    `missing` is the running number of missing samples (data "rate"), or 1 at missing points ("phase"); None without gaps.
    """
    squares, counts = np.zeros(len(m)), np.zeros(len(m), dtype=np.int64)
    for i, (size, number) in enumerate(zip(m.tolist(), kind.count(samples, m).tolist(), strict=True)):
        step = max(size // _STARTS, 1) if kind.overlapped else size
        starts = np.arange(0, number, step) if kind.overlapped else np.arange(number) * size
        points = [theta[starts + j * size] for j in range(kind.order + 1)]
        valid = np.ones(len(starts), bool)
        if missing is not None and data == "rate":
            valid = missing[starts + kind.order * size] == missing[starts]
        elif missing is not None:
            valid = np.sum([missing[starts + j * size] for j in range(kind.order + 1)], axis=0) == 0
        while len(points) > 1:
            points = [b - a for a, b in itertools.pairwise(points)]
        counts[i] = round(number * valid.mean())
        squares[i] = _square_of_scale(points[0][valid]) if valid.any() else 0.0
    return squares, counts


def _square_of_scale(d: Float[np.ndarray, " differences"]) -> float:
    """The square of the scale s; if more than half of the differences are zero, the mean square."""
    square = d**2
    s2 = float(np.median(square)) / (2.0 * scipy.special.gammaincinv(0.5, 0.5))
    if s2 == 0.0:
        return float(square.mean())
    for _ in range(_MOST):
        new = float(np.mean(_weight(square / s2) * square)) / _level()
        # the plain iteration reduces an error to a third; this step, exact for normal differences, converges faster
        step = np.log(new / s2) * _level() / _slope() * 2.0
        s2 *= float(np.exp(np.clip(step, -1.0, 1.0)))
        if abs(step) < _ENOUGH:
            return s2
    raise DataError("the robust scale has not settled: the differences have no one scale; look at the record, or leave out robust")
