"""`jaxcal.device.simulate`: the motion agrees with finite differences, and the sensors with the formulas of `DeviceModel`."""

import dataclasses

import equinox as eqx
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxcal
from jaxcal.device import DeviceModel, simulate
from jaxcal.imu import Triad
from jaxcal.magnetometer import MagModel

UP = np.array([0.0, 0.0, 1.0])
SILENT = {"noise": {"accel": 0.0, "gyro": 0.0, "mag": 0.0}}
PLAIN = DeviceModel(Triad(np.eye(3), np.zeros(3)), Triad(np.eye(3), np.zeros(3)), MagModel(np.eye(3), np.zeros(3)), 50e-6, np.deg2rad(60.0))

MOTIONS = {
    "free": {},
    "rests": {"rests": 2, "still": 1.0, "initial": 2.0},
    "held": {"rests": 2, "still": 1.0, "held": True},
    "one axis": {"turns": "one axis"},
    "no tilt": {"turns": "no tilt"},
    "arm": {"arm": (0.1, -0.2, 0.05)},
}


@pytest.mark.parametrize("options", MOTIONS.values(), ids=list(MOTIONS))
def test_rates_and_accelerations_are_the_derivatives_of_attitude_and_place(options):
    # with steps of 0.5 ms, the error of a central difference is below 1e-6 of the fastest tremor
    _, _, true = simulate(8.0, 2000.0, seed=3, **options)
    step = 1 / 2000.0
    middle = slice(1, -1)

    def slope(x):
        return (x[2:] - x[:-2]) / (2 * step)

    turned = Rotation.from_matrix(true.attitude)
    between = (turned[:-2].inv() * turned[2:]).as_rotvec() / (2 * step)
    for found, expected in (
        (slope(true.position), true.velocity[middle]),
        (slope(true.velocity), true.acceleration[middle]),
        (between, true.rate[middle]),
        (slope(true.rate), true.angular_acceleration[middle]),
    ):
        assert np.abs(found - expected).max() < 2e-3 * np.abs(expected).max()
    up = np.einsum("nji,nj->ni", true.attitude, true.acceleration + UP * 9.80665)
    assert np.abs(true.force - up).max() < 1e-12
    assert np.abs(np.linalg.det(true.attitude) - 1).max() < 1e-12


def test_a_rest_on_a_table_is_exact_and_one_in_the_hand_is_not():
    _, _, table = simulate(60.0, seed=1, rests=5)
    assert 5 * 4.0 * 100 <= table.resting.sum() <= 5 * 4.01 * 100 + 5
    assert np.abs(table.rate[table.resting]).max() == 0
    assert np.abs(table.velocity[table.resting]).max() == 0
    _, _, hand = simulate(60.0, seed=1, rests=5, held=True)
    rates = np.abs(hand.rate[hand.resting])
    assert 1e-3 < rates.max() < 0.3


def test_a_free_motion_keeps_its_reach_and_shows_every_side():
    places, ups, rates = [], [], []
    for seed in range(12):
        _, _, true = simulate(180.0, 10.0, seed=seed, tremor=0.0)
        places.append(true.position)
        ups.append(true.attitude[:, 2])
        rates.append(true.rate)
    assert np.std(places) == pytest.approx(0.25, rel=0.1)
    assert np.sqrt(np.mean(np.square(rates))) == pytest.approx(1.0, rel=0.1)
    for up in ups:
        # if all directions were equally frequent, the mean square along the weakest direction would be 1/3
        assert np.linalg.eigvalsh(up.T @ up / len(up)).min() > 0.1


def test_constrained_turns_stay_what_they_are_called():
    _, _, true = simulate(30.0, seed=2, turns="no tilt", tremor=0.0)
    assert np.abs(true.attitude[:, 2] - [0, 0, 1]).max() < 1e-12
    _, _, true = simulate(30.0, seed=2, turns="one axis", tremor=0.0)
    assert np.linalg.svd(true.rate, compute_uv=False)[1] < 1e-9


