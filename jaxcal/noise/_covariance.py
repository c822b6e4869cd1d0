r"""Exact covariance of overlapped Allan variances across cluster sizes, for Gaussian noise and a record of finite length.

.. math:: \mathrm{Cov}(v_m, v_{m'}) = \frac{2}{M_m M_{m'}} \sum_h \mathrm{cnt}(h)\, c_{mm'}(h)^2,\qquad
          c_{mm'}(h) = \frac{1}{2mm'} \sum_{a,b=0}^{2} w_a w_b\, G(h + b m' - a m),\quad w = (1, -2, 1)

where c is the covariance of two second differences at a lag h (`Term.lagged`), G the generalised covariance of phase, and cnt(h) the
number of pairs at that lag. c is linear in the squared coefficients, so the covariance is a quadratic form in them. Its tensor depends
only on the record length, the cluster sizes, the sampling interval and the terms, and is cached.

The sum over lags is computed as follows. The summand is smooth between the lags at which the ends of
two clusters coincide. Each such range of lags is divided into parts that become shorter towards its ends, and summed by Gauss quadrature
for sums (with the nodes of the discrete Chebyshev polynomials), which is exact for polynomials. The cost therefore does not depend on
the length of the record.
"""

import functools
import itertools
from collections.abc import Sequence

import jax
import numpy as np

from .._errors import DataError
from .._precision import array_module, host_float64
from .._types import AnyArray, Checked, Float
from ._model import Noise
from ._terms import Ramp, Term

#: nodes of a rule; ranges of lags up to this length are summed term by term
_NODES, _DIRECT = 10, 24


@functools.lru_cache(maxsize=64)
def covariance_tensor(samples: int, m: tuple[int, ...], dt: float, terms: tuple[Term, ...]) -> Float[np.ndarray, "p p clusters clusters"]:
    """Tensor T with Cov(v_m, v_m') = sum_ij theta_i theta_j T[i, j], where theta are the squared coefficients.

    `samples` is the number of rate samples of the record.
    """
    clusters = len(m)
    tensor = np.zeros((len(terms), len(terms), clusters, clusters))
    if unknown := [term.name for term in terms if term.lagged(np.zeros(1), 1, 1, dt) is None]:
        raise DataError(
            f'the covariance of Allan variances has no closed form for {", ".join(unknown)}; fit with method "whittle"',
            code="no_closed_form",
        )
    pairs = np.array([(i, j) for i in range(clusters) for j in range(i + 1)])
    small, large = np.sort(np.array(m)[pairs], axis=1).T
    tensor[:, :, *pairs.T] = _closed(samples, small, large, dt, terms)
    tensor[:, :, pairs[:, 1], pairs[:, 0]] = tensor[:, :, pairs[:, 0], pairs[:, 1]]
    tensor.flags.writeable = False
    return tensor


@host_float64
def allan_covariance(noise: Noise, samples: int, m: Checked[Sequence[int] | AnyArray], dt: float) -> Float[AnyArray, "clusters clusters"]:
    r"""Exact covariance of the overlapped Allan variances of a record, across cluster sizes.

    If second differences of Gaussian noise have the covariance c(h) at a lag of h samples, their squares have the covariance 2 c(h)^2,
    so that

    .. math:: \mathrm{Cov}(\sigma^2_m, \sigma^2_{m'}) = \frac{2}{M_m M_{m'}} \sum_h \mathrm{cnt}(h)\, c_{mm'}(h)^2

    where M = samples - 2m + 1 is the number of differences of cluster size m, and cnt(h) the number of pairs of them at lag h. The cost
    does not depend on the length of the record. A ramp is not random: it contributes only through its product with the noise.
    Variances of neighbouring cluster sizes share most of their samples, so that correlations above 0.9 are common.

    Parameters
    ----------
    noise : noise model of one channel, without sinusoids.
    samples : number of rate samples of the record, which must have no gaps.
    m : (clusters,) cluster sizes in samples, each at most half the record.
    dt : sampling interval in s.

    Returns
    -------
    (clusters, clusters) array in the unit of B to the fourth power. The degrees of freedom are :math:`2\sigma^4` divided by its diagonal.
    It can be differentiated with respect to the coefficients.

    Raises
    ------
    DataError
        If the model has sinusoids, terms of your own, several channels or no coefficient, or a cluster size does not fit into the record.

    Examples
    --------
    White noise has M^2/(M + (M - 1)/2) degrees of freedom at a cluster size of one sample, about two thirds of the number of samples:

    >>> import numpy as np
    >>> from jaxcal.noise import Noise, allan_covariance
    >>> noise, m = Noise(N=1e-3), np.array([1, 10, 100])
    >>> covariance = allan_covariance(noise, 10_000, m, 0.01)
    >>> (2 * noise.avar(0.01 * m, dt=0.01) ** 2 / covariance.diagonal()).round(1).tolist()
    [6666.2, 1479.4, 147.8]

    References
    ----------
    Sum over lags: C. A. Greenhall and W. J. Riley, Proc. 35th PTTI Meeting, 2003, 267-280.
    """
    parts = [(coefficient, term) for _, coefficient, term in noise.parts if not (isinstance(coefficient, float) and coefficient == 0.0)]
    if not parts or any(np.ndim(value) for value in jax.tree.leaves(noise)) or noise.sinusoid:
        raise DataError("noise must be the model of one channel with a coefficient above zero and no sinusoids; take noise.channel(i)")
    if not (sizes := tuple(int(size) for size in m)) or min(sizes) < 1 or 2 * max(sizes) > samples:
        raise DataError(f"m must be cluster sizes from 1 to half of the {samples} samples; got {m!r}")
    with jax.ensure_compile_time_eval():
        tensor = covariance_tensor(samples, sizes, dt, tuple(term for _, term in parts))
    xp = array_module(noise)
    theta = xp.stack([xp.asarray(coefficient) for coefficient, _ in parts]) ** 2
    return xp.einsum("i,ijab,j->ab", theta, tensor, theta)


