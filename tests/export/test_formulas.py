"""Signs, orders and units of every format: the tool's own formula corrects raw readings with the numbers of its file.

The formulas come from the tools' sources, as listed in table 2.1 of formats.md. The expected values are the check vectors of section 2.2
and, where the format loses nothing, the readings as `Calibration.correct` corrects them.
"""

import json
import pathlib
import re

import numpy as np
import pytest
import yaml

from jaxcal import Calibration, Log
from jaxcal.calibration import Part
from jaxcal.export import write
from jaxcal.magnetometer import MagModel

FOLDER = pathlib.Path(__file__).parent
DOCUMENT = json.loads((FOLDER / "golden.json").read_text())
ACCEL, GYRO, MAG = np.array([1.0, 2.0, 9.5]), np.array([0.3, -0.2, 0.1]), np.array([20.0, 10.0, -35.0])
TOLERANCE = 1e-6
AXES = "XYZ"


@pytest.fixture(scope="module")
def golden():
    return Calibration.load(FOLDER / "golden.json")


@pytest.fixture(scope="module")
def right(golden):
    """Readings (accel, gyro, mag) corrected by `Calibration.correct` at 35 and at 50 degC."""

    def at(t):
        raw = {"accel": ACCEL, "gyro": GYRO, "mag": 1e-6 * MAG}
        found = golden.correct(Log(None, **{name: np.tile(y, (3, 1)) for name, y in raw.items()}, temperature=np.full(3, t), rate=10.0))
        return found.accel[0], found.gyro[0], 1e6 * found.mag[0]

    return {t: at(t) for t in (35.0, 50.0)}


def close(found, expected, scale=1.0):
    np.testing.assert_allclose(found, expected, rtol=0, atol=TOLERANCE * scale)


def params(path, column):
    rows = [line.replace(",", "\t").split("\t") for line in path.read_text().splitlines() if not line.startswith("#")]
    return {row[column]: float(row[column + 1]) for row in rows}


def three(p, pattern):
    return np.array([p[pattern.format(axis)] for axis in AXES])


def test_px4(golden, tmp_path):
    """PX4: accelerometer (raw - thermal - OFF) SCALE; gyroscope raw - thermal - OFF; magnetometer S (raw - OFF) in gauss."""
    write(golden, tmp_path / "a", format="px4")
    p = params(tmp_path / "a", 2)

    def thermal(letter, t):
        d = np.clip(t, p[f"TC_{letter}0_TMIN"], p[f"TC_{letter}0_TMAX"]) - p[f"TC_{letter}0_TREF"]
        return np.array([sum(p[f"TC_{letter}0_X{i}_{k}"] * d**i for i in range(4)) for k in range(3)])

    for t, expected in ((35.0, [0.88176, 2.07584, 9.29625]), (50.0, [0.867894825, 2.0855705, 9.25245712])):
        close((ACCEL - thermal("A", t) - three(p, "CAL_ACC0_{}OFF")) * three(p, "CAL_ACC0_{}SCALE"), expected)
    close(thermal("A", 50.0), [0.0138375, -0.00975, 0.043575])
    close(GYRO - thermal("G", 35.0) - three(p, "CAL_GYRO0_{}OFF"), [0.29, -0.18, 0.095])
    (xs, ys, zs), (xo, yo, zo) = three(p, "CAL_MAG0_{}SCALE"), three(p, "CAL_MAG0_{}ODIAG")
    s = np.array([[xs, xo, yo], [xo, ys, zo], [yo, zo, zs]])
    close(100 * s @ (0.01 * MAG - three(p, "CAL_MAG0_{}OFF")), [8.87, 14.9325, -64.5575], scale=10)