def test_each_sensor_reads_the_motion_at_its_own_time():
    _, device, early = simulate(20.0, seed=5, **SILENT)
    device = eqx.tree_at(lambda m: (m.gyro_delay, m.mag_delay), device, (0.02, -0.01))
    log, _, true = simulate(20.0, seed=5, model=device, **SILENT)
    assert np.abs(true.attitude - early.attitude).max() == 0
    assert np.abs(np.asarray(device.accel.correct(log.accel)) - true.force).max() < 1e-9
    # the gyroscope is two samples late, and the magnetometer one sample early
    assert np.abs(np.asarray(device.gyro.correct(log.gyro))[2:] - true.rate[:-2]).max() < 1e-9
    field = np.einsum("nji,j->ni", true.attitude, device.world_field)
    assert np.abs(np.asarray(device.magnetometer.correct(log.mag))[:-1] - field[1:]).max() < 1e-9 * 50e-6


def test_the_elements_of_the_accelerometer_feel_the_rotation_at_their_places():
    arm = np.array([[0.02, 0.0, 0.01], [0.0, -0.03, 0.0]])
    # at 1 kHz the second difference has an error of 3e-4 of the tremor's acceleration
    log, _, true = simulate(4.0, 1000.0, seed=5, model=eqx.tree_at(lambda m: m.lever, PLAIN, arm), **SILENT)
    for axis, r in ((0, np.zeros(3)), (1, arm[0]), (2, arm[1])):
        # differentiate the position of the element in the world twice
        path = true.position + true.attitude @ r
        acceleration = (path[2:] - 2 * path[1:-1] + path[:-2]) * 1000.0**2
        force = np.einsum("nji,nj->ni", true.attitude[1:-1], acceleration + UP * 9.80665)
        assert np.abs(force[:, axis] - log.accel[1:-1, axis]).max() < 1e-3


def test_what_the_model_does_not_hold_changes_the_magnetometer_alone():
    plain, device, true = simulate(30.0, seed=4)
    field = float(device.field)
    for options, least, most in (({"gradient": 0.2}, 0.01, 0.5), ({"iron": (10.0, 15.0, 0.3)}, 0.2, 0.4)):
        log, _, moved = simulate(30.0, seed=4, **options)
        assert np.array_equal(log.accel, plain.accel)
        assert np.array_equal(log.gyro, plain.gyro)
        assert all(np.array_equal(getattr(true, f.name), getattr(moved, f.name)) for f in dataclasses.fields(true))
        assert least < np.abs(log.mag - plain.mag).max() / field < most
    log, _, _ = simulate(30.0, seed=4, iron=(10.0, 15.0, 0.3))
    touched = np.abs(log.mag - plain.mag).max(axis=1) > 0
    assert 10.0 <= log.time[touched].min() < log.time[touched].max() <= 15.0 + 0.03


def test_noise_is_that_which_was_asked_for():
    noise = jaxcal.noise.Noise(N=1e-3, B=1e-3)
    silent = simulate(60.0, seed=6, **SILENT)[0]
    log, device, _ = simulate(60.0, seed=6, noise={"gyro": noise})
    assert np.std(log.accel - silent.accel) == pytest.approx(120e-6 * 9.80665 * 10, rel=0.02)
    assert np.std(log.mag - silent.mag) == pytest.approx(0.005 * float(device.field), rel=0.02)
    avar = [float(np.mean(jaxcal.allan.deviation(log.gyro - silent.gyro, 100.0, m=[m]).deviation) ** 2) for m in (1, 300)]
    assert avar == pytest.approx([float(noise.avar(tau, 0.01)) for tau in (0.01, 3.0)], rel=0.3)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"rests": 60}, "do not fit"),
        ({"turns": "wild"}, "no tilt"),
        ({"noise": {"accel": -1.0}}, "noise of accel"),
        ({"iron": (3.0, 2.0, 0.1)}, "iron"),
        ({"arm": (0.1, 0.2)}, "three finite lengths"),
    ],
)
def test_bad_input_is_named(options, named):
    with pytest.raises(jaxcal.DataError, match=named):
        simulate(**{"duration": 60.0, "seed": 1, **options})
