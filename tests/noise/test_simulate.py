"""Simulated noise agrees with theory within stated standard errors."""

import numpy as np
import pytest

from jaxcal import DataError
from jaxcal.allan import deviation
from jaxcal.noise import Noise

TERMS = {
    "Q": Noise(Q=1.0),
    "N": Noise(N=1.0),
    "B": Noise(B=1.0),
    "K": Noise(K=1.0),
    "R": Noise(R=1.0),
    "markov": Noise(markov=((1.0, 3.0),)),
    "sinusoid": Noise(sinusoid=((1.0, 0.37),)),
    "all": Noise(Q=0.01, N=1.0, B=0.5, K=0.2, R=0.05, markov=((0.5, 3.0),), sinusoid=((0.3, 0.37),)),
}


M = np.array([1, 2, 4, 8, 32, 128, 512, 1024])
RUNS, SAMPLES, RATE = 300, 2**14, 10.0


def mean_variance(noise, **options):
    """Mean Allan variance of 300 records of 16,384 samples, and its standard error."""
    y = np.stack([noise.simulate(SAMPLES, RATE, seed=s, **options) for s in range(RUNS)], axis=1)
    variance = deviation(y, RATE, m=M, alpha=0).deviation ** 2
    return variance.mean(axis=1), variance.std(axis=1, ddof=1) / np.sqrt(RUNS)


@pytest.mark.long
@pytest.mark.parametrize("term", TERMS)
def test_mean_allan_variance_is_the_exact_one(term):
    """The mean Allan variance agrees within 4.5 standard errors at every cluster size."""
    mean, error = mean_variance(TERMS[term])
    z = (mean - TERMS[term].avar(M / RATE, dt=1 / RATE)) / np.maximum(error, 1e-9 * mean)  # a ramp has no random error
    assert np.all(np.abs(z) < 4.5), z
    assert np.all(error < 0.025 * mean)  # the test is sensitive enough


@pytest.mark.long
@pytest.mark.parametrize("term", ["markov", "Q"])
def test_stationary_processes_have_their_autocovariance_from_the_first_sample(term):
    y = np.stack([TERMS[term].simulate(4, RATE, seed=s) for s in range(5000)])
    lag = np.abs(np.arange(4)[:, None] - np.arange(4)[None, :])
    expected = 1.5 * np.exp(-lag / (3.0 * RATE)) if term == "markov" else RATE**2 * (2.0 * (lag == 0) - (lag == 1))
    variance = expected[0, 0] ** 2 + expected**2  # variance of a product of two Gaussian variables
    assert np.all(np.abs(y.T @ y / len(y) - expected) < 4.5 * np.sqrt(variance / len(y)))


def test_rounding_with_dither_is_white():
    """With a step of one standard deviation, rounding adds LSB^2 dt/12 to N^2 and does not change the random walk."""
    noise = Noise(N=1.0 / np.sqrt(RATE), K=0.01)
    mean, error = mean_variance(noise, resolution=1.0)
    model = Noise(N=np.sqrt(noise.N**2 + 1.0 / RATE / 12.0), K=noise.K)
    assert np.all(np.abs(mean - model.avar(M / RATE, dt=1 / RATE)) < 4.5 * error)
    assert (mean[0] - noise.avar(1 / RATE, dt=1 / RATE)) / error[0] > 50.0  # the effect of rounding is significant


def test_rounded_samples_are_those_without_rounding_rounded():
    noise = Noise(N=np.array([1.0, 2.0]), K=0.1)
    exact, step = noise.simulate(1000, RATE, seed=0), np.array([0.5, 3.0])
    rounded = noise.simulate(1000, RATE, seed=0, resolution=step)
    np.testing.assert_array_equal(rounded / step, np.round(rounded / step))
    assert np.all(np.abs(rounded - exact) <= step / 2.0 * (1.0 + 1e-12))
    # if the noise is far below one step, all samples are equal
    assert len(np.unique(Noise(N=0.01).simulate(1000, 1.0, seed=0, resolution=1.0))) == 1


def test_flicker_increments_have_their_autocovariance():
    runs, n = 400, 512
    d = np.diff(np.stack([Noise(B=1.0).simulate(n, 1.0, seed=s) for s in range(runs)]), axis=1)
    for h in range(6):
        measured = np.mean(d[:, : n - 1 - h] * d[:, h:], axis=1)
        expected = -(4.0 / np.pi) / (4.0 * h**2 - 1.0)
        assert abs(measured.mean() - expected) < 4.5 * measured.std() / np.sqrt(runs)


def test_seeds_and_channels():
    noise = Noise(N=np.array([1.0, 2.0]), K=0.1)
    y = noise.simulate(1000, 10.0, seed=4)
    assert y.shape == (1000, 2)
    np.testing.assert_array_equal(y, noise.simulate(1000, 10.0, seed=4))
    assert np.any(y != noise.simulate(1000, 10.0, seed=5))
    assert abs(np.corrcoef(np.diff(y, axis=0).T)[0, 1]) < 0.15
    assert Noise(B=1.0).simulate(1, 10.0, seed=0).shape == (1,)
    assert not np.any(Noise().simulate(5, 1.0, seed=0))


@pytest.mark.parametrize(
    ("noise", "n", "rate", "words"),
    [
        (Noise(N=1.0), 0, 1.0, "n must be a whole number"),
        (Noise(N=1.0), 1.5, 1.0, "n must be a whole number"),
        (Noise(N=1.0), 10, 0.0, "rate must be positive"),
        (Noise(N=1.0), 10, "fast", "rate must be a number"),
        (Noise(N=-1.0), 10, 1.0, "not negative"),
        (Noise(K=np.nan), 10, 1.0, "finite"),
        (Noise(N=[1.0, 2.0], K=[1.0, 2.0, 3.0]), 10, 1.0, "different lengths"),
    ],
)
def test_messages(noise, n, rate, words):
    with pytest.raises(DataError, match=words.replace("(", r"\(")):
        noise.simulate(n, rate, seed=0)


@pytest.mark.parametrize("resolution", [0.0, -1.0, np.nan, "fine", [1.0, 2.0, 3.0]])
def test_message_about_the_resolution(resolution):
    with pytest.raises(DataError, match="resolution must"):
        Noise(N=[1.0, 2.0]).simulate(10, 1.0, seed=0, resolution=resolution)
