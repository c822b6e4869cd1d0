"""Few logs at rest are refused and few logs with motion accepted, although the logs have effects that the check does not model."""

import numpy as np
import pytest

import jaxcal
from jaxcal.io._suited import unsuited


def resting(seed):
    """Simulate a minute or more at rest, with random noise level, random walk and warm-up of the bias, vibration, sagging and gaps."""
    random = np.random.default_rng(seed)
    rate = float(random.choice([10.0, 50.0, 100.0, 400.0]))
    n = round(rate * random.uniform(60.0, 200.0))
    t = np.arange(n) / rate
    drift = np.deg2rad(random.uniform(0.0, 1.0)) * np.exp(-t / 60.0)[:, None] * random.normal(size=3)
    wander = np.cumsum(random.normal(size=(n, 3)), axis=0) * 10 ** random.uniform(-7, -5) * np.sqrt(100.0 / rate)
    gyro = (
        10 ** random.uniform(-4, -0.5) * random.normal(size=(n, 3))
        + drift
        + wander
        + np.deg2rad(random.uniform(0, 20)) * random.normal(size=3)
    )
    shaken = random.uniform(0.0, 3.0) * np.sin(2 * np.pi * random.uniform(0.13, 0.4) * rate * t)[:, None] * random.normal(size=3)
    sag = np.deg2rad(random.uniform(0.0, 1.0)) * t / t[-1]
    up = random.normal(size=3)
    up *= 9.80665 / np.linalg.norm(up)
    accel = up + np.cross(random.normal(size=3), up) * sag[:, None] + shaken + 10 ** random.uniform(-3, 0) * random.normal(size=(n, 3))
    if seed % 3 == 0:
        gyro[n // 3 : n // 3 + n // 20] = np.nan
    return jaxcal.Log(None, gyro=gyro, accel=accel, rate=rate)


def turned(seed):
    """The same log, but with the device turned by 10 degrees or more for at least a twentieth of the time."""
    random = np.random.default_rng(1000 + seed)
    log = resting(seed)
    accel, n = np.array(log.accel), len(log.time)
    start = random.integers(0, n // 2)
    part = slice(start, start + max(n // 20, round(6 * log.rate)) + random.integers(0, n // 3))
    angle, axis = np.deg2rad(random.uniform(10.0, 180.0)), random.integers(3)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.roll(np.roll(np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), axis, 0), axis, 1)
    level = np.roll(np.array([0.0, 0.0, 9.80665]), axis)  # an axis perpendicular to that of the turn
    accel += level - np.nanmean(accel, axis=0)
    accel[part] = accel[part] @ turn.T
    return jaxcal.Log(None, gyro=log.gyro, accel=accel, rate=log.rate)


@pytest.mark.parametrize("command", ["noise", "temperature"])
def test_a_sensor_at_rest_is_not_refused(command):
    refused = [seed for seed in range(100) if unsuited(command, resting(seed))]
    assert len(refused) <= 1, refused


def test_a_sensor_that_was_turned_is_refused():
    missed = [seed for seed in range(100) if not unsuited("noise", turned(seed))]
    assert len(missed) <= 5, missed


def test_the_part_at_rest_is_named_and_is_not_refused():
    log = turned(1)
    still = np.concatenate([np.tile([0.0, 0.0, 9.8], (9000, 1)), np.tile([9.8, 0.0, 0.0], (2000, 1))])
    log = jaxcal.Log(None, accel=still + 0.01 * np.random.default_rng(0).normal(size=still.shape), rate=100.0)
    said = unsuited("noise", log, "a.csv")
    assert said.endswith("jaxcal noise a.csv --start 0 --stop 89")
    assert unsuited("noise", log.select(0.0, 89.0)) is None
