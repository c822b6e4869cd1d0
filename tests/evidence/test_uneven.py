"""Noise whose level wanders is named, and its intervals are wider; noise of a steady level is not, in 99 % of records."""

import numpy as np
import pytest

import jaxcal
from jaxcal.evidence._uneven import unevenness

from .test_bursts import records


def lowpass(rng, n):
    return np.convolve(rng.normal(size=n + 99), np.exp(-np.arange(100) / 20.0), "valid")


STEADY = {
    "white": lambda rng, n: rng.normal(size=n),
    "tails": lambda rng, n: rng.standard_t(5, size=n),
    "coarse": lambda rng, n: np.round(rng.normal(size=n) / 1.5),
    "slow": lambda rng, n: records.noise(rng, n, 100.0, 0.1, 0.03)[:, 0],
    "filtered": lowpass,
}


@pytest.mark.parametrize("noise", STEADY)
@pytest.mark.parametrize("samples", [10_500, pytest.param(60_000, marks=pytest.mark.long)])
def test_steady_noise_is_not_named(noise, samples):
    rng = np.random.default_rng(0)
    named = [unevenness(STEADY[noise](rng, samples)).loudest is not None for _ in range(300)]
    assert sum(named) <= 8  # 1 % of 300, and three standard deviations


def wandering(rng, n, share=0.3):
    """White noise with a level that wanders by 30 % in a tenth of the record, and a mean square of 1 + share^2."""
    f = np.fft.rfftfreq(2000, 1 / 1000)
    size = np.exp(-((f / 10.0) ** 2))
    draws = np.fft.irfft(size * (rng.normal(size=len(f)) + 1j * rng.normal(size=len(f))), 2000)[:1000]
    level = draws * 2000 / np.sqrt(2.0 * 2.0 * np.sum(size**2))
    return rng.normal(size=n) * (1.0 + share * np.interp(np.linspace(0.0, 999.0, n), np.arange(1000), level))


def test_a_wandering_level_is_named_and_its_intervals_hold():
    rng = np.random.default_rng(1)
    named, hold = [], []
    for _ in range(100):
        y = wandering(rng, 60_000)
        curve, spectrum = jaxcal.allan.deviation(y, 100.0, m=[1, 10, 100]), jaxcal.spectrum.density(y, 100.0)
        for found in (curve, spectrum):
            named.append("uneven" in [one.code for one in found.findings])
        truth = np.sqrt(1.09 / curve.m)
        hold.append([*((curve.lower < truth) & (truth < curve.upper)), spectrum.lower[-1] < 0.0109 < spectrum.upper[-1]])
    assert np.mean(named) > 0.95
    assert (np.mean(hold, axis=0) > 0.85).all(), np.mean(hold, axis=0)


def test_the_loudest_part_is_named_in_seconds_and_by_channel():
    y = np.random.default_rng(2).normal(size=(60_000, 2))
    y[42_000:48_000, 1] *= 1.6
    for found in (jaxcal.allan.deviation(y, 100.0), jaxcal.spectrum.density(y, 100.0)):
        (one,) = [one for one in found.findings if one.code == "uneven"]
        assert one.subject == ("channel 1",)
        assert (one.facts["start"], one.facts["stop"]) == pytest.approx((420.0, 480.0), abs=0.1)
        assert found.channel(0).edf.max() > 3 * found.channel(1).edf.max()
