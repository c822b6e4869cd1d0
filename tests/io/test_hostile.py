"""Malicious files: they would need too much memory, or their contents are not of the type that the name states."""

import gzip
import json
import os
import pathlib
import zipfile

import numpy as np
import pytest

import jaxcal
from jaxcal import read

HEADER = "time_s,gx_dps,gy_dps,gz_dps\n"


def rows(n, digits=4):
    noise = np.random.default_rng(0)
    return "".join(f"{i / 100:.2f},{x:.{digits}f},{y:.{digits}f},{z:.{digits}f}\n" for i, (x, y, z) in enumerate(noise.normal(size=(n, 3))))


@pytest.mark.parametrize("mark", [",", ";", "\t", " "])
@pytest.mark.parametrize("above", ["", HEADER])
def test_a_line_of_many_thousand_fields_is_no_log(mark, above, tmp_path, refuses):
    (tmp_path / "log.csv").write_text(above + (f"1.0{mark}" * 200_000)[:-1] + "\n")
    with refuses("too_wide"):
        read(tmp_path / "log.csv", quiet=True)


def test_bombs_are_not_unpacked(tmp_path, refuses):
    with gzip.open(tmp_path / "log.csv.gz", "wb") as file:
        file.write(HEADER.encode())
        for _ in range(160):
            file.write(b"0,0,0,0\n" * 131_072)
    np.savez_compressed(tmp_path / "log.npz", gyro=np.zeros((4_000_000, 3)), rate=100.0)
    with zipfile.ZipFile(tmp_path / "log.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("log.csv", b"0,0,0,0\n" * 20_000_000)
    for name in ("log.csv.gz", "log.npz", "log.zip"):
        with refuses("too_large"):
            read(tmp_path / name, quiet=True)


@pytest.mark.parametrize(("end", "kept"), [("0.12", False), ("0.1234", True), ("0", False), ("-", False), ("0.123", False), ('"', False)])
def test_a_last_number_that_may_be_cut_off_is_no_number(end, kept, tmp_path, capfd):
    text = HEADER + rows(100)
    text = text[: text.rindex(",") + 1] + end
    (tmp_path / "log.csv").write_text(text)
    log = read(tmp_path / "log.csv", quiet=True)
    assert (len(log.time) == 100 and np.isfinite(log.gyro[-1]).all()) == kept
    if not kept and end not in '-"':
        assert "last_row" in log.codes
    assert capfd.readouterr().err == ""  # a library that breaks down says so by itself


@pytest.mark.parametrize("end", ["371", "58"])
def test_a_last_whole_number_that_is_short_is_left_out(end, tmp_path):
    body = "".join(f"{10 * i},{100 + i % 7},{200 + i % 5},{500 + i % 11}\n" for i in range(60))
    (tmp_path / "log.csv").write_text("ms,gx [deg/s],gy [deg/s],gz [deg/s]\n" + body + f"600,101,201,{end}")
    assert len(read(tmp_path / "log.csv", quiet=True).time) == (61 if end == "371" else 60)


@pytest.mark.parametrize(
    ("name", "text", "code"),
    [
        ("log.csv", HEADER + 2 * rows(120), "several_recordings"),
        ("log.mcap", "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 990\n", "lfs"),
    ],
)
def test_recordings_one_below_the_other_and_pointers_are_no_log(name, text, code, tmp_path, refuses):
    (tmp_path / name).write_text(text)
    with refuses(code):
        read(tmp_path / name, quiet=True)


def test_a_signalling_nan_among_the_stamps_hides_no_second_recording(still, tmp_path, refuses):
    table = np.tile(np.column_stack([still.time, still.gyro]), (2, 1))
    table[5].view(np.uint64)[0] = 0x7FF0000000000001
    np.save(tmp_path / "log.npy", table)
    with refuses("several_recordings"):
        read(tmp_path / "log.npy", quiet=True)


def test_a_zip_file_of_one_log_and_of_one_sensor_in_each_file(still, tmp_path):
    def text(names, values):
        table = "".join(f"{t:.3f}," + ",".join(f"{v:.9g}" for v in row) + "\n" for t, row in zip(still.time, values, strict=True))
        return f"seconds_elapsed,{names}\n{table}"

    with zipfile.ZipFile(tmp_path / "one.zip", "w") as archive:
        archive.writestr("deep/log.csv", text("gx [rad/s],gy [rad/s],gz [rad/s]", still.gyro))
        archive.writestr("__MACOSX/._log.csv", "junk")
    one = read(tmp_path / "one.zip", quiet=True)
    np.testing.assert_allclose(one.gyro, still.gyro, rtol=1e-8)
    assert (one.provenance["file"], one.provenance["inside"]) == ("one.zip", "log.csv")
    with zipfile.ZipFile(tmp_path / "app.zip", "w") as archive:
        archive.writestr("Gyroscope.csv", text("x [rad/s],y [rad/s],z [rad/s]", still.gyro))
        archive.writestr("Accelerometer.csv", text("x [m/s^2],y [m/s^2],z [m/s^2]", still.accel))
        archive.writestr("Orientation.csv", text("roll,pitch,yaw", still.gyro))
    both = read(tmp_path / "app.zip", quiet=True)
    np.testing.assert_allclose(both.gyro, still.gyro, rtol=1e-8)
    np.testing.assert_allclose(both.accel, still.accel, rtol=1e-8)
    assert both.provenance["columns"]["accel"] == ["Accelerometer.csv", 1, 2, 3]


def test_a_name_that_is_no_text_costs_no_log(tmp_path):
    from concurrent.futures import ThreadPoolExecutor

    (tmp_path / "logs").mkdir()
    names = [b"good.csv", b"caf\xe9.csv", b"line\nfeed.csv", b"bad\xff.csv"]
    try:
        for name in names:
            pathlib.Path(os.fsdecode(os.fsencode(tmp_path / "logs") + b"/" + name)).write_text(
                HEADER + rows(400) if b"bad" not in name else "no log"
            )
    except OSError:
        pytest.skip("the file system takes no such names")
    with ThreadPoolExecutor(1) as pool:
        fleet = jaxcal.batch.run(tmp_path / "logs", "allan", executor=pool, out=tmp_path / "out", options={"m": "octave"})
    assert sorted(entry.status for entry in fleet) == ["done", "done", "done", "failed"]
    assert fleet.failed[0].reason.startswith("bad\\xff.csv: there are no rows of numbers")
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["count"] == {"logs": 4, "done": 3, "failed": 1, "left": 0}


@pytest.mark.skipif(os.name != "posix", reason="files are not limited in size here")
@pytest.mark.parametrize("suffix", [".npz", ".parquet"])
def test_a_full_disk_is_a_sentence_and_leaves_nothing(suffix, still, tmp_path, refuses):
    import resource

    np.savez(tmp_path / "log.npz", time=still.time, gyro=np.random.default_rng(0).normal(size=(400, 3)), units="SI")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limits[1]))
        with refuses("not_written"):
            jaxcal.io.convert(tmp_path / "log.npz", tmp_path / f"out{suffix}", quiet=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [path.name for path in tmp_path.iterdir()] == ["log.npz"]
