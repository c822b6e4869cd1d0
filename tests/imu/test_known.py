"""Six positions, the rate table and the detector of rests: closed forms, scatter of simulated runs against the covariance, refusals."""

import numpy as np
import pytest

import jaxcal
from jaxcal._arrays import windowed_variance
from jaxcal.evidence._rests import still_intervals
from jaxcal.imu import MEMS, Triad, gravity, observability, rate_table, six_position

from .cases import inside, positions

G = 9.81
ACCEL, GYRO = MEMS.accel, MEMS.gyro
EARTH_RATE = 7.292115e-5  # rad/s, WGS 84
SIX = np.kron(np.eye(3), np.array([[1.0], [-1.0]]))


def test_six_positions_are_the_closed_form(precision):
    y = positions(sigma=0.005, seed=1)  # with less scatter than the noise given, the faces are level
    found = six_position(y, G, sigma=0.01)
    np.testing.assert_allclose(found.triad.bias, y.mean(axis=0), atol=1e-10)
    np.testing.assert_allclose(found.triad.matrix, ((y[0::2] - y[1::2]) / (2 * G)).T, atol=1e-10)
    error = found.estimate.error
    np.testing.assert_allclose(error[:9], 0.01 / (np.sqrt(2) * G), rtol=1e-9)
    np.testing.assert_allclose(error[9:], 0.01 / np.sqrt(6), rtol=1e-9)
    exact = six_position(positions(), G, sigma=0.01).triad
    np.testing.assert_allclose(exact.matrix, ACCEL.matrix, atol=1e-14)


@pytest.mark.long
def test_six_position_scatter_is_its_covariance():
    """With 400 runs a standard deviation is known to 3.5 %, and the mean of twelve of them to about 1 %."""
    truth = np.r_[np.ravel(ACCEL.matrix), ACCEL.bias]
    fits = [six_position(positions(sigma=0.02, seed=s), G, sigma=0.02) for s in range(400)]
    predicted = np.sqrt(np.mean([f.estimate.error**2 for f in fits], axis=0))
    ratio = np.std([f.estimate.values for f in fits], axis=0) / predicted
    np.testing.assert_allclose(ratio[[0, 4, 8, 9, 10, 11]], 1, atol=0.12)
    assert ratio.max() < 1.12  # the misalignment is left out in some runs
    assert 0.937 < np.mean([inside(f, truth) for f in fits]) < 0.99  # 4 standard errors of 4,800 intervals


def test_six_position_refuses(refuses):
    y = positions()
    for readings, options, code in (
        (y, {"gravity": 1.0}, "gravity"),
        (y[:5], {}, "six"),
        (y[:3], {"up": SIX[:3]}, "few"),
        (y[:4], {"up": SIX[:4]}, "few"),
        (y[[0, 0, 0, 0, 0]], {"up": SIX[[0, 0, 0, 0, 0]]}, "positions_open"),
        (y[[0, 2, 1, 3, 4, 5]], {}, "order"),
        (np.full((6, 3), np.nan), {}, "not_finite"),
        (y[0], {}, "shapes"),
        (y, {"up": SIX[:4]}, "shapes"),
        (y, {"sigma": -1.0}, "not_positive"),
    ):
        with refuses(code):
            six_position(readings, **{"gravity": G, **options})
    assert six_position(y[::-1], sigma=1.0).codes == {"axes_exchanged", "gravity_assumed"}
    assert six_position(positions(levelling=np.deg2rad(0.5), seed=1), G, sigma=1e-3).codes == {"no_misalignment"}


def table(latitude=None, sigma=0.0, seed=0, faces=SIX, gyro=GYRO):
    """Mean readings on a rate table with each face up, at +-0.5 and +-1.5 rad/s about the vertical; then the true rates and forces."""
    up = np.repeat(faces, 4, axis=0)
    rates = up * np.tile([0.5, -0.5, 1.5, -1.5], len(faces))[:, None]
    force = G * up
    earth = 0.0 if latitude is None else EARTH_RATE * np.sin(latitude) * up
    return gyro.measure(rates + earth, force) + sigma * np.random.default_rng(seed).normal(size=rates.shape), rates, force


