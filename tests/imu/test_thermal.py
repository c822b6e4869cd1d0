"""Matrices over temperature: sessions of an independent simulator at several temperatures, intervals, and a log that is corrected."""

import dataclasses

import numpy as np
import pytest

import jaxcal
from jaxcal.imu import over_temperature

from . import world

#: change of the scale factors and cross terms of both sensors per degC, and its curvature per degC^2, relative
SLOPE, BEND = np.array([4e-5, -3e-5, 6e-5]), 4e-7


def warmed(readings, temperature):
    above = temperature - 25.0
    return readings * (1 + SLOPE * above + BEND * above**2)


def session(seed, temperature, **options):
    stamps, accel, gyro, truth = world.record(seed, device=3, **options)
    log = jaxcal.Log(
        stamps, accel=warmed(accel, temperature), gyro=warmed(gyro, temperature), temperature=np.full(len(stamps), temperature)
    )
    return log, truth


def calibrated(seed, temperatures=(0.0, 25.0, 50.0)):
    logs = [session(1000 * seed + k, t) for k, t in enumerate(temperatures)]
    fits = [jaxcal.imu.multi_position(log, gravity=world.GRAVITY, held_out=False) for log, _ in logs]
    return over_temperature(fits), fits, logs[0][1]


def scale_inside(found, truth, t):
    """Whether the intervals of the six scale factors at a temperature hold the truth."""
    inside = []
    for sensor, start in (("accel", 0), ("gyro", 12)):
        model = getattr(found, sensor)
        for axis in range(3):
            names = [f"{sensor}.matrix[{axis},{axis}]"]
            names += [f"{sensor}.matrix_powers[{i},{axis},{axis}]" for i in range(len(model.bias_powers))]
            powers = (t - model.reference) ** np.arange(len(names))
            error = np.sqrt(powers @ found.estimate.covariance[names].array @ powers)
            inside.append(abs(model.at(t)[0][0, axis, axis] - warmed(truth[start + 4 * axis], t)[axis]) < 1.96 * error)
    return inside


@pytest.mark.long
def test_scale_over_temperature_is_in_its_intervals(tmp_path):
    results = [calibrated(seed) for seed in range(4)]
    # 4 runs of six scales at three temperatures: the coverage has a standard error of 3 %
    assert np.mean([scale_inside(found, truth, t) for found, _, truth in results for t in (0.0, 15.0, 50.0)]) > 0.85
    found, fits, _ = results[0]
    assert found.verdict == "good"
    jaxcal.Calibration(imu=found).save(tmp_path / "device.json")
    log, _ = session(7, 40.0)
    still = jaxcal.imu.multi_position(log, gravity=world.GRAVITY, held_out=False).still
    done = jaxcal.Calibration.load(tmp_path / "device.json").correct(log)
    norm = [np.linalg.norm(done.accel[i:j].mean(axis=0)) for i, j in still.ends]
    assert np.mean(norm) == pytest.approx(world.GRAVITY, rel=1e-4)
    cold = jaxcal.Calibration(imu=fits[0]).correct(log)
    assert abs(np.mean([np.linalg.norm(cold.accel[i:j].mean(axis=0)) for i, j in still.ends]) / world.GRAVITY - 1) > 5e-4


def test_sessions_that_do_not_go_together(refuses):
    log = jaxcal.imu.simulate(poses=18, rate=50, still=3, turn=2, seed=0)
    one = dataclasses.replace(jaxcal.imu.multi_position(log, gravity=9.81, held_out=False), temperature=20.0)
    with refuses("range"):
        over_temperature([one, dataclasses.replace(one, temperature=22.0)])
    with refuses("range"):
        over_temperature([one, dataclasses.replace(one, temperature=float("nan"))])
    with refuses("unlike"):
        over_temperature([one, dataclasses.replace(one, temperature=50.0, convention="lower")])
    line = over_temperature([one, dataclasses.replace(one, temperature=50.0)])
    assert line.accel.matrix_powers.shape == (1, 3, 3)
    np.testing.assert_allclose(line.accel.matrix, one.accel.matrix, atol=1e-12)
