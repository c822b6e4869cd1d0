"""Noise type at each cluster size: by the lag-1 autocorrelation, and by the ratios B1 and R(n) where points are few.

W. J. Riley and C. A. Greenhall, "Power law noise identification using the lag 1 autocorrelation", EFTF 2004. A fractionally
integrated process has r1/(1+r1) = delta; differencing until it is stationary gives alpha = -2 (delta + differences).
"""

import functools
from types import ModuleType
from typing import NamedTuple

import numpy as np

from ..._types import Int
from .._kinds import Kind
from ._b1_ratio import bounds_of_ratios, carried_on, fewest_averages, thinned_sums
from ._lag_one import lag_one, moments_of
from ._segments import Segments, followed, steps

FEWEST = 30  # averaged points that the lag-1 autocorrelation needs; with fewer, the ratios decide
_STATIONARY = 0.25
_MOST_SIZES = 512  # cluster sizes identified; neighbours then differ by 3 % in a record of 10^7 samples
_MOST = 1 << 11  # averaged points used: r1 to 0.022, where half a unit of alpha is 0.1 and more


def _without_polynomial(z, weight, series: Segments, degree: int, xp: ModuleType):
    """Residual of each series from its least-squares polynomial in time over the valid points, 0 at the others; z is spent."""
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
        gram = xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2) + 1e-12 * np.eye(degree + 1, dtype=z.dtype)[None]
        right = xp.stack([moment / norm for moment, norm in zip(moments, norms, strict=True)], axis=-1)
        solved = xp.linalg.solve(gram, right[..., None])[..., 0]
        factors = [solved[..., i] / norm for i, norm in enumerate(norms)]
    z -= series.spread(factors[0])  # in place where z is an array of NumPy
    for b, factor in zip(basis, factors[1:], strict=True):
        term = series.spread(factor)
        term *= b
        z -= term
    return z if weight is None else z * weight


def _lag_one(z, weight, series: Segments, xp: ModuleType):
    """Lag-1 autocorrelation of each series over pairs of valid points; z is 0 at the others, and loses its mean."""
    one_less = series.shorter
    if weight is None:
        total, pairs = series.points.astype(z.dtype), one_less.points.astype(z.dtype)
        z -= series.spread(series.sums(z) / total)
    else:
        total, pairs = series.sums(weight), xp.maximum(one_less.sums(followed(weight, xp)), 1.0)
        z = (z - series.spread(series.sums(z) / xp.maximum(total, 1.0))) * weight
    square = series.sums(z * z)
    positive = square > 0
    return xp.where(positive, one_less.sums(followed(z, xp)) * (total / pairs) / xp.where(positive, square, 1.0), 0.0)


def _order(r1, xp: ModuleType):
    """Fractional order of integration r1/(1 + r1); a series is stationary where it is below `_STATIONARY`."""
    # r1 = -1 would divide by zero: it belongs to a pure alternation, far below every noise type
    return r1 / (1.0 + xp.where(r1 > -0.99, r1, -0.99))


def _type(rho, xp: ModuleType):
    # half up rather than to even, so that a boundary is the same for every number of differences
    return -xp.floor(2.0 * rho + 0.5)


def _alpha_of(z, weight, series: Segments, degree: int, highest: int, xp: ModuleType):
    """Noise type of each series of averaged rate (degree 1) or decimated phase (degree 2)."""
    z = _without_polynomial(z, weight, series, degree, xp)
    alpha, settled = xp.zeros(len(series.lengths), dtype=z.dtype), xp.zeros(len(series.lengths), dtype=bool)
    for differences in range(highest + 1):
        rho = _order(_lag_one(z, weight, series, xp), xp)
        here = _type(rho, xp) - 2.0 * differences + (2.0 if degree == 2 else 0.0)
        alpha = xp.where(settled, alpha, here)
        settled = settled | (rho < _STATIONARY)
        if xp is np and settled.all():
            break
        z, series = steps(z, xp), series.shorter
        if weight is not None:
            weight = followed(weight, xp)
            z = z * weight
    return alpha


