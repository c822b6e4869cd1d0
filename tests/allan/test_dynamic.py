"""`dynamic` agrees with `deviation` of each window alone; gaps, channels, a part with large noise, bad input."""

import math

import hypothesis
import hypothesis.strategies as st
import jax
import numpy as np
import pytest

from jaxcal import DataError
from jaxcal.allan import deviation, dynamic

KINDS = ("oadev", "ohdev", "mdev", "tdev")
M = [1, 2, 5, 16]


@pytest.mark.parametrize("kind", KINDS)
@hypothesis.settings(max_examples=10, deadline=None)
@hypothesis.given(
    length=st.integers(60, 400),
    step=st.integers(15, 80),
    seed=st.integers(0, 2**32 - 1),
    gaps=st.integers(0, 4),
    offset=st.sampled_from([0.0, 9.81]),
)
def test_every_window_is_the_deviation_of_its_samples(kind, length, step, seed, gaps, offset):
    random = np.random.default_rng(seed)
    y = offset + random.standard_normal(length) + np.cumsum(random.standard_normal(length))
    for _ in range(gaps):
        start = random.integers(0, length)
        y[start : start + random.integers(1, 30)] = np.nan
    if np.isnan(y).all():
        return
    window = 60
    found = dynamic(y, 2.0, window=window / 2.0, step=step / 2.0, m=M, kind=kind)
    starts = np.arange(0, length - window + 1, step)
    np.testing.assert_allclose(found.time, (starts + window / 2) / 2.0)
    for i, start in enumerate(starts):
        try:
            alone = deviation(y[start : start + window], 2.0, m=M, kind=kind)
        except DataError:
            assert np.isnan(found.deviation[i]).all()
            continue
        there = np.isin(found.m, alone.m)
        assert np.isnan(found.deviation[i, ~there]).all()
        assert np.isnan(found.upper[i, ~there]).all()
        np.testing.assert_array_equal(found.count[i, there], alone.count)
        np.testing.assert_allclose(found.deviation[i, there], alone.deviation, rtol=1e-9)
        np.testing.assert_array_equal(found.alpha[i, there], alone.alpha)
        for name in ("edf", "lower", "upper"):
            np.testing.assert_allclose(getattr(found, name)[i, there], getattr(alone, name), rtol=1e-9)
    assert bool(found.findings) == (np.isnan(found.deviation).any() or len(found.m) < len(M))


def test_channels_defaults_and_the_record_at_hand():
    y = np.random.default_rng(1).standard_normal((4000, 3))
    y[:, 1] = np.nan
    found = dynamic(y, 10.0, window=100.0)
    assert found.deviation.shape == (7, len(found.m), 3)
    assert found.time.tolist() == [50.0, 100.0, 150.0, 200.0, 250.0, 300.0, 350.0]
    assert found.m[-1] == 500
    assert found.window == 100.0
    assert (found.codes, found.findings[0].subject) == ({"empty"}, ("channel 1",))
    assert np.isnan(found.deviation[:, :, 1]).all()
    alone = dynamic(y[:, 2], 10.0, window=100.0)
    np.testing.assert_allclose(found.channel(2).deviation, alone.deviation, rtol=1e-12)
    np.testing.assert_array_equal(found.channel(2).alpha, alone.alpha)
    with pytest.raises(IndexError, match="single channel"):
        alone.channel(0)


def test_intervals_cover_as_often_as_they_say():
    """The noise is white, so that adjacent windows are independent."""
    windows = 400
    found = dynamic(np.random.default_rng(3).standard_normal(512 * windows), 1.0, window=512, step=512, m=[1, 8, 32])
    truth = 1.0 / np.sqrt(found.m)
    share = np.mean((found.lower <= truth) & (truth <= found.upper), axis=0)
    # the limit is 5 standard errors, plus 2 % for the chi-square approximation and for identifying the noise type from 16 averages
    assert np.all(np.abs(share - 0.95) < 5 * math.sqrt(0.95 * 0.05 / windows) + 0.02), share


def test_no_setting_of_jax_is_changed_and_precision_does_not_matter(precision):
    before = jax.config.jax_enable_x64
    y = 9.81 + 1e-3 * np.random.default_rng(2).standard_normal(3000)
    found = dynamic(y, 100.0, window=10.0, m=[1, 10])
    assert jax.config.jax_enable_x64 == before
    assert found.deviation.dtype == np.float64
    np.testing.assert_allclose(found.deviation[1], deviation(y[500:1500], 100.0, m=[1, 10]).deviation, rtol=1e-9)


def test_a_constant_has_deviation_zero():
    found = dynamic(np.full(200, 9.81), 1.0, window=50)
    assert np.all(found.deviation == 0.0)
    assert np.all(found.upper == 0.0)


@pytest.mark.parametrize(
    ("y", "options", "words"),
    [
        (np.zeros(0), {}, "not empty"),
        (np.zeros(100), {"window": 101}, "longer than the record"),
        (np.zeros(100), {"window": 0.1}, "at least one sample"),
        (np.zeros(100), {"window": "long"}, "window must be"),
        (np.zeros(100), {"step": 0}, "step must be"),
        (np.zeros(100), {"step": math.nan}, "step must be"),
        (np.zeros(100), {"m": [6]}, "outside 1 .. 5"),
        (np.zeros(100), {"kind": "adev"}, "there is no dynamic adev"),
        (np.zeros(100), {"kind": "what"}, "unknown kind"),
        (np.zeros(100), {"confidence": 1.0}, "between 0 and 1"),
        (np.full(100, np.nan), {}, "100 of 100 samples are missing"),
        (np.where(np.arange(100) % 2, np.nan, 1.0), {}, "no window has a difference free of gaps: 50 of 100"),
        (np.where(np.arange(100) == 7, np.inf, 1.0), {}, "infinite values, the first at sample 7"),
    ],
)
def test_messages(y, options, words):
    with pytest.raises(DataError, match=words):
        dynamic(y, 1.0, **({"window": 10} | options))


def test_a_traced_record_is_refused():
    with pytest.raises(DataError, match="inside jit or grad"):
        jax.jit(lambda y: dynamic(y, 1.0, window=10).deviation)(np.zeros(100))
