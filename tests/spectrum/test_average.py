"""Averaging tables of spectra, and intervals that depend on the number of averaged ordinates."""

import math

import numpy as np
import pytest
import scipy.stats

from jaxcal.spectrum import density

#: Table 5.1 of the thesis: first ordinate, last ordinate, number of ordinates per average
TABLE = [
    (1, 32, 1), (33, 64, 2), (65, 128, 4), (129, 256, 8), (257, 512, 16), (513, 1024, 32), (1025, 2048, 64), (2049, 4096, 128),
    (4097, 8192, 256), (8193, 16384, 512), (16385, 32768, 1024),
]  # fmt: skip


def groups(average, ordinates, keep_tail=False):
    """First ordinate and number of ordinates for every value of an averaged spectrum."""
    y = np.random.default_rng(ordinates).standard_normal(2 * ordinates + 1)
    count = density(y, 1.0, average=average, keep_tail=keep_tail).count
    return np.cumsum(count) - count, count


def test_octave_groups_are_the_table_of_the_thesis():
    start, count = groups("octave", 32_768)
    assert len(start) == 192
    expected = [(first, size) for low, high, size in TABLE for first in range(low, high + 1, size)]
    assert [(a + 1, c) for a, c in zip(start.tolist(), count.tolist(), strict=True)] == expected


def test_a_record_of_65536_samples_has_192_values():
    y = np.random.default_rng(0).standard_normal(65_536)
    found, raw = density(y, 100.0), density(y, 100.0, average=None)
    assert found.frequency.shape == (192,)
    assert found.findings == ()
    np.testing.assert_allclose(found.frequency[-1], raw.frequency[-1024:].mean(), rtol=1e-12)
    assert found.count[[0, 31, 32, 47, 48, -1]].tolist() == [1, 1, 2, 2, 4, 1024]


@pytest.mark.parametrize("average", [None, "octave", "log"])
@pytest.mark.parametrize("ordinates", [2, 31, 32, 33, 47, 48, 49, 100, 4095, 4096, 4097, 12_345])
def test_groups_lie_one_behind_the_other(average, ordinates):
    start, count = groups(average, ordinates, keep_tail=True)
    assert count.sum() == ordinates
    assert np.all(count >= 1)
    whole = groups(average, ordinates)
    dropped = len(start) - len(whole[0])
    assert dropped in (0, 1)
    np.testing.assert_array_equal(whole[0], start[: len(whole[0])])
    if dropped:  # the last group was not full and grows with a few more ordinates
        longer = groups(average, ordinates + int(count[-1]) * 20, keep_tail=True)
        assert longer[1][len(start) - 1] > count[-1]


def test_log_groups_are_forty_to_the_decade():
    start, _ = groups("log", 48_000, keep_tail=True)
    assert start[:48].tolist() == list(range(48))
    for decade in (48, 480, 4800):
        assert np.count_nonzero((start >= decade) & (start < 10 * decade)) == 40
    np.testing.assert_allclose(start[100:] / start[99:-1], 10 ** (1 / 40), rtol=2e-3)


def test_a_ragged_tail_is_dropped_and_said_or_kept_with_its_count():
    y = np.random.default_rng(1).standard_normal(220)  # 110 ordinates, of which 2 are after the last full group of four
    raw = density(y, 22.0, average=None)
    dropped, kept = density(y, 22.0), density(y, 22.0, keep_tail=True)
    assert len(kept.density) == len(dropped.density) + 1
    assert (dropped.codes, kept.codes) == ({"tail"}, set())
    assert dropped.findings[0].facts == {"lowest": pytest.approx(10.9), "lost": 2, "ordinates": 110}
    assert kept.count[-2:].tolist() == [4, 2]
    assert kept.density[-1] == pytest.approx(raw.density[-2:].mean())
    assert kept.frequency[-1] == pytest.approx(raw.frequency[-2:].mean())


@pytest.mark.parametrize("average", ["octave", "log"])
def test_average_is_a_mean_over_each_group(average):
    y = np.random.default_rng(2).standard_normal((1001, 2))
    values, start_count = density(y, 1.0, average=None).density, groups(average, 500, keep_tail=True)
    expected = [values[a : a + c].mean(axis=0) for a, c in zip(*start_count, strict=True)]
    np.testing.assert_allclose(density(y, 1.0, average=average, keep_tail=True).density, expected, rtol=1e-13)


