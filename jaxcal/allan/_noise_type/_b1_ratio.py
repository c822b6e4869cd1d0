"""Noise type from a ratio of variances, for use where too few averages remain for an autocorrelation.

B1, the sample variance of N averages over their Allan variance, grows with N as the noise gets redder (J. A. Barnes, NBS
Technical Note 375, 1969). It is compared with the geometric mean of the expectations for neighbouring types (D. Howe, R. Beard, C.
Greenhall, F. Vernotte and W. Riley, "A total estimator of the Hadamard function used for GPS operations", PTTI 2000; NIST SP 1065,
section 5.5). It is the same for white and flicker phase noise: phase noise is white where the smaller cluster sizes say so.
"""

import functools
import itertools

import numpy as np

from ..._types import Any
from .._kinds import Kind
from ._segments import Segments, followed, steps

#: largest number of points: the autocorrelation is known to 0.031, where half a unit of alpha is 0.1 and more
POINTS = 1 << 10
#: lowest and highest noise type by the number of boundaries that B1 exceeds
_BOUNDS = np.array([[1.0, 0.0, -1.0, -2.0, -np.inf], [np.inf, 0.0, -1.0, -2.0, -3.0]])


def fewest_averages(kind: Kind) -> int:
    """Smallest number of averages for the ratios; below this T/tau Stable32 keeps the last type in its tables of PHASE.DAT."""
    return 8 if kind.overlapped else 10


def _b1(terms, mu: int):
    """Expected B1 of `terms` averages if the Allan variance goes as tau^mu."""
    if mu == 0:
        return terms * np.log(terms) / (2.0 * (terms - 1.0) * np.log(2.0))
    if mu == 2:
        return terms * (terms + 1.0) / 6.0
    if mu == 1:
        return terms / 2.0
    if mu == -1:
        return np.ones_like(terms)
    return (terms + 1.0) / (1.5 * terms)


@functools.lru_cache(maxsize=256)
def _boundaries(held: bytes, order: int) -> np.ndarray:
    """The values of B1 between noise types that go as tau^-2 and tau^-1, tau^-1 and tau^0, ...; records of one length share them."""
    expected = [_b1(np.frombuffer(held), mu) for mu in range(-2, order)]
    return np.array([np.sqrt(least * most) for least, most in itertools.pairwise(expected)])


def carried_on(low, high, carried):
    """Noise types, (clusters,): each continues the one before (`carried` for the first), limited by two bounds."""
    found = low.copy()
    for i in np.flatnonzero(low != high).tolist():  # equal bounds leave nothing to carry on
        found[i] = min(max(found[i - 1] if i else carried, low[i]), high[i])
    return found


def bounds_of_ratios(averages, weight, series: Segments, m, kind: Kind, samples: Any):
    """Noise types from B1, as bounds on the type of the next smaller cluster size.

    The bounds are equal where the type is identified, and infinite where it cannot be. `averages` of the rate are joined as `series`
    describes. `weight` is 1 for averages free of gaps and 0 for others; None means no gaps. Phase noise counts as flicker phase noise,
    unless the type before is white phase noise.
    """
    points, one_less = series.points.astype(averages.dtype), series.shorter
    terms = (samples - 2 * m + 1 if kind.overlapped else series.points - 1).astype(averages.dtype)
    change = steps(averages)
    if weight is None:
        some, number, pairs = np.ones(len(m), dtype=bool), points, points - 1.0
    else:
        both = followed(weight)
        number, pairs = series.sums(weight), one_less.sums(both)
        some = (number >= fewest_averages(kind)) & (pairs >= 2)
        number, pairs = (np.where(some, v, 10.0) for v in (number, pairs))  # 10 is an arbitrary valid divisor; its results are not used
        terms = terms * pairs / (points - 1.0)
        averages, change = averages * weight, change * both
    spread = averages - series.spread(series.sums(averages) / number)
    spread = series.sums(spread**2 if weight is None else spread**2 * weight) / (number - 1.0)
    allan = one_less.sums(change**2) / (2.0 * pairs)
    some = some & (allan > 0)
    b1 = spread / np.where(allan > 0, allan, 1.0)
    beyond = (b1 > _boundaries(terms.tobytes(), kind.order)).sum(axis=0)
    low, high = np.where(some, _BOUNDS[:, beyond], [[-np.inf], [np.inf]]).astype(averages.dtype)
    return low, high


def noise_type_of_ratio(averages, weight, m: int, kind: Kind, samples: int, carried: float) -> float:
    """Noise type at one cluster size from B1; if that is impossible, `carried`, the type at the next smaller size."""
    series = Segments(np.array([len(averages)]))
    return carried_on(*bounds_of_ratios(averages, weight, series, np.array([m]), kind, samples), carried)[0]
