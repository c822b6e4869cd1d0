"""`read` prints and records its choices; a recording of a real sensor is read correctly."""

import hashlib

import numpy as np
import pytest

import jaxcal
from jaxcal import read


@pytest.fixture
def path(still, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,gx,gy,gz\n" + "".join(",".join(f"{v:.6g}" for v in row) + "\n" for row in np.column_stack([still.time, still.gyro])))
    return path


def test_notes_and_warnings_go_to_stderr(path, capsys):
    path.write_text(path.read_text() + "4.00,1\n")
    log = read(path)
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == [f"{'warning' if one.severity else 'note'}: {one}" for one in log.findings]
    assert {one.severity for one in log.findings} == {0, 1}
    read(path, quiet=True)
    assert capsys.readouterr() == ("", "")


def test_provenance_says_where_the_data_come_from(path):
    assert read(path, quiet=True).provenance == {
        "file": "log.csv",
        "size": path.stat().st_size,
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "format": "csv",
        "columns": {"time": [0], "gyro": [1, 2, 3]},
        "units": {"time": "s", "gyro": "rad/s"},
        "jaxcal": jaxcal.__version__,
        "epoch_ns": 0,
    }


def test_a_folder_has_one_fingerprint(still, write_bag):
    stamps = (np.arange(400) + 1) * 10_000_000
    topics = {"/imu": ("Imu", stamps, np.column_stack([still.gyro, still.accel]))}
    first, second = (write_bag("sqlite3", topics, name=name) for name in "ab")
    found = read(first, quiet=True).provenance
    assert found["size"] == sum(file.stat().st_size for file in first.iterdir())
    assert found["sha256"] == read(first, quiet=True).provenance["sha256"] != read(second, quiet=True).provenance["sha256"]


def test_the_path_may_be_a_string_and_the_format_forced(path):
    assert read(str(path), format="csv", quiet=True).provenance["format"] == "csv"


def test_the_static_recording_of_an_adis16405(reference):
    folder = reference / "data" / "adis16405"
    log = read(folder / "imu1.csv.gz", quiet=True)
    counts = np.load(folder / "imu1.npz", allow_pickle=False)["counts"]
    assert (log.rate, log.duration, log.gaps, log.warnings) == (100.0, 10_000.0, (), ())
    # the scale is from the data sheet of the sensor
    np.testing.assert_allclose(log.gyro, counts[:, :3] * np.radians(0.05), rtol=1e-12)
    np.testing.assert_allclose(log.accel, counts[:, 3:] * 3.33e-3 * 9.80665, rtol=1e-12)
    steps = {one.subject[0]: one.facts["step"].value for one in log.findings if one.code == "steps"}
    assert steps == {"gyro_x": 0.0008727, "accel_x": 0.03266}