def test_rate_table_recovers_the_triad_with_its_g_sensitivity():
    y, rates, force = table()
    found = rate_table(y, rates, force, sigma=1e-5)
    for name in ("matrix", "bias", "g_sensitivity"):
        np.testing.assert_allclose(getattr(found.triad, name), getattr(GYRO, name), atol=1e-13)
    column = (y[2] - y[3]) / 3.0
    np.testing.assert_allclose(found.triad.matrix[:, 0], column, atol=2e-3 * np.abs(column).max())
    truth = np.r_[np.ravel(GYRO.matrix), GYRO.bias, np.ravel(GYRO.g_sensitivity)]
    fits = [rate_table(*table(sigma=2e-4, seed=s)) for s in range(300)]
    assert np.mean([inside(f, truth) for f in fits]) == pytest.approx(0.95, abs=0.011)  # 4 standard errors of 6,300 intervals
    values = np.array([np.ravel(f.triad.g_sensitivity) for f in fits])
    predicted = np.sqrt(np.mean([f.estimate.select("g_sens*").error ** 2 for f in fits], axis=0))
    np.testing.assert_allclose(np.std(values, axis=0) / predicted, 1, atol=0.17)
    servo = rate_table(y, rates, force, sigma=1e-9, servo=1e-3)
    np.testing.assert_allclose(servo.estimate.error[0], 1e-3 * GYRO.matrix[0, 0], rtol=1e-3)


def test_the_vertical_part_of_the_earths_rate_passes_for_g_sensitivity():
    """At a latitude of 40 degrees the g-sensitivity is wrong by 15.041 deg/h sin 40 = 9.67 deg/h per g on its diagonal."""
    planted = Triad(np.eye(3), np.zeros(3), np.deg2rad(0.05) / G * np.array([[1.0, 0.5, -0.3], [0.2, -1, 0.4], [0.1, 0.2, 0.7]]))
    y, rates, force = table(np.deg2rad(40.0), gyro=planted)
    good = rate_table(y, rates, force, latitude=np.deg2rad(40.0), sigma=1e-6).triad.g_sensitivity
    np.testing.assert_allclose(good, planted.g_sensitivity, atol=1e-13)
    wrong = rate_table(y, rates, force, sigma=1e-6).triad.g_sensitivity - planted.g_sensitivity
    np.testing.assert_allclose(np.rad2deg(wrong * G) * 3600, 9.67 * np.eye(3), atol=0.01)


def test_rate_table_refuses(refuses):
    y, rates, force = table()
    for arguments, options, code in (
        ((y, rates[:3], force), {}, "shapes"),
        ((y, rates, force / G), {}, "unit"),
        ((y[:3], rates[:3]), {}, "few"),
        ((y[:8], rates[:8], force[:8]), {}, "positions_open"),
        ((y[:8], np.ones((8, 3))), {}, "positions_open"),
        ((y, rates), {"latitude": 0.5}, "no_up"),
    ):
        with refuses(code):
            rate_table(*arguments, **options)


def test_windowed_variance_is_that_of_numpy_even_with_large_counts():
    rng = np.random.default_rng(0)
    x = 1e6 + 2 * rng.normal(size=(3000, 3))
    x[1000:1400] += 4000 * np.sin(np.arange(400) / 30)[:, None]
    windows = np.lib.stride_tricks.sliding_window_view(x, 51, axis=0)
    expected = np.linalg.norm(windows.var(axis=-1, ddof=1), axis=1)
    np.testing.assert_allclose(windowed_variance(x, 51), expected, rtol=1e-8)
    # a missing sample is left out of its windows; the variance of a window that lacks half of its samples is undefined
    x[2000] = np.nan
    expected[1950:2001] = np.linalg.norm(np.nanvar(windows[1950:2001], axis=-1, ddof=1), axis=1)
    np.testing.assert_allclose(windowed_variance(x, 51), expected, rtol=1e-8)
    x[2000:2030] = np.nan
    undefined = np.isinf(windowed_variance(x, 51))
    assert (undefined[1979:2000].all(), undefined[:1974].any(), undefined[2005:].any()) == (True, False, False)


