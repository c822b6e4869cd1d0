"""A folder in place of a log: its only log is read, or the parts of a split recording are joined."""

import shutil

import numpy as np
import pytest

from jaxcal import read

HEADER = "time,gyro_x,gyro_y,gyro_z\n"
START = 1_700_000_000_000_000_000


def rows(still):
    return HEADER + "".join(",".join(f"{v:.6g}" for v in row) + "\n" for row in np.column_stack([still.time, still.gyro]))


def test_the_only_log_of_a_folder(still, tmp_path):
    (tmp_path / "log.csv").write_text(rows(still))
    (tmp_path / "README.md").write_text("# what was done\n")
    (tmp_path / ".hidden.csv").write_text(rows(still))
    (tmp_path / "more").mkdir()
    log = read(tmp_path, quiet=True)
    assert len(log.time) == 400
    assert log.provenance["format"] == "csv"


def test_several_logs_are_listed(still, tmp_path, refuses):
    for name in ("b.csv", "a.csv"):
        (tmp_path / name).write_text(rows(still))
    np.savez(tmp_path / "c.npz", time=still.time, gyro=still.gyro)
    with refuses("several_logs"):
        read(tmp_path, quiet=True)


@pytest.mark.parametrize("storage", ["ros1", "sqlite3", "mcap"])
def test_parts_of_a_recording_are_joined_in_order(storage, make, write_bag, tmp_path, finding, refuses):
    still = make(n=1200)
    values = np.column_stack([still.gyro, still.accel])
    stamps = START + np.arange(1200) * 10_000_000
    folder = tmp_path / "parts"
    folder.mkdir()
    suffix = {"ros1": ".bag", "sqlite3": ".db3", "mcap": ".mcap"}[storage]
    for k in range(3):
        part = slice(400 * k, 400 * k + 400)
        written = write_bag(storage, {"/imu": ("Imu", stamps[part], values[part])}, name=f"w{k}")
        source = written if storage == "ros1" else written / f"w{k}{suffix}"
        shutil.copy(source, folder / f"day_{k}{suffix}")
    log = read(folder, quiet=True)
    np.testing.assert_array_equal(log.gyro, still.gyro)
    assert log.gaps == ()
    assert log.provenance["size"] == sum(file.stat().st_size for file in folder.iterdir())
    assert finding(log, "joined").facts["count"] == 3
    (folder / f"day_1{suffix}").unlink()
    with refuses("part_missing"):
        read(folder, quiet=True)


def test_sensors_in_files_of_their_own_keep_their_times(tmp_path):
    rng = np.random.default_rng(3)
    for name, rate, late, size in (("Gyroscope", 100.0, 0.0, 1.0), ("MagnetometerUncalibrated", 30.0, 0.004, 40.0)):
        at = late + np.arange(10 * rate) / rate
        table = np.column_stack([at, size * rng.normal(size=(len(at), 3))])
        lines = [f"{START + round(row[0] * 1e9)}," + ",".join(f"{v:.6f}" for v in row) for row in table]
        (tmp_path / f"{name}.csv").write_text("time,seconds_elapsed,z,y,x\n" + "\n".join(lines))
    log = read(tmp_path, quiet=True)
    at = (log.time + log.offset["mag"])[np.isfinite(log.mag[:, 0])]
    np.testing.assert_allclose(at, 0.004 + np.arange(len(at)) / 30, atol=1e-6)
    assert list(log.offset) == ["mag"]


def test_a_topic_with_a_single_message_is_left_out(still, write_bag, finding):
    stamps = START + np.arange(400) * 10_000_000
    topics = {
        "/imu": ("Imu", stamps, np.column_stack([still.gyro, still.accel])),
        "/mag": ("MagneticField", stamps[100:101], still.mag[100:101]),
    }
    log = read(write_bag("ros1", topics), quiet=True)
    assert log.mag is None
    assert finding(log, "left_out").subject == ("/mag",)
