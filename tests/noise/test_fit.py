"""`fit`: bias, scatter, coverage and verdicts on simulated records, the band, gaps, the differentiable path, and messages."""

import jax
import numpy as np
import pytest
import scipy.signal

import jaxcal
from jaxcal import DataError
from jaxcal.noise import Noise, characterise, fit

RATE = 100.0
#: thesis table 7.3, gyroscope X, in deg and s
GYRO = Noise(N=0.25 / 60, B=7.6 / 3600, K=1.8 / 3600)
WHITE = Noise(N=0.25 / 60)


@pytest.fixture(scope="module")
def runs():
    """Fits of records of 2^15 samples: 80 with N, B and K, and 60 of white noise alone."""

    def records(noise, number):
        return fit(np.stack([noise.simulate(2**15, RATE, seed=s) for s in range(number)], axis=1), RATE)

    return {"gyro": records(GYRO, 80), "white": records(WHITE, 60)}


@pytest.mark.long
def test_coefficients_are_unbiased_and_intervals_cover(runs):
    """The expected errors come from those of 2^17 samples (N 0.20, B 9.8, K 20.7 %), which grow at most by 2 for B and K."""
    found = runs["gyro"]
    relative = {term: np.asarray(getattr(found.noise, term)) / getattr(GYRO, term) - 1 for term in ("N", "B", "K")}
    assert abs(relative["N"].mean()) < 0.004
    assert abs(relative["B"].mean()) < 0.10
    for term, rmse in (("N", 0.008), ("B", 0.30), ("K", 0.75)):
        assert np.sqrt(np.mean(relative[term] ** 2)) < rmse
        low, high = found.interval[term]
        share = np.mean((low <= getattr(GYRO, term)) & (getattr(GYRO, term) <= high))
        # by the binomial distribution, fewer than 69 of 80 intervals of 95 % contain the truth once in a thousand tries
        assert share >= 69 / 80, (term, share)
        if term != "N":  # N can be low if Q, bounded at zero, absorbs a part of it
            assert np.mean(found.upper_limit[term] >= getattr(GYRO, term)) >= 69 / 80
    low, high = found.interval["Q"]
    assert np.mean(low == 0) >= 69 / 80
    assert np.mean([verdict == "present" for verdict in found.presence["Q"]]) <= 0.05
    assert np.mean([any(line[0] > 0 for line in found.channel(i).noise.sinusoid) for i in range(80)]) <= 0.05


@pytest.mark.long
def test_the_covariance_is_the_scatter(runs):
    found = runs["gyro"]
    spread = np.sqrt(np.mean(found.covariance["N", "N"]))
    np.testing.assert_allclose(np.std(found.noise.N**2), spread, rtol=0.35)


@pytest.mark.long
def test_absent_terms_are_not_detected(runs):
    found = runs["white"]
    for term in ("Q", "B", "K"):
        # nominal shares are at most 5 % and 1 %: 60 records exceed 9 and 4 once in several thousand tries
        assert sum(v != "not detected" for v in found.presence[term]) <= 9, term
        assert sum(v == "present" for v in found.presence[term]) <= 4, term
    assert set(found.presence["N"]) == {"present"}
    assert set(runs["gyro"].presence["B"]) <= {"present", "hint", "not detected"}
    # five minutes show B in 5 of 6 records, and exclude one Gauss-Markov process in its place in half of them
    assert np.mean([v != "not detected" for v in runs["gyro"].presence["B"]]) > 0.75
    assert np.mean([v == "present" for v in runs["gyro"].presence["B"]]) > 0.4


@pytest.mark.long
def test_the_band_is_left_whole_where_the_model_holds(runs):
    for found in runs.values():
        whole = np.all(found.used, axis=0)
        assert sum(whole) >= len(whole) - 2
        assert np.mean(found.goodness < 0.05) < 0.15


def test_a_low_pass_filter_is_left_out_and_named():
    """The sensor averages 16 samples, which distorts cluster times near and below this length."""
    samples = 2**16
    raw = WHITE.simulate(samples + 15, RATE, seed=3)
    found = fit(np.convolve(raw, np.full(16, 1 / 16), "valid"), RATE)
    low, high = found.interval["N"]
    assert low <= WHITE.N <= high
    assert 0.08 <= found.band[0] <= 2.0
    assert found.presence["Q"] == "not detected"
    assert "band" in found.codes
    assert not found.used[0]
    assert found.used[-1]
    everything = fit(np.convolve(raw, np.full(16, 1 / 16), "valid"), RATE, band=(0.01, 100.0))
    assert everything.band[0] == 0.01
    assert everything.goodness < 1e-3
    assert "misfit" in everything.codes


@pytest.mark.long
def test_behind_a_filter_intervals_still_cover():
    """For 40 records behind a moving average of 4 samples, N, B and K are not biased, and their intervals cover."""
    samples, runs = 2**15, 40
    y = [np.convolve(GYRO.simulate(samples + 3, RATE, seed=s), np.full(4, 0.25), "valid") for s in range(runs)]
    found = fit(np.stack(y, axis=1), RATE)
    assert not np.any(np.all(found.used, axis=0))
    assert abs(np.mean(found.noise.N) / GYRO.N - 1) < 0.02
    for term in ("N", "B", "K"):
        low, high = found.interval[term]
        share = np.mean((low <= getattr(GYRO, term)) & (getattr(GYRO, term) <= high))
        # fewer than 33 of 40 intervals of 95 % contain the truth once in a thousand tries
        assert share >= 33 / 40, (term, share)


def test_band_on_request():
    y = GYRO.simulate(2**15, RATE, seed=1)
    found = fit(y, RATE, band=(0.1, 50.0))
    assert 0.1 <= found.band[0] < 0.2
    assert 25 < found.band[1] <= 50.0
    assert not found.used[0]


