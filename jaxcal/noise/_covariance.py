r"""Exact covariance of overlapped Allan variances across cluster sizes, for Gaussian noise and a record of finite length.

.. math:: \mathrm{Cov}(v_m, v_{m'}) = \frac{2}{M_m M_{m'}} \sum_h \mathrm{cnt}(h)\, c_{mm'}(h)^2,\qquad
          c_{mm'}(h) = \frac{1}{2mm'} \sum_{a,b=0}^{2} w_a w_b\, G(h + b m' - a m),\quad w = (1, -2, 1)

where c is the covariance of two second differences a lag h apart, G the generalised covariance of phase of
`jaxcal.noise._columns`, and cnt(h) the number of pairs. c is linear in the squared coefficients, so the covariance is a
quadratic form in them whose tensor depends on the record length and the cluster sizes alone; it is kept.

Between the places where a cluster ends on another's end, the summand is smooth. Each such stretch is cut geometrically
towards its ends and summed by Gauss quadrature for sums (nodes of the discrete Chebyshev polynomials), which is exact for
polynomials: the cost does not depend on the length of the record.
"""

import functools
import itertools

import numpy as np
import scipy.special

from .._types import Float

_NODES = 10
_DIRECT = 24  # stretches up to this length are summed as they are
_W = (1.0, -2.0, 1.0)


@functools.lru_cache(maxsize=64)
def covariance_tensor(samples: int, m: tuple[int, ...], dt: float, terms: tuple[str, ...]) -> Float[np.ndarray, "p p clusters clusters"]:
    """T with Cov(v_m, v_m') = sum_ij theta_i theta_j T[i, j], theta the squared coefficients.

    Parameters
    ----------
    samples : number of rate samples.
    m : cluster sizes.
    dt : sampling interval in s.
    terms : names among Q, N, B, K, R.
    """
    clusters = len(m)
    tensor = np.zeros((len(terms), len(terms), clusters, clusters))
    for i, small in enumerate(m):
        for j in range(i, clusters):
            values = _pair(samples, min(small, m[j]), max(small, m[j]), dt, terms)
            tensor[:, :, i, j] = tensor[:, :, j, i] = values
    tensor.flags.writeable = False
    return tensor


def covariance(tensor, theta):
    """Covariance of the Allan variances at squared coefficients theta: (clusters, clusters)."""
    return ((tensor * theta[:, None, None, None]).sum(axis=0) * theta[:, None, None]).sum(axis=0)


def _pair(samples: int, small: int, large: int, dt: float, terms: tuple[str, ...]) -> np.ndarray:
    first, second = samples - 2 * small + 1, samples - 2 * large + 1
    knots = np.unique([a * small - b * large for a in range(3) for b in range(3)])
    h, weight = _nodes(knots, -first + 1, second - 1, first, second)
    weight = weight * np.maximum(np.minimum(first, second - h) - np.maximum(0, -h), 0.0)
    smooth = [_lagged(term, h, small, large, dt) for term in terms]
    values = np.array([[np.dot(weight, a * b) for b in smooth] for a in smooth])
    if "Q" in terms:
        q = terms.index("Q")
        inside = knots[(knots > -first) & (knots < second)]
        number = np.minimum(first, second - inside) - np.maximum(0, -inside)
        strength = np.array(
            [sum(_W[a] * _W[b] for a in range(3) for b in range(3) if a * small - b * large == k) for k in inside]
        ) / (2.0 * small * large * dt**2)  # fmt: skip
        for other, term in enumerate(terms):
            there = strength if term == "Q" else _lagged(term, inside.astype(float), small, large, dt)
            values[q, other] = values[other, q] = np.dot(number * strength, there)
    if "R" in terms:
        ramp = terms.index("R")
        values[ramp, ramp] = 0.0  # a ramp is not random; it only multiplies the noise
    return 2.0 / (first * second) * values


