"""`jaxcal budget`, `jaxcal sheet`, and the noise of a file under a motion."""

import json

import numpy as np
import pytest
import yaml

import jaxcal
from jaxcal.budget import Motion, increments, requirement

SHEET = "gyro: ARW 0.3 deg/sqrt(h), BI 2 deg/h; accel: VRW 0.1 m/s/sqrt(h), 60 ug"


@pytest.fixture
def sheet(call):
    assert call("sheet", SHEET, "--calibration", "sheet.json").status == 0
    return "sheet.json"


def test_a_data_sheet_becomes_a_file_for_a_filter(call, folder, sheet):
    told = call("sheet", SHEET, "--to", "kalibr", "--rate", 400)
    assert "gyro N = 8.727e-05 rad/sqrt(s)" in told.out
    noise = yaml.safe_load((folder / "imu.yaml").read_text())
    assert noise["update_rate"] == 400
    assert noise["gyroscope_noise_density"] == pytest.approx(np.deg2rad(0.3 / 60))
    # the flicker's Allan variance 0.441 B^2 is that of a random walk, K^2 T/3, at T = 100 s
    assert noise["gyroscope_random_walk"] == pytest.approx(np.deg2rad(2 / 3600) * (3 / 100) ** 0.5)
    assert jaxcal.Calibration.load(folder / sheet).noise.gyro.K is None
    wrong = call("sheet", "gyro: 3 apples")
    assert (wrong.status, wrong.code) == (2, "sheet")


def test_a_budget_of_a_calibration_and_of_a_log(call, folder, sheet, log):
    asked = ("--rest", 60, "--error", "accel.bias=0.02", "--require", "heading=1")
    told = call("budget", sheet, *asked, "--json", "b.json", "--report", "r.html")
    assert told.status == 0
    assert len(told.out.splitlines()) <= 40
    found, page = json.loads((folder / "b.json").read_text()), (folder / "r.html").read_text(encoding="utf-8")
    assert [one["code"] for one in found["findings"]] == ["exact"]
    direct = jaxcal.budget.propagate(jaxcal.Calibration.load(folder / sheet), Motion.rest(3600.0), rest=60.0, errors={"accel.bias": 0.02})
    factor = requirement(direct, after=3600.0, heading=np.deg2rad(1.0))["all"][0]
    assert f"all {factor:.3g}," in told.out
    values = {name: one["value"] for name, one in found["numbers"].items()}
    assert values == pytest.approx({name: one.value for name, one in direct.numbers.items()})
    assert page.count("<svg") == 4
    assert "--error" in page
    told = call("budget", log, "--motion", "hand", "--duration", 60, "--aid", 5)
    assert "velocity" not in told.out
    assert "No noise of the magnetometer" in told.out
    assert {path.name for path in (folder / "imu-budget").iterdir()} == {"budget.json", "report.html"}
    assert not (folder / "sheet-budget").exists()  # other files were named
    assert call("budget", sheet, "--require", "course=1").code == "require"
    assert call("budget", sheet, "--error", "gyro.scale").code == "error"
    assert call("budget", sheet, "--error", "gyro.colour=1").code == "no_error"
    assert call("budget", sheet, "--motion", "gone.csv").code == "motion"


def test_noise_for_a_motion(call, folder, sheet):
    motion = Motion.hand(20.0, seed=1)
    names = ",".join(f"{name}_{axis} [{unit}]" for name, unit in (("gyro", "rad/s"), ("accel", "m/s^2")) for axis in "xyz")
    rows = np.column_stack([motion.step * np.arange(len(motion.rate)), motion.rate, motion.force])
    np.savetxt(folder / "hand.csv", rows, delimiter=",", header=f"time [s],{names}", comments="")
    device, covariance = jaxcal.Calibration.load(folder / sheet), {"parameters": ("matrix[0,0]",), "values": np.array([[1e-6]])}
    gyro = {"unit": "rad/s", "matrix": np.eye(3), "bias": np.zeros(3), "g_sensitivity": np.zeros((3, 3)), "covariance": covariance}
    device = jaxcal.Calibration(noise=device.noise, imu={"gyro": gyro})
    device.save(folder / "device.json")
    words = ["--random-walk", "gyro=1e-6,accel=1e-5", "--window", 2]
    assert call("export", "device.json", "--to", "kalibr", "--for", "hand.csv", *words).status == 0
    times, text = increments(device, motion, windows=[2.0]).factor("gyro")[0], (folder / "imu.yaml").read_text()
    # the bias that is taken from a motion without a rest is a little wrong
    assert yaml.safe_load(text)["gyroscope_noise_density"] == pytest.approx(times * np.deg2rad(0.3 / 60), rel=0.1)
    assert "under the motion (tilt from gyro scale" in text
