"""Norms and a second sensor together: exact data, partial coverage, intervals, what stays open."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxcal import DataError
from jaxcal.magnetometer import MagModel, aligned, fit
from jaxcal.magnetometer._joint import Pairs
from jaxcal.magnetometer._joint_residuals import joint_pose_residuals, joint_turn_residuals

from . import cases

TURN = Rotation.from_rotvec(np.deg2rad([2.0, -1.0, 3.0])).as_matrix()
SENSOR = MagModel(np.asarray(cases.MILD.soft_iron) @ TURN, cases.MILD.hard_iron)
NORTH = np.array([np.cos(cases.DIP), 0.0, np.sin(cases.DIP)])
RATE, COUNT, FINE = 50.0, 1000, 8
BIAS = np.deg2rad([0.2, -0.14, 0.1])
NOISE, GYRO_NOISE, FORCE_NOISE = 0.01, np.deg2rad(0.1), 0.005


def attitudes(kind, t, phase):
    """Yaw, elevation and bank: everywhere, a cap of 40 degrees, a vehicle that turns three times and tilts by 20 degrees, one axis."""
    swing = lambda most, pace, i: np.deg2rad(most) * np.sin(pace * t + phase[i])  # noqa: E731
    once = 6 * np.pi * t * RATE / COUNT + phase[0]
    found = {
        "all": [0.8 * t + phase[0], swing(69, 0.5, 1), 0.67 * t + phase[2]],
        "cap": [swing(40, 0.31, 0), swing(28, 0.6, 1), swing(28, 0.83, 2)],
        "tilt": [once, swing(20, 0.7, 1), swing(20, 0.53, 2)],
        "yaw": [once, 0 * t, 0 * t],
    }
    return Rotation.from_euler("ZYX", np.stack(found[kind], axis=1))


def log(kind, seed, sigma=NOISE, exact=False):
    """Readings, rates at their times, and specific force; exact: turned by the mean of the rates at both ends of every step."""
    rng = np.random.default_rng([seed, 9])
    body = attitudes(kind, np.arange(-1, FINE * COUNT + 1) / (FINE * RATE), rng.uniform(0, 2 * np.pi, 3))
    rates = (body[:-2].inv() * body[2:]).as_rotvec()[::FINE] * FINE * RATE / 2
    body = body[1:-1][::FINE]
    if exact:
        turned = [body[0].as_matrix()]
        for step in Rotation.from_rotvec((rates[1:] + rates[:-1]) / 2 / RATE).as_matrix():
            turned.append(turned[-1] @ step)
        body = Rotation.from_matrix(np.array(turned))
    field, up = body.inv().apply(NORTH), -body.inv().apply([0.0, 0.0, 1.0])
    scale = sigma / NOISE
    noise = [rng.normal(size=field.shape) for _ in range(3)]
    m = SENSOR.measure(field) + sigma * noise[0]
    return m, rates + BIAS + scale * GYRO_NOISE * noise[1], 9.81 * (up + scale * FORCE_NOISE * noise[2])


def sensors(made):
    m, gyro, accel = made
    return m, {"gyro": {"gyro": gyro, "rate": RATE}, "accel": {"accel": accel}}


def heading_error(model):
    level = np.stack([np.arange(24) * np.pi / 12, np.zeros(24), np.zeros(24)], axis=1)
    body = Rotation.from_euler("ZYX", level)
    y = np.asarray(model.correct(SENSOR.measure(body.inv().apply(NORTH))))
    return cases.rms(np.rad2deg(np.angle(np.exp(1j * (np.arctan2(-y[:, 1], y[:, 0]) - level[:, 0])))))


def off(model):
    return float(np.linalg.norm(np.asarray(model.hard_iron) - SENSOR.hard_iron))


@pytest.mark.parametrize("kind", ["all", "cap"])
@pytest.mark.parametrize("name", ["gyro", "accel"])
def test_exact_data_give_the_whole_soft_iron_and_the_hard_iron(kind, name):
    m, other = sensors(log(kind, 0, sigma=0.0, exact=True))
    found = fit(m, field=1.0, joint=True, **other[name])
    np.testing.assert_allclose(found.model.soft_iron, SENSOR.soft_iron, atol=1e-6)
    np.testing.assert_allclose(found.model.hard_iron, SENSOR.hard_iron, atol=1e-6)
    assert (found.verdict, found.joint, found.kind) == ("good", True, "symmetric")
    if name == "gyro":
        np.testing.assert_allclose(found.alignment.bias, BIAS, atol=1e-7)
    else:
        assert found.alignment.dip == pytest.approx(cases.DIP, abs=1e-9)


@pytest.fixture(scope="module")
def partial():
    """Both fits of twelve logs of a vehicle, for each sensor."""
    found = {"gyro": [], "accel": []}
    for seed in range(12):
        m, other = sensors(log("tilt", seed))
        for name, options in other.items():
            found[name].append((fit(m, **options), fit(m, joint=True, **options)))
    return found


@pytest.mark.parametrize("name", ["gyro", "accel"])
def test_partial_coverage_gains_by_a_large_factor_and_says_so_rightly(partial, name):
    after, both = zip(*partial[name], strict=True)
    assert cases.rms([off(f.model) for f in after]) > 4 * cases.rms([off(f.model) for f in both])
    true = cases.rms([heading_error(f.model) for f in both])
    assert true < 0.8 * cases.rms([heading_error(f.model) for f in after])
    # chi-square of few degrees in twelve logs: the ratio scatters by about 0.15
    assert true == pytest.approx(np.rad2deg(cases.rms([f.heading_error[0] for f in both])), rel=0.45)
    away = [
        (f.model.hard_iron - SENSOR.hard_iron) @ np.linalg.solve(f.covariance[6:, 6:], f.model.hard_iron - SENSOR.hard_iron) for f in both
    ]
    assert np.mean(away) == pytest.approx(3.0, abs=4 * np.sqrt(6 / 12))
    for f in both:
        assert f.verdict == "good"
        assert f.noise == pytest.approx(NOISE, rel=0.1)
        assert f.alignment.spread[1] <= f.alignment.spread[0]
        assert f.needed.shape == (3, 3)
        assert len(f.residual) == f.used == COUNT
