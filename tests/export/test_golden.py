"""Every format agrees with its golden file, and real parsers and compilers accept it."""

import json
import pathlib
import shutil
import subprocess

import numpy as np
import pytest
import yaml

from jaxcal import Calibration, ExportError, Log
from jaxcal.export import write
from jaxcal.imu import ThermalTriad

FOLDER = pathlib.Path(__file__).parent
DOCUMENT = json.loads((FOLDER / "golden.json").read_text())
GOLDEN = FOLDER / "golden"
CASES = [
    ("kalibr", "imu.yaml"), ("openvins", "kalibr_imu_chain.yaml"), ("vins", "vins.yaml"), ("orbslam3", "orbslam3.yaml"),
    ("gtsam", "gtsam.py.txt"), ("px4", "px4.params"), ("ardupilot", "ardupilot.param"), ("ros", "ros_ros2.yaml"), ("c", "calibration.h"),
]  # fmt: skip
MARKS = {"c": "//"}
RAW = {"gyro": np.array([0.3, -0.2, 0.1]), "accel": np.array([1.0, 2.0, 9.5]), "mag": np.array([20e-6, 10e-6, -35e-6])}


def codes(findings):
    return {one.code for one in findings}


@pytest.fixture(scope="module")
def golden():
    return Calibration.load(FOLDER / "golden.json")


def yaml_of(path):
    """Read a file with PyYAML, without OpenCV's directive `%YAML:1.0`, which is not valid YAML."""
    return yaml.safe_load(path.read_text().removeprefix("%YAML:1.0\n"))


@pytest.mark.parametrize(("format", "file"), CASES)
def test_golden_file(golden, tmp_path, format, file):
    write(golden, tmp_path / file, format=format, provenance=False)
    assert (tmp_path / file).read_bytes() == (GOLDEN / file).read_bytes()


@pytest.mark.parametrize(("format", "file"), CASES)
def test_provenance_adds_comments_alone(golden, tmp_path, format, file):
    signed = Calibration(
        noise=golden.noise, imu=golden.imu, magnetometer=golden.magnetometer, temperature=golden.temperature,
        device={**golden.device, "name": "unit 7\nB: 1"}, provenance={"file": "a.csv", "sha256": "ab", "version": "0"},
    )  # fmt: skip
    found = write(signed, tmp_path / file, format=format)
    mark = MARKS.get(format, "#")
    lines, expected = (path.read_text().splitlines() for path in (tmp_path / file, GOLDEN / file))
    added = [line for line in lines if line not in expected]
    assert all(line.startswith(f"{mark} ") for line in added)
    assert [line for line in lines if line not in added] == expected
    assert f"{mark} device: unit 7 B: 1" in added
    assert f"{mark} recording: a.csv, SHA-256 ab" in added
    assert all(f"{mark} {one}" in added for one in found)


def test_golden_files_without_comments(golden, tmp_path):
    write(golden, tmp_path / "a.bin", format="motioncal")
    assert (tmp_path / "a.bin").read_bytes() == bytes.fromhex((GOLDEN / "motioncal.hex").read_text())


@pytest.mark.parametrize("frame", ["up", "down"])
def test_the_snippet_of_gtsam_runs(golden, tmp_path, frame, monkeypatch):
    """The snippet runs with a substitute for GTSAM that stores the values it receives; method names are from GTSAM's documentation."""
    values = np.diag([4e-6, 5e-6, 6e-6]), np.diag([7e-8, 8e-8, 9e-8])
    imu = {
        name: {**DOCUMENT["imu"][name], "covariance": {"parameters": tuple(f"bias[{i}]" for i in range(3)), "values": value}}
        for name, value in zip(("accel", "gyro"), values, strict=True)
    }
    write(Calibration(noise=golden.noise, imu=imu), tmp_path / "a.py", format="gtsam", frame=frame)
    kept = {}

    class Parameters:
        def __getattr__(self, name):
            if name == "setBiasAccOmegaInit":
                raise AttributeError(name)
            return lambda value: kept.__setitem__(name, value)

    class Gtsam:
        class PreintegrationCombinedParams:
            MakeSharedU = staticmethod(lambda g: kept.__setitem__("up", g) or Parameters())
            MakeSharedD = staticmethod(lambda g: kept.__setitem__("down", g) or Parameters())

    monkeypatch.setitem(__import__("sys").modules, "gtsam", Gtsam)
    text = (tmp_path / "a.py").read_text()
    exec(compile(text, "a.py", "exec"), {})
    assert kept[frame] == 9.80665
    np.testing.assert_allclose(kept["setAccelerometerCovariance"], np.diag([1.9e-3, 2e-3, 2.1e-3]) ** 2, rtol=1e-8)
    np.testing.assert_allclose(kept["setBiasOmegaCovariance"], np.diag([2e-6, 2.2e-6, 2.4e-6]) ** 2, rtol=1e-8)
    np.testing.assert_allclose(kept["setBiasAccOmegaInt"], np.diag([4e-6, 5e-6, 6e-6, 7e-8, 8e-8, 9e-8]), rtol=1e-8)


