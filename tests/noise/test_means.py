"""`mean_covariance` against sums over samples of known semivariograms, and against densities."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal import DataError
from jaxcal.noise import GaussMarkov, Noise, mean_covariance

START, DWELL = np.array([0.0, 31.0, 70.0, 300.0]), np.array([20.0, 30.0, 25.0, 10.0])


def contrasts(covariance, weight=DWELL):
    """Covariance after subtracting the weighted mean, which removes a free constant."""
    away = np.eye(len(weight)) - np.outer(np.ones(len(weight)), weight / weight.sum())
    return away @ covariance @ away.T


#: noise and semivariogram of its samples for each term, with intervals dt in seconds and lags h in samples
VARIOGRAMS = {
    "B": (Noise(B=0.7), lambda h, dt: 0.7**2 * 2 / np.pi * np.concatenate([[0], np.cumsum(1 / (2 * np.arange(1, h.size) - 1))])),
    "K": (Noise(K=0.3), lambda h, dt: 0.3**2 * dt * h / 2),
    "Gauss-Markov": (Noise(markov=((0.2, 40.0),)), lambda h, dt: 0.2**2 * 20 * -np.expm1(-h * dt / 40.0)),
    "all": (
        Noise(N=0.5, B=0.7, K=0.3),
        lambda h, dt: 0.5**2 / dt * (h > 0) + VARIOGRAMS["B"][1](h, dt) + VARIOGRAMS["K"][1](h, dt),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", VARIOGRAMS)
def test_means_of_samples_have_this_covariance(name):
    noise, variogram = VARIOGRAMS[name]
    dt = 0.25
    gamma = variogram(np.arange(1600.0), dt)
    samples = [np.round((start + np.arange(0, dwell, dt)) / dt).astype(int) for start, dwell in zip(START, DWELL, strict=True)]
    expected = np.array([[-np.mean(gamma[np.abs(i[:, None] - j[None, :])]) for j in samples] for i in samples])
    found = mean_covariance(noise, START, DWELL)
    np.testing.assert_allclose(contrasts(found), contrasts(expected), atol=2e-3 * np.abs(contrasts(expected)).max())


def test_a_slow_process_is_a_random_walk_and_a_fast_one_white():
    for noise, limit in (
        (Noise(markov=((0.2, 1e7),)), Noise(K=0.2)), (Noise(markov=((10.0, 1e-3),)), Noise(N=1e-2)),
        (Noise(further=((1.0, GaussMarkov(1e7)),)), Noise(K=1.0)),
    ):  # fmt: skip
        found, wanted = (contrasts(mean_covariance(one, START, DWELL)) for one in (noise, limit))
        np.testing.assert_allclose(found, wanted, atol=2e-4 * np.abs(wanted).max())


def test_what_wanders_is_counted_from_the_common_mean():
    wander = mean_covariance(Noise(B=1.0, K=0.1), START, DWELL)
    assert np.abs(wander @ DWELL).max() < 1e-10 * np.abs(wander).max() * DWELL.sum()
    np.testing.assert_allclose(mean_covariance(Noise(N=2.0, R=5.0), START, DWELL), np.diag(4.0 / DWELL))
    # a mean of quantisation noise has an error at each of its ends
    np.testing.assert_allclose(mean_covariance(Noise(Q=3.0), START, DWELL)[0, 0], 2 * 9 / DWELL[0] ** 2)
    alone = mean_covariance(Noise(B=1.0, K=0.1), START, DWELL, np.array([1.0, 1.0, 0.0, 0.0]))
    two = mean_covariance(Noise(B=1.0, K=0.1), START[:2], DWELL[:2], np.ones(2))
    np.testing.assert_allclose(alone[:2, :2], two, rtol=1e-9, atol=1e-12)


def test_derivatives_with_respect_to_coefficients_and_times():
    def one(x):
        return mean_covariance(Noise(N=x[0], B=x[1], K=x[2], markov=((x[3], x[4]),)), x[5:9], x[9:])[0, 2]

    at = np.concatenate([[0.3, 0.4, 0.05, 0.02, 35.0], START, DWELL])
    slope = jax.jit(jax.grad(one))(jnp.asarray(at))
    for i, step in enumerate(1e-4 * at + 1e-6):
        up, down = (one(at + sign * step * (np.arange(at.size) == i)) for sign in (1, -1))
        assert float(slope[i]) == pytest.approx((up - down) / (2 * step), rel=1e-5, abs=1e-9)


def test_wrong_calls():
    with pytest.raises(DataError, match="one number for each"):
        mean_covariance(Noise(N=1.0), START, DWELL[:2])
    with pytest.raises(DataError, match="one channel"):
        mean_covariance(Noise(N=[1.0, 2.0]), START, DWELL)
