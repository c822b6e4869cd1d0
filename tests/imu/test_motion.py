"""Delay of the gyroscope and lever arms from turns by hand, with linear accelerations that the model does not contain."""

import numpy as np
import pytest

import jaxcal
from jaxcal.evidence._rests import still_intervals
from jaxcal.imu import Imu, Triad, motion

from . import cases, world

#: true delay (s): `world` computes the rate of a sample over the 2.5 ms before it, which adds half of this time to the offset
DELAY = 0.02 + 0.00125
ARMS = np.array([[0.03, 0.0, -0.01], [0.01, 0.02, 0.0], [-0.02, 0.01, 0.03]])


def found_in(seed, **case):
    stamps, accel, gyro, truth = world.record(seed, **case)
    log = jaxcal.Log(stamps, accel=accel, gyro=gyro)
    sensors = Imu(Triad(truth[:9].reshape(3, 3), truth[9:12]), Triad(truth[12:21].reshape(3, 3), truth[21:24], truth[24:].reshape(3, 3)))
    return motion(log, sensors, gravity=world.GRAVITY, rests=still_intervals({"accel": log.accel, "gyro": log.gyro}, log.rate).ends)


def test_delay_and_arms_of_a_steady_hand():
    found = found_in(0, offset=0.02, arms=ARMS)
    assert found.delay == pytest.approx(DELAY, abs=3e-4)
    np.testing.assert_allclose(found.lever_arm, ARMS, atol=2e-3)
    assert (found.verdict, found.turns) == ("good", 23)
    assert found.headline.startswith("gyroscope 21 ± ")


@pytest.mark.long
def test_intervals_hold_in_a_hand_that_sways():
    inside = []
    for seed in range(30):
        found = found_in(seed, offset=0.02, arms=ARMS, sway=0.3)
        inside.append(cases.inside(found, np.concatenate([[DELAY], ARMS.ravel()])))
    # 30 runs of ten numbers: the coverage has a standard error of 2 %
    assert 0.90 <= np.mean(inside) <= 0.99


def test_what_has_no_answer(refuses):
    with refuses("no_rests"):
        motion(jaxcal.Log(None, accel=np.ones((5, 3)), rate=1.0), Imu(Triad(np.eye(3), np.zeros(3)), Triad(np.eye(3), np.zeros(3))))
    with refuses("no_gyro"):
        motion(jaxcal.Log(None, accel=np.ones((5, 3)), rate=1.0), Imu(Triad(np.eye(3), np.zeros(3))))
