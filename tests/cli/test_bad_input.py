"""Logs that allow no result end with an error message and leave no files; logs with small faults give a result and a warning."""

import json

import numpy as np
import pytest

from .conftest import RATE, listing, save, table


def text(folder, name, content):
    (folder / name).write_text(content)


def with_rows(change):
    """Return a function that writes a log whose rows are changed by `change`."""

    def make(folder):
        save(folder / "bad.csv", change(table(3000)))

    return make


def constant(rows):
    rows[:, 1:] = [1.0, 2.0, 3.0, 0.0, 0.0, 9.8]
    return rows


def all_missing(rows):
    rows[:, 1] = np.nan
    return rows


REFUSED = {
    "empty file": (lambda folder: text(folder, "bad.csv", ""), "empty"),
    "header alone": (lambda folder: text(folder, "bad.csv", "time,gx,gy,gz\n"), ""),
    "one sample": (with_rows(lambda rows: rows[:1]), ""),
    "too short for the terms": (with_rows(lambda rows: rows[:20]), "too short"),
    "constant": (with_rows(constant), "equal"),
    "nothing but NaN in a channel": (with_rows(all_missing), "gyro_x"),
    "text": (lambda folder: text(folder, "bad.csv", "once upon a time\nthere was a log\n" * 20), ""),
    "columns that cannot be told": (
        lambda folder: save(folder / "bad.csv", np.random.default_rng(0).normal(size=(500, 4)), header="a,b,c,d"),
        "--columns",
    ),
    "stamps that stand still": (with_rows(lambda rows: np.column_stack([np.zeros(len(rows)), rows[:, 1:]])), ""),
    "not a bag": (lambda folder: (folder / "bad.csv").write_bytes(b"#ROSBAG V2.0\n" + bytes(range(256)) * 20), "damaged"),
    "cut-off bag": (lambda folder: (folder / "bad.csv").write_bytes(b"#ROSBAG V2.0\n"), "damaged"),
    "cut-off mcap": (lambda folder: (folder / "bad.csv").write_bytes(b"\x89MCAP0\r\n" + b"\x01\x02\x03"), ""),
    "cut-off npz": (lambda folder: (folder / "bad.csv").write_bytes(b"PK\x03\x04" + b"\x00" * 40), ""),
    "cut-off parquet": (lambda folder: (folder / "bad.csv").write_bytes(b"PAR1" + b"\x00" * 40), ""),
    "bytes": (lambda folder: (folder / "bad.csv").write_bytes(bytes(range(256)) * 40), ""),
    "empty folder": (lambda folder: (folder / "bad.csv").mkdir(), ""),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_with_a_sentence_and_nothing_written(call, folder, case):
    make, words = REFUSED[case]
    make(folder)
    found = call("noise", "bad.csv")
    assert found.status == 1, found.out + found.err
    assert found.reason.startswith("jaxcal: ")
    assert words in found.reason
    assert "Traceback" not in found.err
    assert 20 < len(found.reason) < 600
    assert max(map(len, found.err.splitlines())) <= 100
    assert listing(folder) == ["bad.csv"]


@pytest.mark.parametrize("command", ["noise", "allan"])
def test_a_rate_that_contradicts_the_stamps_is_refused(call, folder, log, command):
    found = call(command, "imu.csv", "--rate", "200", "--json", "a.json")
    assert found.status == 1
    assert "200" in found.reason
    assert "100" in found.reason
    assert listing(folder) == ["imu.csv"]


def gap(rows):
    return np.delete(rows, slice(1000, 1300), axis=0)


def few_nan(rows):
    rows[500:510, 1] = np.nan
    return rows


def few_inf(rows):
    rows[700, 4] = np.inf
    return rows


def jitter(rows):
    rows[:, 0] += np.random.default_rng(1).normal(size=len(rows)) * 0.05 / RATE
    return rows


def disordered(rows):
    rows[[100, 101]] = rows[[101, 100]]
    return rows


def duplicated(rows):
    return np.insert(rows, 200, rows[200], axis=0)


@pytest.mark.parametrize(
    ("spoil", "code"),
    [(gap, "gaps"), (few_nan, "gaps"), (few_inf, "infinite"), (jitter, "jitter"), (disordered, "unsorted"), (duplicated, "copies")],
    ids=lambda value: value.__name__ if callable(value) else "",
)
def test_mended_with_a_finding(call, folder, spoil, code):
    save(folder / "rough.csv", spoil(table(6000)))
    found = call("noise", "rough.csv", "--json", "a.json")
    assert found.status == 0, found.err
    document = json.loads((folder / "a.json").read_text())
    assert code in [one["code"] for one in document["log"]["findings"]]
    assert document["channels"]["gyro_y"]["coefficients"]["N"] == pytest.approx(1e-3, rel=0.1)


@pytest.mark.parametrize("argv", ["--out file", "--out file/deep", "--json file/a.json", "--report missing/a.html"])
def test_an_output_folder_that_cannot_be_written_is_found_before_the_work(call, folder, log, monkeypatch, argv):
    (folder / "file").write_text("")
    monkeypatch.setattr("jaxcal.read", lambda *a, **k: pytest.fail("the log must not be read yet"))
    found = call("noise", "imu.csv", *argv.split())
    assert found.status == 2
    assert "cannot" in found.reason
    assert listing(folder) == ["file", "imu.csv"]


def test_a_failure_of_the_last_file_takes_the_first_ones_with_it(call, folder, log, monkeypatch):
    def fail(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("jaxcal.export.write", fail)
    found = call("noise", "imu.csv", "--json", "a.json", "--export", "kalibr", "--out", "made")
    assert found.status == 2
    assert "no space left on device" in found.reason
    assert listing(folder) == ["imu.csv"]