class _Plan(NamedTuple):
    """Where the phase points of each cluster size lie, in the record and in the array that holds them end to end."""

    points: Int[np.ndarray, " clusters"]
    spans: list[slice]
    series: Segments
    decided: int  # cluster sizes with points enough for an autocorrelation; the ratios take those beyond
    few: Segments


@functools.lru_cache(maxsize=256)
def _planned(held: bytes, samples: int, kind: Kind) -> _Plan:
    """The plan at ascending cluster sizes: many records of one length make it once."""
    sizes = np.frombuffer(held, np.int64)
    points = samples // sizes + 1
    told = np.count_nonzero(points > fewest_averages(kind))
    points = np.minimum(points[:told], _MOST)
    decided = np.count_nonzero(points > FEWEST)
    spans = _spans(samples + 1, sizes[:told], points)
    return _Plan(points, spans, Segments(points, np), int(decided), Segments(points[decided:], np).shorter)


def _types_of_rate(theta, sizes, kind: Kind) -> np.ndarray:
    """`identify` for a rate record without gaps at ascending cluster sizes.

    The autocorrelations follow from moments of the averages. The averages less their line are formed only where the moments
    do not suffice.
    """
    points, spans, series, decided, short = _planned(sizes.tobytes(), len(theta) - 1, kind)
    types = np.zeros(len(sizes))  # nothing is known of a record that is too short
    if not spans:
        return types
    z, moments = moments_of([theta[span] for span in spans], series)
    r1, lost = lag_one(moments[:, :decided], points[:decided] - 1)
    rho = _order(r1, np)
    known, further = _type(rho, np), lost | (rho >= _STATIONARY)
    if further.any():
        chosen = np.flatnonzero(further)
        averages = np.concatenate([z[series.starts[i] : series.stops[i]] for i in chosen.tolist()])
        known[chosen] = _alpha_of(averages, None, Segments(points[chosen], np).shorter, 1, kind.order, np)
    low = high = np.minimum(np.maximum(known, -2 if kind.order == 2 else -4), 2)
    told = len(spans)
    if decided < told:
        thinned, few = functools.partial(thinned_sums, theta, None, "rate", np), sizes[decided:told]
        bounds = bounds_of_ratios(z[series.starts[decided] :], None, short, few, kind, len(theta) - 1, thinned, np)
        low, high = (np.concatenate([low, bound]) for bound in bounds)
    types[:told] = carried_on(low, high, 0.0, np)
    types[told:] = types[told - 1]
    return types


