"""For every unreadable file, `read` raises an error that names the file and a remedy."""

import gzip
import os
import sys

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings, strategies as st

from jaxcal import DataError, JaxcalError, read

HEADER = "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n"


def body(still):
    values = np.column_stack([still.time, still.gyro, still.accel])
    return "".join(",".join(f"{v:.9g}" for v in row) + "\n" for row in values)


@pytest.fixture
def fails(tmp_path):
    """``fails(content, name)`` -> the message of the error."""

    def run(content, name="log.csv", **options):
        path = tmp_path / name
        if content is not None:
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
        with pytest.raises(DataError) as caught:
            read(path, quiet=True, **options)
        message = str(caught.value)
        assert message.startswith(name), message
        assert "\n" not in message
        return message

    return run


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "there is no such file; check the path"),
        *((content, "the file is empty") for content in (b"", b"\n\n", gzip.compress(b"", mtime=0), b"\xef\xbb\xbf")),
        (HEADER, f"there are no rows of numbers; the first line is '{HEADER.strip()}'"),
    ],
)
def test_a_file_without_rows(content, said, fails):
    assert fails(content) == f"log.csv: {said}"


def test_no_time_and_no_rate(still, fails):
    message = fails("\n".join(line.split(",", 1)[1] for line in (HEADER + body(still)).splitlines()))
    assert "there is no time column among 0 (gyro_x), 1 (gyro_y)" in message
    assert "give rate=HZ, or name the column with columns={'time': ...}" in message


def test_a_folder_without_a_recording(tmp_path, fails):
    (tmp_path / "folder").mkdir()
    assert "no readable log and no ROS 2 recording (metadata.yaml)" in fails(None, "folder")
    for name in ("a.mcap", "b.mcap"):
        (tmp_path / "folder" / name).write_bytes(b"\x89MCAP0\r\n")
    assert "2 parts of a recording but no metadata.yaml; run `ros2 bag reindex`" in fails(None, "folder")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_without_permission(tmp_path, fails):
    (tmp_path / "log.csv").write_text(HEADER)
    (tmp_path / "log.csv").chmod(0)
    assert "no permission to read it" in fails(None)


@pytest.mark.parametrize("share", [0.02, 0.5, 0.99, None])
def test_a_gzip_file_cut_off_or_damaged(share, make, fails):
    content = bytearray(gzip.compress((HEADER + body(make(n=8000))).encode(), 1))
    if share is None:
        content[len(content) // 2] ^= 0x5A
    message = fails(bytes(content[: int((share or 1.0) * len(content))]), "log.csv.gz")
    assert "the gzip file is damaged or cut off" in message
    assert "copy it again" in message


def test_damage_inside_zipped_arrays(still, tmp_path, fails):
    np.savez_compressed(tmp_path / "log.npz", time=still.time, gyro=still.gyro)
    content = bytearray((tmp_path / "log.npz").read_bytes())
    content[len(content) // 2] ^= 0x5A
    assert "it cannot be read as NumPy arrays (" in fails(bytes(content), "log.npz")


@pytest.mark.parametrize("share", [0.001, 0.3, 0.99])
@pytest.mark.parametrize("kind", ["npz", "npy", "parquet"])
def test_files_cut_off(kind, share, still, tmp_path, fails):
    path = tmp_path / f"log.{kind}"
    if kind == "npz":
        np.savez(path, time=still.time, gyro=still.gyro)
    elif kind == "npy":
        np.save(path, np.column_stack([still.time, still.gyro, still.accel]))
    else:
        pl.DataFrame({"time": still.time, "gx": still.gyro[:, 0]}).write_parquet(path)
    content = path.read_bytes()
    assert "damaged" in fails(content[: max(12, int(share * len(content)))], path.name)


@pytest.mark.parametrize(
    "start",
    [
        b"\x93NUMPY", b"\x93NUMPY\x01\x00\x76\x00", b"PK\x03\x04", b"PAR1", b"#ROSBAG V2.0\n", b"SQLite format 3\0", b"\x89MCAP0\r\n",
        b"\x1f\x8b\x08", b"\x89HDF\r\n\x1a\n", b"MATLAB 5.0".ljust(126) + b"IM", b"ULog\x01\x12\x35\x01", b"\xa3\x95\x80",
    ],
)  # fmt: skip
@given(rest=st.binary(max_size=300))
@settings(max_examples=25, deadline=None)
def test_rubbish_behind_every_beginning(start, rest, tmp_path_factory):
    suffix = {b"SQLite format 3\0": ".db3", b"\x89MCAP0\r\n": ".mcap"}.get(start, ".csv")
    path = tmp_path_factory.mktemp("rubbish") / f"log{suffix}"
    path.write_bytes(start + rest)
    with pytest.raises(JaxcalError, match=r"^log\."):
        read(path, quiet=True)


@given(text=st.text(alphabet='0123456789.,;\t -+eE#\n"naif', max_size=300))
@settings(max_examples=150, deadline=None)
def test_any_text_is_a_log_or_a_sentence(text, tmp_path_factory):
    path = tmp_path_factory.mktemp("text") / "log.csv"
    path.write_bytes(text.encode())
    try:
        log = read(path, rate=10.0, quiet=True)
    except JaxcalError as error:
        assert str(error).startswith("log.csv: ")  # noqa: PT017
        assert "Error:" not in str(error), error  # noqa: PT017
    else:
        assert len(log.time) >= 2


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"\x89HDF\r\n\x1a\n" + b"\0" * 50, "it cannot be read (OSError: "),
        (b"MATLAB 5.0 MAT-file".ljust(126) + b"IM\x0e\0\0\0\xff\xff\0\0", "it cannot be read (ValueError: "),
        (b"ULog\x01\x12\x35\x01" + b"\0" * 50, "no sensor topic (sensor_gyro, sensor_accel, "),
        (b"\xa3\x95\x80\x80" + b"\0" * 50, "the log describes no records (no FMT); it is damaged"),
    ],
)
def test_beginnings_without_a_log_behind_them(content, said, fails):
    assert said in fails(content)


