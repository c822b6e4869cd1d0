"""`jaxcal imu` and `jaxcal simulate imu`, end to end."""

import json
import re

import numpy as np
import pytest

import jaxcal
from jaxcal.imu import MEMS
from jaxcal.imu._simulate import NOISE

from .conftest import listing

# as many poses and samples as in tests/imu after padding, so that the tests share compiled programs
LOG = ("simulate", "imu", "--out", "log.csv", "--rate", "50", "--poses", "18", "--still", "3", "--turn", "2")


def test_a_simulated_log_is_calibrated(call, folder):
    assert call(*LOG).status == 0
    found = call("imu", "log.csv", "--gravity", "9.80665")
    assert (found.status, found.err) == (0, "")
    assert listing(folder / "log-imu") == ["calibration.json", "imu.json", "report.html"]
    assert len(found.out.splitlines()) <= 40
    for text in ("good: accelerometer scale to ", r"bias +m/s\^2 ", "bias +deg/s ", "g-sensitivity z +deg/s/g"):
        assert re.search(text, found.out)
    document = json.loads((folder / "log-imu" / "imu.json").read_text())
    assert (document["schema"], document["verdict"], len(document["residual_norm"])) == ("jaxcal.ImuFit/1", "good", 18)
    accel = document["accel"]
    assert accel["bias"] == pytest.approx(MEMS.accel.bias, abs=5e-3)
    assert accel["matrix"][0] == pytest.approx(MEMS.accel.matrix[0], abs=2e-3)
    scale = document["numbers"]["gyro.matrix[1,1]"]
    assert scale["low"] < document["gyro"]["matrix"][1][1] < scale["high"]
    page = (folder / "log-imu" / "report.html").read_text()
    for text in ('<h2 id="numbers">Numbers</h2>', 'data-number="gyro.g_sensitivity[2,2]"', "Calibration of log.csv", "<svg"):
        assert text in page
    stored = jaxcal.Calibration.load(folder / "log-imu" / "calibration.json")
    np.testing.assert_allclose(stored.imu.gyro.model.bias, document["gyro"]["bias"])
    np.testing.assert_allclose(stored.imu.gyro.model.g_sensitivity, MEMS.gyro.g_sensitivity, atol=1e-4)
    assert stored.imu.accel.estimate.names[0] == "matrix[0,0]"
    # the same with prior knowledge: the noise of the sensors, and the first calibration
    told = {
        sensor: {"unit": unit, **dict.fromkeys("QBKR"), "N": [NOISE[sensor]] * 3}
        for sensor, unit in (("gyro", "rad/s"), ("accel", "m/s^2"))
    }
    jaxcal.Calibration(noise={"rate": 100.0, **told}).save(folder / "known.json")
    known = ("--noise", "known.json", "--prior", "log-imu/calibration.json", "--name", "unit 7", "--calibration", "again.json")
    assert call("imu", "log.csv", "--gravity", "9.80665", *known, "--quiet").status == 0
    again = jaxcal.Calibration.load(folder / "again.json")
    assert (again.device, again.imu.verdict) == ({"name": "unit 7"}, "good")
    widths = [np.diff(one.imu.accel.estimate.intervals()[:9]) for one in (stored, again)]
    assert np.mean(widths[1]) < np.mean(widths[0])
    # and in counts of 16384 per g and 131 per deg/s, without giving the command their size
    table = np.genfromtxt(folder / "log.csv", delimiter=",", skip_header=1)
    axes = (folder / "log.csv").read_text().partition("\n")[0].split(",")
    size = np.array([1 / 16384 * 9.80665 if "accel" in name else np.deg2rad(1 / 131) for name in axes[1:]])
    counts = np.column_stack([table[:, 0], np.round(table[:, 1:] / size)])
    header = ",".join([axes[0], *(name.partition(" ")[0] for name in axes[1:])])
    np.savetxt(folder / "counts.csv", counts, delimiter=",", header=header, comments="", fmt=["%.9f"] + ["%d"] * 6)
    found = call("imu", "counts.csv", "--gravity", "9.80665", "--counts", "--json", "counts.json", "--out", "counts")
    assert (found.status, found.err) == (0, "")
    assert "counts per rad/s" in found.out
    matrix = json.loads((folder / "counts.json").read_text())["accel"]["matrix"]
    assert np.array(matrix) * 9.80665 / 16384 == pytest.approx(np.array(accel["matrix"]), abs=1e-4)


@pytest.mark.parametrize(
    ("words", "status", "reason"),
    [("--convention sideways", 2, ""), ("--method magic", 2, ""), ("--units accel=mg", 1, "unsuited"), ("--stop 40", 1, "refused")],
)
def test_what_cannot_be_done_is_said(call, folder, words, status, reason):
    call(*LOG)
    found = call("imu", "log.csv", *words.split())
    assert found.status == status
    assert reason == found.code or reason in found.reason
    assert listing(folder) == ["log.csv"]


def test_a_session_with_labelled_regions(call, folder):
    rng = np.random.default_rng(0)
    regions, rows = {}, []
    for j, axis in enumerate("xyz"):
        for kind, sign in (("p", 1), ("a", -1), ("rot", 0)):
            regions[f"{axis}_{kind}"] = {"start": 300 * len(rows), "end": 300 * len(rows) + 300}
            force = 9.81 * (sign or 1) * np.eye(3)[j] + 0.01 * rng.normal(size=(300, 3))
            rows.append(np.concatenate([force, (sign == 0) * 2 * np.pi / 3 * np.eye(3)[j] + 1e-3 * rng.normal(size=(300, 3))], axis=1))
    header = "acc_x [m/s^2],acc_y [m/s^2],acc_z [m/s^2],gyr_x [rad/s],gyr_y [rad/s],gyr_z [rad/s]"
    np.savetxt(folder / "box.csv", np.concatenate(rows), delimiter=",", header=header, comments="")
    (folder / "regions.json").write_text(json.dumps(regions))
    found = call("imu", "box.csv", "--rate", "100", "--gravity", "9.81", "--regions", "regions.json", "--json", "box.json")
    assert found.status == 0
    document = json.loads((folder / "box.json").read_text())
    assert (document["verdict"], document["method"], len(document["residual_turn"])) == ("good", "ferraris", 3)
    assert np.diag(document["gyro"]["matrix"]) == pytest.approx(np.ones(3), abs=2e-3)
    refused = call("imu", "box.csv", "--rate", "100", "--gravity", "9.81", "--regions", "regions.json", "--terms", "auto")
    assert (refused.status, "take none of --convention" in refused.reason) == (2, True)
