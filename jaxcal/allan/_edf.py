"""Equivalent degrees of freedom of a variance, and the chi-square interval that follows from it.

C. A. Greenhall and W. J. Riley, "Uncertainty of stability variances based on finite differences", Proc. 35th PTTI, 2003,
the "combined" algorithm. alpha is the noise type: 2 white phase, 1 flicker phase, 0 white rate, -1 flicker rate, -2 random
walk of rate, and for three-sample statistics -3 and -4.
"""

import math
from types import ModuleType

import numpy as np
import scipy.special

from .._types import Float
from ._kinds import Kind

_JMAX = 100
#: points of the table of interval factors; more values than that are looked up
TABLE = 4000
_NODES = 1024  # arguments up to which a function is evaluated at each

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


def _sx(t, f, alpha: int):
    if np.ndim(f) == 0 and math.isinf(f):
        return _sw(t, alpha + 2)
    whole = f**2 * (2 * _sw(t, alpha) - _sw(t - 1 / f, alpha) - _sw(t + 1 / f, alpha))
    if alpha != 1:  # the others take this road at small f only
        return whole
    # the second difference of t^2 ln |t| at spacing 1/f cancels; its series does not
    reach = np.abs(t) * f
    far = reach > 300.0
    reach = np.where(far, reach, 300.0)
    return np.where(far, 1 / (6 * reach**2) - 2 * np.log(reach / f) - 3, whole)


def _sz(t, f, alpha: int, order: int):
    weights = _TWICE[order]
    total = weights[0] * _sx(t, f, alpha)
    for shift, weight in enumerate(weights[1:], start=1):
        total = total + weight * (_sx(t - shift, f, alpha) + _sx(t + shift, f, alpha))
    return total


def _basic_sum(j, m, s, f, alpha: int, order: int) -> np.ndarray:
    """BasicSum of the paper for arrays of arguments, (clusters,); f may be the scalar infinity."""
    i = np.arange(1, int(np.max(j)))
    total = _sz(np.zeros_like(s), f, alpha, order) ** 2 + (1 - j / m) * _sz(j / s, f, alpha, order) ** 2
    column = f if np.ndim(f) == 0 else f[:, None]
    terms = np.where(i < j[:, None], (1 - i / m[:, None]) * _sz(i / s[:, None], column, alpha, order) ** 2, 0.0)
    return total + 2 * np.sum(terms, axis=1)


