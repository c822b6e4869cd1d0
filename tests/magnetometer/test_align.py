"""The rotation that field magnitudes do not determine: known rotations, real pairs of sensors, finite differences."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxcal import Log
from jaxcal.magnetometer import (
    Accelerometer,
    Gyroscope,
    Headings,
    MagModel,
    align,
    body_field,
    fit,
    scenario,
)

from . import cases

PLAIN = MagModel(np.eye(3), np.zeros(3))
VECTOR = np.deg2rad([2.0, -1.0, 3.0])
TURN = Rotation.from_rotvec(VECTOR).as_matrix()
#: soft iron C Q, which also rotates the field from the axes of the other sensor to those of the magnetometer
TURNED = MagModel(np.asarray(cases.MILD.soft_iron) @ TURN, cases.MILD.hard_iron)


def poses(count, sigma, seed, name="all"):
    attitudes = scenario(name, samples=count, seed=seed)
    rng = np.random.default_rng([seed, 3])
    up = -body_field(attitudes, 1.0, np.pi / 2)
    m = TURNED.measure(body_field(attitudes, 1.0, cases.DIP)) + sigma * rng.normal(size=(len(attitudes), 3))
    return attitudes, m, 9.81 * (up + sigma * rng.normal(size=up.shape))


def recovered(found, true=TURN):
    return Rotation.from_matrix(true.T @ np.asarray(found.rotation)).as_rotvec()


def test_furbrain_dips_are_no_wider_than_listed(reference):
    """Six cave surveying devices: spread of the dip before and after, and angle, against computed and recorded reference values."""
    recorded = json.loads((reference / "reference" / "magnetometer_fits.json").read_text())["furbrain_dip"]["devices"]
    listed = {
        "BB": (0.883, 0.230, 1.69), "CF": (0.311, 0.236, 0.36), "FG": (0.711, 0.251, 1.48),
        "HC": (2.270, 0.135, 4.89), "IB": (0.503, 0.193, 0.84), "JG": (1.035, 0.127, 1.77),
    }  # fmt: skip
    for name, (before, after, angle) in listed.items():
        shots = json.loads((reference / "data" / "magnetometer" / "furbrain" / f"SAP6_{name}.json").read_text())
        m = np.array(shots["mag"]) * [1, 1, -1]
        gravity = np.array(shots["grav"])[:, [1, 0, 2]] * [-1, -1, 1]
        up = fit(gravity, model="symmetric").model.correct(gravity)
        found = fit(m, model="symmetric", aid=Accelerometer(up)).alignment
        assert np.rad2deg(found.spread) == pytest.approx([before, after], abs=6e-4)
        assert np.rad2deg(found.angle) == pytest.approx(angle, abs=6e-3)
        assert np.rad2deg(found.spread[1]) <= recorded[name]["dip_std_rotation_aligned_deg"]
        off = np.rad2deg(np.sqrt(np.diag(found.covariance)))
        # some sets of shots are not white from shot to shot
        assert np.all((off > 0.04) & (off < 0.25))


def test_the_accelerometer_finds_the_turn_and_the_dip_as_well_as_it_says():
    away, dips = [], []
    for seed in range(40):
        _, m, up = poses(60, 0.01, seed)
        found = align(m, cases.MILD, Accelerometer(up))
        off = recovered(found)
        away.append(off @ np.linalg.solve(found.covariance, off))
        dips.append(found.dip - cases.DIP)
    # chi-square with three degrees of freedom, scaled by an estimated variance: the mean of 40 scatters by 0.4
    assert np.mean(away) == pytest.approx(3.0, abs=1.3)
    assert abs(np.mean(dips)) < 4 * np.std(dips) / np.sqrt(40)
    assert np.std(dips) < np.deg2rad(0.3)


def test_fit_puts_the_turn_into_the_model():
    _, m, up = poses(200, 0.002, 0)
    found, bare = fit(m, field=1.0, aid=Accelerometer(up)), fit(m, field=1.0)
    assert found.verdict == "good"
    assert found.alignment.source == "accel"
    np.testing.assert_allclose(found.model.soft_iron, TURNED.soft_iron, atol=4e-3)
    assert cases.rms(cases.heading_errors(found.model, TURNED, 1.0)) < 0.3
    # without the rotation the headings are wrong by its part about the vertical, and the residuals do not show it
    assert cases.rms(cases.heading_errors(bare.model, TURNED, 1.0)) > 2.0
    assert bare.alignment is None
    assert found.heading_error[0] > bare.heading_error[0]
    wrong = fit(m, field=np.array([np.cos(cases.DIP), 0, np.sin(cases.DIP)]), aid=Accelerometer(-up))
    assert "dip_differs" in wrong.codes


def test_level_poses_leave_the_turn_about_the_vertical_open():
    level = np.stack([np.arange(12) * np.pi / 6, np.zeros(12), np.zeros(12)], axis=1)
    up = np.tile([0.0, 0.0, -9.81], (12, 1))
    found = align(TURNED.measure(body_field(level)), cases.MILD, Accelerometer(up))
    assert found.verdict == "refused"
    assert "rotation_open" in found.codes
    kept = fit(TURNED.measure(body_field(scenario("all", samples=12))), model="sphere", aid=Accelerometer(up))
    assert kept.alignment.verdict == "refused"
    assert "rotation_open" in kept.codes


def test_axes_that_are_exchanged():
    _, m, up = poses(60, 0.001, 0)
    swapped = up[:, [1, 2, 0]]  # x of the new frame is y of the old
    found = align(m, cases.MILD, Accelerometer(swapped, mounting="any"))
    assert found.verdict == "good"
    np.testing.assert_allclose(found.rotation @ np.eye(3)[[1, 2, 0]], TURN, atol=2e-3)
    assert found.angle < np.deg2rad(5)
    assert align(m, cases.MILD, Accelerometer(up, dip=cases.DIP)).angle == pytest.approx(np.linalg.norm(VECTOR), abs=2e-3)


def tumble(rate, seconds, bias, sigma, seed):
    """Simulate readings of the field and of the rates of a turning sensor; attitudes are integrated from smooth rates in fine steps."""
    fine, n = 20, int(rate * seconds)
    t = np.arange(n * fine) / (rate * fine)
    rates = np.stack([1.1 * np.sin(0.7 * t), 0.9 * np.cos(0.45 * t + 1), 0.8 * np.sin(0.3 * t + 2)], axis=1)
    small = Rotation.from_rotvec((rates[1:] + rates[:-1]) / 2 / (rate * fine)).as_matrix()
    body = np.eye(3)
    field = np.empty((n, 3))
    h = np.array([np.cos(cases.DIP), 0.0, np.sin(cases.DIP)])
    for k in range(n * fine):
        if k % fine == 0:
            field[k // fine] = body.T @ h
        body = body @ small[min(k, len(small) - 1)]
    rng = np.random.default_rng(seed)
    return TURNED.measure(field) + sigma * rng.normal(size=field.shape), rates[::fine] + bias


def test_the_gyroscope_finds_the_turn_and_its_own_bias():
    bias = np.array([0.01, -0.02, 0.005])
    m, rates = tumble(50.0, 40.0, bias, 0.005, 0)
    found = align(m, cases.MILD, Gyroscope(rates, 50.0))
    assert found.verdict == "good"
    off = recovered(found)
    assert off @ np.linalg.solve(found.covariance, off) < 16.3  # chi-square of three degrees, 99.9 %
    np.testing.assert_allclose(found.bias, bias, atol=6e-4)
    # the remaining spread is the noise of a reading, 0.005 in each of the two directions perpendicular to the field
    assert found.spread[1] == pytest.approx(0.005, rel=0.15)
    assert found.spread[0] > 3 * found.spread[1]
    whole = fit(m, field=1.0, aid=Gyroscope(rates, 50.0))
    np.testing.assert_allclose(whole.model.soft_iron, TURNED.soft_iron, atol=5e-3)


def test_a_gap_in_the_rates_ends_a_segment():
    m, rates = tumble(50.0, 40.0, 0.0, 0.0, 0)
    rates[300:320] = np.nan
    m[500] = np.nan
    found = align(m, cases.MILD, Gyroscope(rates, 50.0))
    assert found.used == 2000 - 21
    assert np.linalg.norm(recovered(found)) < 2e-4


def test_known_headings_find_the_turn():
    attitudes, m, up = poses(40, 0.002, 1)
    gentle = np.abs(attitudes[:, 1]) < 1.2
    headings = np.where(gentle, attitudes[:, 0] + 0.1, np.nan)
    found = align(m, cases.MILD, Headings(headings, accel=up, declination=0.1))
    off = recovered(found)
    assert off @ np.linalg.solve(found.covariance, off) < 25
    assert np.linalg.norm(off) < np.deg2rad(0.5)
    # level poses alone suffice: because of the dip, a tilt of the sensor causes a heading error that varies with the heading
    level = np.stack([np.arange(12) * np.pi / 6, np.zeros(12), np.zeros(12)], axis=1)
    alone = align(TURNED.measure(body_field(level)), cases.MILD, Headings(level[:, 0]))
    assert np.linalg.norm(recovered(alone)) < 1e-6
    assert alone.spread[1] < 1e-9 < 0.03 < alone.spread[0]


@pytest.mark.parametrize(
    ("aid", "code"),
    [
        (lambda: None, "no_such_aid"),
        (lambda: Accelerometer(np.ones((4, 3))), "rows_differ"),
        (lambda: Accelerometer(np.ones(3)), "bad_shape"),
        (lambda: Gyroscope(np.ones((8, 3)), 0.0), "no_rate"),
        (lambda: Headings(np.ones(4)), "heading_shape"),
        (lambda: Headings(np.full(8, np.nan)), "few_readings"),
        (lambda: Accelerometer(np.full((8, 3), np.nan)), "few_readings"),
        (lambda: Accelerometer(np.ones((8, 3)), mounting="odd"), "no_such_mounting"),
    ],
)
def test_bad_input_is_an_error_that_says_so(aid, code, refuses):
    with refuses(code), np.errstate(all="ignore"):
        align(cases.directions(8, 0), PLAIN, aid())


@pytest.mark.parametrize("rho", [np.zeros(3), 1e-6 * VECTOR, VECTOR, np.array([0.0, 0.9, 0.5])])
def test_exact_poses_give_the_exact_turn(rho):
    attitudes, matrix = scenario("all", samples=40), Rotation.from_rotvec(rho).as_matrix()
    found = align(
        MagModel(matrix, np.zeros(3)).measure(body_field(attitudes)), PLAIN, Accelerometer(-body_field(attitudes, 9.81, np.pi / 2))
    )
    np.testing.assert_allclose(found.rotation, matrix, rtol=0, atol=1e-10)
    assert found.angle == pytest.approx(np.linalg.norm(rho), abs=1e-10)


def test_the_covariance_is_that_of_slopes_by_differences():
    """The covariance agrees with finite differences of y'Qf - s with respect to the rotation and s."""
    _, m, up = poses(60, 0.01, 0)
    found = align(m, cases.MILD, Accelerometer(up))
    assert found.used == 60
    y, f = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (np.asarray(cases.MILD.correct(m)), up))

    def left(p):
        return np.sum(y * (f @ (found.rotation @ Rotation.from_rotvec(p[:3]).as_matrix()).T), axis=1) + np.sin(found.dip) - p[3]

    slopes = np.stack([(left(step) - left(-step)) / 2e-6 for step in 1e-6 * np.eye(4)], axis=1)
    np.testing.assert_allclose(slopes.T @ left(np.zeros(4)), 0, atol=1e-6)  # the minimum
    expected = np.sum(left(np.zeros(4)) ** 2) / (60 - 4) * np.linalg.inv(slopes.T @ slopes)
    np.testing.assert_allclose(found.covariance, expected[:3, :3], rtol=1e-4, atol=1e-4 * np.abs(expected[:3, :3]).max())


