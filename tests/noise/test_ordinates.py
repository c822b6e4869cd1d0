"""DCT-II ordinates: expected values against dense covariance matrices, bins, and the traced path."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.fft
import scipy.optimize

from jaxcal.noise import GaussMarkov, Noise
from jaxcal.noise._likelihood import nonnegative
from jaxcal.noise._observed import Observed, bins_of

DT = 0.02
NAMES = ("Q", "N", "B", "K")
TERMS = tuple(Noise().part(name)[2] for name in NAMES)


def covariance(term, n, scale=None):
    """Covariance of n samples at unit coefficient; for B and K up to a constant, on which ordinates do not depend."""
    h = np.abs(np.arange(n)[:, None] - np.arange(n)[None, :])
    if term == "Q":
        return (2.0 * (h == 0) - (h == 1)) / DT**2
    if term == "N":
        return (h == 0) / DT
    if term == "K":
        return DT * np.minimum(np.arange(1, n + 1)[:, None], np.arange(1, n + 1)[None, :])
    if term == "markov":
        return scale / 2.0 * np.exp(-h * DT / scale)
    semivariogram = np.concatenate([[0.0], 2.0 / np.pi * np.cumsum(1.0 / (2.0 * np.arange(1, n) - 1.0))])
    return -semivariogram[h]


@pytest.mark.parametrize("n", [40, 97])
@pytest.mark.parametrize(("term", "scale"), [*((name, None) for name in NAMES), ("markov", 0.05), ("markov", 30.0)])
def test_expected_ordinates_equal_the_dense_covariance(term, scale, n):
    basis = scipy.fft.dct(np.eye(n), norm="ortho", axis=0)
    dense = DT * np.diag(basis @ covariance(term, n, scale) @ basis.T)[1:]
    np.testing.assert_allclose(
        (GaussMarkov(time=scale) if scale else Noise().part(term)[2]).ordinates(np.arange(1, n), n, DT), dense, rtol=1e-9
    )


def test_long_records_use_the_scaling_of_flicker():
    n = 1 << 17
    k = np.arange(1, n)
    h = np.arange(n, dtype=float)
    g = np.concatenate([[0.0], -2.0 / np.pi * np.cumsum(1.0 / (2.0 * h[1:] - 1.0))])
    cosine, sine = np.fft.rfft(g * (n - h), 2 * n)[1:n].real, -np.fft.rfft(g, 2 * n)[1:n].imag
    exact = DT * 2.0 / n * (cosine - sine / np.sin(np.pi * k / n))
    np.testing.assert_allclose(Noise().part("B")[2].ordinates(k, n, DT), exact, rtol=2e-6)


def test_bins_average_ordinates_and_count_them():
    y = Noise(N=1.0, K=0.3).simulate(5000, 1.0 / DT, seed=0)
    bins = Observed(y, DT).bins(TERMS)
    ordinates = DT * scipy.fft.dct(y - y.mean(), norm="ortho")[1:] ** 2
    assert bins.weight.sum() == 4999
    np.testing.assert_allclose((bins.density * bins.unit)[:48], ordinates[:48])
    np.testing.assert_allclose(np.sum(bins.density * bins.weight) * bins.unit, ordinates.sum())
    assert (bins.weight[:48] == 1).all()
    # there are 40 bins per decade; the Nyquist frequency truncates the last bin
    f = bins.frequency[bins.weight > 0]
    ratio = np.diff(np.log10(f))[-31:-1]
    np.testing.assert_allclose(ratio, 1 / 40, rtol=0.1)


def test_traced_equals_host():
    y = Noise(N=1.0, B=0.1).simulate(3000, 1.0 / DT, seed=2)
    host, traced = Observed(y, DT).bins(TERMS), jax.jit(lambda y: bins_of(y, DT, TERMS))(jnp.asarray(y))
    np.testing.assert_allclose(traced.density * traced.unit, host.density * np.where(host.weight > 0, host.unit, traced.unit), rtol=1e-9)
    np.testing.assert_array_equal(traced.weight, host.weight)


def test_a_traced_gap_is_refused():
    y = np.ones(200)
    y[3] = np.nan
    with pytest.raises(Exception, match="gap-free"):
        jax.block_until_ready(jax.jit(lambda y: bins_of(y, DT, TERMS).density)(jnp.asarray(y)))


def test_nonnegative_least_squares_equals_that_of_scipy():
    random = np.random.default_rng(3)
    rows, target = random.standard_normal((50, 30, 8)), random.standard_normal((50, 30))
    rows[..., 7] = rows[..., 6] + 1e-4 * rows[..., 7]  # nearly equal columns
    gram, goal = np.einsum("lij,lik->ljk", rows, rows), np.einsum("lij,li->lj", rows, target)
    found, active = nonnegative(gram, goal, False, np.ones((50, 8), dtype=bool))
    for one, a, b in zip(found, rows, target, strict=True):
        exact, least = scipy.optimize.nnls(a, b)
        assert np.linalg.norm(a @ one - b) == pytest.approx(least, rel=1e-9)
        np.testing.assert_allclose(a @ one, a @ exact, atol=1e-6)
    np.testing.assert_array_equal(active, found > 0.0)
