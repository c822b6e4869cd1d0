"""With `each`, every IMU of a log with several has its own result."""

import json
from concurrent.futures import ThreadPoolExecutor

import h5py
import numpy as np
import polars as pl
import pytest

from jaxcal.batch import run

from ..io import flightlogs
from .conftest import counts, make_logs

STAMPS = 7_000_000 + 10_000 * np.arange(300)


def signals(number):
    rng = np.random.default_rng(number)
    return 1e-2 * number + 1e-3 * rng.standard_normal((300, 3)), [0.0, 0.0, 9.81] + 1e-2 * rng.standard_normal((300, 3))


@pytest.fixture
def logs(tmp_path):
    """Write an ArduPilot log with two IMUs, a ULog with three, HDF5 with two, and a log with one."""
    folder = tmp_path / "logs"
    make_logs(folder, 1)
    log = flightlogs.DataFlashWriter()
    log.describe(176, "IMU", "QBffffffIIfBBHH", flightlogs.IMU_LABELS)
    for number in (0, 1):
        log.write_all("IMU", flightlogs.imu_records(STAMPS, *signals(number + 1), number))
    (folder / "unit2.bin").write_bytes(log.content)
    (folder / "unit3.ulg").write_bytes(flightlogs.ulog_with_imu(STAMPS, *signals(3), instances=(0, 1, 2)).content)
    with h5py.File(folder / "unit4.h5", "w") as file:
        for name in ("left", "right"):
            gyro, accel = signals(5 if name == "left" else 6)
            file[f"{name}/t"], file[f"{name}/gyro"], file[f"{name}/accel"] = STAMPS * 1e-6, gyro, accel
    return folder


def test_each_imu_of_a_log_has_a_result_of_its_own(tasks, room, logs, tmp_path):
    moves = []
    with ThreadPoolExecutor(2) as pool:
        call = {"executor": pool, "out": tmp_path / "out", "each": True}
        fleet = run(logs, tasks.counted, progress=lambda *at: moves.append(at), **call)
        again = run(logs, tasks.counted, **call)
        alone = run(logs, tasks.counted, executor=pool, out=tmp_path / "alone")
    assert [(entry.name, entry.status) for entry in fleet] == [
        (name, "done")
        for name in (
            "unit1.npz", "unit2.bin", "unit2.bin IMU:1", "unit3.ulg", "unit3.ulg sensor_gyro:1,sensor_accel:1",
            "unit3.ulg sensor_gyro:2,sensor_accel:2", "unit4.h5", "unit4.h5 right",
        )
    ]  # fmt: skip
    means = [entry.coefficients["mean[0]"].value for entry in fleet]
    assert means[1:3] == pytest.approx([signals(1)[0][:, 0].mean(), signals(2)[0][:, 0].mean()], rel=1e-6)
    assert means[6:] == pytest.approx([signals(5)[0][:, 0].mean(), signals(6)[0][:, 0].mean()], rel=1e-6)
    assert (len(moves), moves[-1][:2]) == (8, (8, 8))
    assert all(entry.kept for entry in again)
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["count"] == {"logs": 8, "done": 8, "failed": 0, "left": 0}
    assert [row["topics"] for row in manifest["logs"]][1:3] == ["", "IMU:1"]
    assert pl.read_csv(tmp_path / "out" / "summary.csv")["topics"].to_list()[2] == "IMU:1"
    # without `each`, the first of several IMUs is read with a warning; a log in which none is the first is refused
    assert [entry.status for entry in alone] == ["done", "done", "done", "failed"]
    assert any("IMU:0 is read, the first of 2" in sentence for sentence in alone.done[1].warnings)
    assert "several groups hold sensors" in alone.failed[0].reason
    assert counts(room) == {"unit1.npz": 2, "unit2.bin": 3, "unit3.ulg": 4, "unit4.h5": 2}


def test_a_run_that_was_cut_off_between_two_imus_goes_on(tasks, room, logs, tmp_path, refuses):
    with ThreadPoolExecutor(1) as pool:
        call = {"executor": pool, "out": tmp_path / "out", "each": True}
        fleet = run(logs, tasks.counted, **call)
        lost = [fleet.entries[2], fleet.entries[5], fleet.entries[6]]  # IMUs: second of two, third of three, first of two
        for entry in lost:
            entry.file.unlink()
        again = run(logs, tasks.counted, **call)
    assert [entry.name for entry in again] == [entry.name for entry in fleet]
    assert [entry.kept for entry in again] == [True, True, False, True, True, False, False, False]
    with refuses("each"):
        run(logs, tasks.counted, each=True, reading={"topics": "IMU:1"})
