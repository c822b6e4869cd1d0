"""Equivalent degrees of freedom of a variance, and the chi-square interval that follows from it.

C. A. Greenhall and W. J. Riley, "Uncertainty of stability variances based on finite differences", Proc. 35th PTTI, 2003,
the "combined" algorithm. alpha is the noise type: 2 white phase, 1 flicker phase, 0 white rate, -1 flicker rate, -2 random
walk of rate, and for three-sample statistics -3 and -4.
"""

import functools
import math

import numpy as np
import scipy.special

from .._types import Float
from ._kinds import Kind

_JMAX = 100

# generalised autocovariance of phase, by alpha: sign * |t|^power * (ln |t| or 1)
_WALK = {2: (-1, 1, 0), 1: (1, 2, 1), 0: (1, 3, 0), -1: (-1, 4, 1), -2: (-1, 5, 0), -3: (1, 6, 1), -4: (1, 7, 0)}
# weights of the second and third difference applied twice, at shifts 0, 1, 2, 3
_TWICE = {2: (6.0, -4.0, 1.0), 3: (20.0, -15.0, 6.0, -1.0)}

_TABLE_1 = {
    2: {2: (7 / 9, 1 / 2), 1: (0.997, 0.616), 0: (1.033, 0.607), -1: (1.048, 0.534), -2: (1.302, 0.535)},
    3: {
        2: (22 / 25, 2 / 3), 1: (1.141, 0.843), 0: (1.184, 0.848), -1: (1.180, 0.816), -2: (1.175, 0.777),
        -3: (1.194, 0.703), -4: (1.489, 0.702),
    },
}  # fmt: skip
_TABLE_2 = {
    2: {2: (35 / 18, 1.0), 1: (790.0, 410.0), 0: (2 / 3, 1 / 3), -1: (0.852, 0.375), -2: (1.079, 0.368)},
    3: {
        2: (231 / 100, 3 / 2), 1: (9950.0, 6520.0), 0: (7 / 9, 1 / 2), -1: (0.997, 0.617), -2: (1.033, 0.607),
        -3: (1.053, 0.553), -4: (1.302, 0.535),
    },
}  # fmt: skip
_TABLE_3 = {2: (15.23, 12.0), 3: (47.8, 40.0)}


def _sw(t, alpha: int):
    sign, power, log = _WALK[alpha]
    t = np.abs(t)
    if not log:
        return sign * t**power
    return sign * t**power * np.log(np.where(t > 0, t, 1.0))  # zero at t = 0


def _sx(t, f: float, alpha: int):
    if math.isinf(f):
        return _sw(t, alpha + 2)
    return f**2 * (2 * _sw(t, alpha) - _sw(t - 1 / f, alpha) - _sw(t + 1 / f, alpha))


def _sz(t, f: float, alpha: int, order: int):
    weights = _TWICE[order]
    total = weights[0] * _sx(t, f, alpha)
    for shift, weight in enumerate(weights[1:], start=1):
        total = total + weight * (_sx(t - shift, f, alpha) + _sx(t + shift, f, alpha))
    return total


def _basic_sum(j: int, m: float | int, s: float, f: float, alpha: int, order: int) -> float:
    inner = np.arange(1, j)
    total = _sz(np.zeros(()), f, alpha, order) ** 2 + (1 - j / m) * _sz(np.float64(j / s), f, alpha, order) ** 2
    return float(total + 2 * np.sum((1 - inner / m) * _sz(inner / s, f, alpha, order) ** 2))


@functools.lru_cache(maxsize=65536)
def _inverse_edf(m: int, points: int, alpha: int, order: int, modified: bool, overlapped: bool) -> float:
    """1/edf of one cluster size; `points` phase points."""
    f = 1.0 if modified else float(m)
    s = float(m) if overlapped else 1.0
    reach = m / f + m * order
    total = 1 + math.floor(s * (points - reach) / m)
    j = int(min(total, (order + 1) * s))
    r = total / s
    wide = j > _JMAX
    if alpha == 2 and not modified:
        k = math.ceil(r)
        if k <= order:
            centre = math.comb(2 * order, order)
            pairs = sum((1 - i / r) * math.comb(2 * order, order - i) ** 2 for i in range(1, k))
            return (1 + 2 * pairs / centre**2) / total
        a0, a1 = _TABLE_2[order][2]
        return (a0 - a1 / r) / total
    if modified:
        zero, table, wide_f = _sz(np.zeros(()), 1.0, alpha, order) ** 2, _TABLE_1, 1.0
    elif alpha == 1:
        b0, b1 = _TABLE_3[order]
        zero = (b0 + b1 * math.log(m)) ** 2 if wide else _sz(np.zeros(()), f, alpha, order) ** 2
        table, wide_f = _TABLE_2, None
    else:
        if not wide:
            f = f if m * (order + 1) <= _JMAX else math.inf
        zero, table, wide_f = _sz(np.zeros(()), math.inf if wide else f, alpha, order) ** 2, _TABLE_2, math.inf
    if not wide:
        return _basic_sum(j, total, s, f, alpha, order) / float(total * zero)
    if r >= order + 1:
        a0, a1 = table[order][alpha]
        return (a0 - a1 / r) / r / (float(zero) if alpha == 1 and not modified else 1.0)
    step = _JMAX / r
    return _basic_sum(_JMAX, _JMAX, step, step if wide_f is None else wide_f, alpha, order) / (_JMAX * float(zero))


def degrees_of_freedom(m, alpha, kind: Kind, samples: int) -> Float[np.ndarray, "..."]:
    """Equivalent degrees of freedom for cluster sizes m (broadcast against noise types alpha), gap-free record.

    Parameters
    ----------
    m : cluster sizes.
    alpha : noise types, 2 .. -2 (-4 for three-sample statistics); clipped to that range.
    kind : the statistic.
    samples : number of rate samples of the record.

    Examples
    --------
    Overlapped Allan deviation of white rate noise, 1025 phase points:

    >>> from jaxcal.allan._edf import degrees_of_freedom
    >>> from jaxcal.allan._kinds import find_kind
    >>> [round(float(v), 1) for v in degrees_of_freedom([2, 16, 128], 0, find_kind("oadev"), 1024)]
    [553.7, 88.5, 9.8]
    """
    sizes, types = np.broadcast_arrays(np.asarray(m, dtype=np.int64), np.clip(np.asarray(alpha), -2 if kind.order == 2 else -4, 2))
    inverse = [
        _inverse_edf(int(size), samples + 1, int(kind_of_noise), kind.order, kind.modified, kind.overlapped)
        for size, kind_of_noise in zip(sizes.ravel(), types.ravel(), strict=True)
    ]
    # a variance of a single difference has one degree of freedom; formulas for large arguments can dip below
    return np.maximum(1.0 / np.array(inverse), 1.0).reshape(sizes.shape)


def interval_factors(edf, confidence: float) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
    """Factors from a deviation to the limits of its interval: sqrt(edf / chi2_{1-a/2}), sqrt(edf / chi2_{a/2}), a = 1 - confidence."""
    edf = np.asarray(edf, dtype=np.float64)
    tail = (1.0 - confidence) / 2.0
    low, high = (2.0 * scipy.special.gammaincinv(edf / 2.0, p) for p in (tail, 1.0 - tail))
    return np.sqrt(edf / high), np.sqrt(edf / low)
