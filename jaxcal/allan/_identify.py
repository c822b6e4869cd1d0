"""Noise type at each cluster size: by the lag-1 autocorrelation, and by the ratios B1 and R(n) where points are few.

W. J. Riley and C. A. Greenhall, "Power law noise identification using the lag 1 autocorrelation", EFTF 2004. A fractionally
integrated process has r1/(1+r1) = delta; differencing until it is stationary gives alpha = -2 (delta + differences).
"""

import functools
from types import ModuleType

import numpy as np

from ._kinds import Kind
from ._moments import lag_one, moments_of, moments_of_rows
from ._ratios import bounds_of_ratios, carried_on, fewest_averages, thinned_sums
from ._segments import Segments, followed, steps

FEWEST = 30  # averaged points that the lag-1 autocorrelation needs; with fewer, the ratios decide
_STATIONARY = 0.25
_MOST = 1 << 11  # averaged points used: r1 to 0.022, where half a unit of alpha is 0.1 and more
#: phase of a record, cluster sizes, and how many phase points to take at each
_Cut = tuple[np.ndarray, np.ndarray, np.ndarray]


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


def types_of_rates(thetas: list[np.ndarray], sizes: list[np.ndarray], kind: Kind) -> list[np.ndarray]:
    """`identify` for several rate records without gaps at once: what takes a step of Python takes one for all of them.

    Parameters
    ----------
    thetas : (points,) phase in samples of each record.
    sizes : ascending cluster sizes for each record.
    kind : the statistic.
    """
    if not thetas:
        return []
    records, samples = range(len(thetas)), [len(theta) - 1 for theta in thetas]
    points = [n // m + 1 for n, m in zip(samples, sizes, strict=True)]
    decided = [int(np.count_nonzero(p > FEWEST)) for p in points]
    told = [int(np.count_nonzero(p > fewest_averages(kind))) for p in points]
    pairs = [(thetas[i], sizes[i][: decided[i]], np.minimum(points[i][: decided[i]], _MOST)) for i in records]
    known = _by_autocorrelation(pairs, kind) if any(decided) else np.zeros(0)
    which = np.repeat(records, np.subtract(told, decided))
    low = high = np.zeros(0)
    if len(which):
        pairs = [(thetas[i], sizes[i][decided[i] : told[i]], points[i][decided[i] : told[i]]) for i in records]
        averages, series = _averages(pairs)
        few = np.concatenate([part[1] for part in pairs])
        sums = functools.cache(lambda i: thinned_sums(thetas[i], None, "rate", np))
        bounds = bounds_of_ratios(
            averages / np.repeat(few, series.lengths), None, series, few, kind, np.take(samples, which), lambda j: sums(int(which[j])), np,
        )  # fmt: skip
        low, high = bounds
    found, at, beside = [], 0, 0
    for i in records:
        here, bounded = known[at : at + decided[i]], slice(beside, beside + told[i] - decided[i])
        at, beside = at + decided[i], beside + told[i] - decided[i]
        beyond = np.full(len(sizes[i]) - told[i], np.inf)
        found.append(carried_on(np.concatenate([here, low[bounded], -beyond]), np.concatenate([here, high[bounded], beyond]), 0.0, np))
    return found


def _by_autocorrelation(pairs: list[_Cut], kind: Kind) -> np.ndarray:
    """Noise types at all cluster sizes of all records, each of which has points enough.

    From the moments of the averages, which are formed themselves only where need be.
    """
    full = [int(np.count_nonzero(points == _MOST)) for _, _, points in pairs]
    moments = []
    for (theta, sizes, _), many in zip(pairs, full, strict=True):
        if many:
            z = np.empty((many, _MOST - 1))
            for row, size in zip(z, sizes[:many].tolist(), strict=True):
                start = _first(len(theta), size, _MOST)
                held = theta[start : start + (_MOST - 1) * size + 1 : size]
                np.subtract(held[1:], held[:-1], out=row)
            moments.append(moments_of_rows(z))
    fewer = [(theta, sizes[many:], points[many:]) for (theta, sizes, points), many in zip(pairs, full, strict=True)]
    if any(len(sizes) for _, sizes, _ in fewer):
        moments.append(moments_of(*_averages(fewer)))
    # back from all the full series and all the others to one record after another
    lengths = [len(sizes) for _, sizes, _ in pairs]
    is_full = np.concatenate([np.arange(n) < many for n, many in zip(lengths, full, strict=True)])
    place = np.argsort(np.argsort(~is_full, kind="stable"), kind="stable")
    points = np.concatenate([points for _, _, points in pairs])
    r1, lost = lag_one(np.concatenate(moments)[place], points - 1)
    rho = _order(r1, np)
    alpha, further = _type(rho, np), lost | (rho >= _STATIONARY)
    if further.any():
        parts = np.split(further, np.cumsum(lengths)[:-1])
        again = [(theta, sizes[part], points[part]) for (theta, sizes, points), part in zip(pairs, parts, strict=True)]
        averages, series = _averages(again)
        alpha[further] = _alpha_of(averages, None, series, 1, kind.order, np)
    return np.clip(alpha, -2 if kind.order == 2 else -4, 2)


def _averages(pairs: list[_Cut]) -> tuple[np.ndarray, Segments]:
    """Sums of the rate over each cluster, of one cluster size and one record after another."""
    parts, lengths = [], []
    for theta, sizes, points in pairs:
        for size, count in zip(sizes.tolist(), points.tolist(), strict=True):
            start = _first(len(theta), size, count)
            parts.append(theta[start : start + (count - 1) * size + 1 : size])
            lengths.append(count)
    return steps(np.concatenate(parts), np), Segments(np.array(lengths), np).shorter()


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
        return types_of_rates([theta], [sizes], kind)[0][np.argsort(order, kind="stable")]
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