def test_a_ramp_is_fitted_where_asked():
    y = Noise(N=1e-3, R=1e-4).simulate(2**15, RATE, seed=2)
    found = fit(y, RATE, terms=("N", "B", "K", "R"))
    low, high = found.interval["R"]
    assert low <= 1e-4 <= high
    assert found.presence["R"] == "present"
    assert found.terms == ("N", "B", "K", "R")
    assert found.presence["K"] == "not detected"


def test_gaps_change_the_result_little_and_are_told():
    y = GYRO.simulate(2**16, RATE, seed=5)
    whole = fit(y, RATE)
    holed = y.copy()
    for start in (1000, 20_000, 41_000):
        holed[start : start + 40] = np.nan
    found = fit(holed, RATE)
    np.testing.assert_allclose(found.noise.N, whole.noise.N, rtol=0.01)
    assert next(one.facts["share"] for one in found.findings if one.code == "gaps") == pytest.approx(0.183, abs=1e-3)
    for leaf in jax.tree.leaves(found):
        if isinstance(leaf, np.ndarray) and leaf.dtype.kind == "f":
            assert not np.any(np.isnan(leaf))


def test_units_scale_and_records_fitted_together_do_not_mix():
    records = [GYRO.simulate(2**14, RATE, seed=s) for s in range(6)]
    t = np.arange(2**14) / RATE
    records[1][3000:3700] = np.nan
    records[2] = scipy.signal.lfilter(*scipy.signal.butter(2, 0.3), records[2])
    records[3] += 0.02 * np.sin(2 * np.pi * 7.3 * t)
    records[4] += 0.05 * (t > 60.0)
    records[5][5000:5040] += 1.0
    together = fit(np.stack(records, axis=1), RATE)
    for i, y in enumerate(records):
        one, own = fit(y * 1e-9, RATE), together.channel(i)
        for term in ("Q", "N", "B", "K"):
            np.testing.assert_allclose(np.asarray(getattr(one.noise, term)) * 1e9, getattr(own.noise, term), rtol=1e-6, atol=1e-9)
            np.testing.assert_allclose(np.array(one.interval[term]) * 1e9, own.interval[term], rtol=1e-4, atol=1e-9)
        np.testing.assert_allclose([one.goodness, *one.deviation.edf], [own.goodness, *own.deviation.edf], rtol=1e-5)
        assert (one.presence, one.codes) == (own.presence, own.codes)
    lines = [float(together.channel(i).noise.sinusoid[0][0]) for i in (0, 3)]  # without a line, one of zero
    assert (lines[0], lines[1]) == (0.0, pytest.approx(0.02, rel=0.05))
    assert together.noise.N.shape == (6,)
    assert together.covariance.array.shape == (4, 4, 6)
    assert together.channel(1).deviation.deviation.ndim == 1


def test_longer_record_is_about_right():
    """If the record is four times as long, the relative error of N is halved."""
    # the width of one interval scatters, because the noise of a short record may be uneven by chance
    fits = {n: [fit(WHITE.simulate(n, RATE, seed=seed), RATE) for seed in range(9)] for n in (2**13, 2**15)}
    short, long = (np.median([one.longer_record["N"] for one in found]) for found in fits.values())
    np.testing.assert_allclose(short, long, rtol=0.1)
    short = fits[2**13][0]
    assert short.longer_record["N"] < short.duration < 1000.0 < short.longer_record["K"]


def test_results_are_numpy_in_float64_whatever_the_precision(precision):
    found = fit(GYRO.simulate(2000, RATE, seed=1), RATE)
    np.testing.assert_allclose(found.noise.N, 0.25 / 60, rtol=0.1)
    assert all(not isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(found))


def test_characterise_names_channels_and_reports_progress():
    log = jaxcal.Log(None, gyro=Noise(N=[1e-4, 2e-4, 3e-4]).simulate(4000, RATE, seed=0), rate=RATE)
    steps = []
    found = characterise(log, progress=lambda done, total, name: steps.append((done, total, name)))
    assert list(found) == ["gyro_x", "gyro_y", "gyro_z"]
    assert steps == [(0, 3, "gyro_x"), (3, 3, "")]
    np.testing.assert_allclose(found["gyro_z"].noise.N, 3e-4, rtol=0.1)


def test_characterise_names_the_channel_that_cannot_be_used():
    with pytest.raises(DataError, match=r"gyro_x: .*equal"):
        characterise(jaxcal.Log(None, gyro=np.full((4000, 3), 0.5), rate=RATE))


@pytest.mark.parametrize(
    ("y", "options", "words"),
    [
        (np.full(1000, 3.0), {}, "every sample is equal"),
        (np.arange(20.0), {}, "too short to fit 4 noise terms"),
        (np.zeros(1), {}, "of 1 sample is too short"),
        (np.random.default_rng(0).standard_normal(1000), {"method": "magic"}, "unknown method"),
        (np.random.default_rng(0).standard_normal(1000), {"terms": ("N", "X")}, "distinct names among Q, N, B, K, R"),
        (np.random.default_rng(0).standard_normal(1000), {"band": (1.0, 1.1)}, "too few for 4 terms"),
        (np.random.default_rng(0).standard_normal(1000), {"band": 3.0}, "(shortest, longest)"),
        (np.array([0.0, np.inf] * 500), {}, "infinite values"),
        (np.stack([np.arange(100.0) % 7, np.ones(100)], axis=1), {}, "channel 1: every sample is equal"),
    ],
)
def test_messages(y, options, words):
    with pytest.raises(DataError) as caught:
        fit(y, RATE, **options)
    assert words in str(caught.value)