def test_constant_rates_are_integrated_exactly():
    """From three turns with gaps between them, a bias of the rates is found to first order."""
    rate, n = 100.0, 400
    gyro, field = [], []
    for w in ([0.3, -0.5, 0.8], [0.7, 0.4, -0.2], [-0.5, 0.6, 0.4]):
        body = Rotation.from_rotvec(np.array(w) * np.arange(n)[:, None] / rate)
        gyro += [*np.tile(w, (n, 1)), np.full(3, np.nan)]
        field += [*body.inv().apply([0.6, 0.0, 0.8]), np.zeros(3)]
    gyro, field = np.array(gyro), np.array(field)
    bias = np.array([1e-5, -2e-5, 1e-5])
    found = align(field, PLAIN, Gyroscope(gyro + bias, rate))
    assert found.used == 3 * n
    np.testing.assert_allclose(found.bias, bias, rtol=2e-3)
    np.testing.assert_allclose(found.rotation, np.eye(3), atol=1e-7)


def test_the_vertical_of_the_accelerometer_is_that_of_the_heading_error():
    """A sensor tilts by 30 degrees at a dip of 70; its heading error must not depend on which axis points down."""
    dip = np.deg2rad(70.0)
    attitudes = scenario("three_turns")
    field, up = body_field(attitudes, 1.0, dip), -9.81 * body_field(attitudes, 1.0, np.pi / 2)
    noisy = field + 0.003 * np.random.default_rng(0).normal(size=field.shape)
    roll = np.eye(3)[[2, 0, 1]]
    found = [fit(noisy @ turn.T, model="symmetric", aid=Accelerometer(up @ turn.T)) for turn in (np.eye(3), roll)]
    assert found[0].inclination == pytest.approx(dip, abs=np.deg2rad(2.0))
    np.testing.assert_allclose(found[1].heading_error, found[0].heading_error, rtol=1e-3)
    np.testing.assert_allclose(found[1].down, [1.0, 0.0, 0.0], atol=0.05)
    blind = [fit(noisy @ turn.T, model="symmetric") for turn in (np.eye(3), roll)]
    np.testing.assert_allclose(blind[1].heading_error, blind[0].heading_error, rtol=1e-3)
    assert all("dip_assumed" in one.codes for one in blind)
    assert "dip_assumed" not in found[0].codes


