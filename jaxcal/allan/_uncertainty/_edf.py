"""Equivalent degrees of freedom of a variance, and the chi-square interval that follows from them.

C. A. Greenhall and W. J. Riley, "Uncertainty of stability variances based on finite differences", Proc. 35th PTTI, 2003,
the "combined" algorithm. alpha is the noise type: 2 white phase, 1 flicker phase, 0 white rate, -1 flicker rate, -2 random
walk of rate, and for three-sample statistics -3 and -4.
"""

import functools
import itertools
import math
from collections.abc import Sequence
from types import ModuleType
from typing import NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from ..._errors import DataError
from ..._types import Float, Samples
from .._kinds import Kind, autocorrelation, find_kind
from ._tables import GREENHALL_RILEY

_JMAX = 100
#: number of points of the table of interval factors
TABLE = 4000
_NODES = 1024  # largest number of arguments for which a function is evaluated at each, and of records whose values are kept


def _sw(t, alpha: int):
    sign, power, log = GREENHALL_RILEY["walk"][alpha]
    t = np.abs(t)
    value = sign * t
    for _ in range(power - 1):  # takes a tenth of the time of t**power
        value = value * t
    return value * np.log(np.where(t > 0, t, 1.0)) if log else value  # zero at t = 0


def _sx(t, f, alpha: int):
    if np.ndim(f) == 0 and math.isinf(f):
        return _sw(t, alpha + 2)
    whole = f**2 * (2 * _sw(t, alpha) - _sw(t - 1 / f, alpha) - _sw(t + 1 / f, alpha))
    if alpha != 1:  # other noise types reach this line at small f only
        return whole
    # the second difference of t^2 ln |t| at spacing 1/f suffers from cancellation; its series does not
    reach = np.abs(t) * f
    far = reach > 300.0
    reach = np.where(far, reach, 300.0)
    return np.where(far, 1 / (6 * reach**2) - 2 * np.log(reach / f) - 3, whole)


def _sz(t, f, alpha: int, order: int):
    weights = autocorrelation(order)
    shifts = np.arange(-order, order + 1)
    values = _sx(np.asarray(t) + shifts.reshape(-1, *(1,) * np.ndim(t)), f, alpha)
    # add one after another: large values cancel, and the rounding must not depend on the number of arguments
    return (
        sum(weights[abs(shift)] * value for shift, value in zip(shifts[1:].tolist(), values[1:], strict=True)) + weights[order] * values[0]
    )


def _basic_sum(j, m, s, f, alpha: int, order: int) -> np.ndarray:
    """BasicSum of the paper for arrays of arguments, (clusters,); f may be the scalar infinity."""
    i = np.arange(1, int(np.max(j)))
    total = _sz(np.zeros_like(s), f, alpha, order) ** 2 + (1 - j / m) * _sz(j / s, f, alpha, order) ** 2
    column = f if np.ndim(f) == 0 else f[:, None]
    terms = np.where(i < j[:, None], (1 - i / m[:, None]) * _sz(i / s[:, None], column, alpha, order) ** 2, 0.0)
    return total + 2 * np.sum(terms, axis=1)