def test_options_of_the_other_kind(still, fails):
    message = fails(HEADER + body(still), topics="/imu")
    assert message == "log.csv: this is a text table, and topics= belongs to recordings of messages; choose with columns="
    assert "format=: 'xml' is unknown; use one of csv, npy" in fails(HEADER, format="xml")


def test_columns_do_not_choose_in_ros_recordings(still, write_bag, refuses):
    stamps = (np.arange(400) + 1) * 10_000_000
    path = write_bag("ros1", {"/imu": ("Imu", stamps, np.column_stack([still.gyro, still.accel]))})
    with refuses("columns"):
        read(path, columns="gyro=1:3", quiet=True)


@pytest.mark.parametrize(("module", "content", "name", "extra"), [
    ("polars", HEADER.encode(), "log.csv", "csv"), ("polars", b"PAR1" + b"\0" * 20, "log.parquet", "parquet"),
    ("rosbags", b"#ROSBAG V2.0\n", "log.bag", "ros"), ("h5py", b"\x89HDF\r\n\x1a\n", "log.h5", "hdf5"),
])  # fmt: skip
def test_a_reader_that_is_not_installed_is_named(module, content, name, extra, fails, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    assert f'pip install "jaxcal[{extra}]"' in fails(content, name)


def test_panics_and_lack_of_memory_are_sentences(still, fails, monkeypatch):
    polars = pytest.importorskip("polars")
    PanicException = type("PanicException", (BaseException,), {})
    panic = PanicException("called unwrap on None")
    for error, said in ((panic, "PanicException: called unwrap"), (MemoryError(), "more memory than there is")):

        def reader(*_, error=error, **__):
            raise error

        monkeypatch.setattr(polars, "read_csv", reader)
        assert said in fails(HEADER + body(still))


def test_an_interrupt_goes_through(still, tmp_path, monkeypatch):
    polars = pytest.importorskip("polars")

    def reader(*_, **__):
        raise KeyboardInterrupt

    (tmp_path / "log.csv").write_text(HEADER + body(still))
    monkeypatch.setattr(polars, "read_csv", reader)
    with pytest.raises(KeyboardInterrupt):
        read(tmp_path / "log.csv", quiet=True)
