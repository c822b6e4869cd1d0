"""Noise type at each cluster size, by the lag-1 autocorrelation.

W. J. Riley and C. A. Greenhall, "Power law noise identification using the lag 1 autocorrelation", EFTF 2004. A fractionally
integrated process has r1/(1+r1) = delta; differencing until it is stationary gives alpha = -2 (delta + differences).
"""

from types import ModuleType

import numpy as np

from ._kinds import Kind

_FEWEST = 30  # averaged points that the estimate needs; beyond, the last value is carried on
_MOST = 1 << 14  # averaged points used: r1 to 0.008, where a quarter of a unit of alpha is 0.06


def _without_polynomial(z, degree: int, xp: ModuleType):
    """Residual of a least-squares polynomial in time, ignoring missing points."""
    n = z.shape[0]
    valid = ~xp.isnan(z)
    t = np.linspace(-1.0, 1.0, n)
    basis = np.stack([t**p for p in range(degree + 1)], axis=1).astype(z.dtype)  # points, powers
    weight = valid.astype(z.dtype)
    products = (basis[:, :, None] * basis[:, None, :]).reshape(n, -1)
    gram = (weight.T @ products).reshape(-1, degree + 1, degree + 1)
    right = xp.where(valid, z, 0.0).T @ basis
    coefficient = xp.linalg.solve(gram + 1e-12 * n * np.eye(degree + 1, dtype=z.dtype)[None], right[..., None])[..., 0]
    return z - basis @ coefficient.T


def _lag_one(z, xp: ModuleType):
    """Lag-1 autocorrelation over pairs without a missing point."""
    z = z - xp.nanmean(z, axis=0, keepdims=True)
    product = z[1:] * z[:-1]
    variance = xp.nanmean(z * z, axis=0)
    return xp.where(variance > 0, xp.nanmean(product, axis=0) / xp.where(variance > 0, variance, 1.0), 0.0)


def _alpha_of(z, degree: int, highest: int, xp: ModuleType):
    """Noise type of averaged rate (degree 1) or decimated phase (degree 2), per channel."""
    z = _without_polynomial(z, degree, xp)
    alpha = settled = None
    for differences in range(highest + 1):
        r1 = _lag_one(z, xp)
        # r1 = -1 would divide by zero: it belongs to a pure alternation, far below every noise type
        rho = r1 / (1.0 + xp.where(r1 > -0.99, r1, -0.99))
        # half up rather than to even, so that a boundary is the same for every number of differences
        here = -xp.floor(2.0 * rho + 0.5) - 2.0 * differences + (2.0 if degree == 2 else 0.0)
        alpha = here if settled is None else xp.where(settled, alpha, here)
        settled = rho < 0.25 if settled is None else settled | (rho < 0.25)
        z = z[1:] - z[:-1]
    return alpha


def identify(theta, missing, m: np.ndarray, kind: Kind, samples: int, data: str, xp: ModuleType = np):
    """Noise types at ascending cluster sizes, (clusters, channels).

    Parameters
    ----------
    theta : (points, channels) phase in samples.
    missing : (points, channels) running number of missing samples ("rate"), or 1 at missing points ("phase"); None without gaps.
    m : cluster sizes.
    kind : the statistic; it sets how often the series may be differenced and the range of alpha.
    samples : number of rate samples.
    data : "rate" or "phase", what was recorded.
    xp : numpy, or jax.numpy where theta is traced.
    """
    channels = theta.shape[1]
    found, carried = [], xp.zeros(channels)
    order = np.argsort(m, kind="stable")
    for size in m[order]:
        size = int(size)
        points = samples // size + 1
        if points - (1 if data == "rate" else 0) >= _FEWEST:
            first = max(points - _MOST, 0) // 2  # the middle of the record
            chosen = slice(first * size, (first + min(points, _MOST)) * size, size)
            z = theta[chosen][: min(points, _MOST)]
            if data == "rate":
                z = z[1:] - z[:-1]
            if missing is not None:
                lost = missing[chosen][: min(points, _MOST)]
                lost = lost[1:] != lost[:-1] if data == "rate" else lost != 0
                z = xp.where(lost, xp.nan, z)
            enough = xp.sum(~xp.isnan(z), axis=0) >= _FEWEST
            z = xp.where(enough[None, :], z, theta[: z.shape[0]])  # keeps the algebra finite; not used
            alpha = _alpha_of(z, 1 if data == "rate" else 2, kind.order, xp)
            carried = xp.where(enough, xp.clip(alpha, -2 if kind.order == 2 else -4, 2), carried)
        found.append(carried)
    back = np.argsort(order, kind="stable")
    return xp.stack(found)[back]
