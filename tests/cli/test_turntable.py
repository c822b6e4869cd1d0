"""`jaxcal rate-table`, the six-position test, and a calibration found by its device, end to end."""

import json

import numpy as np
import pytest

import jaxcal

DEGREE = np.pi / 180
HEADER = "acc_x [m/s^2],acc_y [m/s^2],acc_z [m/s^2],gyr_x [rad/s],gyr_y [rad/s],gyr_z [rad/s]"


def save(path, accel, gyro):
    np.savetxt(path, np.concatenate([accel, gyro], axis=1), delimiter=",", fmt="%.7g", header=HEADER, comments="")


def test_a_rate_table(call, folder):
    rng = np.random.default_rng(0)
    rates = [axis * rate for axis in np.eye(3) for rate in np.array([0, 50, 100, 50, 0, -50, -100, -50]) * DEGREE]
    w = np.concatenate([np.tile(rate, (400, 1)) for rate in rates])
    accel = np.tile([0, 0, 9.81], (len(w), 1)) + 0.01 * rng.normal(size=w.shape)
    save(folder / "sweep.csv", accel, 1.01 * w + 1e-3 * rng.normal(size=w.shape))
    found = call("rate-table", "sweep.csv", "--rate", "100", "--rates", "50,100", "--name", "unit 7")
    assert (found.status, found.err) == (0, "")
    assert len(found.out.splitlines()) <= 40
    for text in ("good: scale to ", "scale factor ", "nonlinearity ", "ppm", "deg/s "):
        assert text in found.out
    stored = jaxcal.Calibration.load(folder / "sweep-rate-table" / "calibration.json")
    assert stored.imu.gyro.model.matrix.diagonal() == pytest.approx(1.01 * np.ones(3), abs=1e-3)
    assert json.loads((folder / "sweep-rate-table" / "rate_table.json").read_text())["schema"] == "jaxcal.RateTest/1"
    # the calibration is found by the name of the device and the date of the log file
    assert call("apply", ".", "sweep.csv", "--rate", "100", "--name", "unit 7", "--out", "corrected.csv").status == 0
    assert call("apply", ".", "sweep.csv", "--rate", "100", "--out", "c.csv").status == 2
    for words, status, reason in (
        ((), 2, "--rates"),
        (("--rates", "fast"), 2, "expected numbers with commas"),
        (("--rates", "3000"), 1, "none of the rates"),
    ):
        refused = call("rate-table", "sweep.csv", "--rate", "100", *words)
        assert (refused.status, reason in refused.reason) == (status, True)


def test_a_block_on_its_faces(call, folder):
    rng = np.random.default_rng(0)
    up = np.concatenate([sign * np.eye(3)[[axis]] for axis in range(3) for sign in (1, -1)])
    force = np.concatenate([np.concatenate([np.tile(u, (300, 1)), u + rng.normal(size=(50, 3))]) for u in up])
    accel = 9.81 * 1.02 * force + 0.01 * rng.normal(size=force.shape)
    save(folder / "block.csv", accel, 1e-3 * rng.normal(size=force.shape) + 0.2 * rng.normal(size=force.shape) * (np.abs(force) > 1.2))
    found = call("imu", "block.csv", "--rate", "100", "--gravity", "9.81", "--method", "six_position", "--json", "block.json")
    assert (found.status, found.err) == (0, "")
    document = json.loads((folder / "block.json").read_text())
    assert (document["method"], document["verdict"]) == ("six_position", "good")
    assert np.diag(document["accel"]["matrix"]) == pytest.approx(1.02 * np.ones(3), abs=2e-3)
    # one log for each face in a folder, in any order, and a table of their means
    (folder / "faces").mkdir()
    header = "acc_x [m/s^2],acc_y [m/s^2],acc_z [m/s^2]"
    for k in range(6):
        np.savetxt(folder / "faces" / f"{6 - k}.csv", accel[350 * k : 350 * k + 300], delimiter=",", header=header, comments="")
    np.savetxt(
        folder / "means.csv", [accel[350 * k : 350 * k + 300].mean(axis=0) for k in range(6)], delimiter=",", header=header, comments=""
    )
    for words in (("faces", "--rate", "100"), ("means.csv",)):
        found = call("imu", *words, "--gravity", "9.81", "--method", "six_position", "--json", f"{words[0]}.json")
        assert found.status == 0
        stored = json.loads((folder / f"{words[0]}.json").read_text())
        assert np.diag(stored["accel"]["matrix"]) == pytest.approx(np.diag(document["accel"]["matrix"]), abs=2e-4)
