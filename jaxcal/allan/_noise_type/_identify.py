"""Noise type at each cluster size: by the lag-1 autocorrelation, and by the ratios B1 and R(n) where points are few.

W. J. Riley and C. A. Greenhall, "Power law noise identification using the lag 1 autocorrelation", EFTF 2004. A fractionally
integrated process has r1/(1+r1) = delta; differencing until it is stationary gives alpha = -2 (delta + differences).
"""

import functools
from types import ModuleType

import numpy as np

from .._kinds import Kind
from ._b1_ratio import bounds_of_ratios, carried_on, fewest_averages, thinned_sums
from ._lag_one import lag_one, moments_of, moments_of_rows
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
    one_less = series.shorter()
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
        z, series = steps(z, xp), series.shorter()
        if weight is not None:
            weight = followed(weight, xp)
            z = z * weight
    return alpha


def _types_of_rate(theta, sizes, kind: Kind) -> np.ndarray:
    """`identify` for a rate record without gaps at ascending cluster sizes, from few passes over the record."""
    samples = len(theta) - 1
    points = samples // sizes + 1
    decided, told = np.count_nonzero(points > FEWEST), np.count_nonzero(points > fewest_averages(kind))
    low = high = known = np.zeros(0)
    if decided:
        known = _by_autocorrelation(theta, sizes[:decided], np.minimum(points[:decided], _MOST), kind)
    if told > decided:
        few = sizes[decided:told]
        averages, series = _averages(theta, few, points[decided:told])
        sums = functools.cache(functools.partial(thinned_sums, theta, None, "rate", np))
        averages /= np.repeat(few, series.lengths)
        low, high = bounds_of_ratios(averages, None, series, few, kind, samples, lambda _: sums(), np)
    beyond = np.full(len(sizes) - told, np.inf)
    return carried_on(np.concatenate([known, low, -beyond]), np.concatenate([known, high, beyond]), 0.0, np)


def _by_autocorrelation(theta, sizes, points, kind: Kind) -> np.ndarray:
    """Noise types at ascending cluster sizes, each of which has points enough.

    From the moments of the averages. The averages less their line are formed only where the moments do not suffice.
    """
    many, moments = np.count_nonzero(points == _MOST), []
    if many:  # series of one length, a row each
        z = np.empty((many, _MOST - 1))
        for row, size in zip(z, sizes[:many].tolist(), strict=True):
            start = _first(len(theta), size, _MOST)
            held = theta[start : start + (_MOST - 1) * size + 1 : size]
            np.subtract(held[1:], held[:-1], out=row)
        moments.append(moments_of_rows(z))
    if many < len(sizes):
        moments.append(moments_of(*_averages(theta, sizes[many:], points[many:])))
    r1, lost = lag_one(np.concatenate(moments), points - 1)
    rho = _order(r1, np)
    alpha, further = _type(rho, np), lost | (rho >= _STATIONARY)
    if further.any():
        averages, series = _averages(theta, sizes[further], points[further])
        alpha[further] = _alpha_of(averages, None, series, 1, kind.order, np)
    return np.clip(alpha, -2 if kind.order == 2 else -4, 2)


def _averages(theta, sizes, points) -> tuple[np.ndarray, Segments]:
    """Sums of the rate over each cluster, of one cluster size after another."""
    parts = []
    for size, count in zip(sizes.tolist(), points.tolist(), strict=True):
        start = _first(len(theta), size, count)
        parts.append(theta[start : start + (count - 1) * size + 1 : size])
    return steps(np.concatenate(parts), np), Segments(points, np).shorter()


def _first(length: int, size: int, points: int) -> int:
    """Where `points` points `size` apart begin, so that they lie in the middle of the record."""
    return ((length - 1) // size + 1 - points) // 2 * size


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
            z, series = steps(z, xp), series.shorter()
            weight = None if weight is None else followed(weight, xp)
        z = z / np.repeat(sizes[decided:told], series.lengths).astype(z.dtype)
        sums = functools.cache(functools.partial(thinned_sums, theta, missing, data, xp))
        bounds.insert(0, bounds_of_ratios(z, weight, series, sizes[decided:told], kind, samples, lambda _: sums(), xp))
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
    decided = np.broadcast_to(decided, alpha.shape)
    channels = np.arange(alpha.shape[1])
    last = alpha[np.argmax(np.where(decided, m[:, None], 0), axis=0), channels]
    last = xp.where(decided.any(axis=0), last, xp.full_like(last, 2))
    return xp.where(decided, alpha, xp.minimum(alpha, last[None, :]))


def _series(theta, missing, sizes, points, data: str, xp: ModuleType):
    """For each cluster size `points` phase points that far apart, from the middle of the record ("rate": their differences).

    The series, 1 where they are valid and 0 elsewhere (None: everywhere), and where they lie in the array.
    """
    first = (theta.shape[0] - 1) // sizes + 1 - points
    first = first // 2 * sizes
    spans = [slice(a, b, s) for a, b, s in zip(first.tolist(), (first + (points - 1) * sizes + 1).tolist(), sizes.tolist(), strict=True)]

    def taken(array):
        return xp.concatenate([array[span] for span in spans])

    z, series = taken(theta), Segments(points, xp)
    lost = None if missing is None else taken(missing)
    if data == "phase":
        return z, None if lost is None else (lost == 0).astype(z.dtype), series
    return steps(z, xp), None if lost is None else (steps(lost, xp) == 0).astype(z.dtype), series.shorter()
