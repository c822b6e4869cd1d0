"""Noise type at each cluster size: by the lag-1 autocorrelation, and by the ratios B1 and R(n) where points are few.

W. J. Riley and C. A. Greenhall, "Power law noise identification using the lag 1 autocorrelation", EFTF 2004. A fractionally
integrated process has r1/(1+r1) = delta; differencing until it is stationary gives alpha = -2 (delta + differences).
"""

import functools
from types import ModuleType

import numpy as np

from ._kinds import Kind
from ._ratios import fewest_averages, noise_type_of_ratios, thinned_sums

FEWEST = 30  # averaged points that the lag-1 autocorrelation needs; with fewer, the ratios decide
_MOST = 1 << 13  # averaged points used: r1 to 0.011, where half a unit of alpha is 0.1 and more


@functools.lru_cache(maxsize=512)
def _polynomials(points: int, degree: int) -> np.ndarray:
    """Orthonormal polynomials in time, (points, degree + 1)."""
    t = np.arange(points) - (points - 1) / 2.0
    columns = [np.ones(points), t, t**2 - (points**2 - 1) / 12.0][: degree + 1]  # Gram's polynomials, orthogonal as they are
    basis = np.stack([column / np.linalg.norm(column) for column in columns], axis=1)
    basis.flags.writeable = False
    return basis


def _without_polynomial(z, valid, degree: int, xp: ModuleType):
    """Residual of a least-squares polynomial in time over the valid points, 0 at the others; all are valid where `valid` is None."""
    basis = _polynomials(z.shape[0], degree).astype(z.dtype)
    if valid is None:
        return z - basis @ (basis.T @ z)
    rows = xp.where(valid[:, None], basis, 0.0)
    ridge = 1e-12 * np.eye(degree + 1, dtype=z.dtype)
    return xp.where(valid, z - basis @ xp.linalg.solve(rows.T @ rows + ridge, rows.T @ z), 0.0)


def _lag_one(z, valid, xp: ModuleType):
    """Lag-1 autocorrelation over pairs of valid points; z is 0 at the others."""
    if valid is None:
        z = z - xp.mean(z)
        total, pairs = z.shape[0], z.shape[0] - 1
    else:
        total, pairs = (xp.sum(v).astype(z.dtype) for v in (valid, valid[1:] & valid[:-1]))
        pairs = xp.maximum(pairs, 1.0)
        z = xp.where(valid, z - xp.sum(z) / total, 0.0)
    square = z @ z
    positive = square > 0
    return xp.where(positive, (z[1:] @ z[:-1]) * (total / pairs) / xp.where(positive, square, 1.0), 0.0)


def _alpha_of(z, valid, degree: int, highest: int, xp: ModuleType):
    """Noise type of averaged rate (degree 1) or decimated phase (degree 2)."""
    z = _without_polynomial(z, valid, degree, xp)
    alpha, settled = 0.0, False
    for differences in range(highest + 1):
        r1 = _lag_one(z, valid, xp)
        # r1 = -1 would divide by zero: it belongs to a pure alternation, far below every noise type
        rho = r1 / (1.0 + xp.where(r1 > -0.99, r1, -0.99))
        # half up rather than to even, so that a boundary is the same for every number of differences
        here = -xp.floor(2.0 * rho + 0.5) - 2.0 * differences + (2.0 if degree == 2 else 0.0)
        alpha = xp.where(settled, alpha, here)
        settled = settled | (rho < 0.25)
        if xp is np and settled:
            break
        z = z[1:] - z[:-1]
        if valid is not None:
            valid = valid[1:] & valid[:-1]
            z = xp.where(valid, z, 0.0)
    return alpha


def identify(theta, missing, m: np.ndarray, kind: Kind, samples: int, data: str, xp: ModuleType = np):
    """Noise types at the cluster sizes m, (clusters,).

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
    lowest, degree = (-2 if kind.order == 2 else -4), (1 if data == "rate" else 2)
    found, carried = [], xp.zeros(())
    sums = functools.cache(functools.partial(thinned_sums, theta, missing, data, xp))
    order = np.argsort(m, kind="stable")
    for size in (int(size) for size in m[order]):
        points = samples // size + 1
        if points - (1 if data == "rate" else 0) >= FEWEST:
            z, valid = _thinned(theta, missing, size, min(points, _MOST), data)
            if data == "rate":
                z = z[1:] - z[:-1]
            if valid is None:
                carried = xp.clip(_alpha_of(z, None, degree, kind.order, xp), lowest, 2)
            else:
                enough = xp.sum(valid) >= FEWEST
                some = valid | ~enough  # keeps the algebra finite where there are too few; not used then
                alpha = _alpha_of(xp.where(some, z, 0.0), some, degree, kind.order, xp)
                carried = xp.where(enough, xp.clip(alpha, lowest, 2), carried)
        elif points > fewest_averages(kind):
            z, valid = _thinned(theta, missing, size, points, data)
            if valid is not None and data == "phase":
                valid = valid[1:] & valid[:-1]
            carried = noise_type_of_ratios((z[1:] - z[:-1]) / size, valid, sums, size, kind, samples, carried, xp)
        found.append(carried)
    back = np.argsort(order, kind="stable")
    return xp.stack(found)[back]


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


def _thinned(theta, missing, size: int, points: int, data: str):
    """`points` phase points `size` apart from the middle of the record, and which are there ("rate": which averages); None: all."""
    first = (theta.shape[0] - 1) // size + 1 - points
    first = first // 2 * size
    chosen = slice(first, first + points * size, size)
    if missing is None:
        return theta[chosen][:points], None
    lost = missing[chosen][:points]
    return theta[chosen][:points], lost[1:] == lost[:-1] if data == "rate" else lost == 0