def test_degrees_of_freedom_of_the_periodogram_and_the_dct():
    """An ordinate has two degrees of freedom, that at half the rate (in even records) one; each DCT ordinate has one."""
    y = np.random.default_rng(0).standard_normal(101)
    np.testing.assert_allclose(density(y, 1.0).edf, 2.0 * density(y, 1.0).count)
    np.testing.assert_allclose(density(y[:100], 1.0, average=None).edf, [2.0] * 49 + [1.0])
    np.testing.assert_allclose(density(y[:100], 1.0, average=None, sided=1).edf, [2.0] * 49 + [1.0])
    assert density(y[:64], 1.0, sided=1).edf[-1] == pytest.approx(1.0)
    # in a one-sided spectrum the last of two ordinates counts half, so that the sum behaves as three equal squares
    assert density(y[:68], 1.0, sided=1).edf[-1] == pytest.approx(3.0)
    found = density(y, 1.0, method="dct", keep_tail=True)
    np.testing.assert_array_equal(found.edf, found.count)


def test_degrees_of_freedom_of_half_overlapping_hann_segments():
    """The value is 36 K^2 / (19 K - 1) by Percival and Walden, Spectral Analysis for Physical Applications, 1993, equation 294."""
    for segments in (1, 2, 7, 100):
        y = np.random.default_rng(0).standard_normal(128 * (segments + 1))
        found = density(y, 1.0, method="welch", segment=256, overlap=0.5, average=None).edf
        np.testing.assert_allclose(found[8:120], 36.0 * segments**2 / (19.0 * segments - 1.0), rtol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize(("average", "overlap"), [(None, 0.5), ("octave", 0.5), ("log", 0.5), ("octave", 0.75), ("log", 0.0)])
def test_degrees_of_freedom_of_welch_are_those_of_the_spread(average, overlap):
    """Degrees of freedom agree with 2 mean^2 / variance over 6000 white records, which has a standard error of 1.9 to 3 %."""
    y = np.random.default_rng(3).standard_normal((1024, 6000))
    found = density(y, 1.0, method="welch", average=average, segment=256, overlap=overlap, keep_tail=True)
    spread = 2.0 * found.density.mean(axis=1) ** 2 / found.density.var(axis=1)
    edf = found.edf[:, 0]
    error = np.sqrt((2.0 + 12.0 / edf) / 6000)  # relative variance of a sample variance of chi-square
    assert np.all(np.abs(spread / edf - 1.0) < 4.5 * error), spread / edf


@pytest.mark.parametrize(
    "options",
    [
        {"average": None}, {"average": "octave"}, {"average": "log", "sided": 1}, {"method": "dct"}, {"method": "dct", "sided": 1},
        {"method": "welch", "segment": 128}, {"method": "welch", "segment": 128, "average": None, "sided": 1},
        {"confidence": 0.8},
    ],
    ids=str,
)  # fmt: skip
def test_intervals_of_white_noise_cover_as_often_as_they_say(options):
    """For 2000 records of 600 samples, the number of intervals that contain the truth is binomial at every frequency."""
    runs, level = 2000, options.get("confidence", 0.95)
    y = math.sqrt(10.0) * np.random.default_rng(4).standard_normal((600, runs))
    found = density(y, 10.0, keep_tail=True, **options)
    truth = np.full(len(found.frequency), 2.0 if found.sided == 1 else 1.0)
    if found.sided == 1 and found.average is None:
        truth[-1] = 1.0  # the ordinate at half the rate is not doubled
    share = np.mean((found.lower <= truth[:, None]) & (truth[:, None] <= found.upper), axis=1)
    error = math.sqrt(level * (1 - level) / runs)
    # 0.5 % allow for the chi-square approximation of a sum of unequal squares
    assert np.all(np.abs(share - level) < 4.5 * error + 0.005), (share.min(), share.max())
    assert abs(share.mean() - level) < 0.005


def test_limits_are_the_quantiles_of_chi_square():
    found = density(np.random.default_rng(0).standard_normal(1000), 1.0, confidence=0.9)
    high, low = (found.edf / scipy.stats.chi2.ppf(p, found.edf) for p in (0.05, 0.95))
    np.testing.assert_allclose(found.upper / found.density, high, rtol=1e-9)
    np.testing.assert_allclose(found.lower / found.density, low, rtol=1e-9)
    assert found.confidence == 0.9
