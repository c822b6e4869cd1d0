"""Converted logs are read back unchanged."""

import json

import numpy as np
import pytest

import jaxcal
from jaxcal import read

from .flightlogs import dataflash_with_imu, ulog_with_imu

STAMPS = 5_000_000 + np.arange(400) * 10_000


def same(a, b):
    for name in ("time", "gyro", "accel", "mag", "temperature"):
        one, other = getattr(a, name), getattr(b, name)
        assert (one is None) == (other is None)
        if one is not None:
            np.testing.assert_array_equal(one, other)
            assert one.shape == other.shape
    assert a.offset.keys() == b.offset.keys()
    for name, values in a.offset.items():
        np.testing.assert_array_equal(values, b.offset[name])
    assert (a.rate, a.gaps, a.findings) == (b.rate, b.gaps, b.findings)
    assert b.provenance | {"converted": 0} == a.provenance | {"converted": 0}


@pytest.mark.parametrize("suffix", [".npz", ".parquet"])
@pytest.mark.parametrize("kind", ["csv", "npy", "bag", "mcap", "ulog", "dataflash"])
def test_every_log_is_read_back_equal(suffix, kind, still, write_bag, tmp_path):
    path, options = tmp_path / f"log.{kind}", {}
    if kind == "csv":
        # a gap, a missing value, an infinite value, an omitted axis, and units and rate that `read` would otherwise have to guess
        rows = [f"{t:.3f},{w[0] * 3000:.6f},{w[1]:.6f},{25 + k % 7}" for k, (t, w) in enumerate(zip(still.time, still.gyro, strict=True))]
        rows[10] = rows[10].replace("25", "nan").replace("26", "nan").replace("27", "nan").replace("28", "nan")
        rows[20] = ",".join(["0.200", "inf", "0", "25"])
        path.write_text("t,gx,gy,temp\n" + "\n".join(rows[:100] + rows[130:]))
        options = {"units": {"gyro": "rad/s"}}
    elif kind == "npy":
        np.save(path, np.column_stack([still.gyro, still.accel]))
        options = {"rate": 123.456}
    elif kind == "ulog":
        path.write_bytes(ulog_with_imu(STAMPS, still.gyro, still.accel, still.mag[:, ::-1] * 1e4).content)
    elif kind == "dataflash":
        path.write_bytes(dataflash_with_imu(STAMPS, still.gyro, still.accel).content)
    else:
        stamps = 1_700_000_000_123_456_789 + np.arange(400) * 10_000_000
        topics = {
            "/imu": ("Imu", stamps, np.column_stack([still.gyro, still.accel])),
            "/mag": ("MagneticField", stamps[::10], still.mag[::10]),
        }
        path = write_bag("ros1" if kind == "bag" else "mcap", topics)
    out = tmp_path / f"out{suffix}"
    log = jaxcal.io.convert(path, out, quiet=True, **options)
    same(log, read(path, quiet=True, **options))
    again = read(out, quiet=True)
    same(log, again)
    assert again.provenance["converted"]["file"] == out.name
    assert sorted(file.name for file in tmp_path.iterdir() if file.name.startswith(".")) == []
    # convert again, and convert a part
    same(again, jaxcal.io.convert(out, tmp_path / f"second{suffix}", quiet=True))


@pytest.mark.parametrize("suffix", [".npz", ".parquet"])
def test_options_go_before_what_was_saved(suffix, still, tmp_path):
    np.savez(tmp_path / "log.npz", time=still.time, gyro=still.gyro)
    jaxcal.io.convert(tmp_path / "log.npz", tmp_path / f"out{suffix}", quiet=True)
    log = read(tmp_path / f"out{suffix}", units={"gyro": "deg/s"}, quiet=True)
    np.testing.assert_allclose(log.gyro, np.radians(still.gyro), rtol=1e-14)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"schema": 2}, "written by a later version of jaxcal"),
        ({"rate": -1.0}, "its description is damaged: convert the log again"),
        ({"rate": "fast"}, "its description is damaged"),
        ({"notes": [1]}, "its description is damaged"),
        ({"provenance": {"epoch_ns": "0"}}, "its description is damaged"),
        (None, "its description is damaged"),
    ],
)
def test_a_damaged_description_is_refused(change, said, still, tmp_path, refuses):
    about = {"schema": 1, "rate": 100.0, "notes": [], "warnings": [], "provenance": {"epoch_ns": 0}}
    text = "{" if change is None else json.dumps(about | change)
    np.savez(tmp_path / "log.npz", time=still.time, gyro=still.gyro, jaxcal=np.array(text))
    with refuses("damaged"):
        read(tmp_path / "log.npz", quiet=True)


def test_the_command(still, tmp_path, capsys, monkeypatch):
    pytest.importorskip("cyclopts")
    from jaxcal.cli import main

    monkeypatch.chdir(tmp_path)
    np.savez("log.npz", time=still.time, gyro=still.gyro)
    assert main(["convert", "log.npz", "out.parquet", "--stop", "2"]) == 0
    assert "wrote out.parquet" in capsys.readouterr().out
    same(read("log.npz", quiet=True).select(None, 2.0), read("out.parquet", quiet=True))
    assert main(["convert", "log.npz", "out.csv"]) == 2
    assert main(["convert", "log.npz", "log.npz"]) == 2
    assert main(["convert", "missing.npz", "out.npz"]) == 2
