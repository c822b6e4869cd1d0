"""Recordings in memory: every estimator accepts the same inputs as `read`, or refuses them with a clear message."""

import numpy as np
import pytest

import jaxcal

RATE, N = 100.0, 1500
TIME = np.arange(N) / RATE
GYRO = np.random.default_rng(0).normal(size=(N, 3)) * 0.01
NAMES = [f"gyro_{axis} [rad/s]" for axis in "xyz"]


def frame(library):
    module = pytest.importorskip(library)
    return module.DataFrame({"time [s]": TIME} | dict(zip(NAMES, GYRO.T, strict=True)))


def indexed():
    pandas = pytest.importorskip("pandas")
    index = pandas.date_range("2026-05-31", periods=N, freq="10ms", tz="Europe/Berlin", name="time")
    return pandas.DataFrame(dict(zip(NAMES, GYRO.T, strict=True)), index=index)


SOURCES = {
    "polars": lambda: frame("polars"),
    "polars lazy": lambda: frame("polars").lazy(),
    "pandas": lambda: frame("pandas"),
    "pandas with times": indexed,
    "dictionary": lambda: {"time": TIME, "gyro": GYRO},
    "log": lambda: jaxcal.Log(TIME, gyro=GYRO),
}


@pytest.mark.parametrize("kind", SOURCES)
def test_read_takes_it(kind):
    source = SOURCES[kind]()
    before = GYRO.copy()
    options = {} if kind != "dictionary" else {"units": "gyro=rad/s"}
    log = jaxcal.read(source, quiet=True, **options)
    assert log.rate == pytest.approx(RATE)
    np.testing.assert_allclose(log.gyro, GYRO)
    log.gyro[:] = 0.0  # changes a copy only
    if kind != "log":
        np.testing.assert_array_equal(GYRO, before)
    GYRO[:] = before


def test_an_array_needs_its_rate_and_says_which_sensor_it_is(refuses):
    log = jaxcal.read(GYRO * 180 / np.pi, rate=RATE, columns={"gyro": [0, 1, 2]}, units={"gyro": "deg/s"}, quiet=True)
    np.testing.assert_allclose(log.gyro, GYRO)
    with refuses("no_rate"):
        jaxcal.read(GYRO, columns={"gyro": [0, 1, 2]}, units={"gyro": "rad/s"})


@pytest.mark.parametrize("source", [3, None, object(), {1, 2}], ids=lambda source: type(source).__name__)
def test_what_is_no_recording_is_refused(source, refuses):
    with refuses("not_a_recording"):
        jaxcal.read(source)


def test_options_of_files_are_refused(refuses):
    with refuses("is_log"):
        jaxcal.read(jaxcal.Log(TIME, gyro=GYRO), rate=RATE)
    with refuses("of_files"):
        jaxcal.read({"time": TIME, "gyro": GYRO}, format="csv")


def test_estimators_take_it(tmp_path):
    found = jaxcal.noise.characterise({"gyro": GYRO[:, :1]}, rate=RATE, terms=("N",))
    same = jaxcal.noise.fit(GYRO[:, 0], RATE, terms=("N",))
    assert found["gyro_x"].noise.N == same.noise.N
    field = 1e6 * jaxcal.magnetometer.body_field(jaxcal.magnetometer.scenario("all"), 50e-6)
    path = tmp_path / "tumble.csv"
    rows = np.column_stack([np.arange(len(field)) / 10, field])
    np.savetxt(path, rows, delimiter=",", header="time [s],mag_x [uT],mag_y [uT],mag_z [uT]", comments="")
    iron = jaxcal.magnetometer.fit(path)
    assert iron.verdict == "good"
    assert iron.field == pytest.approx(50e-6, rel=1e-6)
    poses = jaxcal.imu.simulate(poses=4, rate=50, still=3, turn=2, seed=0)
    whole = {"time": poses.time, "gyro": poses.gyro, "accel": poses.accel}
    assert jaxcal.imu.multi_position(whole, gravity=9.81).reason == jaxcal.imu.multi_position(poses, gravity=9.81).reason


@pytest.mark.parametrize(
    "call", [jaxcal.noise.fit, jaxcal.allan.deviation, jaxcal.spectrum.density], ids=lambda call: f"{call.__module__}.{call.__name__}"
)
@pytest.mark.parametrize(
    ("y", "words"),
    [
        ("imu.csv", r"y is the name of a file; read it with log = jaxcal\.read\('imu\.csv'\)"),
        (jaxcal.Log(TIME, gyro=GYRO), "y is a Log; give one sensor and its rate, such as log.gyro and log.rate"),
        ({"gyro": GYRO}, "y is a dict of several arrays"),
    ],
    ids=["path", "log", "dictionary"],
)
def test_what_takes_samples_says_so(call, y, words, refuses):
    with refuses("record"):
        call(y, RATE)