PROGRAM = r"""
#include <stdio.h>
#include "calibration.h"
int main(void)
{
    const REAL y[3][3] = {{1.0, 2.0, 9.5}, {0.3, -0.2, 0.1}, {20e-6, 10e-6, -35e-6}};
    REAL x[3][3];
    jaxcal_correct_accel(y[0], 50, DAYS, x[0]);
    jaxcal_correct_gyro(y[1], x[0], 50, DAYS, x[1]);
    jaxcal_correct_mag(y[2], 50, DAYS, x[2]);
    for (int i = 0; i < 9; i++)
        printf("%.17g ", (double)x[i / 3][i % 3]);
    return 0;
}
"""


def compiled(folder, program, name="main"):
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    (folder / f"{name}.c").write_text(program)
    command = [compiler, "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", f"{name}.c", "-o", name]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return subprocess.run([str(folder / name)], text=True, capture_output=True, check=True).stdout


@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("case", ["plain", "warm and aged"])
def test_the_c_header_corrects_as_python_does(golden, tmp_path, double, case):
    rng, imu, days, options = np.random.default_rng(2), golden.imu, 0.0, {}
    if case != "plain":
        parts = {}
        for sensor, size in (("accel", 1e-2), ("gyro", 1e-4)):
            powers = [scale * rng.standard_normal((2, *shape)) for scale, shape in ((1e-4, (3, 3)), (size, (3,)), (1e-7, (3, 3)))]
            model = getattr(imu, sensor).model
            parts[sensor] = ThermalTriad(model.matrix, model.bias, model.g_sensitivity, *powers, 25.0, -10.0, 45.0)
        # the bias moves by 1 uT in 50 days on two axes; the change of x is not certain
        mag = {"unit": "T", "soft_iron": np.eye(3), "field": 48e-6, "hard_iron": golden.magnetometer.model.hard_iron - [1e-9, 1e-6, 1e-6]}
        names = [*(f"soft_iron[{i},{j}]" for i in range(3) for j in range(3)), *(f"hard_iron[{i}]" for i in range(3)), "field"]
        mag["covariance"] = {"parameters": names, "values": 1e-14 * np.eye(13)}
        imu, days = parts, 100.0
        options["earlier"] = Calibration(magnetometer=mag, provenance={"date": "2026-01-01"})
    device = Calibration(imu=imu, magnetometer=golden.magnetometer, temperature=golden.temperature, provenance={"date": "2026-02-20"})
    found = write(device, tmp_path / "calibration.h", format="c", double=double, **options)
    assert codes(found) == ({"no_ageing"} if options else set())
    program = PROGRAM.replace("REAL", "double" if double else "float").replace("DAYS", f"{days:g}")
    x = np.array(compiled(tmp_path, program).split(), dtype=float).reshape(3, 3)
    aged = RAW | {"mag": RAW["mag"] - days / 50 * np.array([0.0, 1e-6, 1e-6]) * bool(options)}
    right = device.correct(Log(None, **{name: np.tile(y, (3, 1)) for name, y in aged.items()}, temperature=np.full(3, 50.0), rate=10.0))
    np.testing.assert_allclose(x, [right.accel[0], right.gyro[0], right.mag[0]], rtol=1e-14 if double else 1e-6)


def test_a_c_header_of_one_sensor_and_another_prefix(golden, tmp_path):
    write(Calibration(magnetometer=golden.magnetometer), tmp_path / "calibration.h", format="c", prefix="UNIT7_")
    text = (tmp_path / "calibration.h").read_text()
    assert "JAXCAL" not in text
    assert "TEMPERATURE" not in text
    program = '#include "calibration.h"\nint main(void) { return UNIT7_MAG_MATRIX[0][0] == 0.0f; }'
    assert compiled(tmp_path, program) == ""


def test_vins_states_both_readings_of_its_convention(golden, tmp_path):
    write(golden, tmp_path / "a", format="vins")
    write(golden, tmp_path / "b", format="vins", convention="per_sample", gravity=9.81)
    a, b = (yaml.safe_load((tmp_path / name).read_text()) for name in "ab")
    assert b["g_norm"] == 9.81
    for key in ("acc_n", "gyr_n"):
        assert a[key] == pytest.approx(np.sqrt(2) * b[key], rel=1e-8)
    assert (a["acc_w"], a["gyr_w"]) == (b["acc_w"], b["gyr_w"])
    dt = 1 / 200
    # the covariance that integration_base.h adds in each step
    assert 2 * 0.5**2 * a["acc_n"] ** 2 * dt**2 == pytest.approx(2.1e-3**2 * dt, rel=1e-8)
    assert (a["gyr_w"] * dt) ** 2 == pytest.approx(2.4e-6**2 * dt, rel=1e-8)
    assert "mid-point covariance equal N^2*dt: acc 0.042, gyr 0.0036" in (tmp_path / "b").read_text()


