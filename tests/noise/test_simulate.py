"""Generators against theory by Monte Carlo, with stated error."""

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
    "markov": Noise(markov=((1.0, 3.0),)),
    "sinusoid": Noise(sinusoid=((1.0, 0.37),)),
    "all": Noise(Q=0.01, N=1.0, B=0.5, K=0.2, R=0.05, markov=((0.5, 3.0),), sinusoid=((0.3, 0.37),)),
}


@pytest.mark.parametrize("term", TERMS)
def test_mean_allan_variance_is_the_exact_one(term):
    """200 records of 4,096 samples: the mean within 4.5 standard errors at every cluster size."""
    noise, runs, rate = TERMS[term], 200, 10.0
    y = np.stack([noise.simulate(4096, rate, seed=s) for s in range(runs)], axis=1)
    m = np.array([1, 2, 4, 8, 32, 128, 512, 1024])
    variance = deviation(y, rate, m=m).deviation ** 2
    error = variance.std(axis=1, ddof=1) / np.sqrt(runs)
    z = (variance.mean(axis=1) - noise.avar(m / rate, dt=1 / rate)) / error
    assert np.all(np.abs(z) < 4.5), z
    # and the test could tell: the error is a few per cent of what is measured
    assert np.all(error / variance.mean(axis=1) < 0.09)


def test_a_ramp_is_exact():
    found = deviation(Noise(R=0.5).simulate(1000, 10.0, seed=0), 10.0, m=[1, 10, 100])
    np.testing.assert_allclose(found.deviation**2, 0.5**2 * found.tau**2 / 2.0, rtol=1e-9)


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
        (Noise(N=1.0), 0, 1.0, "positive whole number"),
        (Noise(N=1.0), 1.5, 1.0, "positive whole number"),
        (Noise(N=1.0), 10, 0.0, "positive and finite"),
        (Noise(N=1.0), 10, "fast", "positive and finite"),
        (Noise(N=-1.0), 10, 1.0, "not negative"),
        (Noise(K=np.nan), 10, 1.0, "finite"),
        (Noise(N=[1.0, 2.0], K=[1.0, 2.0, 3.0]), 10, 1.0, "different lengths"),
    ],
)
def test_messages(noise, n, rate, words):
    with pytest.raises(DataError, match=words.replace("(", r"\(")):
        noise.simulate(n, rate, seed=0)
