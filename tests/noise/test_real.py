"""A reduced version of benchmarks/real_noise.py: halves of real logs, disturbances, and spectra that are not those of the model."""

import collections

import numpy as np
import pytest
import scipy.fft

import jaxcal

RATE, SAMPLES = 100.0, 2**16
N, B = 7.3e-5, 3.7e-5


def drawn(seed, exponent=1.0, corner=(B / N) ** 2 / (2 * np.pi)):
    """A record of white noise N and slow noise of an exponent, equal at a corner in Hz, drawn ordinate by ordinate."""
    f = RATE / np.pi * np.sin(np.pi * np.arange(1, SAMPLES) / (2 * SAMPLES))
    level = N**2 * (1.0 + (corner / f) ** exponent)
    ordinates = np.sqrt(level * RATE) * np.random.default_rng(seed).standard_normal(SAMPLES - 1)
    return scipy.fft.idct(np.concatenate([[0.0], ordinates]), norm="ortho")


@pytest.mark.parametrize(("exponent", "corner"), [(1.0, 0.04), (0.8, 0.1), (0.8, 1.0), (1.2, 1.0)])
def test_n_and_the_curve_hold_under_other_spectra(exponent, corner):
    inside = []
    for seed in range(8):
        fit = jaxcal.noise.fit(drawn(seed, exponent, corner), RATE)
        x = np.pi * np.arange(1, SAMPLES) / (2 * SAMPLES)
        level = N**2 * (1.0 + (corner / (RATE / np.pi * np.sin(x))) ** exponent)
        row = [fit.interval["N"][0] <= N <= fit.interval["N"][1]]
        for tau in (1.0, 10.0):
            m = round(tau * RATE)
            expected = np.sqrt(np.mean(2 * np.sin(m * x) ** 4 / (m * np.sin(x)) ** 2 * level) * RATE)
            cell = fit.numbers[f"deviation_{tau:g}_s"]
            row.append(cell.low <= expected <= cell.high)
        inside.append(row)
    assert np.all(np.mean(inside, axis=0) >= 0.75)  # of 8 intervals of 95 %; fewer have a probability of 0.5 %


def test_findings_are_hardly_ever_needless():
    """Each is said of at most 3 % of plain records; of 40, more than five have a probability of 0.15 %."""
    said = collections.Counter(code for seed in range(40) for code in jaxcal.noise.fit(drawn(100 + seed), RATE).codes)
    assert max(said.values(), default=0) <= 5, said


def test_an_event_is_found_or_named_beside_k():
    """A change of 60 deg/h with 250 s from the middle was K in 57 % of records, without a word."""
    t, silent = np.arange(SAMPLES) / RATE, 0
    for seed in range(12):
        fit = jaxcal.noise.fit(drawn(seed) - 2.9e-4 * np.expm1(-np.maximum(t - t[-1] / 2, 0.0) / 250.0), RATE)
        silent += fit.presence["K"] == "present" and not fit.codes & {"step", "warm_up", "ramp", "sinusoid", "instead"}
    assert silent <= 3  # of 7 % of records, more than three of twelve have a probability of 0.8 %


def half_sine(y, size, start, length):
    m = int(length * RATE)
    y[start : start + m] += size * np.sin(np.pi * np.arange(m) / m)


@pytest.mark.parametrize(("size", "start", "length"), [(0.03, 30_000, 1.0), (0.15, 0, 0.2), (0.5, 64_000, 2.0)])
def test_a_knock_changes_nothing(size, start, length):
    y = drawn(1)
    clean = jaxcal.noise.fit(y, RATE)
    half_sine(y, size, start, length)
    fit = jaxcal.noise.fit(y, RATE)
    assert fit.presence["N"] == "present"
    assert "set_aside" in fit.codes
    for term in "NB":
        low, high = clean.interval[term]
        assert abs(getattr(fit.noise, term) - getattr(clean.noise, term)) < 0.3 * (high - low) / 3.92


def test_halves_of_a_real_record_agree(reference):
    with np.load(reference / "data" / "adis16405" / "imu1.npz") as file:
        y, rate = file["counts"][:500_000, :3] * file["scale"][:3], float(file["fs"])
    first, second = (jaxcal.noise.fit(part, rate) for part in (y[:250_000], y[250_000:]))
    for i in range(3):
        a, b = first.channel(i), second.channel(i)
        errors = [np.diff(one.interval["N"])[0] / 3.92 for one in (a, b)]
        assert abs(float(a.noise.N) - float(b.noise.N)) < 3.0 * np.hypot(*errors)
        assert np.hypot(*errors) < 0.1 * float(a.noise.N)


def test_compare_finds_the_process(refuses):
    walk = jaxcal.noise.Noise(N=1e-3, K=1e-3).simulate(20_000, rate=RATE, seed=1)
    found = jaxcal.noise.compare(walk, RATE)
    assert found.names[0] == "K"
    assert found.names[-1] == "white"
    assert np.all(np.isfinite(found.later))
    process = jaxcal.noise.Noise(N=1e-3, markov=((1e-3, 20.0),)).simulate(100_000, rate=RATE, seed=1)
    best = jaxcal.noise.compare(process, RATE, rivals=("white", "B and K", "markov"))
    assert best.names[0] == "markov"
    assert 5.0 < float(best.shape[0].split()[1]) < 80.0
    with refuses("unknown_rival"):
        jaxcal.noise.compare(walk, RATE, rivals=("pink",))
