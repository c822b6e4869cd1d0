"""Noise-free readings reproduce the truth: closed forms at 300 attitudes, joint fit, drift, turning table, full IMU."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal.alignment import Positions, Readings, Sensor, azimuth, fit, level, simulate
from jaxcal.alignment._azimuth import AZIMUTH_METHODS
from jaxcal.alignment._level import LEVEL_METHODS
from jaxcal.alignment._model import NAMES

from . import cases
from .cases import DEG, apart

EVERY = Positions(np.array([0, 90, 180, 270, 60, 120, 240, 300, 0, 90, 180, 270, 0]) * DEG, ["x"] * 8 + ["y"] * 4 + ["z"], dwell=20.0)
NANO = 1e-9 * DEG


def made(draw):
    """Noise-free readings of all positions for `draw`: phi, theta, psi and latitude, rad."""
    return simulate(EVERY, draw[:3], draw[3])


@pytest.fixture(scope="module")
def attitudes():
    """300 random attitudes at least 10 degrees away from roll and pitch of 90 degrees and from the meridian."""
    rng = np.random.default_rng(0)
    span = np.array([[-80, 80], [-80, 80], [10, 170], [-75, 75]]) * DEG
    draws = rng.uniform(span[:, 0], span[:, 1], (300, 4))
    draws[:, 2] *= rng.choice([-1, 1], 300)
    return draws


@pytest.mark.parametrize("method", LEVEL_METHODS)
def test_levels(attitudes, method):
    found = jax.vmap(lambda draw: level(made(draw), method=method))(jnp.asarray(attitudes))
    assert np.max(apart(found.phi, attitudes[:, 0])) < NANO
    assert np.max(apart(found.theta, attitudes[:, 1])) < NANO


@pytest.fixture(scope="module")
def solved(attitudes):
    """A function that returns the roots of a method at all attitudes; it caches them for the tests that share them."""

    @functools.cache
    def found(method):
        return jax.vmap(lambda draw: azimuth(made(draw), draw[:2], draw[3], method=method, hint=draw[2]))(jnp.asarray(attitudes))

    return found


@pytest.mark.parametrize("method", AZIMUTH_METHODS)
def test_azimuths(attitudes, solved, method):
    found = solved(method)
    away = np.where(found.real, apart(found.roots, attitudes[:, 2:3]), np.inf)
    away = np.sort(np.concatenate([away, np.full((300, 1), np.inf)], axis=1), axis=1)
    # keep attitudes ten degrees away from the singularity of the method, where two of its roots merge
    kept = away[:, 1] > 10 * DEG
    assert np.sum(kept) > 200
    assert np.max(away[kept, 0]) < NANO


def test_two_orders_of_solution_agree(solved):
    first, second = solved("bias_and_scale"), solved("scale_first")
    nearest = np.min(apart(np.asarray(second.roots)[:, :, None], np.asarray(first.roots)[:, None, :]), axis=2)
    assert np.max(np.where(second.real, nearest, 0)) < NANO


def test_maximum_agrees_with_the_quartic(attitudes, solved):
    """The roots agree with those of the polynomial in cos(psi) of the corrected equation (50), with the matching sign of sin(psi)."""
    worst, counted, found = 0.0, 0, solved("maximum")
    for (phi, theta, _, lat), all_roots, real, rho in zip(attitudes, found.roots, found.real, found.rho, strict=True):
        direct = np.asarray(all_roots)[np.asarray(real)]
        sf, cf, st, ct, sl, cl = (f(a) for a in (phi, theta, lat) for f in (np.sin, np.cos))
        a = (cf**2 * ct**2 - 2 * cf**2 + 1) * cl**2
        b, c, d = 2 * cf**2 * cl * st * ct * sl, -2 * cl**2 * cf * st * sf, 2 * cf * cl * ct * sf * sl
        e = cf**2 * ct**2 * cl**2 + cf**2 * cl**2 - cf**2 * ct**2 + sl**2 - float(rho) ** 2
        cosines = np.roots([a**2 + c**2, 2 * a * b + 2 * c * d, b**2 + 2 * a * e - c**2 + d**2, 2 * b * e - 2 * c * d, e**2 - d**2])
        cosines = cosines[np.abs(cosines.imag) < 1e-5].real
        if len(cosines) != len(direct) or np.min(np.abs(c * cosines + d)) < 1e-2:
            continue
        # two roots of the quartic that nearly merge have errors of the square root of the rounding error
        gaps = np.abs(cosines[:, None] - cosines[None, :]) + np.eye(len(cosines))
        if np.min(gaps) < 1e-3 or np.max(np.abs(cosines)) > 1 - 1e-4:
            continue
        roots = np.arctan2(-(a * cosines**2 + b * cosines + e) / (c * cosines + d), cosines)
        worst, counted = max(worst, max(float(np.min(apart(root, roots))) for root in direct)), counted + 1
    assert counted > 60
    assert worst < 1e-6 * DEG


def test_joint_fit_of_every_parameter(attitudes):
    """Eleven parameters, and twelve with the latitude, are determined by four x and four z positions."""
    places = Positions(np.tile([0, 90, 180, 270], 2) * DEG, ["x"] * 4 + ["z"] * 4, dwell=30.0)
    accel, gyro = Sensor(1e-4, np.array([1e-4, -2e-4]), 1e-3), Sensor(-2e-4, np.array([-1e-4, 3e-4]), 1e-7)
    worst = np.zeros(2)
    for phi, theta, psi, latitude in attitudes[:5]:
        readings = simulate(places, [phi, theta, psi], latitude, accel=accel, gyro=gyro)
        readings = Readings(places, readings.accel, readings.gyro, accel_noise=cases.VRW, gyro_noise=cases.ARW)
        for i, known in enumerate((latitude, None)):
            found = fit(readings, known, free=NAMES[:11])
            worst[i] = max(worst[i], *apart([found.phi, found.theta, found.psi], [phi, theta, psi]), abs(found.latitude - latitude))
    assert np.all(worst < NANO)


def test_joint_fit_beyond_80_degrees_of_pitch():
    places = Positions(np.tile([0, 90, 180, 270], 2) * DEG, ["x"] * 4 + ["z"] * 4, dwell=30.0, angle_std=0.0)
    for theta in (85.0, 89.9, -89.99):
        truth = np.array([20.0, theta, -50.0]) * DEG
        clean = simulate(places, truth, 0.6, accel=Sensor(bias=1e-3), gyro=Sensor(bias=1e-7))
        found = fit(Readings(places, clean.accel, clean.gyro, accel_noise=cases.VRW, gyro_noise=cases.ARW), 0.6)
        # roll and azimuth are nearly confounded; only their combination below is well determined
        assert abs(found.theta - truth[1]) < NANO
        turn = np.sign(theta)
        assert apart(found.phi - turn * found.psi, truth[0] - turn * truth[2]) < NANO
        assert found.std["phi"] == pytest.approx(found.std["theta"] / np.cos(truth[1]), rel=0.5)


def test_linear_drift_is_fitted_exactly(reference):
    case = cases.vectors(reference)["drift"]
    rows = np.array(case["rows"])
    readings = Readings(Positions(rows[:, 0], dwell=case["dwell"]), rows[:, 2], rows[:, 3], accel_noise=cases.VRW, gyro_noise=cases.ARW)
    np.testing.assert_allclose(readings.positions.time, rows[:, 1])
    found = fit(readings, case["latitude"], free=("phi", "theta", "psi", "b_a", "b_g", "b_a_rate", "b_g_rate"))
    np.testing.assert_allclose([found.phi, found.theta, found.psi], case["attitude"], atol=NANO)
    assert found.parameters["b_g_rate"] == pytest.approx(case["gyro"]["bias_rate"], rel=1e-9)
    assert found.parameters["b_a_rate"] == pytest.approx(case["accel"]["bias_rate"], rel=1e-9)
    # the positions are in mirrored order, so that a drift that is not fitted causes no error of azimuth
    ignored = fit(readings, case["latitude"])
    assert apart(ignored.psi, case["attitude"][2]) < 1e-6 * DEG


def test_sectors_of_a_turning_table(reference):
    case = cases.vectors(reference)["carousel"]
    sectors = np.array(case["sectors"])
    places = Positions(sectors[:, 0], rate=case["table_rate"], width=case["sector_width"])
    readings = Readings(places, sectors[:, 1], sectors[:, 2], lever_arm=case["lever_arm"], accel_noise=cases.VRW, gyro_noise=cases.ARW)
    accel, gyro = case["accel"], case["gyro"]
    known = {
        "s_a": accel["scale_error"], "s_g": gyro["scale_error"], "ma_a_xy": accel["misalignment"][0], "ma_a_xz": accel["misalignment"][1],
        "ma_g_xy": gyro["misalignment"][0], "ma_g_xz": gyro["misalignment"][1],
    }  # fmt: skip
    found = fit(readings, case["latitude"], start=known)
    np.testing.assert_allclose([found.phi, found.theta, found.psi], case["attitude"], atol=NANO)
    assert found.parameters["b_g"] == pytest.approx(gyro["bias"], abs=1e-16)
    # without the sensor errors the fitted offset contains the table rate times the misalignment
    apart_from_it = fit(readings, case["latitude"]).parameters["b_g"]
    assert apart_from_it == pytest.approx(gyro["misalignment"][1] * case["table_rate"] + gyro["bias"], rel=0.01)
