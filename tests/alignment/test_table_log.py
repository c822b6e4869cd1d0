"""Raw logs of a table that rests and moves, simulated without jaxcal, against ideal means over the same rests."""

import numpy as np
import pytest

import jaxcal
from jaxcal import DataError
from jaxcal.alignment import Positions, Readings, fit, from_log
from jaxcal.noise import Noise

from . import world
from .cases import DEG

ATTITUDE = np.array([1.0, 2.0, 40.0]) * DEG
WORDS = {1: ("x",), 3: ("x", "y", "fixed z")}


def compared(axes, runs, kind):
    """Answers from raw logs less those from ideal means, rms in standard deviations, and the share of intervals that contain the truth."""
    sensors = {"accel": world.ACCEL, "gyro": world.GYRO}
    noise = {name: Noise(**dict(zip("NBK", c * world.NOISES[kind], strict=True))) for name, c in sensors.items()}
    differences, inside = [], []
    for run in range(runs):
        rng = np.random.default_rng([run, 9])
        angles = np.array([0, 90, 180, 270, 270, 180, 90, 0][: 4 if run % 2 else 8])
        dwells = rng.uniform(60, 150, len(angles))
        time, angle, accel, gyro, rests, ideal = world.recording(rng, angles, dwells, kind, ATTITUDE, axes=axes)
        found = from_log(jaxcal.Log(time, accel=accel, gyro=gyro), angle=angle, noise=noise)
        assert len(found.angle) == len(angles)
        got, words = found.fit(world.LATITUDE), WORDS[axes]
        times = (rests[:, 1] - rests[:, 0]) / 50, rests[:, 0] / 50
        places = Positions(np.repeat(angles * DEG, axes), words * len(angles), *(np.repeat(x, axes) for x in times))
        means = Readings(places, *(mean.ravel() for mean in ideal), accel_noise=noise["accel"], gyro_noise=noise["gyro"])
        best = fit(means, world.LATITUDE, model=found.model, free=found.free, priors=found.priors or None)
        names = ("phi", "theta", "psi")
        differences.append([(got.parameters[name] - best.parameters[name]) / got.std[name] for name in names])
        inside.append([got.estimate[name].low <= truth <= got.estimate[name].high for name, truth in zip(names, ATTITUDE, strict=True)])
    return np.sqrt(np.mean(np.square(differences), axis=0)), np.mean(inside, axis=0)


@pytest.mark.parametrize("axes", [1, 3])
@pytest.mark.parametrize(("kind", "runs"), [("N+B+K", 2), *(pytest.param(one, 100, marks=pytest.mark.long) for one in ("white", "N+B+K"))])
def test_a_raw_log_gives_the_answer_of_ideal_means(axes, kind, runs):
    difference, inside = compared(axes, runs, kind)
    assert np.all(difference < 0.1), difference
    assert np.all(np.abs(inside - 0.95) < 3 * np.sqrt(0.95 * 0.05 / runs)), inside


@pytest.fixture(scope="module")
def made():
    rng = np.random.default_rng(4)
    return world.recording(rng, [0, 90, 180, 270], [30.0, 45.0, 40.0, 35.0], "white", ATTITUDE, axes=3, rate=20.0, mount=(0.02, -0.01))


def test_the_gyroscope_tells_the_angles_and_the_axis(made):
    time, _, accel, gyro, rests, _ = made
    noise = {"accel": world.ACCEL[0], "gyro": world.GYRO[0]}
    found = from_log(jaxcal.Log(time, accel=accel, gyro=gyro), noise=noise)
    np.testing.assert_allclose(np.rad2deg(found.angle), [0, 90, 180, 270], atol=0.05)
    # the device is tilted on the table by 0.02 and 0.01 rad; its gyro determines the tilt apart from a misalignment of 1e-3
    assert np.arccos(found.frame[2, 2]) == pytest.approx(np.hypot(0.02, 0.01), abs=3e-3)
    assert np.all((found.start >= rests[:, 0]) & (found.stop <= rests[:, 1]))
    got = found.fit(world.LATITUDE)
    for name, truth in zip(("phi", "theta", "psi"), ATTITUDE, strict=True):
        # the azimuth is that of the projection of the device's x axis on the plane of the table
        assert abs(got.parameters[name] - truth) < 4 * got.std[name] + (0.001 if name == "psi" else 0.0), name
    exact = from_log(jaxcal.Log(time, accel=accel, gyro=gyro), angles=found.angle, noise=noise, angle_std=0.0)
    assert got.std["phi"] > exact.fit(world.LATITUDE).std["phi"]


def test_an_angle_that_grows_the_other_way_is_turned(made):
    time, angle, accel, gyro, _, _ = made
    found = from_log(jaxcal.Log(time, accel=accel, gyro=gyro), angle=-angle)
    np.testing.assert_allclose(np.rad2deg(found.angle), [0, 90, 180, 270], atol=1e-3)
    assert "angle_turned" in {one.code for one in found.findings}


