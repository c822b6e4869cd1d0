"""Noise type at each cluster size: from the lag-1 autocorrelation, or from the ratio B1 if points are few.

W. J. Riley and C. A. Greenhall, "Power law noise identification using the lag 1 autocorrelation", EFTF 2004. A fractionally
integrated process has r1/(1+r1) = delta; differencing until it is stationary gives alpha = -2 (delta + differences).
"""

import functools
from typing import NamedTuple

import numpy as np

from .._kinds import MANY, Kind
from ._b1_ratio import POINTS, bounds_of_ratios, carried_on, fewest_averages
from ._segments import Segments, followed, lag_one, moments_of, steps

FEWEST = 30  # smallest number of averaged points for the lag-1 autocorrelation; with fewer, the ratios decide
_STATIONARY = 0.25


def _without_polynomial(z, weight, series: Segments, degree: int):
    """Residual of each series from its least-squares polynomial in time over the valid points, 0 at all others; z is overwritten."""
    n, t = series.points.astype(np.float64), series.time()
    # Gram's polynomials, orthogonal over all points of a series, and their squared norms
    basis = [t, t**2 - np.repeat((n**2 - 1.0) / 12.0, series.lengths) if degree == 2 else t][:degree]
    basis = [b.astype(z.dtype) for b in basis]
    norms = [n, n * (n**2 - 1.0) / 12.0, n * (n**2 - 1.0) * (n**2 - 4.0) / 180.0][: degree + 1]
    moments = [series.sums(z), *(series.sums(b * z) for b in basis)]
    if weight is None:
        factors = [moment / norm.astype(z.dtype) for moment, norm in zip(moments, norms, strict=True)]
    else:
        norms = [np.sqrt(norm).astype(z.dtype) for norm in norms]
        weighted = [weight, *(b * weight for b in basis)]
        rows = [
            [series.sums(v if j == 0 else v * basis[j - 1]) / (norms[i] * norms[j]) for j in range(degree + 1)]
            for i, v in enumerate(weighted)
        ]
        gram = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2) + 1e-12 * np.eye(degree + 1, dtype=z.dtype)[None]
        right = np.stack([moment / norm for moment, norm in zip(moments, norms, strict=True)], axis=-1)
        solved = np.linalg.solve(gram, right[..., None])[..., 0]
        factors = [solved[..., i] / norm for i, norm in enumerate(norms)]
    z -= series.spread(factors[0])  # in place for NumPy arrays
    for b, factor in zip(basis, factors[1:], strict=True):
        term = series.spread(factor)
        term *= b
        z -= term
    return z if weight is None else z * weight


def _lag_one(z, weight, series: Segments):
    """Lag-1 autocorrelation of each series over pairs of valid points; z must be 0 at all others, and its mean is subtracted."""
    one_less = series.shorter
    if weight is None:
        total, pairs = series.points.astype(z.dtype), one_less.points.astype(z.dtype)
        z -= series.spread(series.sums(z) / total)
    else:
        total, pairs = series.sums(weight), np.maximum(one_less.sums(followed(weight)), 1.0)
        z = (z - series.spread(series.sums(z) / np.maximum(total, 1.0))) * weight
    square = series.sums(z * z)
    positive = square > 0
    return np.where(positive, one_less.sums(followed(z)) * (total / pairs) / np.where(positive, square, 1.0), 0.0)


def _order(r1):
    """Fractional order of integration r1/(1 + r1); a series is stationary if it is below `_STATIONARY`."""
    # r1 = -1 would divide by zero; it means a pure alternation, far below every noise type
    return r1 / (1.0 + np.where(r1 > -0.99, r1, -0.99))


def _type(rho):
    # round half up and not to even, so that a boundary is the same for every number of differences
    return -np.floor(2.0 * rho + 0.5)


def _alpha_of(z, weight, series: Segments, degree: int, highest: int):
    """Noise type of each series of averaged rate (degree 1) or decimated phase (degree 2)."""
    z = _without_polynomial(z, weight, series, degree)
    alpha, settled = np.zeros(len(series.lengths), dtype=z.dtype), np.zeros(len(series.lengths), dtype=bool)
    for differences in range(highest + 1):
        rho = _order(_lag_one(z, weight, series))
        here = _type(rho) - 2.0 * differences + (2.0 if degree == 2 else 0.0)
        alpha = np.where(settled, alpha, here)
        settled = settled | (rho < _STATIONARY)
        if settled.all():
            break
        z, series = steps(z), series.shorter
        if weight is not None:
            weight = followed(weight)
            z = z * weight
    return alpha


class _Plan(NamedTuple):
    """Position of the phase points of each cluster size, in the record and in the array that joins them end to end."""

    spans: list[slice]
    series: Segments
    decided: int  # number of cluster sizes with enough points for an autocorrelation; the ratios serve those beyond
    long: Segments
    few: Segments


@functools.lru_cache(maxsize=256)
def _planned(held: bytes, samples: int, kind: Kind, data: str) -> _Plan:
    """The plan at ascending cluster sizes, with points from the middle of the record; records of one length share it."""
    sizes = np.frombuffer(held, np.int64)
    every = samples // sizes + 1
    told = np.count_nonzero(every > fewest_averages(kind))
    decided = int(np.count_nonzero(every - (1 if data == "rate" else 0) >= FEWEST))
    points = np.concatenate([np.minimum(every[:decided], POINTS), every[decided:told]])
    first = (every[:told] - points) // 2 * sizes[:told]
    ends = first + (points - 1) * sizes[:told] + 1
    spans = [slice(*span) for span in zip(first.tolist(), ends.tolist(), sizes.tolist(), strict=False)]
    return _Plan(spans, Segments(points), decided, Segments(points[:decided]), Segments(points[decided:]))


