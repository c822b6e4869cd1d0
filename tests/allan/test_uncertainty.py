"""Degrees of freedom against published values and simulations, and identification of known noise types."""

import functools

import numpy as np
import pytest

from jaxcal.allan import cluster_sizes, degrees_of_freedom, deviation
from jaxcal.allan._noise_type._b1_ratio import _b1
from jaxcal.allan._uncertainty._edf import _sx, interval_factors, tabulated_factors
from jaxcal.noise import Noise

#: noise types and the term of each
TYPES = [(2, "Q"), (0, "N"), (-1, "B"), (-2, "K")]


@functools.cache
def records(name, samples, runs):
    """Simulate records of one noise term with a coefficient of one, (samples, runs)."""
    return np.stack([Noise(**{name: 1.0}).simulate(samples, 1.0, seed=s) for s in range(runs)], axis=1)


def test_edf_of_white_noise_as_published():
    """The edf agrees with NIST SP 1065 (Greenhall and Riley): overlapped Allan variance of white FM noise, 1025 phase points."""
    m = 2 ** np.arange(10)
    published = [801, 554, 314, 170, 88.5, 44.4, 21.8, 9.83, 4.00, 1]
    np.testing.assert_allclose(degrees_of_freedom(m, 0, "oadev", 1024), published, rtol=2e-3)


@pytest.mark.parametrize("kind", ["oadev", *(pytest.param(one, marks=pytest.mark.long) for one in ("adev", "mdev", "hdev", "ohdev"))])
@pytest.mark.parametrize(("alpha", "name"), TYPES)
def test_edf_against_the_scatter_of_simulated_records(kind, alpha, name):
    samples, m = 256, np.array([1, 4, 16, 48])
    variance = deviation(records(name, samples, 400), 1.0, kind=kind, m=m, alpha=alpha).deviation ** 2
    measured = 2.0 * variance.mean(axis=1) ** 2 / variance.var(axis=1)
    # a variance over 400 runs has a sampling error of 7 %, and more at a small edf; the formulas are accurate to 10 %
    np.testing.assert_allclose(degrees_of_freedom(m, alpha, kind, samples), measured, rtol=0.35)


def test_interval_factors_are_chi_square_quantiles():
    from scipy.stats import chi2

    found = deviation(np.random.default_rng(0).standard_normal(100_000), 1.0, m=[1, 1000, 10_000, 50_000], confidence=0.9)
    assert found.edf[0] > 5e4
    assert found.edf[-1] == 1.0
    np.testing.assert_allclose(found.lower / found.deviation, np.sqrt(found.edf / chi2.ppf(0.95, found.edf)), rtol=1e-8)
    np.testing.assert_allclose(found.upper / found.deviation, np.sqrt(found.edf / chi2.ppf(0.05, found.edf)), rtol=1e-8)


@pytest.mark.parametrize(("alpha", "name"), TYPES)
@pytest.mark.parametrize("data", ["rate", "phase"])
def test_the_noise_type_is_found(alpha, name, data):
    # flicker is close to the boundary with a random walk (r1 = -0.217 after averaging, boundary -0.2); the test uses the median record
    y = records(name, 20_000, 31)
    if data == "phase":
        y = np.concatenate([np.zeros((1, 31)), np.cumsum(y, axis=0)])
    found = deviation(y, 1.0, m=[1, 4, 16], data=data)
    assert np.median(found.alpha, axis=1).tolist() == [alpha] * 3


def test_the_last_type_is_carried_forward():
    found = deviation(Noise(K=1.0).simulate(3000, 1.0, seed=1), 1.0, m=[10, 100, 400, 700])
    assert found.alpha[2] == found.alpha[3]  # fewer than eight averages do not determine a type
    assert found.alpha[:2].tolist() == [-2, -2]