def test_gaps_spikes_and_a_slow_sensor_cost_their_samples_and_no_more(made):
    time, angle, accel, gyro, rests, _ = made
    rng = np.random.default_rng(1)
    accel, gyro = accel.copy(), gyro.copy()
    accel[rng.random(len(accel)) < 0.02] = np.nan
    gyro[rests[1, 0] + 300] += 1.0
    gyro[rests[2, 0] + 300 : rests[2, 0] + 340] = np.nan
    noise = {"accel": world.ACCEL[0], "gyro": world.GYRO[0]}
    found = from_log(jaxcal.Log(time, accel=accel, gyro=gyro), angles=np.array([0, 90, 180, 270]) * DEG, noise=noise)
    np.testing.assert_allclose(np.rad2deg(found.angle), [0, 90, 90, 180, 180, 270])
    got = found.fit(world.LATITUDE)
    assert abs(got.psi - ATTITUDE[2]) < 4 * got.std["psi"] + 0.001
    slow = np.where((np.arange(len(accel)) % 5 == 0)[:, None], made[2], np.nan)
    found = from_log(jaxcal.Log(time, accel=slow, gyro=made[3]), angle=angle, noise=noise)
    np.testing.assert_allclose(np.rad2deg(found.angle), [0, 90, 180, 270], atol=1e-3)


@pytest.mark.parametrize("steps", [1, 5])
def test_coarse_values_have_the_same_rests(made, steps):
    """At five standard deviations of the noise, most readings at rest are equal, and a rate is known to half a step."""
    time, angle, accel, gyro, rests, _ = made
    sizes = (steps * n[0] * np.sqrt(20.0) for n in (world.ACCEL, world.GYRO * 30))
    accel, gyro = (np.round(x / size) * size for x, size in zip((accel, gyro), sizes, strict=True))
    found = from_log(jaxcal.Log(time, accel=accel, gyro=gyro), angle=angle)
    assert len(found.start) == len(rests)
    assert np.all((found.start - rests[:, 0] < 30) & (rests[:, 1] - found.stop < 30) & (found.start >= rests[:, 0]))


def test_a_known_azimuth_calibrates_the_gyro():
    rng, inside, ratio = np.random.default_rng(6), [], []
    for _ in range(4):
        time, angle, accel, gyro, _, _ = world.recording(rng, [0, 90, 180, 270], [120.0] * 4, "white", ATTITUDE, rate=20.0, scale=1.01)
        found = from_log(jaxcal.Log(time, accel=accel, gyro=gyro), angle=angle, noise={"accel": world.ACCEL[0], "gyro": world.GYRO[0]})
        got = found.fit(world.LATITUDE, free=("phi", "theta", "b_a", "b_g", "s_g"), start={"psi": ATTITUDE[2]})
        inside.append(got.estimate["s_g"].low <= 0.01 <= got.estimate["s_g"].high)
        ratio.append(abs(got.parameters["s_g"] - 0.01) / got.std["s_g"])
    assert sum(inside) >= 3
    assert got.std["s_g"] < 2e-3


def test_logs_that_give_no_positions_say_why(refuses, made):
    time, angle, accel, gyro, _, _ = made
    log = jaxcal.Log(time, accel=accel, gyro=gyro)
    single = jaxcal.Log(time, accel=accel[:, :1], gyro=gyro[:, :1])
    for source, options, code in (
        (single, {}, "no_angles"), (single, {"angles": [0.0, 1.0]}, "angles"),
        (log, {"angles": np.array([0, 90, 200, 270]) * DEG}, "angles"), (log, {"angle": angle[:5]}, "angles"),
        (log, {"least": 60.0}, "few_rests"), (jaxcal.Log(None, mag=gyro, rate=20.0), {}, "no_sensor"),
        (jaxcal.Log(time, accel=accel[:, :2], rate=20.0), {}, "axes"),
        (jaxcal.Log(time, accel=accel / 9.80665, gyro=gyro), {}, "implausible"),
    ):  # fmt: skip
        with refuses(code):
            from_log(source, **options)
    turned = gyro.copy()
    half = len(gyro) // 2
    turned[half:] = turned[half:, [2, 1, 0]]
    with refuses("axes_of_moves"):
        from_log(jaxcal.Log(time, gyro=turned))


@pytest.mark.parametrize(
    ("accel", "gyro", "match"),
    [
        (None, [9.31, -9.1, -9.3, 9.2], r"15.04 deg/h.*look like deg/h"),
        (None, [4.2e-3, 1e-3, -4.1e-3, -1e-3], "look like deg/s"),
        ([171.0, 341.0, -170.0, -9800.0], None, r"9800 m/s\^2.*9.76 to 9.84.*mm/s"),
    ],
)  # fmt: skip
def test_readings_that_no_table_on_earth_gives_are_refused_with_the_likely_unit(accel, gyro, match):
    places = Positions(np.array([0, 90, 180, 270]) * DEG, dwell=60.0)
    with pytest.raises(DataError, match=match):
        fit(Readings(places, accel and np.array(accel), gyro and np.array(gyro)), world.LATITUDE)


def test_a_poor_gyro_is_not_taken_for_a_wrong_unit():
    """The noise of a consumer gyro (5 deg/sqrt(h)) exceeds the Earth's rate; the result is weak but not refused."""
    angles = np.array([0, 90, 180, 270]) * DEG
    rng = np.random.default_rng(0)
    clean = [vector[:, 0] for vector in world.vectors(ATTITUDE, angles)]
    gyro = clean[1] + 0.05 + 5 * DEG / 60 / np.sqrt(60.0) * rng.normal(size=4)
    places = Positions(angles, dwell=60.0)
    found = fit(Readings(places, clean[0], gyro, accel_noise=1e-3, gyro_noise=5 * DEG / 60), world.LATITUDE)
    assert found.std["psi"] > 10 * DEG
