r"""Exact covariance of overlapped Allan variances across cluster sizes, for Gaussian noise and a record of finite length.

.. math:: \mathrm{Cov}(v_m, v_{m'}) = \frac{2}{M_m M_{m'}} \sum_h \mathrm{cnt}(h)\, c_{mm'}(h)^2,\qquad
          c_{mm'}(h) = \frac{1}{2mm'} \sum_{a,b=0}^{2} w_a w_b\, G(h + b m' - a m),\quad w = (1, -2, 1)

where c is the covariance of two second differences at a lag h (`Term.lagged`), G the generalised covariance of phase, and cnt(h) the
number of pairs at that lag. c is linear in the squared coefficients, so the covariance is a quadratic form in them. Its tensor depends
only on the record length, the cluster sizes, the sampling interval and the terms, and is cached.

If all terms have a closed form, the sum over lags is computed as follows. The summand is smooth between the lags at which the ends of
two clusters coincide. Each such range of lags is divided into parts that become shorter towards its ends, and summed by Gauss quadrature
for sums (with the nodes of the discrete Chebyshev polynomials), which is exact for polynomials. The cost therefore does not depend on
the length of the record.

For a term without a closed form, c follows from the density. Let m' be the larger cluster size, and count h from the lag at which the
two differences have the same centre. The number of pairs is then M' up to m' - m and falls by one per lag beyond, so that

.. math:: \sum_h \mathrm{cnt}\,c_i c_j = \frac{M'}{\pi}\int_0^\pi \hat c_i \hat c_j\,d\omega - \sum_h (M' - \mathrm{cnt})\,c_i c_j,
          \qquad \hat c = \frac{8 S}{mm'\,dt}\,\frac{\sin^2(m\omega/2)\,\sin^2(m'\omega/2)}{s^2}

with s = 2 sin(omega/2). The integral uses the mean of the kernel in narrow bins of frequency. The sum is the contribution of the ends of
the record. It depends on long lags only and is therefore computed in steps of m'/64, from a cosine transform of the density.
"""

import functools
import itertools

import jax
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._precision import array_module, host_float64
from .._types import Any, AnyArray, Float
from ._model import Noise
from ._terms import Ramp, Term

_NODES = 10
_DIRECT = 24  # ranges of lags up to this length are summed term by term
#: edges of the frequency bins of the integral over the density; steps of the sum over lags per larger cluster; number of steps
_EDGES = np.pi * np.geomspace(1e-12, 1.0, 1201)
_MIDDLE, _WIDTH = (_EDGES[1:] + _EDGES[:-1]) / 2.0, np.diff(_EDGES)
_PARTS, _STEPS = 64, 1 << 13
_TOGETHER = 512  # pairs of cluster sizes: a few hundred thousand lags


