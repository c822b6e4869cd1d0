"""Prior knowledge from data sheets and earlier calibrations, and additional terms, chosen by name or because the log requires them."""

import numpy as np
import pytest

import jaxcal
from jaxcal import DataError
from jaxcal.imu import Nonlinear, Triad, multi_position

from . import world


def log_of(seed, **case):
    stamps, accel, gyro, truth = world.record(seed, **case)
    return jaxcal.Log(stamps, accel=accel, gyro=gyro), truth


def known_to(truth, sigma, rng):
    """A calibration whose parameters have errors of standard deviation `sigma`, with the covariance that states these errors."""
    value = truth + np.where(truth != 0, sigma * rng.normal(size=33), 0)
    parts = {}
    for sensor, first, count in (("accel", 0, 12), ("gyro", 12, 21)):
        numbers = value[first : first + count]
        triad = Triad(numbers[:9].reshape(3, 3), numbers[9:12], numbers[12:].reshape(3, 3) if count == 21 else np.zeros((3, 3)))
        names = [f"matrix[{i},{j}]" for i in range(3) for j in range(3)] + [f"bias[{i}]" for i in range(3)]
        names += [f"g_sensitivity[{i},{j}]" for i in range(3) for j in range(3)] * (count == 21)
        covariance = jaxcal.calibration.Covariance(tuple(names), np.diag(np.where(truth[first : first + count] != 0, sigma**2, 0.0)))
        parts[sensor] = jaxcal.calibration.Part(triad, {"accel": "m/s^2", "gyro": "rad/s"}[sensor], covariance=covariance)
    return jaxcal.Calibration(imu=parts)


@pytest.mark.long
def test_ten_poses_with_an_earlier_calibration_are_as_good_as_it():
    inside, errors = [], []
    for seed in range(6):
        log, truth = log_of(seed, poses=10)
        prior = known_to(truth, 5e-5, np.random.default_rng(seed))
        alone, found = (multi_position(log, gravity=world.GRAVITY, held_out=False, prior=one) for one in (None, prior))
        free = np.flatnonzero(found.standard_error[:9] > 0)
        inside.append((found.interval[free, 0] <= truth[free]) & (truth[free] <= found.interval[free, 1]))
        errors.append([(one.values - truth)[free] for one in (alone, found)])
        assert np.all(found.standard_error[free] <= 5.1e-5)
        assert (alone.verdict, found.verdict) == ("weak", "good")
    assert np.mean(inside) > 0.85
    without, with_prior = np.sqrt(np.mean(np.square(errors), axis=(0, 2)))
    assert with_prior < min(5e-5, 0.7 * without)


def test_five_poses_and_a_data_sheet():
    """A data sheet allows 1 % of scale and misalignment and a bias of 0.1. Five poses leave some parameters open; the sheet bounds them."""
    log, truth = log_of(0, poses=5)
    sheet = {"scale": 0.01, "misalignment": 0.01, "bias": 0.1}
    found = multi_position(jaxcal.Log(log.time, accel=log.accel), gravity=world.GRAVITY, prior={"accel": sheet}, held_out=False)
    free = np.flatnonzero(found.standard_error[:12] > 0)
    assert len(free) == 9
    assert np.all(found.standard_error[free] <= np.array([0.0101] * 6 + [0.101] * 3))
    assert np.all(np.abs(found.residual_norm) < 5e-3)
    assert np.all((found.interval[free, 0] <= truth[free]) & (truth[free] <= found.interval[free, 1]))


def test_a_prior_of_another_device_is_told():
    log, truth = log_of(1, poses=12)
    found = multi_position(log, gravity=world.GRAVITY, prior=known_to(truth * 1.01, 3e-4, np.random.default_rng(0)), held_out=False)
    assert found.verdict == "weak"
    assert "prior contradicts" in found.reason
    for bad, reason in (
        ({"accel": {"sclae": 1.0}}, "expected accel and gyro"),
        ({"accel": {"scale": -1.0}}, "above zero"),
        (3, "expected a data sheet"),
        (jaxcal.Calibration(imu={"accel": Triad(np.eye(3), np.zeros(3))}), "has no covariance"),
    ):
        with pytest.raises(DataError, match=reason):
            multi_position(log, gravity=world.GRAVITY, prior=bad)


@pytest.mark.long
def test_terms_that_the_log_asks_for_are_added():
    log, truth = log_of(0, **world.CASES["quadratic"])
    plain = multi_position(log, gravity=world.GRAVITY, held_out=False)
    assert (plain.verdict, plain.asked) == ("weak", ("accel.quadratic",))
    found = multi_position(log, gravity=world.GRAVITY, held_out=False, terms="auto")
    assert found.verdict == "good"
    assert isinstance(found.accel, Nonlinear)
    free = np.concatenate([found.standard_error > 0])
    truth = np.concatenate([truth, np.full(3, world.CASES["quadratic"]["quadratic"])])
    inside = (found.interval[free, 0] <= truth[free]) & (truth[free] <= found.interval[free, 1])
    assert inside.mean() > 0.8
    assert any("asked for accel.quadratic" in sentence for sentence in found.warnings)


@pytest.mark.long
def test_a_drift_is_fitted_where_it_is_asked_for():
    """The accelerometer drifts by 2 mg over the recording; the fitted bias is that at its middle."""
    log, truth = log_of(2)
    time = np.asarray(log.time) - np.mean(log.time)
    drift = 0.02 / np.ptp(time)
    drifting = jaxcal.Log(log.time, accel=log.accel + drift * time[:, None], gyro=log.gyro)
    plain = multi_position(drifting, gravity=world.GRAVITY, held_out=False)
    assert plain.verdict == "weak"
    assert plain.asked[0] in ("accel.drift", "accel.warm_up")
    found = multi_position(drifting, gravity=world.GRAVITY, held_out=False, terms=["accel.drift"])
    assert found.verdict == "good"
    free = found.standard_error > 0
    assert np.mean((found.interval[free, 0] <= truth[free]) & (truth[free] <= found.interval[free, 1])) > 0.8
    # three more parameters increase the errors little; the drift increased them much
    assert np.mean(np.abs(found.values - truth)[:9]) < 0.5 * np.mean(np.abs(plain.values - truth)[:9])


def test_a_squared_sensitivity_of_the_gyroscope_is_named():
    log, _ = log_of(0, poses=12)
    known = np.array([[1, 0, 0]]) * 1e-4 * log.accel**2
    found = multi_position(jaxcal.Log(log.time, accel=log.accel, gyro=log.gyro + known), gravity=world.GRAVITY, held_out=False)
    assert (found.verdict, found.asked) == ("weak", ("gyro.g_squared",))
    assert "still rates ask for a term of the squared specific force of 0.56 deg/s at 1 g" in found.reason


def test_terms_that_there_are_not():
    log, _ = log_of(0, poses=12)
    with pytest.raises(DataError, match="needs a log with a gyroscope"):
        multi_position(jaxcal.Log(log.time, accel=log.accel), gravity=world.GRAVITY, terms=["accel.drift"])
    with pytest.raises(DataError, match="There is no term"):
        multi_position(log, gravity=world.GRAVITY, terms=["accel.quartic"])
    with pytest.raises(DataError, match="convention='upper' or 'lower'"):
        multi_position(log, gravity=world.GRAVITY, terms=["accel.cubic"], convention="full")
