"""The state-space form against the densities of the model, in simulations, and in a Kalman filter."""

import math

import jax
import numpy as np
import pytest

from jaxcal import DataError
from jaxcal.allan import deviation
from jaxcal.noise import Noise, discrete

RATE = 10.0
ALL = Noise(Q=0.02, N=0.5, B=0.7, K=0.1, R=0.01, markov=((0.5, 3.0),), sinusoid=((0.3, 0.37),))


def simulated(model, steps, runs, seed):
    """Simulate outputs of the state-space model step by step, (steps, runs)."""
    random = np.random.default_rng(seed)

    def drawn(covariance):
        values, vectors = np.linalg.eigh(covariance)
        return vectors * np.sqrt(np.maximum(values, 0.0))

    size = len(model.output)
    state, push = drawn(model.initial) @ random.standard_normal((size, runs)), drawn(model.process)
    y = math.sqrt(model.white) * random.standard_normal((steps, runs))
    for t in range(steps):
        y[t] += model.output @ state
        state = model.transition @ state + push @ random.standard_normal((size, runs))
    return y


@pytest.mark.parametrize("noise", [ALL, Noise(Q=1.0), Noise(N=1.0), Noise(B=1.0), Noise(K=1.0), Noise(R=1.0), Noise(markov=((1.0, 3.0),))])
def test_simulation_has_the_allan_variance_of_the_model(noise):
    """300 simulated records of 4,096 samples agree with the state-space model within 4.5 standard errors.

    Where the chain approximates flicker, they agree with the noise itself within the stated error of the chain.
    """
    model = discrete(noise, RATE, band=(1e-3, 5.0))
    m = np.array([1, 2, 4, 8, 32, 128, 512])
    tau = m / RATE
    variance = deviation(simulated(model, 4096, 300, seed=0), RATE, m=m, alpha=0).deviation ** 2
    mean, error = variance.mean(axis=1), variance.std(axis=1, ddof=1) / math.sqrt(300.0)
    np.testing.assert_array_less(np.abs(mean - model.noise.avar(tau, dt=1.0 / RATE)), 4.5 * error)
    assert np.all(error < 0.1 * mean)
    served = tau <= 0.1 / model.band[0] if model.band else tau > 0.0
    assert served.sum() >= 6
    off = np.abs(np.sqrt(mean / noise.avar(tau, dt=1.0 / RATE)) - 1.0) - 2.25 * error / mean
    assert np.all(off[served] < 0.5 * (model.psd_error or 0.0))


@pytest.mark.parametrize("states", [3, 7])
def test_density_of_the_matrices(states):
    """The density of the model is dt [H (z - F)^-1 P (z - F)^-H H' + r] at z = exp(2 pi i f dt), exactly for each term."""
    model = discrete(Noise(Q=0.02, N=0.5, B=0.7, K=0.1, markov=((0.5, 3.0), (0.1, 0.01))), RATE, states=states, band=(1e-3, 5.0))
    for f in (1e-4, 0.01, 0.3, 2.0, 5.0):
        z = np.exp(2j * np.pi * f / RATE)
        gain = np.linalg.solve((z * np.eye(len(model.output)) - model.transition).T, model.output.astype(complex))
        found = ((gain @ model.process @ gain.conj()).real + model.white) / RATE
        np.testing.assert_allclose(model.noise.psd(f, dt=1.0 / RATE), found, rtol=1e-9)