def _lagged(term: str, h, small: int, large: int, dt: float):
    """c_{mm'}(h) per squared coefficient; Q, which lives on the knots alone, is added by the caller."""
    if term == "Q":
        return np.zeros_like(h)
    if term == "R":
        return np.full_like(h, dt**2 * small * large / 2.0)
    inner = {"N": _inner_white, "K": _inner_walk, "B": _inner_flicker}[term]
    centre = h - small
    outer = inner(centre, small) - 2.0 * inner(centre + large, small) + inner(centre + 2 * large, small)
    return outer * {"N": 1.0 / dt, "K": dt, "B": 1.0}[term] / (2.0 * small * large)


def _inner_white(x, m: int):
    """Second difference of -|x|/2 with step m."""
    return -np.maximum(m - np.abs(x), 0.0)


def _inner_walk(x, m: int):
    """Second difference of (|x|^3 - |x|)/12 with step m."""
    x = np.abs(x)
    cubic = np.where(x >= m, 6.0 * m**2 * x, 2.0 * m**3 + 6.0 * m * x**2 - 2.0 * x**3)
    return (cubic - 2.0 * np.maximum(m - x, 0.0)) / 12.0


def _inner_flicker(x, m: int):
    """Second difference with step m of (4 x^2 - 1) psi(|x| + 1/2) / (8 pi), flicker's phase covariance.

    Polynomials up to the third degree are left out, since the outer second difference removes what is left of them. Far
    from zero the difference is formed from derivatives of 4 x^2 ln x - ln x + 1/6, for it would cancel.
    """
    x = np.abs(np.asarray(x, dtype=float))
    far = x > 32 * m + 64
    out = np.empty_like(x)
    z = x[far]
    r = (m / z) ** 2
    series = 4.0 * np.log(z) + 6.0 - r * (1 / 3 + r * (1 / 15 + r / 42)) + (0.5 + 0.25 * r) / z**2
    out[far] = 2.0 * m**2 * series
    near = x[~far]
    out[~far] = _phase_flicker(near - m) - 2.0 * _phase_flicker(near) + _phase_flicker(near + m)
    return out / (8.0 * np.pi)


def _phase_flicker(x):
    x = np.abs(x)
    return (4.0 * x**2 - 1.0) * scipy.special.digamma(x + 0.5)


def _nodes(knots, low: int, high: int, first: int, second: int):
    """Lags and weights that sum any summand smooth between the knots over low .. high."""
    cuts = np.unique(np.clip(np.concatenate([knots, [low, high + 1, 0, second - first]]), low, high + 1))
    cuts = np.unique(np.concatenate([cuts, np.clip(cuts + 1, low, high + 1)]))  # a knot by itself: it belongs to both sides
    starts, lengths = [], []
    for a, b in itertools.pairwise(cuts):
        edges = _graded(int(b - a))
        starts.append(a + edges[:-1])
        lengths.append(np.diff(edges))
    start, length = np.concatenate(starts), np.concatenate(lengths)
    lags, weights = [], []
    for size in np.unique(length):
        x, w = _sum_rule(int(size))
        here = start[length == size]
        lags.append((here[:, None] + x[None, :]).ravel())
        weights.append(np.tile(w, len(here)))
    return np.concatenate(lags), np.concatenate(weights)


def _graded(length: int) -> np.ndarray:
    """Edges from 0 to length whose steps double from both ends."""
    steps, half = [0], length // 2
    size = _DIRECT
    while steps[-1] + size < half:
        steps.append(steps[-1] + size)
        size = steps[-1]
    left = np.array(steps)
    return np.unique(np.concatenate([left, length - left]))


@functools.lru_cache(maxsize=4096)
def _sum_rule(length: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes x and weights w with sum_{k<length} f(k) = sum w f(x), exact for polynomials of degree 2 _NODES - 1.

    Golub and Welsch on the recurrence of the discrete Chebyshev polynomials.
    """
    if length <= _DIRECT:
        return np.arange(float(length)), np.ones(length)
    k = np.arange(1.0, _NODES)
    off = 0.5 * length * np.sqrt((1.0 - (k / length) ** 2) / (4.0 - 1.0 / k**2))
    matrix = np.diag(off, 1) + np.diag(off, -1)
    values, vectors = np.linalg.eigh(matrix)
    return values + (length - 1) / 2.0, length * vectors[0] ** 2