def identify(theta, missing, sizes: np.ndarray, kind: Kind, samples: int, data: str):
    """Noise types at ascending cluster sizes, (clusters,); the series of all cluster sizes are joined end to end in one array.

    Parameters
    ----------
    theta : (points,) phase in samples.
    missing : (points,) running number of missing samples ("rate"), or 1 at missing points ("phase"); None without gaps.
    kind : the statistic; it limits how often the series may be differenced, and the range of alpha.
    """
    spans, series, decided, long, few = _planned(sizes.tobytes(), samples, kind, data)
    told, beyond = len(spans), long.lengths.sum()
    if not told:  # a record that is too short tells nothing
        return np.zeros(len(sizes), dtype=theta.dtype)
    taken, weight, enough = [theta[span] for span in spans], None, None
    if missing is None and data == "rate":
        averages, alpha = _from_moments(taken, series, long, kind)
    else:
        phase = np.concatenate(taken)
        z = averages = steps(phase)
        if missing is not None:
            lost = np.concatenate([missing[span] for span in spans])
            there = ((steps(lost) if data == "rate" else lost) == 0).astype(z.dtype)
            weight = (there if data == "rate" else followed(there))[beyond:]
        long, z = (long.shorter, z) if data == "rate" else (long, phase)
        z, held = z[:beyond], None
        if missing is not None and decided:
            enough = long.sums(there[:beyond]) >= FEWEST
            # ones keep the algebra finite where there are too few points; those results are not used
            held = np.maximum(there[:beyond], 1.0 - long.spread(enough.astype(z.dtype)))
            z = z * held
        alpha = _alpha_of(z, held, long, 1 if data == "rate" else 2, kind.order) if decided else z
    low = high = np.clip(alpha, -2 if kind.order == 2 else -4, 2)
    # each type continues that of the next smaller cluster size within two bounds: equal if identified, infinite if unknown
    if enough is not None:
        low, high = np.where(enough, low, -np.inf), np.where(enough, high, np.inf)
    if decided < told:
        bounds = bounds_of_ratios(averages[beyond:], weight, few.shorter, sizes[decided:told], kind, samples)
        low, high = (np.concatenate(pair) for pair in zip((low, high), bounds, strict=True))
    found = carried_on(low, high, 0.0)
    return found[np.minimum(np.arange(len(sizes)), told - 1)]


def _from_moments(taken: list[np.ndarray], series: Segments, long: Segments, kind: Kind) -> tuple[np.ndarray, np.ndarray]:
    """The averages, and the types of the long series from moments; averages without their line are formed only if necessary."""
    averages, moments = moments_of(taken, series)
    r1, lost = lag_one(moments[:, : len(long.lengths)], long.lengths - 1)
    rho = _order(r1)
    alpha, further = _type(rho), np.flatnonzero(lost | (rho >= _STATIONARY))
    if len(further):
        chosen = np.concatenate([averages[series.starts[i] : series.stops[i]] for i in further.tolist()])
        alpha[further] = _alpha_of(chosen, None, Segments(long.lengths[further]).shorter, 1, kind.order)
    return averages, alpha


def noise_types(theta, marks, sizes, kind: Kind, samples: int, data: str) -> np.ndarray:
    """Noise types at ascending cluster sizes, (clusters,), by `identify`.

    Of more than 512 cluster sizes, at most 512 are identified, evenly spaced in their logarithm; each of the others has the type of the
    next smaller identified one. The arguments are those of `identify`.
    """
    if len(sizes) <= MANY:
        return identify(theta, marks, sizes, kind, samples, data)
    # rounding up keeps the first size; small sizes are few per decade, so fewer than 512 remain
    chosen = np.unique(np.searchsorted(sizes, np.geomspace(sizes[0], sizes[-1], MANY)).clip(max=len(sizes) - 1))
    found = identify(theta, marks, sizes[chosen], kind, samples, data)
    return found[np.searchsorted(chosen, np.arange(len(sizes)), side="right") - 1]


def types_for_intervals(alpha, m: np.ndarray, samples, data: str):
    """Noise types for the degrees of freedom, (clusters, channels): with few averages, the redder of two estimates.

    The ratios mistake white rate noise for phase noise once in seven times, and the edf of phase noise is several times larger. To keep
    the intervals at their level, the redder of this type and the last one from the autocorrelation is used. Measured on 400 records of
    1000 samples, T/tau = 25 to 3, 95 % intervals of oadev hold 92-98 % for N, B, K and N with K; with the ratios alone 85-97 %.
    """
    decided = np.asarray(samples) // m[:, None] + (1 if data == "phase" else 0) >= FEWEST
    if decided.all() or not decided.any():
        return alpha
    last = alpha[np.argmax(decided * m[:, None], axis=0), np.arange(alpha.shape[1])]
    last = np.where(decided.any(axis=0), last, 2.0).astype(alpha.dtype)
    return np.where(decided, alpha, np.minimum(alpha, last[None, :]))
