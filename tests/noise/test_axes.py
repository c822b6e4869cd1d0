"""Correlation between the white noise of axes, and cross-spectra, on simulated records with known correlation."""

import numpy as np
import pytest

import jaxcal
from jaxcal import DataError
from jaxcal.noise import Noise, correlation

RATE = 100.0


def mixed(seed, n=4096, walk=0.0):
    """Simulate two axes with a correlation of 0.3 between their white noise and independent random walks."""
    random = np.random.default_rng(seed)
    a, b = random.standard_normal((2, n))
    white = np.stack([2.0 * a, 0.5 * (0.3 * a + np.sqrt(1 - 0.09) * b)], axis=1)
    return white + walk * np.cumsum(random.standard_normal((n, 2)), axis=0)


@pytest.mark.parametrize("walk", [0.0, 0.05])
def test_intervals_of_the_correlation_hold_the_truth(walk):
    models = [Noise(N=size / np.sqrt(RATE), K=walk * np.sqrt(RATE)) for size in (2.0, 0.5)]
    found = [correlation(mixed(seed, walk=walk), RATE, models) for seed in range(300)]
    inside = np.mean([one.interval[0, 1, 0] <= 0.3 <= one.interval[0, 1, 1] for one in found])
    assert 0.915 <= inside <= 0.985  # 300 intervals of 95 %: three standard errors
    values = np.array([one.correlation[0, 1] for one in found])
    assert abs(values.mean() - 0.3) < 4 * values.std() / np.sqrt(300)


def test_independent_axes_are_seldom_called_correlated():
    random = np.random.default_rng(5)
    said = [bool(correlation(random.standard_normal((1000, 2)), RATE, [Noise(N=0.1)] * 2).findings) for _ in range(300)]
    assert np.mean(said) < 0.09  # nominal: 5 %


def test_covariance_is_that_of_the_samples_and_serves_a_filter():
    y = mixed(1, n=100_000)
    fits = [jaxcal.noise.fit(axis, RATE) for axis in y.T]
    found = correlation(y, RATE, fits)
    np.testing.assert_allclose(found.covariance * RATE, np.cov(y.T), rtol=0.03)
    np.testing.assert_allclose(np.diag(found.covariance), [float(fit.noise.N) ** 2 for fit in fits])
    assert found.codes == {"correlated"}
    assert "axes 0 and 1" in found.summary()
    y[50_000] = np.nan
    used = next(one.facts for one in correlation(y, RATE, fits).findings if one.code == "stretch")
    assert (used["start"], used["stop"]) in ((50_001, 100_000), (0, 50_000))


@pytest.mark.parametrize(
    ("models", "words"),
    [([Noise(N=1.0)], "got 1 models"), ([Noise(N=1.0), Noise(K=1.0)], "axis 1 has no white noise")],
)
def test_messages(models, words):
    with pytest.raises(DataError, match=words):
        correlation(mixed(0), RATE, models)


def test_a_log_with_correlated_axes_says_so_and_a_common_step_and_line_do_not_count():
    random, n = np.random.default_rng(5), 2**13
    a, b, c = 1e-3 * random.standard_normal((3, n))
    common = 3e-3 * (np.arange(n) > n / 2) + 1e-3 * np.sin(2 * np.pi * 0.2 * np.arange(n))
    log = jaxcal.Log(None, gyro=np.stack([a + common, 0.6 * a + 0.8 * b, c + common], axis=1), rate=RATE)
    (told,) = [one for one in jaxcal.noise.characterise(log).findings if one.code == "correlated"]
    assert (told.subject, told.facts["pair"]) == (("gyro",), "x and y")
    assert abs(told.facts["rho"] - 0.6) < 0.04