def _spans(length: int, sizes, points) -> list[slice]:
    """For each cluster size `points` phase points that far apart, in the middle of the record."""
    first = ((length - 1) // sizes + 1 - points) // 2 * sizes
    return [slice(*span) for span in zip(first.tolist(), (first + (points - 1) * sizes + 1).tolist(), sizes.tolist(), strict=True)]


def identify(theta, missing, m: np.ndarray, kind: Kind, samples: int, data: str, xp: ModuleType = np):
    """Noise types at the cluster sizes m, (clusters,).

    The series of all cluster sizes stand in one array, end to end.

    Parameters
    ----------
    theta : (points,) phase in samples.
    missing : (points,) running number of missing samples ("rate"), or 1 at missing points ("phase"); None without gaps.
    m : cluster sizes.
    kind : the statistic; it sets how often the series may be differenced and the range of alpha.
    samples : number of rate samples.
    data : "rate" or "phase", what was recorded.
    xp : numpy, or jax.numpy where theta is traced.
    """
    order = np.argsort(m, kind="stable")
    sizes = m[order]
    if missing is None and data == "rate" and xp is np:
        return _types_of_rate(theta, sizes, kind)[np.argsort(order, kind="stable")]
    points = samples // sizes + 1
    decided = int(np.count_nonzero(points - (1 if data == "rate" else 0) >= FEWEST))
    told = int(np.count_nonzero(points > fewest_averages(kind)))
    # a type is that of the next smaller cluster size, held between two bounds: equal where it is identified, infinite where nothing is
    beyond = xp.full(len(sizes) - told, np.inf, dtype=theta.dtype)
    bounds = [(-beyond, beyond)]
    if told > decided:
        z, weight, series = _series(theta, missing, sizes[decided:told], points[decided:told], data, xp)
        if data == "phase":
            z, series = steps(z, xp), series.shorter
            weight = None if weight is None else followed(weight, xp)
        z = z / np.repeat(sizes[decided:told], series.lengths).astype(z.dtype)
        thinned = functools.partial(thinned_sums, theta, missing, data, xp)
        bounds.insert(0, bounds_of_ratios(z, weight, series, sizes[decided:told], kind, samples, thinned, xp))
    if decided:
        z, weight, series = _series(theta, missing, sizes[:decided], np.minimum(points[:decided], _MOST), data, xp)
        enough = None
        if weight is not None:
            enough = series.sums(weight) >= FEWEST
            # ones keep the algebra finite where there are too few; not used then
            weight = xp.maximum(weight, 1.0 - series.spread(enough.astype(z.dtype)))
            z = z * weight
        alpha = xp.clip(_alpha_of(z, weight, series, 1 if data == "rate" else 2, kind.order, xp), -2 if kind.order == 2 else -4, 2)
        low, high = (alpha, alpha) if enough is None else (xp.where(enough, alpha, -np.inf), xp.where(enough, alpha, np.inf))
        bounds.insert(0, (low, high))
    low, high = (xp.concatenate(values) for values in zip(*bounds, strict=True))
    return carried_on(low, high, 0.0, xp)[np.argsort(order, kind="stable")]


def noise_types(theta, marks, sizes, kind: Kind, samples: int, data: str) -> np.ndarray:
    """Noise types at ascending cluster sizes, (clusters,), as `identify` finds them.

    Of more than 512 cluster sizes 512, spaced evenly in their logarithm, are identified; each of the others has the type of the
    next smaller one identified.

    Parameters
    ----------
    theta : (points,) phase in samples.
    marks : what `identify` takes as missing.
    sizes : ascending cluster sizes.
    kind, samples, data : as for `identify`.
    """
    if len(sizes) <= _MOST_SIZES:
        return identify(theta, marks, sizes, kind, samples, data)
    # rounding up keeps the first; small sizes are few per decade, so fewer than 512 remain
    chosen = np.unique(np.searchsorted(sizes, np.geomspace(sizes[0], sizes[-1], _MOST_SIZES)).clip(max=len(sizes) - 1))
    found = identify(theta, marks, sizes[chosen], kind, samples, data)
    return found[np.searchsorted(chosen, np.arange(len(sizes)), side="right") - 1]


def types_for_intervals(alpha, m: np.ndarray, samples, data: str, xp: ModuleType = np):
    """Noise types to take the degrees of freedom from, (clusters, channels): with few averages the redder of two estimates.

    Where the ratios decide, they call white rate noise phase noise once in seven times, whose edf is several times larger. The
    redder of their type and the last one that the autocorrelation gave keeps the intervals at their level: measured on 400
    records of 1000 samples, T/tau = 25 to 3, 95 % intervals of oadev hold 92-98 % for N, B, K and N with K; by the ratios alone 85-97 %.
    """
    decided = np.asarray(samples) // m[:, None] + (1 if data == "phase" else 0) >= FEWEST
    if decided.all() or not decided.any():
        return alpha
    last = alpha[np.argmax(decided * m[:, None], axis=0), np.arange(alpha.shape[1])]
    last = xp.where(decided.any(axis=0), last, 2.0).astype(alpha.dtype)
    return xp.where(decided, alpha, xp.minimum(alpha, last[None, :]))


def _series(theta, missing, sizes, points, data: str, xp: ModuleType):
    """For each cluster size `points` phase points that far apart, from the middle of the record ("rate": their differences).

    The series, 1 where they are valid and 0 elsewhere (None: everywhere), and where they lie in the array.
    """
    spans = _spans(theta.shape[0], sizes, points)

    def taken(array):
        return xp.concatenate([array[span] for span in spans])

    z, series = taken(theta), Segments(points, xp)
    lost = None if missing is None else taken(missing)
    if data == "phase":
        return z, None if lost is None else (lost == 0).astype(z.dtype), series
    return steps(z, xp), None if lost is None else (steps(lost, xp) == 0).astype(z.dtype), series.shorter