def test_values():
    model = discrete(ALL, RATE, states=4, band=(0.01, 5.0))
    at = {name: i for i, name in enumerate(model.names)}
    assert model.names == (
        "walk", "flicker 1", "flicker 2", "flicker 3", "flicker 4", "markov 1", "next", "last", "ramp", "slope", "cos 1", "sin 1"
    )  # fmt: skip
    np.testing.assert_allclose(model.white, 0.5**2 * RATE)
    np.testing.assert_allclose(model.process[0, 0], 0.1**2 / RATE)
    i = at["markov 1"]
    np.testing.assert_allclose(model.transition[i, i], np.exp(-0.1 / 3.0))
    np.testing.assert_allclose(model.initial[i, i], 0.5**2 * 3.0 / 2.0)
    np.testing.assert_allclose(model.process[i, i], 0.375 * (1.0 - np.exp(-0.2 / 3.0)))
    # quantisation is the difference of two rounding errors divided by the interval
    i, j = at["next"], at["last"]
    assert model.output[i] == RATE
    assert model.output[j] == -RATE
    assert model.transition[j, i] == 1.0
    assert model.process[i, i] == 0.02**2
    # stationary states stay stationary
    kept = np.isin(model.names, ["walk", "ramp", "slope"], invert=True)
    after = (model.transition @ model.initial @ model.transition.T + model.process)[np.ix_(kept, kept)]
    np.testing.assert_allclose(after, model.initial[np.ix_(kept, kept)], rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(model.process, model.process.T)
    assert len(model.chain) == 4
    assert model.noise.B == 0.0
    assert model.noise.markov[0] == ALL.markov[0]


@pytest.mark.parametrize(("decades", "states"), [(1, 1), (1, 2), (2, 3), (3, 3), (4, 6), (6, 6)])
def test_error_of_the_chain_is_the_one_stated(decades, states):
    """The sum of densities of sampled first-order processes is compared with dt/(2 sin(pi f dt)) on a separate grid."""
    band = (50.0 * 10.0**-decades, 50.0)
    model = discrete(Noise(B=2.0), 100.0, states=states, band=band)
    f = np.geomspace(*band, 5003)
    total = np.zeros_like(f)
    for strength, correlation in model.chain:
        a = np.exp(-0.01 / correlation)
        total += strength**2 * correlation / 2.0 * (1.0 - a**2) * 0.01 / (1.0 + a**2 - 2.0 * a * np.cos(2.0 * np.pi * f * 0.01))
    ratio = total / (4.0 * 0.01 / (2.0 * np.sin(np.pi * f * 0.01)))
    np.testing.assert_allclose(np.max(np.abs(ratio - 1.0)), model.psd_error, rtol=0.02)
    np.testing.assert_allclose(np.max(ratio) - 1.0, 1.0 - np.min(ratio), rtol=0.02)  # the largest errors above and below are equal
    tau = np.unique(np.round(np.geomspace(0.01, 0.1 / band[0], 500) * 100.0)) / 100.0
    off = np.abs(np.sqrt(model.noise.avar(tau, dt=0.01) / Noise(B=2.0).avar(tau, dt=0.01)) - 1.0)
    assert np.max(off) < 0.5 * model.psd_error
    # measured errors of the density: 20 to 8 % with one state per decade, 4 % or less with 1.5
    assert model.psd_error < {1.0: 0.21, 1.5: 0.04, 2.0: 0.02}[states / decades]


def test_the_default_chain():
    model = discrete(Noise(B=1e-4), 100.0)
    np.testing.assert_allclose(model.band, (1.0 / 3600.0, 50.0))
    assert model.psd_error < 0.1
    assert len(model.chain) == 6
    # one state fewer is not enough
    assert discrete(Noise(B=1e-4), 100.0, states=5, band=model.band).psd_error > 0.1
    # the chain scales with B and does not depend on the other terms
    again = discrete(Noise(B=2e-4, N=1.0), 100.0)
    np.testing.assert_allclose(np.array(again.chain) / np.array(model.chain), np.tile([2.0, 1.0], (6, 1)))


def test_a_kalman_filter_with_it_is_consistent():
    """Innovations for flicker with white noise and random walk are white and have the variance that the filter predicts."""
    n, noise = 30_000, Noise(N=0.3, B=1.0, K=0.01)
    model = discrete(noise, 1.0, states=6, band=(1e-4, 0.5))
    y = noise.simulate(n, 1.0, seed=2)
    f, h = model.transition, model.output
    state, covariance = np.zeros(len(h)), model.initial + np.diag([1e4] + [0.0] * (len(h) - 1))
    normalised = np.zeros(n)
    for t in range(n):
        spread = covariance @ h
        variance = h @ spread + model.white
        innovation = y[t] - h @ state
        normalised[t] = innovation / math.sqrt(variance)
        gain = spread / variance
        state = f @ (state + gain * innovation)
        covariance = f @ (covariance - np.outer(gain, spread)) @ f.T + model.process
    settled = normalised[100:]
    assert abs(np.mean(settled**2) - 1.0) < 4.5 * math.sqrt(2.0 / len(settled))
    for lag in (1, 2, 10, 100):
        assert abs(np.mean(settled[lag:] * settled[:-lag])) < 4.5 / math.sqrt(len(settled))
    # the test is sensitive: without flicker the filter is inconsistent
    assert np.mean(settled**2) * variance > 1.1 * model.white


def test_without_any_state():
    model = discrete(Noise(N=2.0), 10.0)
    assert model.transition.shape == model.process.shape == model.initial.shape == (0, 0)
    assert model.output.shape == (0,)
    assert model.names == ()
    assert model.white == 40.0
    assert model.band is model.psd_error is None
    assert discrete(Noise(), 10.0).white == 0.0


@pytest.mark.parametrize(
    ("noise", "rate", "options", "words"),
    [
        (Noise(N=np.ones(3)), 10.0, {}, r"take noise.channel\(0\)"),
        ({"N": 1.0}, 10.0, {}, "must be a jaxcal.noise.Noise"),
        (Noise(N=-1.0), 10.0, {}, "not negative"),
        (Noise(N=1.0), 0.0, {}, "rate must be positive"),
        (Noise(B=1.0), 10.0, {"states": 0}, "whole number from 1"),
        (Noise(B=1.0), 10.0, {"band": 1.0}, r"band must be \(low, high\) in Hz; got 1.0"),
        (Noise(B=1.0), 10.0, {"band": (0.1, 6.0)}, "half the rate, 5 Hz"),
        (Noise(B=1.0), 10.0, {"band": (0.2, 1.0)}, "at least a decade"),
        (Noise(B=1.0), 0.004, {}, "give band="),
    ],
)
def test_messages(noise, rate, options, words):
    with pytest.raises(DataError, match=words):
        discrete(noise, rate, **options)


def test_message_in_a_trace():
    with pytest.raises(DataError, match="outside of jit"):
        jax.jit(lambda n: discrete(Noise(N=n), 10.0).white)(1.0)
