"""The covariance between cluster times against its definition, summed lag by lag, and against the scatter of simulated records."""

import itertools
import math

import jax
import numpy as np
import pytest

from jaxcal import DataError
from jaxcal.allan import deviation
from jaxcal.noise import Noise, allan_covariance

DT = 0.5
TERMS = ("Q", "N", "B", "K", "R")


def tensor(samples, m):
    """T for which the covariance is sum_ij theta_i theta_j T[i, j], where theta are the squared coefficients.

    The elements follow by polarisation from the covariances of one and of two terms.
    """
    found = np.empty((len(TERMS), len(TERMS), len(m), len(m)))
    for i, j in itertools.combinations_with_replacement(range(len(TERMS)), 2):
        both = allan_covariance(Noise(**{TERMS[i]: 1.0, TERMS[j]: 1.0}), samples, m, DT)
        found[i, j] = found[j, i] = both if i == j else both / 2.0
    for i, j in itertools.combinations(range(len(TERMS)), 2):
        found[i, j] = found[j, i] = found[i, j] - (found[i, i] + found[j, j]) / 2.0
    return found


def phase_covariance(term, h):
    """Generalised covariance of phase at integer lags, from the definitions of the terms, in extended precision."""
    h = np.abs(h)
    x = h.astype(np.longdouble)
    if term == "Q":
        return (h == 0) / np.longdouble(DT) ** 2
    if term == "N":
        return -x / (2 * DT)
    if term == "K":
        return DT * (x**3 - x) / 12
    harmonic = np.concatenate([[0], np.cumsum(1 / (2 * np.arange(1, h.max() + 1, dtype=np.longdouble) - 1))])
    return ((4 * x**2 - 1) * harmonic[h] - 3 * x**2) / (4 * np.longdouble(np.pi))


def lag_by_lag(samples, small, large):
    first, second = samples - 2 * small + 1, samples - 2 * large + 1
    h = np.arange(-first + 1, second)
    count = np.minimum(first, second - h) - np.maximum(0, -h)
    weights = (1, -2, 1)
    lagged = []
    for term in TERMS:
        if term == "R":
            lagged.append(np.full(len(h), DT**2 * small * large / 2, dtype=np.longdouble))
            continue
        pairs = [(a, b) for a in range(3) for b in range(3)]
        total = sum(weights[a] * weights[b] * phase_covariance(term, h + b * large - a * small) for a, b in pairs)
        lagged.append(total / (2 * small * large))
    values = np.array([[np.sum(count * a * b) for b in lagged] for a in lagged])
    values[-1, -1] = 0
    return np.asarray(2 / (first * second) * values, dtype=float)


def test_equals_the_sum_over_all_lags():
    samples, m = 3000, (1, 2, 5, 19, 60, 203, 750)
    found = tensor(samples, m)
    for i, small in enumerate(m):
        for j in range(i, len(m)):
            np.testing.assert_allclose(found[:, :, i, j], lag_by_lag(samples, small, m[j]), rtol=3e-5, atol=1e-15)
            np.testing.assert_array_equal(found[:, :, j, i], found[:, :, i, j])


def test_cost_and_size_do_not_grow_with_the_record():
    """For a billion samples of white noise, the edf agrees with Greenhall's closed form, near 2n/3m for m >> 1."""
    samples, m = 10**9, (1, 1000, 10**6, 10**8)
    variance = np.array([1.0 / size for size in m])
    edf = 2.0 * variance**2 / np.diagonal(allan_covariance(Noise(N=1.0), samples, m, 1.0))
    np.testing.assert_allclose(edf[1:3], 1.5 * samples / np.array(m[1:3]), rtol=2e-3)
    together = allan_covariance(Noise(N=1.0, B=1e-3, K=1e-6), samples, m, 1.0)
    assert np.all(np.linalg.eigvalsh(together / np.sqrt(np.outer(variance, variance))) > 0)


