"""Spectra against SciPy, Parseval's identity and dense covariance matrices; options, channels and messages."""

import math

import hypothesis
import hypothesis.strategies as st
import numpy as np
import pytest
import scipy.fft
import scipy.signal

import jaxcal
from jaxcal.spectrum import density

RATE = 25.0
SIDES = {1: True, 2: False}


def record(n=500, seed=0, channels=None):
    shape = (n,) if channels is None else (n, channels)
    return 9.81 + np.random.default_rng(seed).standard_normal(shape)


@pytest.mark.parametrize("sided", [1, 2])
@pytest.mark.parametrize("n", [4, 5, 64, 500, 501])
def test_periodogram_equals_scipy(n, sided):
    y = record(n)
    found = density(y, RATE, sided=sided, average=None)
    frequency, expected = scipy.signal.periodogram(y, RATE, return_onesided=SIDES[sided])
    here = slice(1, n // 2 + 1)
    np.testing.assert_allclose(found.frequency, np.abs(frequency[here]), rtol=1e-13)
    np.testing.assert_allclose(found.density, expected[here], rtol=1e-9)


@pytest.mark.parametrize("sided", [1, 2])
@pytest.mark.parametrize(("segment", "overlap"), [(64, 0.5), (65, 0.5), (50, 0.0), (48, 0.75), (500, 0.5)])
def test_welch_equals_scipy(segment, overlap, sided):
    y = record(500) + np.linspace(0.0, 5.0, 500)
    found = density(y, RATE, method="welch", sided=sided, average=None, segment=segment, overlap=overlap)
    frequency, expected = scipy.signal.welch(y, RATE, nperseg=segment, noverlap=int(segment * overlap), return_onesided=SIDES[sided])
    here = slice(1, segment // 2 + 1)
    np.testing.assert_allclose(found.frequency, np.abs(frequency[here]), rtol=1e-13)
    np.testing.assert_allclose(found.density[1:], expected[here][1:], rtol=1e-9)
    # subtracting the mean of a segment removes a sixth of its first ordinate, for which SciPy does not correct
    np.testing.assert_allclose(found.density[0], expected[1] * 6 / 5, rtol=1e-9)


@hypothesis.settings(max_examples=40, deadline=None)
@hypothesis.given(n=st.integers(4, 300), seed=st.integers(0, 2**32 - 1), average=st.sampled_from(["octave", "log", None]))
def test_parseval(n, seed, average):
    """The sum of ordinates times their spacing is the variance for every kind of averaging."""
    y = record(n, seed)
    one = density(y, RATE, sided=1, average=average, keep_tail=True)
    assert np.sum(one.density * one.count) * RATE / n == pytest.approx(np.var(y), rel=1e-9)
    two = density(y, RATE, sided=2, average=None)
    twice = np.full(n // 2, 2.0)
    if n % 2 == 0:
        twice[-1] = 1.0
    assert np.sum(two.density * twice) * RATE / n == pytest.approx(np.var(y), rel=1e-9)
    dct = density(y, RATE, method="dct", sided=1, average=average, keep_tail=True)
    assert np.sum(dct.density * dct.count) * RATE / (2 * n) == pytest.approx(np.var(y), rel=1e-9)


def test_dct_equals_scipy():
    y = record(333)
    found = density(y, RATE, method="dct", average=None)
    np.testing.assert_allclose(found.frequency, np.arange(1, 333) * RATE / 666, rtol=1e-14)
    np.testing.assert_allclose(found.density, scipy.fft.dct(y, norm="ortho")[1:] ** 2 / RATE, rtol=1e-8, atol=1e-13)
    np.testing.assert_allclose(density(y, RATE, method="dct", sided=1, average=None).density, 2 * found.density, rtol=1e-14)


def expected_ordinates(root, rate):
    """Expected ordinates of a Gaussian record with covariance root root', as the sum of the ordinates of the columns of the root."""
    moving = np.ptp(root, axis=0) > 0  # a constant column contributes nothing above frequency zero
    return density(root[:, moving], rate, method="dct", average=None).density.sum(axis=1)


@pytest.mark.parametrize("n", [8, 33, 96])
def test_dct_of_the_noise_terms_has_the_expectations_of_their_covariance(n):
    dt, z = 1.0 / RATE, np.eye(n + 1)
    k = np.arange(1, n)
    s = 2.0 * np.sin(np.pi * k / (2 * n))
    quantisation = 3e-4 / dt * np.diff(z, axis=0)
    expected = 3e-4**2 / dt * (s**2 + 4.0 / n * np.cos(np.pi * k / (2 * n)) ** 2)
    np.testing.assert_allclose(expected_ordinates(quantisation, RATE), expected, rtol=1e-11)
    walk = 2e-3 * math.sqrt(dt) * np.cumsum(np.eye(n), axis=0)
    np.testing.assert_allclose(expected_ordinates(walk, RATE), 2e-3**2 * dt**2 / s**2, rtol=1e-11)
    np.testing.assert_allclose(expected_ordinates(0.7 * np.eye(n), RATE), np.full(n - 1, 0.49 * dt), rtol=1e-11)
    # ordinates of a random walk are independent, since the transform of its covariance is diagonal
    transform = scipy.fft.dct(np.eye(n), norm="ortho", axis=0)
    covariance = transform @ walk @ walk.T @ transform.T
    inner = covariance[1:, 1:]
    assert np.max(np.abs(inner - np.diag(np.diag(inner)))) < 1e-12 * np.max(inner)


def test_dct_of_flicker_against_its_covariance():
    """Increments of flicker have the autocovariance -(4 B^2/pi)/(4 h^2 - 1); the uncorrected density at k = 1 is 29 % too high."""
    n, h = 96, np.arange(96)
    increments = -(4.0 / np.pi) / (4.0 * h**2 - 1.0)
    root = np.linalg.cholesky(increments[np.abs(h[:, None] - h[None, :])])
    found = expected_ordinates(np.cumsum(root, axis=0), 1.0)
    naive = 1.0 / (2.0 * np.sin(np.pi * np.arange(1, n) / (2 * n)))
    assert naive[0] / found[0] == pytest.approx(1.29, abs=0.005)
    assert naive[1] / found[1] == pytest.approx(1.11, abs=0.005)
    assert naive[20] / found[20] == pytest.approx(1.008, abs=0.001)


@pytest.mark.parametrize("method", ["periodogram", "welch", "dct"])
def test_channels_are_what_each_is_alone(method):
    y = record(3000, channels=3)
    y[:, 1] = np.cumsum(y[:, 1])
    options = {"method": method, "sided": 1}
    both = density(y, RATE, **options)
    fortran = density(np.asfortranarray(y), RATE, **options)
    for i in range(3):
        alone = density(y[:, i], RATE, **options)
        for name in ("frequency", "density", "lower", "upper", "count", "edf"):
            np.testing.assert_allclose(getattr(both.channel(i), name), getattr(alone, name), rtol=1e-9)
            np.testing.assert_allclose(getattr(fortran.channel(i), name), getattr(alone, name), rtol=1e-9)
        assert (both.channel(i).method, both.channel(i).sided, both.channel(i).rate) == (method, 1, RATE)


def test_a_line_stands_at_its_frequency_with_its_power():
    """A sinusoid of amplitude A with whole periods has its mean square A^2/2 in a single ordinate."""
    n, t = 1000, np.arange(1000) / RATE
    y = 3.0 * np.sin(2 * np.pi * 2.5 * t) + 1e-6 * record(n)
    found = density(y, RATE, sided=1, average=None)
    peak = np.argmax(found.density)
    assert found.frequency[peak] == pytest.approx(2.5)
    assert found.density[peak] * RATE / n == pytest.approx(4.5, rel=1e-5)


def test_default_segment_of_welch():
    found = density(record(10_000), RATE, method="welch", average=None)
    assert found.frequency[0] == pytest.approx(RATE / 1024)
    assert found.count.tolist() == [(10_000 - 1024) // 512 + 1] * 512


def test_a_record_is_left_as_it_was():
    y = record(300)
    before = y.copy()
    for method in ("periodogram", "welch", "dct"):
        density(y, RATE, method=method, sided=1)
    np.testing.assert_array_equal(y, before)


RECORD = np.arange(100.0) % 7


@pytest.mark.parametrize(
    ("y", "options", "code"),
    [
        ([], {}, "record"), ([1.0, 2.0, 3.0], {}, "too_short"), ([math.nan] * 5, {}, "empty"), ([3.0] * 50, {}, "constant"),
        ([1.0, 2.0, math.inf, 2.0], {}, "record"), (np.stack([RECORD, np.ones(100)], axis=1), {}, "constant"),
        (["a", "b"], {}, "not_numbers"), (np.zeros((2, 2, 2)), {}, "record"), (np.zeros((3, 100)), {}, "record"),
        *((RECORD, options, code) for options, code in (
            ({"method": "burg"}, "method"), ({"sided": 3}, "sided"), ({"average": "decade"}, "average"), ({"average": [1]}, "average"),
            ({"confidence": 95}, "confidence"), ({"segment": 50}, "segment"), ({"method": "welch", "segment": 101}, "segment"),
            ({"method": "welch", "segment": 20.5}, "segment"), ({"method": "welch", "overlap": 1.0}, "overlap"),
        )),
    ],
)  # fmt: skip
def test_messages(y, options, code, refuses):
    with refuses(code):
        density(y, RATE, **options)


@pytest.mark.parametrize("rate", [100.0, 99.7, 1 / 3, 1e6 / 7])
def test_a_gap_is_refused_and_the_message_names_a_stretch_that_works(rate, refuses):
    y = record(9000, channels=3)
    y[[1234, 1235, 8000], 1] = np.nan
    with refuses("gaps") as caught:
        density(y, rate)
    assert "y[1236:8000]" in str(caught.value)
    call = str(caught.value).partition("log.select(")[2].partition(")")[0]
    part = jaxcal.Log(None, gyro=y, rate=rate).select(*map(float, call.split(", ")))
    np.testing.assert_array_equal(part.gyro, y[1236:8000])
    assert np.all(density(part.gyro, rate).density > 0)


def test_nothing_but_gaps(refuses):
    y = record(300)
    y[::3] = np.nan
    with refuses("scattered"):
        density(y, RATE)