def test_still_intervals_are_those_that_were_made():
    rng = np.random.default_rng(0)
    x = 0.01 * rng.normal(size=(10_000, 3))
    moves = [(4000, 4300), (5000, 5500), (6000, 6400), (8000, 8300)]
    for i, j in moves:
        x[i:j] += 3 * np.sin(np.arange(j - i) / 15)[:, None]
    found = still_intervals({"accel": x}, 100.0)
    assert len(found) == 5
    # a window of 1 s keeps a distance of 0.5 s from motion, to within the few samples that a motion needs to exceed the threshold
    assert np.abs(np.stack([found.stop[:-1], found.start[1:]], axis=1) - np.array(moves) - [-50, 50]).max() <= 5
    # coarse values, most of which are constant at rest, have the same rests
    coarse = still_intervals({"accel": 0.15 * np.round(x / 0.15)}, 100.0)
    assert np.abs(coarse.ends - found.ends).max() <= 12
    # the gyroscope detects a slow turn that the accelerometer does not detect
    gyro = 1e-3 * rng.normal(size=(10_000, 3))
    for i, j in [*moves, (2000, 2200)]:
        gyro[i:j] += 0.1 * np.sin(np.arange(j - i) / 15)[:, None]
    both = still_intervals({"accel": x, "gyro": gyro}, 100.0)
    assert len(both) == 6
    assert abs(both.stop[0] - 1950) < 20
    # some missing samples do not end a rest; a long gap does
    x[2400:2430], x[7000:7200:9] = np.nan, np.nan
    assert len(still_intervals({"accel": x}, 100.0)) == 5
    x[2400:2480] = np.nan
    assert len(still_intervals({"accel": x}, 100.0)) == 6


def test_what_moves_all_the_time_has_no_still_intervals():
    """The stillest windows of a motion are not white, though their variance is that of a twentieth of all windows."""
    rng, time = np.random.default_rng(0), np.arange(12_000) / 100.0
    waves = [np.sin(2 * np.pi * f * time[:, None] + rng.uniform(0, 6, 3)) for f in rng.uniform(0.2, 2.0, 12)]
    moving = {
        "accel": 9.81 + sum(waves) + 0.01 * rng.normal(size=(12_000, 3)),
        "gyro": sum(waves[::2]) + 1e-3 * rng.normal(size=(12_000, 3)),
    }
    assert len(still_intervals(moving, 100.0)) == 0
    # tremor of a hand, or the vibration of a table, is no such motion
    shaking = {name: 0.1 * np.sin(2 * np.pi * 9.0 * time)[:, None] + 0.01 * rng.normal(size=(12_000, 3)) for name in moving}
    assert len(still_intervals(shaking, 100.0)) == 1


@pytest.mark.parametrize(("samples", "size", "code"), [(100, 1.0, "too_short"), (5000, 0.0, "constant")])
def test_what_has_no_still_intervals(samples, size, code, refuses):
    with refuses(code):
        still_intervals({"accel": size * np.random.default_rng(0).normal(size=(samples, 3))}, 100.0)


def test_observability_names_what_is_missing():
    faces = observability(SIX)
    assert faces.condition == np.inf
    assert faces.weakest == ("misalignment of x and y", "misalignment of x and z", "misalignment of y and z")
    assert faces.finding.severity == jaxcal._answer.FATAL
    assert observability(SIX, diagonal=True).condition == pytest.approx(1.0)
    edges = np.array([[a, b, 0] for a in (1, -1) for b in (1, -1)]) / np.sqrt(2)
    eighteen = observability(np.concatenate([SIX, edges, edges[:, [0, 2, 1]], edges[:, [2, 0, 1]]]))
    assert eighteen.condition < 2
    assert len(eighteen.missing) == 0
    rng = np.random.default_rng(0)
    upper = rng.normal(size=(200, 3))
    upper = upper[upper[:, 2] > 0][:24]
    half = observability(upper / np.linalg.norm(upper, axis=1, keepdims=True))
    assert "bias along z" in half.weakest
    assert "-z up" in half.finding.facts["missing"]
    assert half.missing[0, 2] < -0.9
    # poses in the advised directions make the problem well conditioned
    mended = observability(np.concatenate([upper / np.linalg.norm(upper, axis=1, keepdims=True), half.missing]))
    assert mended.condition < half.condition / 2
    near = np.array([0, 0, 1.0]) + 0.02 * rng.normal(size=(20, 3))
    alike = observability(near / np.linalg.norm(near, axis=1, keepdims=True))
    assert alike.finding.code == "attitudes_alike"
    assert gravity(0.5) > 9.78
