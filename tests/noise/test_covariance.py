"""The covariance across tau: against its definition summed lag by lag, and against the scatter of simulated records."""

import numpy as np
import pytest

from jaxcal.allan import deviation
from jaxcal.noise import Noise
from jaxcal.noise._covariance import _sum_rule, covariance, covariance_tensor

DT = 0.5
TERMS = ("Q", "N", "B", "K", "R")


def objects(terms):
    return tuple(Noise().part(term)[2] for term in terms)


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
    tensor = covariance_tensor(samples, m, DT, objects(TERMS))
    for i, small in enumerate(m):
        for j in range(i, len(m)):
            np.testing.assert_allclose(tensor[:, :, i, j], lag_by_lag(samples, small, m[j]), rtol=3e-5, atol=1e-15)
            np.testing.assert_array_equal(tensor[:, :, j, i], tensor[:, :, i, j])


def test_cost_and_size_do_not_grow_with_the_record():
    """A billion samples: white noise at one cluster size has the closed form of Greenhall, edf near 2n/3m for m >> 1."""
    samples, m = 10**9, (1, 1000, 10**6, 10**8)
    tensor = covariance_tensor(samples, m, 1.0, objects("NBK"))
    variance = np.array([1.0 / size for size in m])
    edf = 2.0 * variance**2 / np.diagonal(tensor[0, 0])
    np.testing.assert_allclose(edf[1:3], 1.5 * samples / np.array(m[1:3]), rtol=2e-3)
    assert np.all(np.linalg.eigvalsh(covariance(tensor, np.array([1.0, 1e-6, 1e-12])) / np.sqrt(np.outer(variance, variance))) > 0)


def test_against_the_scatter_of_simulated_records():
    """1,000 records: standard deviations within 4.5 standard errors, correlations within 0.15."""
    noise, samples, runs = Noise(Q=0.2, N=1.0, B=0.5, K=0.2), 1024, 1000
    m = np.array([1, 3, 10, 40, 160])
    y = np.stack([noise.simulate(samples, 1 / DT, seed=s) for s in range(runs)], axis=1)
    variance = deviation(y, 1 / DT, m=m).deviation ** 2
    theory = covariance(
        covariance_tensor(samples, tuple(int(size) for size in m), DT, objects(TERMS[:4])), np.array([0.04, 1.0, 0.25, 0.04])
    )
    measured = np.cov(variance)
    spread = np.sqrt(np.diagonal(theory))
    excess = np.mean((variance - variance.mean(axis=1, keepdims=True)) ** 4, axis=1) / np.diagonal(measured) ** 2 - 1
    z = (np.diagonal(measured) / spread**2 - 1) / np.sqrt(excess / runs)
    assert np.all(np.abs(z) < 4.5), z
    np.testing.assert_allclose(np.corrcoef(variance), theory / np.outer(spread, spread), atol=0.15)


@pytest.mark.parametrize("length", [25, 26, 100, 12_345, 10**9])
def test_the_sum_rule_is_exact_for_polynomials(length):
    x, w = _sum_rule(length)
    n = length - 1
    np.testing.assert_allclose(np.sum(w), length, rtol=1e-12)
    np.testing.assert_allclose(w @ x**3, float(n**2 * (n + 1) ** 2 // 4), rtol=1e-12)
    np.testing.assert_allclose(w @ x**5, float(n**2 * (n + 1) ** 2 * (2 * n**2 + 2 * n - 1) // 12), rtol=1e-11)