def _at_nodes(function, x) -> np.ndarray:
    """A smooth function at positive values: directly if they are few, otherwise linear in ln x between some hundreds of them."""
    if len(x) <= _NODES:
        return function(x)
    values = np.sort(x)
    values = values[np.diff(values, prepend=0.0) > 0]  # np.unique takes ten times as long
    if len(values) > _NODES:
        # half of the nodes are evenly spaced, because BasicSum has kinks where one of its terms meets a whole number of clusters
        inner = [spaced(values[0], values[-1], _NODES // 2) for spaced in (np.geomspace, np.linspace)]
        ends = np.arange(_NODES // 8)
        chosen = np.searchsorted(values, np.concatenate(inner)).clip(max=len(values) - 1)
        values = values[np.unique(np.concatenate([ends, chosen, len(values) - 1 - ends]))]
    return np.interp(np.log(x), np.log(values), function(values))


def _inverse_edf(m, alpha, points, kind: Kind) -> np.ndarray:
    """1/edf at cluster sizes m and noise types alpha, both (values,); `points` phase points, one number or (values,)."""
    order, modified = kind.order, kind.modified
    size = m.astype(np.float64)
    s = size if kind.overlapped else np.ones_like(size)
    reach = (m if modified else 1) + m * order
    total = 1 + np.floor(s * (points - reach) / m)
    r = total / s
    a0, a1 = np.array([*GREENHALL_RILEY["modified" if modified else "plain"][order].values()])[2 - alpha].T
    out = (a0 - a1 / r) / r  # for long records
    j = np.minimum(total, (order + 1) * s)
    limited, short = (j > _JMAX) & (r < order + 1), (j <= _JMAX) & (total > 1)
    if not modified:
        flicker, white = alpha == 1, alpha == 2
        if flicker.any():
            out[flicker] /= _flicker_phase(size[flicker], order)
        if white.any():
            out[white] = _white_phase(total[white], r[white], order) / total[white]
            limited, short = limited & ~white, short & ~white
    if kind.overlapped:
        common = short & (total >= (order + 1) * s)
        if common.any():
            constant, slope = _short_table(order, modified)[:, 2 - alpha[common], m[common]]
            out[common] = (constant - slope / total[common]) / total[common]
            short = short & ~common
    for one in {*alpha[limited | short].tolist()}:
        infinite = not modified and one <= 0  # whether f, in the paper's notation, is infinite where m is large
        here = limited & (alpha == one)
        if here.any():
            out[here] = _limited(r[here], size[here], one, kind)
        here = short & (alpha == one)
        continuous = here & (infinite & (size * (order + 1) > _JMAX))
        for chosen, f in ((here & ~continuous, np.ones_like(size) if modified else size), (continuous, None)):
            if chosen.any():
                part = (total[chosen], j[chosen], s[chosen], math.inf if f is None else f[chosen])
                out[chosen] = _short(*part, one, order)
    out[total <= 1] = 1.0
    return out


def _white_phase(total, r, order: int) -> np.ndarray:
    """Inverse of edf times `total`, for the plain variances of white phase noise."""
    centre, (a0, a1) = math.comb(2 * order, order), GREENHALL_RILEY["plain"][order][2]
    pairs = sum(np.maximum(1 - i / r, 0.0) * math.comb(2 * order, order - i) ** 2 for i in range(1, order))
    return np.where(r <= order, 1 + 2 * pairs / centre**2, a0 - a1 / r)


def _flicker_phase(size, order: int) -> np.ndarray:
    b0, b1 = GREENHALL_RILEY["flicker"][order]
    return (b0 + b1 * np.log(size)) ** 2


def _limited(r, size, alpha: int, kind: Kind) -> np.ndarray:
    """1/edf of a short record, with a hundred terms in place of the whole BasicSum."""
    flicker = not kind.modified and alpha == 1
    f = 1.0 if kind.modified else math.inf

    def wide(r):
        most, step = np.full_like(r, _JMAX), _JMAX / r
        return _basic_sum(most, most, step, step if flicker else f, alpha, kind.order) / _JMAX

    return _at_nodes(wide, r) / (_flicker_phase(size, kind.order) if flicker else _sz(np.zeros(()), f, alpha, kind.order) ** 2)


@functools.cache
def _short_table(order: int, modified: bool) -> Float[np.ndarray, "2 types sizes"]:
    """Coefficients c and b of 1/edf = (c - b / M) / M for M differences, at the cluster sizes for which all terms are added.

    They hold for records in which M is not smaller than the number of terms.
    """
    sizes = np.arange(_JMAX // (order + 1) + 1)
    table = np.zeros((2, 5 if order == 2 else 7, len(sizes)))
    s = sizes[1:].astype(np.float64)
    # 1/edf is linear in 1/M, so two values suffice: at infinite M, and at the smallest M that the terms allow
    j = (order + 1) * s
    for row in range(table.shape[1]):
        part = (s, np.ones_like(s) if modified else s, 2 - row, order)
        zero = _sz(np.zeros_like(s), *part[1:]) ** 2
        constant = _basic_sum(j, np.full_like(s, math.inf), *part) / zero
        table[:, row, 1:] = constant, (constant - _basic_sum(j, j, *part) / zero) * j
    table.flags.writeable = False
    return table


def _short(total, j, s, f, alpha: int, order: int) -> np.ndarray:
    """1/edf with all terms of BasicSum added."""
    return _basic_sum(j, total, s, f, alpha, order) / (total * _sz(np.zeros_like(s), f, alpha, order) ** 2)


def degrees_of_freedom(m: Samples, alpha: Samples, kind: str | Kind, samples: Samples) -> Float[np.ndarray, "..."]:
    """Equivalent degrees of freedom of a variance, for a record without gaps.

    The variance times edf over its expectation is nearly chi-square with edf degrees of freedom ("combined" algorithm of Greenhall and
    Riley, PTTI 2003).

    Parameters
    ----------
    m : cluster sizes in samples.
    alpha : noise types (2 white phase .. -2 random walk of rate, -4 for three-sample statistics), broadcast against m. Types beyond the
        last count as the last.
    kind : name of the statistic, such as "oadev".
    samples : number of rate samples of the record, broadcast against m.

    Examples
    --------
    Overlapping Allan deviation of white rate noise, 1025 phase points:

    >>> from jaxcal.allan import degrees_of_freedom
    >>> [round(float(v), 1) for v in degrees_of_freedom([2, 16, 128], 0, "oadev", 1024)]
    [553.7, 88.5, 9.8]
    """
    kind = find_kind(kind)
    if kind.error:
        raise DataError(f"no distribution of {kind.name} is known, and so no degrees of freedom", code="kind")
    alpha = np.clip(np.asarray(alpha), -2 if kind.order == 2 else -4, 2).astype(np.int64)
    sizes, types, samples = np.broadcast_arrays(np.asarray(m, dtype=np.int64), alpha, samples)
    inverse = _inverse_edf(sizes.ravel(), types.ravel(), samples.ravel() + 1, kind).reshape(sizes.shape)
    # a variance of a single difference has one degree of freedom; formulas for large arguments may give less
    return np.asarray(np.maximum(1.0 / inverse, 1.0))


def interval_factors(edf, confidence: float) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
    """Factors from a deviation to the limits of its interval: sqrt(edf / chi2_{1-a/2}), sqrt(edf / chi2_{a/2}), a = 1 - confidence."""
    half = np.asarray(edf, dtype=np.float64) / 2.0
    low, high = (np.sqrt(half / scipy.special.gammaincinv(half, p)) for p in _tails(confidence))
    return low, high


class Whole(NamedTuple):
    """What the degrees of freedom of a record without gaps depend on: cluster sizes, and (clusters, channels) types, held in bytes."""

    sizes: bytes
    types: bytes
    channels: int
    kind: Kind
    samples: int
    confidence: float


_known: dict[Whole, np.ndarray] = {}


def known_uncertainty(records: Sequence[Whole]) -> list[Float[np.ndarray, "3 clusters channels"]]:
    """The edf and both interval factors of records without gaps, by one kind and confidence; as many at once as are not interpolated.

    They depend on the length of a record and its types, not on its samples.
    """
    new = [one for one in dict.fromkeys(records) if one not in _known]
    if not new:
        return [_known[one] for one in records]
    ends = np.cumsum([len(one.types) // 8 for one in new])
    for _, some in itertools.groupby(zip(new, ends.tolist(), strict=True), lambda pair: 2 * pair[1] // _NODES):
        part = [one for one, _ in some]
        types = [np.frombuffer(one.types) for one in part]
        sizes = np.concatenate([np.repeat(np.frombuffer(one.sizes, np.int64), one.channels) for one in part])
        samples = np.repeat([one.samples for one in part], list(map(len, types)))
        edf = degrees_of_freedom(sizes, np.concatenate(types), part[0].kind, samples)
        every = np.stack([edf, *interval_factors(edf, part[0].confidence)])
        for one, found in zip(part, np.split(every, np.cumsum(list(map(len, types)))[:-1], axis=1), strict=True):
            _known[one] = found.reshape(3, -1, one.channels)
    found = [_known[one] for one in records]
    for one in list(_known)[:-_NODES]:
        _known.pop(one, None)
    return found


def _tails(confidence: float) -> tuple[float, float]:
    """Probabilities of chi-square below the values for the lower and the upper limit of a deviation."""
    return (1.0 + confidence) / 2.0, (1.0 - confidence) / 2.0


def tabulated_factors(edf, largest: float, confidence: float, xp: ModuleType = np):
    """`interval_factors` for many or traced values up to `largest`, from a table: good to 5e-7 (99.9 %, 10^7 degrees of freedom)."""
    scale, curves = _factor_table(max(math.ceil(math.log2(largest)), 1), confidence)
    log, root = xp.log(edf), xp.sqrt(edf)
    return tuple(xp.exp(xp.interp(log, *(xp.asarray(v, dtype=edf.dtype) for v in (scale, curve))) / root) for curve in curves)


@functools.lru_cache(maxsize=16)
def _factor_table(octaves: int, confidence: float) -> tuple[np.ndarray, list[np.ndarray]]:
    """ln(edf), and ln(factor) sqrt(edf) of both limits, which hardly vary: 4,000 points, closer together where edf is small."""
    scale = np.linspace(0.0, 1.0, TABLE) ** 2 * (octaves * math.log(2.0))
    half, root = np.exp(scale) / 2.0, np.exp(scale / 2.0)
    return scale, [np.log(half / scipy.special.gammaincinv(half, p)) / 2.0 * root for p in _tails(confidence)]
