"""Kalibr's imu.yaml contains no value that was not measured or given."""

import math
import pathlib

import equinox as eqx
import numpy as np
import pytest
import yaml

from jaxcal import Calibration, ExportError
from jaxcal.export import write

FOLDER = pathlib.Path(__file__).parent


@pytest.fixture
def golden():
    return Calibration.load(FOLDER / "golden.json")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "imu.yaml"


def with_noise(calibration, sensor, **changes):
    """The calibration with changed noise of one sensor."""
    old = getattr(calibration.noise, sensor)
    new = type(old)(**({name: getattr(old, name) for name in old.__dataclass_fields__} | changes))
    return eqx.tree_at(lambda c: getattr(c.noise, sensor), calibration, new, is_leaf=lambda x: x is old)


def without_walk(calibration, sensor, limit=(1e-5, 2e-5, 9e-5)):
    """The calibration with a random walk K that was found only on axis y of a sensor."""
    verdict = {"N": ("present",) * 3, "K": ("not detected", "present", "hint")}
    return with_noise(
        calibration, sensor, K=np.array([0.0, 3e-5, 1e-6]), verdict=verdict, upper_limit={"K": np.array(limit)}, confidence=0.95
    )


def test_bias_instability_never_becomes_a_random_walk(golden, path):
    found = write(golden, path)
    assert not {"4e-05", "5e-06", "6e-05", "7e-06", "4.0e-05", "7.0e-06"} & set(path.read_text().replace(",", " ").split())
    told = {one.subject: one.facts["terms"] for one in found if one.code == "terms_left_out"}
    assert "bias instability B" in told["gyro",]
    assert "bias instability B" in told["accel",]


def test_rms_and_a_motion(golden, path, refuses):
    from jaxcal.budget import Motion, increments

    motion = Motion.hand(5.0)
    write(golden, path, axis="rms", motion=motion, provenance=False)
    times = increments(golden, motion, windows=[1.0]).factor("gyro")[0]
    assert times > 1
    found = yaml.safe_load(path.read_text())
    assert math.isclose(found["gyroscope_noise_density"], times * math.sqrt((1.6e-4**2 + 1.7e-4**2 + 1.8e-4**2) / 3), rel_tol=1e-8)
    assert math.isclose(found["accelerometer_random_walk"], math.sqrt((2.8e-5**2 + 3e-5**2 + 3.2e-5**2) / 3), rel_tol=1e-8)
    assert "rms axis; per axis N = 0.00016, 0.00017, 0.00018; K = 2.0e-06, 2.2e-06, 2.4e-06; N times " in path.read_text()
    write(golden, path, format="ros", motion=motion, force=True)
    squares = yaml.safe_load(path.read_text())["/**"]["ros__parameters"]["angular_velocity_covariance"]
    assert math.isclose(squares[0], 200 * (times * 1.6e-4) ** 2, rel_tol=1e-8)
    with refuses("window", ExportError):
        write(golden, path, motion=motion, window=9.0)


def test_what_was_not_measured_is_refused(golden, path, refuses):
    noise = type(golden.noise)
    for code, lacking, options in (
        *(("not_detected", without_walk(golden, sensor), {"random_walk": None}) for sensor in ("gyro", "accel")),
        *(("not_detected", with_noise(golden, "gyro", K=missing), {"random_walk": None}) for missing in (np.zeros(3), None)),
        ("no_limit", without_walk(golden, "gyro", limit=(1.0, 1.0, math.inf)), {"random_walk": "upper_limit"}),
        ("no_limit", with_noise(golden, "gyro", K=None), {"random_walk": "upper_limit"}),
        ("no_limit", with_noise(golden, "accel", N=None), {}), ("no_noise", Calibration(), {}),
        *(("no_noise", Calibration(noise=noise(rate=200.0, **{one: getattr(golden.noise, one)})), {}) for one in ("gyro", "accel")),
    ):  # fmt: skip
        with refuses(code, ExportError):
            write(lacking, path, **options)
    assert not path.exists()


def test_upper_limit_is_written_where_k_was_not_found(golden, path):
    found = write(without_walk(golden, "gyro"), path, provenance=False)
    assert yaml.safe_load(path.read_text())["gyroscope_random_walk"] == 9e-5
    assert "K = 1.0e-05, 3.0e-05, 9.0e-05 (95 % upper limit on gyro_x, gyro_z)" in path.read_text()
    assert ("limit_written", ("gyro_x", "gyro_z"), "95 % upper limit") in [(one.code, one.subject, one.facts.get("limit")) for one in found]
    assert yaml.safe_load(path.read_text())["accelerometer_random_walk"] == 3.2e-5  # this value was found and is kept


def test_number_for_a_sensor_that_lacks_a_random_walk(golden, path):
    found = write(without_walk(without_walk(golden, "gyro"), "accel"), path, random_walk={"gyro": 7e-6})
    text = path.read_text()
    values = yaml.safe_load(text)
    assert (values["gyroscope_random_walk"], values["accelerometer_random_walk"]) == (7e-6, 9e-5)
    assert "(given, not measured)" in text
    assert {"given", "limit_written"} <= {one.code for one in found}
    write(golden, path, random_walk={"accel": 1})  # in place of one that was found
    assert yaml.safe_load(path.read_text())["accelerometer_random_walk"] == 1.0


def test_density_from_its_upper_limit(golden, path):
    hidden = {"N": ("not detected", "present", "hint"), "K": ("present",) * 3}
    lacking = with_noise(golden, "accel", verdict=hidden, upper_limit={"N": np.array([5e-3, 1.0, 1e-3])}, confidence=0.9)
    found = write(lacking, path)
    assert yaml.safe_load(path.read_text())["accelerometer_noise_density"] == 5e-3
    assert "N = 0.005, 0.002, 0.001 (90 % upper limit on accel_x, accel_z); K = 2.8e-05" in path.read_text()
    assert ("N", "90 % upper limit") in [(one.facts["term"], one.facts["limit"]) for one in found if one.code == "limit_written"]


def test_terms_that_are_there_and_not_written_are_mentioned(golden, path):
    verdict = {"Q": ("not detected",) * 3, "B": ("not detected",) * 3}
    processes = (((1.0, 2.0),), (), ())
    found = write(with_noise(golden, "gyro", verdict=verdict, Q=np.ones(3), R=np.ones(3), markov=processes), path)
    assert {one.subject: one.facts for one in found if one.code == "terms_left_out"}["gyro",]["terms"] == "ramp R, Gauss-Markov"


@pytest.mark.parametrize("value", [4e-6, 200.0, 0.0021, 1e-300, 123456789.0, 1.5e16, 1 / 3, 100, 1e9, 3.3e-5])
def test_number_text_is_a_yaml_float_exact_for_float32(golden, path, value):
    write(golden, path, rate=value, topic="null")
    assert yaml.safe_load(path.read_text())["rostopic"] == "null"
    found = yaml.safe_load(path.read_text())["update_rate"]
    assert isinstance(found, float)
    assert math.isclose(found, value, rel_tol=1e-8)
    single = np.float32(min(value, 1e30))
    if single > 0:
        write(golden, path, rate=float(single))
        assert np.float32(yaml.safe_load(path.read_text())["update_rate"]) == single
