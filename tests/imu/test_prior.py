"""Prior knowledge from data sheets and earlier calibrations, and additional terms, chosen by name or because the log requires them."""

import numpy as np
import pytest

import jaxcal
from jaxcal.imu import Nonlinear, Triad, multi_position

from . import cases, world


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
        known = jaxcal.fitting.Estimate(names, numbers, np.diag(np.where(truth[first : first + count] != 0, sigma**2, 0.0)))
        parts[sensor] = jaxcal.calibration.Part(triad, {"accel": "m/s^2", "gyro": "rad/s"}[sensor], estimate=known)
    return jaxcal.Calibration(imu=parts)


@pytest.mark.long
def test_ten_poses_with_an_earlier_calibration_are_as_good_as_it():
    inside, errors = [], []
    for seed in range(6):
        log, truth = log_of(seed, poses=10)
        prior = known_to(truth, 5e-5, np.random.default_rng(seed))
        alone, found = (multi_position(log, gravity=world.GRAVITY, held_out=False, prior=one) for one in (None, prior))
        free = np.flatnonzero(found.estimate.error[:9] > 0)
        inside.append(cases.inside(found, truth)[free])
        errors.append([(one.estimate.values - truth)[free] for one in (alone, found)])
        assert np.all(found.estimate.error[free] <= 5.1e-5)
        assert (alone.verdict, found.verdict) == ("weak", "good")
    assert np.mean(inside) > 0.85
    without, with_prior = np.sqrt(np.mean(np.square(errors), axis=(0, 2)))
    assert with_prior < min(5e-5, 0.7 * without)


def test_five_poses_and_a_data_sheet():
    """A data sheet allows 1 % of scale and misalignment and a bias of 0.1. Five poses leave some parameters open; the sheet bounds them."""
    log, truth = log_of(0, poses=5)
    sheet = {"scale": 0.01, "misalignment": 0.01, "bias": 0.1}
    found = multi_position(jaxcal.Log(log.time, accel=log.accel), gravity=world.GRAVITY, prior={"accel": sheet}, held_out=False)
    free = np.flatnonzero(found.estimate.error > 0)
    assert len(free) == 9
    assert np.all(found.estimate.error[free] <= np.array([0.0101] * 6 + [0.101] * 3))
    assert np.all(np.abs(found.residual_norm) < 5e-3)
    assert cases.inside(found, truth[:12])[free].all()


def test_a_prior_of_another_device_is_told(refuses):
    log, truth = log_of(1, poses=12)
    found = multi_position(log, gravity=world.GRAVITY, prior=known_to(truth * 1.01, 3e-4, np.random.default_rng(0)), held_out=False)
    assert found.verdict == "weak"
    assert "prior_conflict" in found.codes
    alone = jaxcal.Calibration(imu={"accel": Triad(np.eye(3), np.zeros(3))})
    for bad in ({"accel": {"sclae": 1.0}}, {"accel": {"scale": -1.0}}, 3, alone):
        with refuses("prior"):
            multi_position(log, gravity=world.GRAVITY, prior=bad)


@pytest.mark.long
def test_terms_that_the_log_asks_for_are_added():
    log, truth = log_of(0, **world.CASES["quadratic"])
    plain = multi_position(log, gravity=world.GRAVITY, held_out=False)
    assert (plain.verdict, plain.asked) == ("weak", ("accel.quadratic",))
    found = multi_position(log, gravity=world.GRAVITY, held_out=False, terms="auto")
    assert found.verdict == "good"
    assert isinstance(found.accel, Nonlinear)
    truth = np.insert(truth, 12, np.full(3, world.CASES["quadratic"]["quadratic"]))
    assert cases.inside(found, truth)[found.estimate.error > 0].mean() > 0.8
    assert next(one for one in found.findings if one.code == "terms_added").facts["terms"] == "accel.quadratic"


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
    free = found.estimate.error > 0
    assert np.mean(cases.inside(found, truth)[free]) > 0.8
    # three more parameters increase the errors little; the drift increased them much
    assert np.mean(np.abs(found.estimate.values - truth)[:9]) < 0.5 * np.mean(np.abs(plain.estimate.values - truth)[:9])


def test_terms_that_there_are_not(refuses):
    log, _ = log_of(0, poses=12)
    with refuses("term"):
        multi_position(jaxcal.Log(log.time, accel=log.accel), gravity=world.GRAVITY, terms=["accel.drift"])
    for options in ({"terms": ["accel.quartic"]}, {"terms": ["accel.cubic"], "convention": "full"}):
        with refuses("term"):
            multi_position(log, gravity=world.GRAVITY, **options)