def test_ardupilot(golden, tmp_path):
    """ArduPilot: accelerometer (raw - thermal - OFFS) SCAL; compass D scale (raw + OFS) in milligauss."""
    write(golden, tmp_path / "a", format="ardupilot", gyro_bias=True)
    p = params(tmp_path / "a", 0)

    def thermal(sensor, t, holds):
        low, high = p["INS_TCAL1_TMIN"], p["INS_TCAL1_TMAX"]

        def series(t):
            return sum(1e-6 * three(p, f"INS_TCAL1_{sensor}{i}_{{}}") * (np.clip(t, low, high) - 35.0) ** i for i in (1, 2, 3))

        return series(t) - series(holds)

    for t, expected in ((35.0, [0.88176, 2.07584, 9.29625]), (50.0, [0.867894825, 2.0855705, 9.25245712])):
        raw = ACCEL - thermal("ACC", t, p["INS_ACC1_CALTEMP"])
        close((raw - three(p, "INS_ACCOFFS_{}")) * three(p, "INS_ACCSCAL_{}"), expected)
    close(GYRO - thermal("GYR", 35.0, p["INS_GYR1_CALTEMP"]) - three(p, "INS_GYROFFS_{}"), [0.29, -0.18, 0.095])
    (dx, dy, dz), (ox, oy, oz) = three(p, "COMPASS_DIA_{}"), three(p, "COMPASS_ODI_{}")
    d = np.array([[dx, ox, oy], [ox, dy, oz], [oy, oz, dz]])
    close(0.1 * d @ (p["COMPASS_SCALE"] * (10 * MAG + three(p, "COMPASS_OFS_{}"))), [8.87, 14.9325, -64.5575], scale=10)


def test_ardupilot_where_the_reference_is_outside_its_range(golden, tmp_path):
    """The firmware clips CALTEMP, so that the offset must belong to the clipped temperature."""
    device = Calibration(imu=golden.imu, temperature={**DOCUMENT["temperature"], "reference": 5.0}, device=golden.device)
    found = write(device, tmp_path / "a", format="ardupilot")
    p = params(tmp_path / "a", 0)
    assert p["INS_ACC1_CALTEMP"] == 10.0
    (outside,) = {tuple(one.facts.values()) for one in found if one.code == "reference_outside"}
    assert outside == (5.0, 10.0, 60.0)
    c = golden.temperature.powers("accel")
    expected = golden.imu.accel.model.bias + c @ np.array([5.0, 25.0, 125.0])
    close(three(p, "INS_ACCOFFS_{}"), expected)


def test_ros2(golden, right, tmp_path):
    write(golden, tmp_path / "a", format="ros")
    p = yaml.safe_load((tmp_path / "a").read_text())["/**"]["ros__parameters"]
    accel, gyro, mag = (np.reshape(p[f"{name}_matrix"], (3, 3)) for name in ("accel", "gyro", "mag"))
    felt = accel @ (ACCEL - p["accel_bias"])
    close(felt, right[35.0][0])
    close(gyro @ (GYRO - p["gyro_bias"] - np.reshape(p["gyro_g_sensitivity"], (3, 3)) @ felt), right[35.0][1])
    close(mag @ (MAG - 1e6 * np.array(p["mag_bias"])), right[35.0][2], scale=10)
    np.testing.assert_allclose(np.diag(np.reshape(p["angular_velocity_covariance"], (3, 3))), 200 * np.array([1.6e-4, 1.7e-4, 1.8e-4]) ** 2)


def test_motioncal(golden, tmp_path):
    """MotionCal: invW (raw - V)."""
    write(golden, tmp_path / "a", format="motioncal")
    values = np.frombuffer((tmp_path / "a").read_bytes()[2:66], dtype="<f4").astype(float)
    v, b, (xx, yy, zz, xy, xz, yz) = values[6:9], values[9], values[10:]
    w = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    # the tolerance is that of float32 numbers of 65 uT
    np.testing.assert_allclose(w @ (MAG - v), [8.82016591, 14.8486051, -64.1947983], rtol=0, atol=65 * 2**-24 * 4)
    assert np.linalg.det(w) == pytest.approx(1, abs=3e-7)
    assert b == pytest.approx(47.73032, rel=1e-6)


def braces(text, name):
    return np.array([float(one) for one in re.findall(r"-?[\d.]+(?:e[-+]\d+)?(?=f)", text.split(f"{name} = ")[1].split(";")[0])])