@pytest.mark.parametrize(("alpha", "name"), TYPES)
@pytest.mark.parametrize("gap", [False, True])
def test_the_ratio_tells_the_type_of_twenty_averages(alpha, name, gap):
    y = records(name, 2000, 60).copy()
    if gap:
        y[900:1000] = np.nan
    found = deviation(y, 1.0, kind="adev", m=[2, 100])  # the smaller size tells white from flicker phase noise, which B1 does not
    # for 150 records each, 73-89 % are correct (71-89 with the gap); a random type would be correct in 20 %
    assert np.mean(found.alpha[-1] == alpha) > 0.55


def test_b1_of_simulated_averages_has_its_expectation():
    """The ratio of the expected sample variance to the expected Allan variance agrees with NBS Technical Note 375."""
    averages, runs = 16, 4000
    for noise, mu in ((Noise(N=1.0), -1), (Noise(K=1.0), 1), (Noise(B=1.0), 0)):
        fine = 64  # averages over 64 samples behave as in continuous time
        # parts of one long record suffice, since neither variance depends on where a part begins
        y = noise.simulate(runs * averages * fine, 1.0, seed=0).reshape(runs, averages, fine).mean(axis=2)
        ratio = y.var(axis=1, ddof=1).mean() / (np.diff(y, axis=1) ** 2 / 2.0).mean()
        # the ratio of means has a sampling error of 1 %, for the random walk of 2 %
        np.testing.assert_allclose(ratio, _b1(np.float64(averages), mu), rtol=0.06)


@pytest.mark.parametrize("noise", [Noise(N=1.0), Noise(B=1.0), Noise(K=1.0), Noise(N=1.0, K=0.02)])
def test_intervals_hold_where_few_averages_are_left(noise):
    m, runs = np.array([1, 2, 4, 8, 16, 32, 40, 60, 100, 125, 200, 300]), 400
    y = np.stack([noise.simulate(1000, 1.0, seed=s) for s in range(runs)], axis=1)
    found = deviation(y, 1.0, m=m)
    truth = np.sqrt(noise.avar(m * 1.0, dt=1.0))[:, None]
    coverage = np.mean((found.lower <= truth) & (truth <= found.upper), axis=1)
    assert coverage[6:].min() > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / runs)


@pytest.mark.parametrize("samples", [3000, pytest.param(1_000_000, marks=pytest.mark.long)])
@pytest.mark.parametrize("kind", ["adev", "oadev", "mdev", "hdev", "ohdev"])
def test_edf_of_many_cluster_sizes_agrees_with_the_formula_at_each(kind, samples):
    """For many cluster sizes the edf is interpolated if its formula needs a sum; for a few sizes the formula itself is used."""
    m = cluster_sizes("all", kind, samples)
    chosen = np.unique(np.concatenate([np.arange(60), len(m) - 1 - np.arange(150), np.linspace(0, len(m) - 1, 400).astype(int)]))
    for alpha in range(2, -5 if kind.endswith("hdev") else -3, -1):
        many = degrees_of_freedom(m, alpha, kind, samples)
        exact = degrees_of_freedom(m[chosen], alpha, kind, samples)
        np.testing.assert_allclose(many[chosen], exact, rtol=1e-3, err_msg=f"{alpha}")
        assert np.all(many >= 1.0)


def test_flicker_phase_keeps_its_digits_at_large_cluster_sizes():
    """s_x is a second difference at a spacing of 1/m; at m = 10^6 its plain form has 4 correct digits, extended precision 8."""
    f, t = np.longdouble(1e6), np.array([1.0, 2.0, 0.5], dtype=np.longdouble)

    def sw(t):
        return t**2 * np.log(np.abs(t))

    exact = f**2 * (2 * sw(t) - sw(t - 1 / f) - sw(t + 1 / f))
    np.testing.assert_allclose(_sx(t.astype(float), 1e6, 1), exact.astype(float), rtol=1e-6)


def test_tabulated_factors_are_those_of_the_quantiles():
    edf = np.geomspace(1.0, 1e6, 5001)
    for quick, exact in zip(tabulated_factors(edf, 1e6, 0.9), interval_factors(edf, 0.9), strict=True):
        np.testing.assert_allclose(quick, exact, rtol=1e-6)