def hand(delay, seed, rate=100.0, count=1200, fine=20):
    """Simulate a hand that turns at varied rates: readings that lag the rates by a delay, the rates, and the true rotation."""
    rng, total = np.random.default_rng(seed), count * fine
    t = np.arange(total)[:, None] / (rate * fine)
    waves = [rng.normal(size=3) * np.sin(2 * np.pi * rng.uniform(0.1, 1.2) * t + rng.uniform(0, 2 * np.pi, 3)) for _ in range(8)]
    rates = 0.75 * np.sum(waves, axis=0)
    body = [np.eye(3)]
    for step in Rotation.from_rotvec((rates[1:] + rates[:-1]) / 2 / (rate * fine)).as_matrix():
        body.append(body[-1] @ step)
    body = np.array(body)
    now = np.arange(count) * fine
    then = np.clip(now - round(delay * rate * fine), 0, total - 1)
    turn = Rotation.from_rotvec(VECTOR).as_matrix()
    field = np.array([np.cos(1.0), 0.0, np.sin(1.0)]) @ body[then]
    m = field @ turn.T + 0.005 * rng.normal(size=field.shape) + [0.3, -0.2, 0.1]
    return m, rates[now] + 0.002 * rng.normal(size=(count, 3)) + [0.01, -0.02, 0.005], turn