def _at_nodes(function, x) -> np.ndarray:
    """A smooth function at positive values: each where there are few, else linear in ln x between some hundreds of them."""
    if len(x) <= _NODES:
        return function(x)
    values = np.sort(x)
    values = values[np.diff(values, prepend=0.0) > 0]  # np.unique takes ten times as long
    if len(values) > _NODES:
        # BasicSum has kinks where one of its terms meets a whole number of clusters: hence the even spacing beside the other
        inner = [spaced(values[0], values[-1], _NODES // 2) for spaced in (np.geomspace, np.linspace)]
        ends = np.arange(_NODES // 8)
        chosen = np.searchsorted(values, np.concatenate(inner)).clip(max=len(values) - 1)
        values = values[np.unique(np.concatenate([ends, chosen, len(values) - 1 - ends]))]
    return np.interp(np.log(x), np.log(values), function(values))


def _inverse_edf(m, points: int, alpha: int, kind: Kind) -> np.ndarray:
    """1/edf at cluster sizes m, (clusters,), of one noise type; `points` phase points."""
    order, modified = kind.order, kind.modified
    size = m.astype(np.float64)
    s = size if kind.overlapped else np.ones_like(size)
    reach = (m if modified else 1) + m * order
    total = 1 + np.floor(s * (points - reach) / m)
    r = total / s
    a0, a1 = (_TABLE_1 if modified else _TABLE_2)[order][alpha]
    if alpha == 2 and not modified:
        centre = math.comb(2 * order, order)
        pairs = sum(np.maximum(1 - i / r, 0.0) * math.comb(2 * order, order - i) ** 2 for i in range(1, order))
        return np.where(r <= order, 1 + 2 * pairs / centre**2, a0 - a1 / r) / total
    f = np.ones_like(size) if modified else size
    j = np.minimum(total, (order + 1) * s)
    scale = np.ones_like(size)
    if not modified and alpha == 1:
        b0, b1 = _TABLE_3[order]
        scale = (b0 + b1 * np.log(size)) ** 2
    out = (a0 - a1 / r) / r / scale  # long records
    limited = (j > _JMAX) & (r < order + 1)
    if limited.any():
        wide_f = 1.0 if modified else math.inf

        def wide(r):
            most, step = np.full_like(r, _JMAX), _JMAX / r
            return _basic_sum(most, most, step, step if scale_known else wide_f, alpha, order) / _JMAX

        scale_known = not modified and alpha == 1
        zero = scale[limited] if scale_known else _sz(np.zeros(()), wide_f, alpha, order) ** 2
        out[limited] = _at_nodes(wide, r[limited]) / zero
    short = j <= _JMAX
    continuous = short & (size * (order + 1) > _JMAX) if not modified and alpha <= 0 else np.zeros_like(short)
    for chosen, infinite in ((short & ~continuous, False), (continuous, True)):
        if chosen.any():
            part = (total[chosen], j[chosen], s[chosen], math.inf if infinite else f[chosen])
            out[chosen] = (_short if kind.overlapped else _short_strided)(*part, alpha, order)
    return out


def _short(total, j, s, f, alpha: int, order: int) -> np.ndarray:
    """1/edf where all terms of BasicSum are added."""
    return _basic_sum(j, total, s, f, alpha, order) / (total * _sz(np.zeros_like(s), f, alpha, order) ** 2)


def _short_strided(total, j, s, f, alpha: int, order: int) -> np.ndarray:
    """The same at s = 1, where the few s_z needed depend on f alone."""

    def one(t):
        if np.ndim(f) == 0:
            return _sz(np.float64(t), f, alpha, order) ** 2
        return _at_nodes(lambda f: _sz(np.full_like(f, t), f, alpha, order) ** 2, f)

    squares = [one(float(t)) for t in range(order + 2)]
    out = squares[0] * np.ones_like(total)
    for i in range(1, order + 2):
        out += np.where(i < j, 2.0, np.where(i == j, 1.0, 0.0)) * (1 - i / total) * squares[i]
    return out / (total * squares[0])


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
    inverse = np.empty(sizes.shape)
    for one in range(int(np.min(types)), int(np.max(types)) + 1):
        here = types == one
        if here.any():
            inverse[here] = _inverse_edf(sizes[here], samples + 1, one, kind)
    # a variance of a single difference has one degree of freedom; formulas for large arguments can dip below
    return np.maximum(1.0 / inverse, 1.0)


def interval_factors(edf, confidence: float) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
    """Factors from a deviation to the limits of its interval: sqrt(edf / chi2_{1-a/2}), sqrt(edf / chi2_{a/2}), a = 1 - confidence."""
    edf = np.asarray(edf, dtype=np.float64)
    tail = (1.0 - confidence) / 2.0
    low, high = (2.0 * scipy.special.gammaincinv(edf / 2.0, p) for p in (tail, 1.0 - tail))
    return np.sqrt(edf / high), np.sqrt(edf / low)


def tabulated_factors(edf, largest: float, confidence: float, xp: ModuleType = np):
    """The same for many or traced values up to `largest`, from a table: good to 1e-7."""
    # ln(factor) sqrt(edf) hardly varies: linear between 4,000 points of ln(edf), closer where edf is small
    scale = np.linspace(0.0, 1.0, TABLE) ** 2 * np.log(max(largest, 2.0))
    factors = []
    for factor in interval_factors(np.exp(scale), confidence):
        curve = np.log(factor) * np.exp(scale / 2.0)
        factors.append(xp.exp(xp.interp(xp.log(edf), *(xp.asarray(v, dtype=edf.dtype) for v in (scale, curve))) / xp.sqrt(edf)))
    return tuple(factors)
