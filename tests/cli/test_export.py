"""`jaxcal export` and `jaxcal diff`."""

import hashlib
import json
import pathlib
import shutil

import numpy as np
import pytest
import yaml

from jaxcal import Calibration
from jaxcal.calibration import Imu

from ..made_fit import made_results

GOLDEN = pathlib.Path(__file__).parents[1] / "export"


@pytest.fixture
def device(folder):
    shutil.copy(GOLDEN / "golden.json", folder / "device.json")
    return "device.json"


DEFAULTS = {
    "kalibr": "imu.yaml", "openvins": "kalibr_imu_chain.yaml", "vins": "vins.yaml", "orbslam3": "orbslam3.yaml", "gtsam": "gtsam_imu.py",
    "px4": "px4.params", "ardupilot": "ardupilot.param", "ros": "calibration.yaml", "motioncal": "motioncal.bin", "c": "calibration.h",
    "csv": "calibration.csv", "fusion": "fusion.c", "magneto": "magneto.c",
}  # fmt: skip


@pytest.mark.parametrize("format", DEFAULTS)
def test_every_format_under_its_usual_name(call, folder, device, format):
    found = call("export", device, "--to", format)
    assert found.status == 0
    assert ("costs 0.002643 of the reading" in " ".join(found.out.split())) == (format in ("px4", "ardupilot"))
    assert {path.name for path in folder.iterdir()} == {DEFAULTS[format], device}
    assert DEFAULTS[format] in found.out.splitlines()[-1]
    assert (folder / DEFAULTS[format]).stat().st_size > 50


def test_calibrations_say_how_they_were_made(call, folder, log, monkeypatch):
    monkeypatch.setattr("jaxcal.noise.characterise", lambda *args, **options: made_results())
    assert call("noise", log, "--terms", "QNBK", "--units", "gyro=rad/s").status == 0
    found = Calibration.load(folder / "imu-noise" / "calibration.json").provenance
    assert found["sha256"] == hashlib.sha256(log.read_bytes()).hexdigest()
    assert found["command"] == "jaxcal noise"
    assert found["options"] == {"terms": "QNBK", "confidence": 0.95, "band": None, "method": "whittle", "conservative": False,
                                "calibration": None, "units": ["gyro=rad/s"]}  # fmt: skip
    assert found["rate"] == "estimated"
    assert set(found["versions"]) == {"python", "jax", "numpy", "scipy"}


def test_options_reach_the_writer(call, folder, device):
    words = ["--rate", 400, "--random-walk", "gyro=1e-5", "--axis", "rms", "--topic", "/a"]
    assert call("export", device, "--to", "kalibr", *words).status == 0
    noise = yaml.safe_load((folder / "imu.yaml").read_text())
    assert noise["update_rate"] == 400
    assert noise["gyroscope_random_walk"] == pytest.approx(1e-5)
    assert noise["gyroscope_noise_density"] == pytest.approx(np.sqrt(np.mean(np.array([1.6e-4, 1.7e-4, 1.8e-4]) ** 2)))
    assert "rostopic: /a" in (folder / "imu.yaml").read_text()
    assert call("export", device, "--to", "vins", "--convention", "per_sample", "--gravity", 9.81).status == 0
    assert "g_norm: 9.81" in (folder / "vins.yaml").read_text()
    assert call("export", device, "--to", "gtsam", "--frame", "down").status == 0
    assert "MakeSharedD" in (folder / "gtsam_imu.py").read_text()
    assert call("export", device, "--to", "c", "--prefix", "UNIT_").status == 0
    assert "UNIT_MAG_MATRIX" in (folder / "calibration.h").read_text()
    for name, bias, day in (("old", 0.1, 1), ("new", 0.2, 11)):
        Calibration(imu=accel(bias).imu, provenance={"date": f"2026-01-{day:02}"}).save(folder / f"{name}.json")
    assert call("export", "new.json", "--to", "c", "--double", "--earlier", "old.json").status == 0
    assert "static const double JAXCAL_ACCEL_BIAS_DAY[3] = {0.01, 0.0, 0.0};" in (folder / "calibration.h").read_text()
    assert call("export", "old.json", "--to", "c", "--earlier", "new.json").code == "dates"


def test_several_devices_and_ids(call, folder, device):
    golden = Calibration.load(folder / device)
    Calibration(imu={"accel": golden.imu.accel}).save(folder / "second.json")
    found = call("export", device, "second.json", "--to", "px4")
    assert found.status == 1
    assert found.code == "no_id"
    assert "--ids accel=ID" in found.reason
    assert call("export", device, "second.json", "--to", "px4", "--ids", "accel=7").status == 0
    text = (folder / "px4.params").read_text()
    assert "CAL_ACC0_ID\t7\t" in text
    assert "CAL_ACC1_ID\t7\t" in text
    assert "CAL_GYRO0_ID\t1310988\t" in text
    assert call("export", "second.json", "--to", "ardupilot", "--ids", "accel=7", "--instance", 2, "--gyro-bias").status == 0
    assert "INS_ACC3OFFS_X,0.12" in (folder / "ardupilot.param").read_text()


def test_a_weak_calibration_is_forced(call, folder, device):
    golden = Calibration.load(folder / device)
    Calibration(imu=Imu(golden.imu.accel, golden.imu.gyro, "weak", "few poses")).save(folder / "weak.json")
    found = call("export", "weak.json", "--to", "c")
    assert found.status == 1
    assert found.code == "doubtful"
    assert "(few poses); --force" in found.reason
    assert not (folder / "calibration.h").exists()
    assert call("export", "weak.json", "--to", "c", "--force").status == 0


NAMES = [f"matrix[{i},{j}]" for i in range(3) for j in range(3)] + [f"bias[{i}]" for i in range(3)]


def accel(bias):
    covariance = {"parameters": NAMES, "values": np.diag([1e-8] * 9 + [1e-4] * 3)}
    part = {"unit": "m/s^2", "matrix": np.eye(3), "bias": [bias, 0.0, 0.0], "covariance": covariance}
    return Calibration(imu={"accel": part})


def test_diff(call, folder):
    for name, bias in (("a", 0.1), ("b", 0.11), ("c", 0.5)):
        accel(bias).save(folder / f"{name}.json")
    found = call("diff", "a.json", "b.json", "--json", "d.json")
    assert found.status == 0
    assert found.out.startswith("no change beyond chance was found")
    row = next(line for line in found.out.splitlines() if line.startswith("bias[0]")).split()
    assert row == ["bias[0]", "m/s^2", "0.1", "0.11", "0.010", "±", "0.028"]
    document = json.loads((folder / "d.json").read_text())
    assert document["schema"] == "jaxcal.Difference/1"
    (part,) = document["parts"]
    assert part["chi_square"] == pytest.approx(0.5)
    assert part["degrees_of_freedom"] == 12
    found = call("diff", "a.json", "c.json", "--json", "e.json")
    assert found.out.startswith("changed: accel")
    (told,) = json.loads((folder / "e.json").read_text())["findings"]
    assert (told["code"], told["subject"]) == ("changed", ["accel"])