@pytest.mark.parametrize("delay", [-0.02, 0.0, 0.005, 0.02])
@pytest.mark.parametrize("joint", [False, True])
def test_the_delay_between_the_sensors_is_found(delay, joint):
    m, gyro, turn = hand(delay, 3)
    found = fit(m, model="symmetric", aid=Gyroscope(gyro, 100.0), joint=joint).alignment
    assert found.delay == pytest.approx(delay, abs=1e-3)
    assert abs(found.delay - delay) < 4 * found.delay_error + 1e-5
    assert found.delay_error < 5e-4
    assert angle_between(found.rotation, turn) < np.deg2rad(0.4)
    assert found.numbers["delay"].half == pytest.approx(1.96 * found.delay_error, rel=1e-3)


def angle_between(one, other):
    return Rotation.from_matrix(one @ other.T).magnitude()


def test_a_delay_that_the_turns_do_not_show_is_said():
    """At constant slow rates about two axes, a delay looks like a rotation; only prior knowledge of delays limits its error."""
    steps = np.repeat([[0.0, 0.0, 0.1], [0.1, 0.0, 0.0]], 300, axis=0)
    body = [np.eye(3)]
    for step in Rotation.from_rotvec(steps[:-1] / 10.0).as_matrix():
        body.append(body[-1] @ step)
    field = np.swapaxes(body, 1, 2) @ np.array([0.5, 0.0, 0.8]) + 0.01 * np.random.default_rng(0).normal(size=(600, 3))
    found = align(field, PLAIN, Gyroscope(steps, 10.0))
    assert found.delay_error > 0.02
    assert "delay_open" in found.codes