@functools.lru_cache(maxsize=64)
def covariance_tensor(samples: int, m: tuple[int, ...], dt: float, terms: tuple[Term, ...]) -> Float[np.ndarray, "p p clusters clusters"]:
    """Tensor T with Cov(v_m, v_m') = sum_ij theta_i theta_j T[i, j], where theta are the squared coefficients.

    `samples` is the number of rate samples of the record.
    """
    clusters = len(m)
    tensor = np.zeros((len(terms), len(terms), clusters, clusters))
    closed = np.array([term.lagged(np.zeros(1), 1, 1, dt) is not None for term in terms])
    exact = tuple(term for term, known in zip(terms, closed, strict=True) if known)
    pairs = np.array([(i, j) for i in range(clusters) for j in range(i + 1)])
    small, large = np.sort(np.array(m)[pairs], axis=1).T
    if not closed.all():
        found = [_from_density(samples, a, b, dt, terms) for a, b in zip(small.tolist(), large.tolist(), strict=True)]
        tensor[:, :, pairs[:, 0], pairs[:, 1]] = np.stack(found, axis=2)
    if exact:
        for part in np.array_split(np.arange(len(pairs)), -(-len(pairs) // _TOGETHER)):
            where = np.flatnonzero(closed)[:, None, None], np.flatnonzero(closed)[None, :, None], *pairs[part].T
            tensor[where] = _closed(samples, small[part], large[part], dt, exact)
    tensor[:, :, pairs[:, 1], pairs[:, 0]] = tensor[:, :, pairs[:, 0], pairs[:, 1]]
    tensor.flags.writeable = False
    return tensor


@host_float64
def allan_covariance(noise: Noise, samples: int, m: Any, dt: float) -> Float[AnyArray, "clusters clusters"]:
    r"""Exact covariance of the overlapped Allan variances of a record, across cluster sizes.

    If second differences of Gaussian noise have the covariance c(h) at a lag of h samples, their squares have the covariance 2 c(h)^2,
    so that

    .. math:: \mathrm{Cov}(\sigma^2_m, \sigma^2_{m'}) = \frac{2}{M_m M_{m'}} \sum_h \mathrm{cnt}(h)\, c_{mm'}(h)^2

    where M = samples - 2m + 1 is the number of differences of cluster size m, and cnt(h) the number of pairs of them at lag h. The cost
    does not depend on the length of the record. A ramp is not random: it contributes only through its product with the noise.
    Variances of neighbouring cluster sizes share most of their samples, so that correlations above 0.9 are common. For terms of your
    own c is computed numerically, to about a part in a thousand.

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
        If the model has sinusoids, several channels or no coefficient, or a cluster size does not fit into the record.

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


def _sums(lagged, weight, terms: tuple[Term, ...]) -> np.ndarray:
    """Sums over lags of the products of two terms; zero for a ramp with itself, because it is not random."""
    fixed = np.array([isinstance(term, Ramp) for term in terms])
    return np.where(fixed[:, None] & fixed[None, :], 0.0, lagged * weight @ lagged.T)


def _from_density(samples: int, small: int, large: int, dt: float, terms: tuple[Term, ...]) -> np.ndarray:
    """The same as `_pair`, from the densities of the terms instead of closed forms."""
    first, second, stride = samples - 2 * small + 1, samples - 2 * large + 1, max(large // _PARTS, 1)
    factor, half = 8.0 / (small * large * dt), _angles(stride) / 2.0
    spectrum = factor * _densities(terms, 0, dt) / (2.0 * np.sin(_MIDDLE / 2.0)) ** 2
    whole = spectrum * _kernel(small, large) @ spectrum.T / np.pi
    lagged = _densities(terms, stride, dt) * factor * (np.sin(small * half) * np.sin(large * half) / (2.0 * np.sin(half))) ** 2
    # the value at zero is the mean over half a step, where the density is taken as a power law
    power = lagged[:, 1] > 0.0
    lagged[power, 1] /= 1.0 + np.log2(lagged[power, 1] / lagged[power, 0])
    lagged = np.asarray(scipy.fft.dct(lagged[:, 1:], type=1)) / (2.0 * stride * _STEPS)
    lags = float(stride) * np.arange(_STEPS + 1)
    count = np.clip(second - (lags - (large - small)), 0.0, second)
    values = second * whole - _sums(lagged, 2.0 * stride * (second - count), terms)
    for i in (i for i, term in enumerate(terms) if isinstance(term, Ramp)):
        lagged[i] = dt**2 * small * large / 2.0
        values[i] = values[:, i] = _sums(lagged, stride * np.where(lags > 0.0, 2.0, 1.0) * count, terms)[i]
    return 2.0 / (first * second) * values


@functools.lru_cache(maxsize=64)
def _densities(terms: tuple[Term, ...], stride: int, dt: float) -> np.ndarray:
    """(p, frequencies) densities at the angles of a stride; for a stride of 0, at the middle of the bins, times the root of their width."""
    angle, scale = (_angles(stride), 1.0) if stride else (_MIDDLE, np.sqrt(_WIDTH))
    return np.stack([np.asarray(term.psd(angle / (2.0 * np.pi * dt), dt)) for term in terms]) * scale


def _angles(stride: int) -> np.ndarray:
    """Angles of the cosine transform, evenly spaced up to pi over the stride; a quarter and half of the first step replace zero."""
    return np.pi / (stride * _STEPS) * np.append([0.25, 0.5], np.arange(1.0, _STEPS + 1))


def _kernel(small: int, large: int) -> np.ndarray:
    """Mean of sin^4(m omega/2) sin^4(m' omega/2) in each bin of frequency."""
    angle, width = _MIDDLE, _WIDTH
    powers = dict(zip(range(-2, 3), np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 16.0, strict=True))  # sin^4(y) as a sum of e^{2ipy}

    def mean(p):
        return np.cos(p * angle) * np.sinc(p * width / (2.0 * np.pi))

    both = sum(a * b * mean(p * small + q * large) for p, a in powers.items() for q, b in powers.items())
    late = sum(b * mean(q * large) for q, b in powers.items())
    late = np.where(large * width < 0.1, np.sin(large * angle / 2.0) ** 4, late)  # the sum of cosines would lose its digits
    return np.where(small * width < 0.1, np.sin(small * angle / 2.0) ** 4 * late, both)


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
    steps, half = [0], length // 2
    size = _DIRECT
    while steps[-1] + size < half:
        steps.append(steps[-1] + size)
        size = steps[-1]
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
