"""`Noise`: closed forms against sums over the variogram, integrals over the spectrum, and published values."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.special

from jaxcal.noise import Noise

DT = 0.1
ALL = Noise(Q=0.3, N=1.2, B=0.7, K=0.4, R=0.2, markov=((0.5, 2.0),), sinusoid=((0.6, 0.7),))


def variogram(term, h):
    """Semivariogram E[x(t+h) - x(t)]^2 / 2 of a term of unit strength at a lag of h samples."""
    if term == "Q":
        return (2.0 + (h == 1)) / DT**2
    if term == "N":
        return np.ones(len(h)) / DT
    if term == "B":
        return 2.0 / np.pi * np.cumsum(1.0 / (2.0 * h - 1.0))
    if term == "K":
        return DT * h / 2.0
    if term == "markov":
        return 1.0 * (1.0 - np.exp(-h * DT / 2.0))  # Tc = 2 s: stationary variance qc^2 Tc/2 = 1
    return 0.5 * (1.0 - np.cos(2.0 * np.pi * 0.7 * DT * h))


@pytest.mark.parametrize("m", [1, 2, 3, 10, 200])
@pytest.mark.parametrize("term", ["Q", "N", "B", "K", "markov", "sinusoid"])
def test_exact_form_is_the_sum_over_the_variogram(term, m):
    noise = {"markov": Noise(markov=((1.0, 2.0),)), "sinusoid": Noise(sinusoid=((1.0, 0.7),))}.get(term) or Noise(**{term: 1.0})
    h = np.arange(1, 2 * m)
    weight = np.where(h <= m, 2 * m - 3 * h, h - 2 * m)
    expected = -np.sum(weight * variogram(term, h)) / m**2
    np.testing.assert_allclose(noise.avar(m * DT, dt=DT), expected, rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize("noise", [Noise(N=1.3), Noise(B=0.7), Noise(K=0.4), Noise(markov=((0.5, 2.0),))])
def test_continuous_form_is_the_integral_over_the_spectrum(noise):
    """sigma^2 = 4 int_0^inf S sin^4(pi f tau)/(pi f tau)^2 df (IEEE Std 952; thesis 5.14), S two-sided."""
    tau = 3.0

    def integrand(f):
        return 4.0 * float(noise.psd(f)) * np.sin(np.pi * f * tau) ** 4 / (np.pi * f * tau) ** 2

    edges = np.arange(0.0, 60.0) / tau
    total = sum(scipy.integrate.quad(integrand, a + 1e-12, b, limit=200)[0] for a, b in itertools.pairwise(edges))
    tail = 4.0 * float(noise.psd(edges[-1])) * 0.375 / (np.pi**2 * tau**2 * edges[-1])  # mean of sin^4, density falling like that of N
    np.testing.assert_allclose(total + tail, noise.avar(tau), rtol=2e-4)


def test_published_values_at_short_cluster_times():
    """The ratio of sampled to continuous variance at m = 1 is 1/ln 2 for flicker and 1.5 for a random walk."""
    m = np.array([1.0, 2.0, 3.0, 7.0, 30.0])
    np.testing.assert_allclose(Noise(B=1.0).avar(m, dt=1.0) / Noise(B=1.0).avar(m), [1.4427, 1.1542, 1.0804, 1.0194, 1.0015], atol=5e-5)
    np.testing.assert_allclose(Noise(K=1.0).avar(m, dt=1.0) / Noise(K=1.0).avar(m), 1 + 0.5 / m**2, rtol=1e-12)
    assert round(float(np.sqrt(Noise(B=1.0).avar(50.0))), 3) == 0.664


def test_exact_spectrum_integrates_to_the_variance():
    """For a stationary process, the integral of the density over the band of the samples is the variance."""
    noise = Noise(Q=0.3, N=1.2, markov=((0.5, 2.0),))
    total, _ = scipy.integrate.quad(lambda f: 2.0 * float(noise.psd(f, dt=DT)), 1e-12, 0.5 / DT, limit=400, points=[0.1, 0.5])
    np.testing.assert_allclose(total, 2.0 * 0.3**2 / DT**2 + 1.2**2 / DT + 0.5**2 * 2.0 / 2.0, rtol=1e-6)


def test_terms_add_and_channels_come_last():
    tau = np.array([0.1, 1.0, 10.0])
    parts = [Noise(Q=0.3), Noise(N=1.2), Noise(B=0.7), Noise(K=0.4), Noise(R=0.2), Noise(markov=ALL.markov), Noise(sinusoid=ALL.sinusoid)]
    np.testing.assert_allclose(ALL.avar(tau, dt=DT), sum(part.avar(tau, dt=DT) for part in parts), rtol=1e-12)
    several = Noise(N=np.array([1.0, 2.0]), K=0.5, markov=((np.array([0.1, 0.2]), 3.0),))
    assert several.avar(tau).shape == (3, 2)
    assert several.psd(1.0).shape == (2,)
    np.testing.assert_allclose(several.avar(tau)[:, 1], several.channel(1).avar(tau), rtol=1e-12)
    np.testing.assert_allclose(several.psd(tau, dt=DT)[:, 0], several.channel(0).psd(tau, dt=DT), rtol=1e-12)
    np.testing.assert_array_equal(Noise(N=[1.0, 2.0]).avar(tau), Noise(N=np.array([1.0, 2.0])).avar(tau))


def test_gauss_markov_keeps_its_digits_at_short_cluster_times():
    """Far below Tc the process is a random walk; the closed form would lose digits there by cancellation."""
    process, walk = Noise(markov=((1.0, 1e4),)), Noise(K=1.0)
    for tau in (0.05, 0.15, 0.25, 1.0):
        np.testing.assert_allclose(process.avar(tau), walk.avar(tau), rtol=2e-4)
        np.testing.assert_allclose(process.avar(tau, dt=0.05), walk.avar(tau, dt=0.05), rtol=2e-4)


def test_under_jit_vmap_and_grad(precision):
    tau = jnp.asarray([0.1, 0.7, 20.0])
    if precision == "float32":
        assert ALL.avar(tau, dt=DT).dtype == np.float64
        return
    np.testing.assert_allclose(jax.jit(lambda t: ALL.avar(t, dt=DT))(tau), ALL.avar(tau, dt=DT), rtol=1e-12)
    np.testing.assert_allclose(jax.vmap(lambda t: ALL.avar(t))(tau), ALL.avar(tau), rtol=1e-12)
    for term in ("Q", "N", "B", "K", "R"):
        slope = jax.grad(lambda value, term=term: Noise(**{term: value}).avar(2.0, dt=DT))(1.5)
        np.testing.assert_allclose(slope, 2.0 * 1.5 * Noise(**{term: 1.0}).avar(2.0, dt=DT), rtol=1e-12)
    slope = jax.grad(lambda t: ALL.avar(t, dt=DT))(0.7)
    np.testing.assert_allclose(slope, (ALL.avar(0.7 + 1e-5, dt=DT) - ALL.avar(0.7 - 1e-5, dt=DT)) / 2e-5, rtol=1e-6)
    short = jax.grad(lambda correlation: Noise(markov=((1.0, correlation),)).avar(1e-4))(100.0)
    assert np.isfinite(short)