@pytest.mark.parametrize(("format", "matrix", "bias"), [
    ("fusion", "softIronMatrix", "hardIronOffset"), ("magneto", "M_Ainv[3][3]", "M_B[3]"),
])  # fmt: skip
def test_lines_of_c_for_a_magnetometer(golden, right, tmp_path, format, matrix, bias):
    """Fusion: softIronMatrix (raw - hardIronOffset); Magneto: Ainv (raw - B)."""
    write(Calibration(magnetometer=golden.magnetometer), tmp_path / "a", format=format)
    text = (tmp_path / "a").read_text()
    close(braces(text, matrix).reshape(3, 3) @ (MAG - braces(text, bias)), right[35.0][2], scale=10)
    assert "// A {" in text
    assert "// soft iron, the inverse of A {" in text


def test_settings_in_counts(tmp_path, golden, refuses):
    """iNav: (raw - magzero) 1024 / maggain; Betaflight: raw - mag_calibration."""
    model = MagModel(np.array([[1.1, 0.02, 0.0], [0.02, 0.9, 0.0], [0.0, 0.0, 1.0]]), np.array([150.0, -75.0, 33.4]))
    device = Calibration(magnetometer=Part(model, "counts", 512.0))
    codes = {one.code for one in write(device, tmp_path / "a", format="inav")}
    lines = dict(re.findall(r"set (\w+) = (-?\d+)", (tmp_path / "a").read_text()))
    zero, gain = (np.array([int(lines[f"{name}_{axis}"]) for axis in "xyz"]) for name in ("magzero", "maggain"))
    raw = model.measure(512.0 * np.eye(3))
    np.testing.assert_allclose(np.diag((raw - zero) * 1024 / gain), 1024.0, atol=6.0)
    assert codes == {"matrix_left_out"}
    write(device, tmp_path / "b", format="betaflight")
    assert "set mag_calibration = 150,-75,33" in (tmp_path / "b").read_text().splitlines()
    for format in ("inav", "betaflight"):
        with refuses("no_part"):
            write(Calibration(magnetometer=golden.magnetometer), tmp_path / "c", format=format)


def test_openvins(golden, right, tmp_path):
    """OpenVINS: accel = R_ACC' inv(Ta) (raw - b); gyro = R_GYRO' inv(Tw) (raw - b - Tg accel), in the file's IMU frame.

    OpenVINS reads only the lower triangle of Ta and Tw; the test does the same.
    """
    (frame,) = (one for one in write(golden, tmp_path / "a", format="openvins") if one.code == "frame_turned")
    assert frame.facts["angle"] == pytest.approx(0.1542, abs=5e-5)
    assert (tmp_path / "a").read_text().startswith("%YAML:1.0\n# openvins file written by jaxcal")
    p = yaml.safe_load((tmp_path / "a").read_text().removeprefix("%YAML:1.0\n"))["imu0"]
    ta, tw = np.tril(p["Ta"]), np.tril(p["Tw"])
    accel = np.transpose(p["R_IMUtoACC"]) @ np.linalg.solve(ta, ACCEL - golden.imu.accel.model.bias)
    gyro = np.transpose(p["R_IMUtoGYRO"]) @ np.linalg.solve(tw, GYRO - golden.imu.gyro.model.bias - np.array(p["Tg"]) @ accel)
    close(accel, [0.881757798, 2.07495958, 9.29492466])
    close(gyro, [0.292150479, -0.17824089, 0.0961253891])
    told = next(line for line in (tmp_path / "a").read_text().splitlines() if "x_file" in line).split(" = ")[-1]
    turn = np.array([[float(word) for word in row.strip("[]").split(", ")] for row in told.split("; ")])
    close(accel, turn @ right[35.0][0])
    close(gyro, turn @ right[35.0][1])


def test_kalibr_and_orbslam3_make_the_noise_discrete_as_the_fit_had_it(golden, tmp_path):
    """ORB-SLAM3 multiplies noise by sqrt(Frequency) and divides walks by it."""
    write(golden, tmp_path / "a", format="orbslam3")
    p = yaml.safe_load((tmp_path / "a").read_text())
    rate = p["IMU.Frequency"]
    assert (p["IMU.NoiseGyro"] * np.sqrt(rate)) ** 2 == pytest.approx(1.8e-4**2 * 200)
    assert (p["IMU.AccWalk"] / np.sqrt(rate)) ** 2 == pytest.approx(3.2e-5**2 / 200)