@pytest.mark.long
def test_against_the_scatter_of_simulated_records():
    """For 1,000 records, standard deviations agree within 4.5 standard errors, and correlations within 0.15."""
    noise, samples, runs = Noise(Q=0.2, N=1.0, B=0.5, K=0.2), 1024, 1000
    m = np.array([1, 3, 10, 40, 160])
    y = np.stack([noise.simulate(samples, 1 / DT, seed=s) for s in range(runs)], axis=1)
    variance = deviation(y, 1 / DT, m=m).deviation ** 2
    theory = allan_covariance(noise, samples, m, DT)
    measured = np.cov(variance)
    spread = np.sqrt(np.diagonal(theory))
    excess = np.mean((variance - variance.mean(axis=1, keepdims=True)) ** 4, axis=1) / np.diagonal(measured) ** 2 - 1
    z = (np.diagonal(measured) / spread**2 - 1) / np.sqrt(excess / runs)
    assert np.all(np.abs(z) < 4.5), z
    np.testing.assert_allclose(np.corrcoef(variance), theory / np.outer(spread, spread), atol=0.15)


def exact_sum(function, cuts, degree):
    """Exact sum over integers of a function that is a polynomial between the cuts, by Newton's forward differences."""
    total = 0
    for low, high in itertools.pairwise(cuts):
        values = [function(h) for h in range(low, min(high, low + degree + 1))]
        for j in range(len(values)):
            total += values[0] * math.comb(high - low, j + 1)
            values = [b - a for a, b in itertools.pairwise(values)]
    return total


@pytest.mark.parametrize(("samples", "small", "large"), [(12_345, 25, 100), (12_345, 26, 26), (10**9, 10**6, 10**8), (10**9, 77, 10**7)])
@pytest.mark.parametrize(("term", "phase", "degree"), [("N", lambda x: -6 * x, 3), ("K", lambda x: x**3 - x, 7)])
def test_sums_of_polynomials_are_exact(term, phase, degree, samples, small, large):
    """For white noise and random walk, the sums over up to a billion lags agree with sums in whole numbers."""
    first, second = samples - 2 * small + 1, samples - 2 * large + 1
    shifts = [(a * small - b * large, (1, -2, 1)[a] * (1, -2, 1)[b]) for a in range(3) for b in range(3)]

    def summand(h):
        return (min(first, second - h) - max(0, -h)) * sum(weight * phase(abs(h - shift)) for shift, weight in shifts) ** 2

    ends = {1 - first, second, 0, second - first, *(shift for shift, _ in shifts)}
    cuts = sorted({cut for end in ends for cut in (end, end + 1) if 1 - first <= cut <= second})
    exact = exact_sum(summand, cuts, degree) / ((24 * small * large) ** 2 * first * second) * 2
    np.testing.assert_allclose(allan_covariance(Noise(**{term: 1.0}), samples, [small, large], 1.0)[0, 1], exact, rtol=1e-9)


def test_derivative_with_respect_to_a_coefficient():
    """The covariance is a quadratic form in the squared coefficients, and so of fourth degree in a single coefficient."""
    with jax.enable_x64(True):
        slope = jax.jit(jax.jacfwd(lambda n: allan_covariance(Noise(N=n), 1000, (1, 7), DT)))(2.0)
    np.testing.assert_allclose(slope, 2.0 * allan_covariance(Noise(N=2.0), 1000, (1, 7), DT), rtol=1e-12)


@pytest.mark.parametrize(
    ("noise", "m", "words"),
    [
        (Noise(), [1], "coefficient above zero"),
        (Noise(N=[1.0, 2.0]), [1], "one channel"),
        (Noise(N=1.0, sinusoid=((1.0, 0.1),)), [1], "no sinusoids"),
        (Noise(N=1.0), [1, 501], "half of the 1000 samples"),
        (Noise(N=1.0), [], "cluster sizes"),
    ],
)
def test_messages(noise, m, words):
    with pytest.raises(DataError, match=words):
        allan_covariance(noise, 1000, m, DT)
