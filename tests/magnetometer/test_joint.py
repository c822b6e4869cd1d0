"""Joint fits of field magnitudes and a second sensor: exact data, partial coverage, intervals, undetermined parameters."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxcal.magnetometer import Accelerometer, Gyroscope, Headings, MagModel, aligned, fit
from jaxcal.magnetometer._rotation._joint import Pairs

from . import cases

TURN = Rotation.from_rotvec(np.deg2rad([2.0, -1.0, 3.0])).as_matrix()
SENSOR = MagModel(np.asarray(cases.MILD.soft_iron) @ TURN, cases.MILD.hard_iron)
NORTH = np.array([np.cos(cases.DIP), 0.0, np.sin(cases.DIP)])
RATE, COUNT, FINE = 50.0, 1000, 8
BIAS = np.deg2rad([0.2, -0.14, 0.1])
NOISE, GYRO_NOISE, FORCE_NOISE = 0.01, np.deg2rad(0.1), 0.005


def attitudes(kind, t, phase):
    """Attitudes of a motion: over the sphere, in a cap or a corner, of a vehicle with three turns and tilts of 20 degrees, or yaw only."""
    swing = lambda most, pace, i: np.deg2rad(most) * np.sin(pace * t + phase[i])  # noqa: E731
    once = 6 * np.pi * t * RATE / COUNT + phase[0]
    found = {
        "all": [0.8 * t + phase[0], swing(69, 0.5, 1), 0.67 * t + phase[2]],
        "cap": [swing(40, 0.31, 0), swing(28, 0.6, 1), swing(28, 0.83, 2)],
        "corner": [swing(15.6, 0.31, 0), swing(12, 1.3, 1), swing(12, 1.83, 2)],
        "tilt": [once, swing(20, 0.7, 1), swing(20, 0.53, 2)],
        "yaw": [once, 0 * t, 0 * t],
    }
    return Rotation.from_euler("ZYX", np.stack(found[kind], axis=1))


def log(kind, seed, sigma=NOISE, exact=False):
    """Simulate readings, rates at the same times, and specific force.

    With `exact`, every step is a rotation by the mean of the rates at its ends, which is how the fit integrates.
    """
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
    return m, {"gyro": Gyroscope(gyro, RATE), "accel": Accelerometer(accel)}


def heading_error(model):
    level = np.stack([np.arange(24) * np.pi / 12, np.zeros(24), np.zeros(24)], axis=1)
    body = Rotation.from_euler("ZYX", level)
    y = np.asarray(model.correct(SENSOR.measure(body.inv().apply(NORTH))))
    return cases.rms(np.rad2deg(np.angle(np.exp(1j * (np.arctan2(-y[:, 1], y[:, 0]) - level[:, 0])))))


def off(model):
    return float(np.linalg.norm(np.asarray(model.hard_iron) - SENSOR.hard_iron))


@pytest.mark.parametrize(("kind", "name"), [("cap", "gyro"), ("all", "accel")])
def test_exact_data_give_the_whole_soft_iron_and_the_hard_iron(kind, name):
    m, other = sensors(log(kind, 0, sigma=0.0, exact=True))
    found = fit(m, field=1.0, joint=True, aid=other[name])
    np.testing.assert_allclose(found.model.soft_iron, SENSOR.soft_iron, atol=1e-6)
    np.testing.assert_allclose(found.model.hard_iron, SENSOR.hard_iron, atol=1e-6)
    assert (found.verdict, found.method, found.kind) == ("good", "joint", "symmetric")
    if name == "gyro":
        np.testing.assert_allclose(found.alignment.bias, BIAS, atol=1e-7)
    else:
        assert found.alignment.dip == pytest.approx(cases.DIP, abs=1e-9)


@pytest.fixture(scope="module")
def partial():
    """Fits one after the other and joint fits of twelve logs of a vehicle, for each second sensor."""
    found = {"gyro": [], "accel": []}
    for seed in range(12):
        m, other = sensors(log("tilt", seed))
        for name, options in other.items():
            found[name].append((fit(m, aid=options), fit(m, joint=True, aid=options)))
    return found


@pytest.mark.long
@pytest.mark.parametrize("name", ["gyro", "accel"])
def test_partial_coverage_gains_by_a_large_factor_and_says_so_rightly(partial, name):
    after, both = zip(*partial[name], strict=True)
    assert cases.rms([off(f.model) for f in after]) > 4 * cases.rms([off(f.model) for f in both])
    true = cases.rms([heading_error(f.model) for f in both])
    assert true < 0.8 * cases.rms([heading_error(f.model) for f in after])
    # chi-square with few degrees of freedom in twelve logs: the ratio scatters by about 0.15
    assert true == pytest.approx(np.rad2deg(cases.rms([f.heading_error[0] for f in both])), rel=0.45)
    away = [
        (f.model.hard_iron - SENSOR.hard_iron)
        @ np.linalg.solve(f.estimate.select("hard_iron*").matrix, f.model.hard_iron - SENSOR.hard_iron)
        for f in both
    ]
    assert np.mean(away) == pytest.approx(3.0, abs=4 * np.sqrt(6 / 12))
    for f in both:
        assert f.verdict == "good"
        assert f.noise == pytest.approx(NOISE, rel=0.1)
        assert f.alignment.spread[1] <= f.alignment.spread[0]
        assert f.needed.shape == (3, 3)
        assert len(f.residual) == f.numbers["used"].value == COUNT


@pytest.mark.long
def test_intervals_and_the_rotation_hold_the_truth(partial):
    """Hard iron, three angles and the soft iron of 24 logs have 360 intervals of 95 %, which are correlated within a log."""
    inverse = np.linalg.inv(SENSOR.soft_iron)
    shape = inverse.T @ inverse
    values, vectors = np.linalg.eigh(shape)
    true_turn = (vectors * np.sqrt(values)) @ vectors.T @ SENSOR.soft_iron
    inside = []
    for _, found in (*partial["gyro"], *partial["accel"]):
        away = found.model.hard_iron - SENSOR.hard_iron
        angle = Rotation.from_matrix(true_turn.T @ found.alignment.rotation).as_rotvec()
        inside += [*(np.abs(away) < 1.96 * found.estimate.select("hard_iron*").error)]
        inside += [*(np.abs(angle) < 1.96 * np.sqrt(np.diag(found.alignment.covariance)))]
        true = SENSOR.soft_iron / np.linalg.det(SENSOR.soft_iron) ** (1 / 3)
        inside += [*(np.abs(found.model.soft_iron - true) < 1.96 * found.estimate.select("soft_iron*").error.reshape(3, 3)).ravel()]
    assert 0.90 < np.mean(inside) < 0.99


def test_a_refused_fit_of_norms_is_a_start():
    """Magnitudes in a corner of 20 degrees do not suffice for a fit alone, but the joint fit can start from it."""
    m, other = sensors(log("corner", 3))
    before, found = (fit(m, model="symmetric", joint=joint, aid=other["gyro"]) for joint in (False, True))
    assert before.verdict == "refused"
    assert found.verdict == "good"
    assert heading_error(found.model) < 2 * np.rad2deg(found.heading_error[0])


@pytest.mark.parametrize(("name", "sigma"), [("gyro", 0.0), ("accel", NOISE)])
def test_turns_about_one_axis_leave_the_field_along_it_open(name, sigma):
    m, other = sensors(log("yaw", 0, sigma=sigma, exact=not sigma))
    found = fit(m, joint=True, aid=other[name])
    assert found.verdict == "refused"
    assert "undetermined" in found.codes
    if not sigma:
        assert "scale along z" in next(one for one in found.findings if one.code == "undetermined").facts["what"]
        assert np.isinf(found.heading_error).all()
        assert np.isinf(found.estimate.select("soft_iron*").matrix).all()
        assert found.alignment.verdict == "refused"


def test_rates_that_contradict_the_readings():
    m, other = sensors(log("all", 0))
    found = fit(m, joint=True, aid=Gyroscope(-other["gyro"].gyro, RATE))
    assert found.verdict == "refused"
    assert "rates_off" in found.codes
    slow = fit(m, joint=True, aid=Gyroscope(0.9 * other["gyro"].gyro, RATE))
    assert slow.verdict == "weak"


def test_rows_without_a_value_and_a_known_dip():
    m, other = sensors(log("all", 1))
    gyro = other["gyro"].gyro.copy()
    gyro[300:310] = np.nan
    m[500] = np.nan
    there = np.isfinite(m).all(axis=1)
    found = aligned(fit(m[there], field=1.0), m, Gyroscope(gyro, RATE), joint=True)
    assert found.numbers["used"].value == COUNT - 1
    assert found.alignment.used == COUNT - 11
    np.testing.assert_allclose(found.model.soft_iron, SENSOR.soft_iron, atol=4e-3)
    assert found.field == pytest.approx(1.0, abs=1e-12)
    known = aligned(fit(m[there], field=1.0), m[there], Accelerometer(other["accel"].accel[there], dip=cases.DIP), joint=True)
    assert known.alignment.dip == pytest.approx(cases.DIP, abs=1e-12)


def test_long_logs_are_thinned_after_the_rates_are_integrated():
    m, other = sensors(log("all", 2))
    # the same turns with 21 times as many samples, of which the fit can use only some
    m, gyro = np.repeat(m, 21, axis=0), np.repeat(other["gyro"].gyro, 21, axis=0)
    found = fit(m, field=1.0, joint=True, aid=Gyroscope(gyro, 21 * RATE), per_direction=8)
    assert 513 <= found.numbers["used"].value <= 1000
    assert len(found.residual) == len(m)
    assert off(found.model) < 0.01


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"aid": None}, "joint_needs_aid"),
        ({"aid": Headings(np.ones(50))}, "joint_needs_aid"),
        ({"method": "consistent"}, "joint_options"),
        ({"model": "planar"}, "joint_options"),
        ({"model": "sphere"}, "joint_options"),
        ({"field": 1.0, "field_error": 0.01}, "joint_options"),
    ],
)
def test_bad_options_are_an_error_that_says_so(options, code, refuses):
    rows = cases.directions(50, 0)
    with refuses(code):
        fit(rows, joint=True, **{"aid": Accelerometer(rows), **options})


def test_residuals_compiled_and_their_slopes():
    m, gyro, accel = log("all", 0)
    m, gyro, accel = m[:40], gyro[:40], accel[:40]
    rows = np.arange(40)
    start = np.concatenate([np.eye(3)[np.triu_indices(3)], cases.MILD.hard_iron, [0.1, -0.2, 0.05]])
    for pairs, more in (
        (Pairs.of(m, rows, Gyroscope(gyro, RATE)), np.zeros(4)),
        (Pairs.of(m, rows, Accelerometer(accel)), np.array([-0.8])),
    ):
        data = jax.tree.map(jnp.asarray, pairs.data(m, start, np.eye(3), np.array([0.01, 0.02]), 1e-4, np.zeros(4)))
        begin = jnp.asarray(np.concatenate([start, more]))
        eager = pairs.function(begin, data)
        run = jax.jit(lambda p, f=pairs.function, d=data: f(p, d))
        np.testing.assert_allclose(run(begin), eager, rtol=1e-9, atol=1e-9)
        slope = jax.jit(lambda p, f=pairs.function, d=data: jax.jacfwd(f)(p, d))(begin)
        for step in 1e-6 * np.random.default_rng(0).normal(size=(3, len(begin))):
            finite = np.asarray(run(begin + step)) - np.asarray(run(begin - step))
            np.testing.assert_allclose(slope @ (2 * step), finite, rtol=1e-4, atol=1e-9)