def test_rate_given_is_no_guess(golden, tmp_path):
    for format in ("kalibr", "openvins", "vins", "orbslam3", "ros"):
        signed = Calibration(noise=golden.noise, provenance={"rate": "given"})
        for device, options, estimated in ((golden, {}, True), (golden, {"rate": 250}, False), (signed, {}, False)):
            found = write(device, tmp_path / "a", format=format, **options)
            assert ("rate_estimated" in {one.code for one in found}) == estimated
    write(golden, tmp_path / "a", format="orbslam3", rate=250)
    assert yaml.safe_load((tmp_path / "a").read_text())["IMU.Frequency"] == 250.0


@pytest.mark.parametrize("verdict", ["weak", "refused"])
@pytest.mark.parametrize("format", ["px4", "c", "csv"])
def test_a_weak_verdict_needs_force(golden, tmp_path, verdict, format, refuses):
    doubtful = Calibration(imu={**DOCUMENT["imu"], "verdict": verdict, "verdict_reason": "three poses"}, device=golden.device)
    with refuses("doubtful", ExportError):
        write(doubtful, tmp_path / "a", format=format)
    assert list(tmp_path.iterdir()) == []
    assert "forced" in {one.code for one in write(doubtful, tmp_path / "a", format=format, force=True)}


def test_other_warnings(golden, tmp_path):
    applied = Calibration(imu=golden.imu, device=golden.device, provenance={"applied": ["accel"]})
    assert "applied_twice" in codes(write(applied, tmp_path / "a", format="px4"))
    unknown = Calibration(magnetometer={**DOCUMENT["magnetometer"], "field": None}, device=golden.device)
    guessed = Calibration(magnetometer=golden.magnetometer, device=golden.device, provenance={"options": {"field": None, "place": None}})
    for device in (unknown, guessed):
        for format in ("px4", "ardupilot", "c", "motioncal", "ros"):
            found = codes(write(device, tmp_path / f"{format}.out", format=format, force=True))
            assert found & {"scale_unknown", "placeholder"}, format
    turn = np.array([[np.cos(0.02), -np.sin(0.02), 0], [np.sin(0.02), np.cos(0.02), 0], [0, 0, 1]])
    soft = golden.magnetometer.model.soft_iron @ turn.T  # A = turn inv(soft)
    turned = Calibration(magnetometer={**DOCUMENT["magnetometer"], "soft_iron": soft}, device=golden.device)
    for format, name in (("px4", "CAL_MAG0_ROT"), ("ardupilot", "COMPASS_ORIENT")):
        (lost,) = (one for one in write(turned, tmp_path / "a", format=format) if one.code == "rotation_left_out")
        assert lost.facts["lost"] == pytest.approx(np.degrees(0.02))
        assert lost.facts["place"] == name
    for format in ("kalibr", "vins", "gtsam"):
        (left,) = (one for one in write(golden, tmp_path / "a", format=format) if one.code == "sections_left_out")
        assert left.facts["sections"] == "imu, magnetometer, temperature"


@pytest.mark.parametrize(
    ("code", "format", "options"),
    [
        ("format", "latex", {}), ("instance", "px4", {"instance": 4}), ("instance", "ardupilot", {"instance": 3}),
        *(("no_such_option", "kalibr", wrong) for wrong in ({"gravity": 9.81}, {"flavour": "dlio"}, {"density": 1.0})),
        *(("option", "kalibr", {"random_walk": wrong}) for wrong in (-1.0, True, "limit", {"gyroscope": 1.0})),
        *(("option", "kalibr", wrong) for wrong in ({"axis": "best"}, {"window": 0.0}, {"motion": 1})),
        *(("option", "kalibr", wrong) for wrong in ({"topic": "/imu0\nevil: 1"}, {"topic": ""})),
        ("option", "vins", {"convention": "x"}), ("option", "gtsam", {"gravity": 0}), ("option", "orbslam3", {"rate": -1.0}),
        ("option", "px4", {"instance": -1}), ("option", "c", {"prefix": "7-"}),
    ],
)  # fmt: skip
def test_options_that_mean_nothing(golden, tmp_path, code, format, options, refuses):
    with refuses(code, ExportError):
        write(golden, tmp_path / "a", format=format, **options)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("format", [*(format for format, _ in CASES), "motioncal", "fusion", "inav", "csv"])
def test_nothing_to_write(tmp_path, format):
    with pytest.raises(ExportError) as error:
        write(Calibration(device="a"), tmp_path / "a", format=format)
    assert error.value.code in ("no_noise", "no_part")
    assert list(tmp_path.iterdir()) == []
