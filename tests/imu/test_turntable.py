"""Raw logs of a rate table and of a block on its faces, simulated with NumPy alone, against the simulated truth."""

import numpy as np
import pytest

import jaxcal
from jaxcal.imu import Triad, ferraris, rate_test
from jaxcal.imu._scale import scale_figures

RATE = 100.0
DEGREE = np.pi / 180
MATRIX = np.array([[1.01, 0.002, -0.001], [0.003, 0.99, 0.002], [-0.002, 0.001, 1.005]])
SWEEP = np.array([0, 50, 100, 150, 100, 50, 0, -50, -100, -150, -100, -50, 0]) * DEGREE


def table_log(seed, cubic=0.0, asymmetry=0.0, wander=0.0):
    """Simulate a sweep up and down about each axis, with ramps of 1 s between the rates and a bias that changes from rate to rate."""
    rng = np.random.default_rng(seed)
    w, shift = [], []
    for axis in range(3):
        for k, rate in enumerate(SWEEP):
            before = SWEEP[k - 1] if k else 0.0
            w.append(np.concatenate([np.linspace(before, rate, 100), np.full(400, rate)])[:, None] * np.eye(3)[axis])
            shift.append(np.tile(wander * rng.normal(size=3), (500, 1)))
    w, shift = np.concatenate(w), np.concatenate(shift)
    bent = w + cubic * w**3 + asymmetry * np.abs(w)
    gyro = bent @ MATRIX.T + [0.01, -0.02, 0.0] + shift + 2e-3 * rng.normal(size=w.shape)
    return jaxcal.Log(None, gyro=gyro, rate=RATE)


def test_the_rates_are_found_in_a_raw_log():
    found = rate_test(table_log(0), np.array([50, 100, 150]) * DEGREE)
    assert (found.verdict, found.codes, len(found.start)) == ("good", set(), 37)  # the rests between two axes are one
    matrix = found.fit.estimate.select("matrix*")
    assert np.sum(np.abs(matrix.values - MATRIX.ravel()) <= matrix.intervals()[:, 1] - matrix.values) >= 7
    np.testing.assert_allclose(found.gyro.matrix, MATRIX, atol=2e-4)
    assert found.numbers["x.nonlinearity"].value == found.figures["x"].nonlinearity
    assert found.numbers["gyro.bias[0]"].unit == "rad/s"
    assert jaxcal.Calibration(imu=found).imu.gyro.estimate.names[0] == "matrix[0,0]"


def test_what_bends_is_told_in_ppm_and_what_does_not_is_noise():
    """A cubic term of 0.1 % at 150 deg/s, of which the straight line absorbs the most, and an asymmetry of 600 ppm between the signs."""
    figures = rate_test(table_log(1, cubic=1e-3 / (150 * DEGREE) ** 2), np.array([50, 100, 150]) * DEGREE).figures
    left = SWEEP**3 - SWEEP * (SWEEP @ SWEEP**3) / (SWEEP @ SWEEP)
    assert figures["x"].nonlinearity == pytest.approx(1e3 * np.abs(left).max() / (150 * DEGREE) ** 3, rel=0.1)
    assert figures["x"].nonlinearity > figures["x"].nonlinearity_noise
    figures = rate_test(table_log(2, asymmetry=3e-4), np.array([50, 100, 150]) * DEGREE).figures
    for one in figures.values():
        low, high = one.asymmetry_interval
        assert abs(one.asymmetry - 600) < high - low < 400
    line = scale_figures(SWEEP, SWEEP + np.where(np.diff(SWEEP, prepend=0) > 0, 1e-4, 0.0), sigma=1e-7)
    assert line.hysteresis == pytest.approx(1e-4 / (150 * DEGREE) * 1e6, rel=0.05)


def test_figures_of_a_straight_line_are_within_the_noise_they_state():
    rng = np.random.default_rng(0)
    runs = [scale_figures(SWEEP, SWEEP + 1e-4 * rng.normal(size=SWEEP.shape)) for _ in range(300)]
    # 300 runs: the shares have standard errors of 1.3 %
    assert np.mean([one.nonlinearity > one.nonlinearity_noise for one in runs]) < 0.09
    assert np.mean([one.hysteresis > one.hysteresis_noise for one in runs]) < 0.09
    assert 0.91 < np.mean([one.asymmetry_interval[0] < 0 < one.asymmetry_interval[1] for one in runs]) < 0.99
    assert np.median([one.repeatability for one in runs]) == pytest.approx(1e-4 / (150 * DEGREE) * 1e6, rel=0.1)


def test_rates_that_are_wrong_or_few(refuses):
    log = table_log(3)
    with refuses("no_such_rate"):
        rate_test(log, [50.0, 100.0, 150.0])
    one = rate_test(jaxcal.Log(None, gyro=np.asarray(log.gyro)[:6500], rate=RATE), np.array([50, 100, 150]) * DEGREE)
    assert (one.verdict, one.codes, one.gyro, list(one.figures)) == ("weak", {"one_way"}, None, ["x"])


def test_a_block_on_its_faces(refuses):
    triad = Triad(np.array([[1.01, 0.01, 0.0], [-0.005, 0.99, 0.002], [0.0, 0.004, 1.02]]), np.array([0.1, -0.2, 0.05]))
    rng = np.random.default_rng(0)
    up = np.concatenate([sign * np.eye(3)[[axis]] for axis in range(3) for sign in (1, -1)] + [np.ones((1, 3)) / np.sqrt(3)])
    parts = []
    for here, there in zip(up, np.roll(up, -1, axis=0), strict=True):
        parts += [np.tile(here, (400, 1)), np.linspace(here, there, 100) + 0.3 * rng.normal(size=(100, 3))]
    force = 9.81 * np.concatenate(parts)
    log = jaxcal.Log(None, accel=triad.measure(force) + 0.01 * rng.normal(size=force.shape), rate=RATE)
    found = ferraris(log, gravity=9.81)
    assert len(found.residual_norm) == 6  # the seventh rest lies on a corner
    assert (found.verdict, found.method, found.gyro) == ("good", "six_position", None)
    np.testing.assert_allclose(found.accel.matrix, triad.matrix, atol=5e-4)
    assert jaxcal.Calibration(imu=found).imu.gyro is None
    with refuses("missing"):
        ferraris(jaxcal.Log(None, accel=log.accel[:2000], rate=RATE))
