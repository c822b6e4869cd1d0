"""Logs of an MPU-9150 turned by hand (mikoff/imu-calib): gravity is the only option needed, and results agree with the published ones."""

import json

import numpy as np
import pytest

import jaxcal


@pytest.mark.parametrize("name", [pytest.param("imu1.log", marks=pytest.mark.long), "imu3.log"])
def test_logs_by_hand_need_no_option(reference, name):
    folder = reference / "data" / "imu" / "mikoff"
    rows = np.loadtxt(folder / name)
    found = jaxcal.imu.multi_position(jaxcal.Log(None, accel=rows[:, :3], gyro=rows[:, 3:], rate=100.0), gravity=9.81)
    assert found.verdict == "good"
    assert len(found.still) >= 22
    # error after turns that were not used in the fit; with thresholds of the accelerometer alone it is 4.3 to 4.6 mrad
    assert found.held_out[1] <= 2.0e-3
    published = json.loads((folder / "published.json").read_text())[name]
    scale = np.diag(found.accel.matrix) - 1 - np.array(published["accelerometer"]["scale_percent"]) / 100
    assert np.abs(scale).max() < 3e-4
    scale = np.diag(found.gyro.matrix) - 1
    if name == "imu3.log":
        np.testing.assert_allclose(scale, np.array(published["gyroscope"]["scale_percent"]) / 100, atol=2e-3)
    else:
        # The published method takes six samples between two turns (1638 to 1644) for a rest. The turns before and after them have errors
        # of 14 and 18 mrad, all others of 2, and the published scales have standard errors of 0.45, 0.24 and 0.32 %. Without these two
        # turns the same method gives:
        np.testing.assert_allclose(scale, [-0.00159, 0.00276, 0.00180], atol=1e-3)