def test_a_shift_of_the_rates_moves_the_delay_and_not_the_rotation(reference):
    """In a flight controller's log at 200 Hz (pichim), the rates are shifted by up to 20 ms."""
    log = np.loadtxt(next((reference / "data" / "magnetometer" / "pichim").glob("*.txt")), delimiter=",")
    m, gyro = log[500:2500, :3], log[:, 3:]
    model = fit(log[:, :3]).model
    found = {k: align(m, model, Gyroscope(gyro[500 + k : 2500 + k], 200.0)) for k in (0, -4, -2, 2, 4)}
    for k, one in found.items():
        assert np.rad2deg(angle_between(one.rotation, found[0].rotation)) < 0.2
        assert one.delay - found[0].delay == pytest.approx(k / 200.0, abs=5e-4)


@pytest.mark.long
def test_a_joint_fit_of_correlated_noise_is_as_certain_as_it_says():
    away = []
    for seed in range(6):
        m, gyro, _ = hand(0.0, seed, count=1000, fine=8)
        rng, slow = np.random.default_rng([seed, 1]), np.zeros((1000, 3))
        for k in range(1, 1000):
            slow[k] = 0.9 * slow[k - 1] + 0.02 * np.sqrt(1 - 0.9**2) * rng.normal(size=3)
        found = fit(m + slow, field=1.0, aid=Gyroscope(gyro, 100.0), joint=True)
        assert set(found.estimate.freedom) == {5.0}
        assert "correlated" in found.codes
        away.append((found.model.hard_iron - [0.3, -0.2, 0.1]) / found.estimate.select("hard_iron*").error)
    assert 0.5 < cases.rms(away) < 1.6


def test_headings_of_a_sensor_with_other_axes():
    """Axes are x forward, y left and z up, as in some flight controllers: x forward, y right, z down, rotated by 180 degrees about x."""
    attitudes, m, up = poses(40, 0.002, 1)
    half = np.diag([1.0, -1.0, -1.0])
    sensor = MagModel(half @ np.asarray(TURNED.soft_iron), half @ np.asarray(TURNED.hard_iron))
    plain = MagModel(half @ np.asarray(cases.MILD.soft_iron) @ half, sensor.hard_iron)
    found = align(m @ half, plain, Headings(attitudes[:, 0], up))
    assert found.verdict == "good"
    np.testing.assert_allclose(found.model.soft_iron, sensor.soft_iron, atol=4e-3)
    assert found.angle < np.deg2rad(6)


def test_the_accelerometer_of_a_log_shows_the_dip_and_turns_nothing():
    """An accelerometer whose axes differ from those of the magnetometer is not used."""
    attitudes = scenario("all", samples=60, seed=1)
    up = -9.81 * body_field(attitudes, 1.0, np.pi / 2)
    m = cases.MILD.measure(body_field(attitudes, 1.0, np.deg2rad(70.0))) + 0.002 * np.random.default_rng(0).normal(size=up.shape)
    found = fit(Log(None, mag=m, accel=up, rate=1.0))
    assert np.rad2deg(found.inclination) == pytest.approx(70.0, abs=0.5)
    assert found.alignment is None
    assert "dip_assumed" not in found.codes
    other = fit(Log(None, mag=m, accel=up[:, [1, 2, 0]], rate=1.0))
    assert "dip_assumed" in other.codes