def _closed(samples: int, small: np.ndarray, large: np.ndarray, dt: float, terms: tuple[Term, ...]) -> np.ndarray:
    """(p, p, pairs) of terms with a closed form, at pairs of cluster sizes.

    The lag at which the two differences have one centre is a place of symmetry, so only the lags from there on are visited.
    """
    first, second = samples - 2 * small + 1, samples - 2 * large + 1
    lags, weight, begin = _nodes(small, large, second)
    pair = np.repeat(np.arange(len(small)), np.diff(begin, append=len(lags)))
    m, other = small[pair].astype(float), large[pair].astype(float)
    weight = weight * np.maximum(np.minimum(first[pair], second[pair] - lags) - np.maximum(0.0, -lags), 0.0)
    weight = np.where(lags == m - other, weight, 2.0 * weight)
    lagged, scale = [np.asarray(term.lagged(lags, m, other, dt)) for term in terms], 2.0 / (first * second)
    found = np.zeros((len(terms), len(terms), len(small)))
    for i, j in itertools.combinations_with_replacement(range(len(terms)), 2):
        if not (isinstance(terms[i], Ramp) and isinstance(terms[j], Ramp)):
            found[i, j] = found[j, i] = scale * np.add.reduceat(lagged[i] * lagged[j] * weight, begin)
    return found


def _nodes(small: np.ndarray, large: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lags from the centre on and weights that sum any summand smooth between the knots, pair after pair, and where each pair begins."""
    starts, steps, counts = [], [], []
    for m, other, number in zip(small.tolist(), large.tolist(), second.tolist(), strict=True):
        low, end = m - other, number
        knots = {a * m - b * other for a in range(3) for b in range(3)} | {0}
        cuts = sorted({min(max(cut + more, low), end) for cut in knots for more in (0, 1)} | {end})  # a knot belongs to both sides
        edges = [a + edge for a, b in itertools.pairwise(cuts) for edge in _graded(b - a)]
        starts += edges
        steps += [b - a for a, b in itertools.pairwise([*edges, end])]
        counts.append(len(edges))
    start, length = np.array(starts, dtype=float), np.array(steps)
    sizes, kind = np.unique(length, return_inverse=True)
    nodes, weights, each = _sum_rules(sizes)
    number = each[kind]
    place = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    rule = np.repeat(kind, number)
    owner = np.concatenate([[0], np.cumsum(counts)[:-1]])
    begin = (np.cumsum(number) - number)[owner]
    return np.repeat(start, number) + nodes[rule, place], weights[rule, place], begin


def _graded(length: int) -> list[int]:
    """Where the steps from 0 to length begin; they double from both ends."""
    half = length // 2
    steps = [0, *(step for i in range(half.bit_length()) if (step := _DIRECT << i) < half)]
    return [*steps, *(length - step for step in steps[:0:-1])]


def _sum_rules(sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each length nodes x and weights w with sum_{k<length} f(k) = sum w f(x), and their number: Golub and Welsch.

    Exact for polynomials of degree 2 _NODES - 1; short stretches are summed as they are.
    """
    nodes = np.tile(np.arange(float(_DIRECT)), (len(sizes), 1))
    weights, number, long = np.ones_like(nodes), np.minimum(sizes, _DIRECT), sizes > _DIRECT
    if long.any():
        length, k = sizes[long, None].astype(float), np.arange(1.0, _NODES)  # of the recurrence of the discrete Chebyshev polynomials
        matrix = np.zeros((len(length), _NODES, _NODES))
        row = np.arange(_NODES - 1)
        matrix[:, row + 1, row] = matrix[:, row, row + 1] = 0.5 * length * np.sqrt((1.0 - (k / length) ** 2) / (4.0 - 1.0 / k**2))
        values, vectors = np.linalg.eigh(matrix)
        nodes[long, :_NODES], weights[long, :_NODES] = values + (length - 1) / 2.0, length * vectors[:, 0] ** 2
        number = np.where(long, _NODES, number)
    return nodes, weights, number
