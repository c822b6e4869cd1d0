"""Every statistic against its definition, gaps, grids of cluster sizes, channels, and messages for unusable input."""

import math

import hypothesis
import hypothesis.strategies as st
import jax
import numpy as np
import pytest

import jaxcal
from jaxcal import DataError
from jaxcal.allan import _deviation, deviation
from jaxcal.allan._kernels import _route

from .definition import differences, truth

KINDS = ("adev", "oadev", "mdev", "tdev", "hdev", "ohdev")


@pytest.mark.parametrize("data", ["rate", "phase"])
@pytest.mark.parametrize("kind", KINDS)
@hypothesis.settings(max_examples=15, deadline=None)
@hypothesis.given(
    length=st.integers(12, 120), seed=st.integers(0, 2**32 - 1), gaps=st.integers(0, 3), offset=st.sampled_from([0.0, 9.81, 1e4])
)
def test_equals_the_definition_with_and_without_gaps(kind, data, length, seed, gaps, offset):
    random = np.random.default_rng(seed)
    y = random.standard_normal(length)
    if data == "phase":
        y = np.cumsum(y)
    y = y + offset
    for _ in range(gaps):
        start = random.integers(0, length)
        y[start : start + random.integers(1, 4)] = np.nan
    m = np.unique(random.integers(1, max(length // 4, 2), size=4))
    if np.isnan(y).all() or not any(counts := [len(differences(y, size, kind, data)[0]) for size in m]):
        with pytest.raises(DataError):
            deviation(y, 1.0, kind=kind, m=m, data=data)
        return
    found = deviation(y, 1.0, kind=kind, m=m, data=data)
    np.testing.assert_array_equal(found.m, m[np.array(counts) > 0])
    np.testing.assert_array_equal(found.count, [count for count in counts if count])
    np.testing.assert_allclose(found.deviation, truth(y, found.m, kind, data), rtol=1e-9, atol=1e-12 * (1 + offset))
    assert found.codes == ({"no_difference"} if 0 in counts else set())
    for values in (found.lower, found.upper, found.edf):
        assert np.all(np.isfinite(values))
    full = deviation(np.where(np.isnan(y), 0.0, y), 1.0, kind=kind, m=found.m, data=data)
    np.testing.assert_array_equal(found.count + found.skipped, full.count)


@pytest.mark.parametrize("kind", KINDS)
def test_blocks_threads_and_shared_points_do_not_show(monkeypatch, kind):
    """A record beyond the cache, in several threads whose large cluster sizes share points, agrees with differences of plain slices."""
    monkeypatch.setattr(_deviation, "PARALLEL_FROM", 1)
    monkeypatch.setattr(_route, "_LONG", 0)
    y = np.random.default_rng(3).standard_normal(280_000).cumsum() + np.random.default_rng(4).standard_normal(280_000)
    m = np.array([1, 2, 7, 100, 1023, 1024, 4095, 8193, 69_999, 93_333])
    found = deviation(np.tile(y[:, None], (1, 3)), 2.0, kind=kind, m=m)
    alone = deviation(y, 2.0, kind=kind, m=m)
    assert alone.count.tolist() == [len(differences(y, size, kind)[0]) for size in m]
    np.testing.assert_allclose(alone.deviation, truth(y, m, kind) / (2.0 if kind == "tdev" else 1.0), rtol=1e-9)
    for channel in range(3):
        np.testing.assert_allclose(found.channel(channel).deviation, alone.deviation, rtol=1e-12)
        np.testing.assert_array_equal(found.alpha[:, channel], alone.alpha)


def test_mdev_keeps_its_digits_on_a_random_walk():
    """For a random walk of rate, the running sum of the phase grows as n^2.5; float64 alone would lose the digits of small clusters."""
    y = np.random.default_rng(0).standard_normal(200_000).cumsum()
    np.testing.assert_allclose(deviation(y, 1.0, kind="mdev", m=[1, 3, 30]).deviation, truth(y, (1, 3, 30), "mdev"), rtol=1e-8)


def test_grids():
    y = np.random.default_rng(0).standard_normal(1000)
    assert deviation(y, 1.0, m="octave").m.tolist() == [1, 2, 4, 8, 16, 32, 64, 128, 256]
    assert deviation(y, 1.0, m="decade").m.tolist() == [1, 2, 4, 10, 20, 40, 100, 200, 400]
    assert deviation(y[:20], 1.0, m="all").m.tolist() == list(range(1, 11))
    log = deviation(y, 1.0).m
    assert [log[0], log[-1], np.all(np.diff(log) > 0)] == [1, 500, True]
    assert deviation(y, 1.0, m=[8, 2]).m.tolist() == [8, 2]
    assert deviation(y, 50.0, m=[10]).tau.tolist() == [0.2]


def test_interval_of_white_noise_covers_as_often_as_it_says():
    """For 500 records of 512 samples, the number of intervals that contain the truth is binomial at each of four cluster sizes."""
    runs = 500
    y = np.random.default_rng(11).standard_normal((512, runs))
    m = np.array([1, 8, 32, 64])
    found = deviation(y, 1.0, m=m, alpha=0)
    truth = 1.0 / np.sqrt(m)[:, None]
    share = np.mean((found.lower <= truth) & (truth <= found.upper), axis=1)
    # the limit is 5 standard errors of a binomial share of 0.95, plus 1 % for the chi-square approximation
    assert np.all(np.abs(share - 0.95) < 5 * math.sqrt(0.95 * 0.05 / runs) + 0.01), share
    np.testing.assert_allclose(found.edf[:, 0], 2 / np.var(found.deviation**2 / truth**2, axis=1), rtol=0.35)


def test_no_setting_of_jax_is_changed_and_precision_does_not_matter(precision):
    before = jax.config.jax_enable_x64
    y = 9.81 + 1e-3 * np.random.default_rng(2).standard_normal(5000)
    found = deviation(y, 100.0, m=[1, 10])
    assert jax.config.jax_enable_x64 == before
    assert isinstance(found.deviation, np.ndarray)
    assert found.deviation.dtype == np.float64
    np.testing.assert_allclose(found.deviation, truth(y, (1, 10), "oadev"), rtol=1e-9)


@pytest.mark.parametrize(
    ("y", "options", "code"),
    [
        ([], {}, "record"), ([1.0], {}, "too_short"), ([1.0, math.inf, 2.0], {}, "record"), ([math.nan] * 5, {}, "no_numbers"),
        (["a", "b"], {}, "not_numbers"), (np.zeros((2, 2, 2)), {}, "record"), (np.zeros((3, 100)), {}, "record"),
        *((np.arange(100.0), options, code) for options, code in (
            ({"kind": "madev"}, "kind"), ({"m": "dense"}, "grid"), ({"m": [0]}, "m"), ({"m": [51]}, "m"), ({"m": [1.5]}, "m"),
            ({"data": "frequency"}, "data"), ({"confidence": 95}, "confidence"),
        )),
    ],
)  # fmt: skip
def test_messages(refuses, y, options, code):
    with refuses(code):
        deviation(np.array(y) if not isinstance(y, np.ndarray) else y, 1.0, **options)


def test_a_single_channel_has_none_to_pick():
    with pytest.raises(IndexError, match="single channel"):
        deviation(np.arange(10.0), 1.0).channel(0)
    assert jaxcal.allan.deviation is deviation


@pytest.mark.parametrize("kind", ["oadev", "tierms"])
def test_a_channel_without_samples_leaves_the_others_alone(kind):
    y = np.random.default_rng(8).standard_normal((500, 3))
    y[:, 1] = np.nan
    found = deviation(y, 1.0, kind=kind, m=[1, 3])
    alone = deviation(y[:, [0, 2]], 1.0, kind=kind, m=[1, 3])
    np.testing.assert_array_equal(found.deviation[:, [0, 2]], alone.deviation)
    assert np.isnan(found.deviation[:, 1]).all()
    assert found.count[:, 1].tolist() == [0, 0]
    assert (found.codes, found.findings[0].subject) == ({"empty"}, ("channel 1",))
    assert (found.channel(0).verdict, found.channel(1).verdict) == ("good", "weak")
