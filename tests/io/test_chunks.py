"""Recordings read in chunks give the same results as the whole arrays."""

import subprocess

import numpy as np
import pytest

import jaxcal


def found(path, columns=None, chunk=37):
    return jaxcal.batch.deviation(path, 100.0, m=[1, 4], chunk=chunk, columns=columns).deviation


def same(path, columns, values, chunk=37):
    whole = jaxcal.allan.deviation(values, 100.0, m=[1, 4]).deviation
    np.testing.assert_allclose(found(path, columns, chunk), whole, rtol=1e-10)


def arrays(still):
    return {
        "time": still.time,
        "gyro": np.asfortranarray(still.gyro),
        "accel": still.accel.astype(np.float32),
        "temperature": still.temperature,
    }


def test_npz(still, tmp_path, refuses):
    path = tmp_path / "log.npz"
    np.savez(path, **arrays(still), rate=100.0)
    same(path, None, np.column_stack([still.gyro, still.accel.astype(np.float32), still.temperature]))
    same(path, ["gyro"], still.gyro)
    same(path, "temperature", still.temperature)
    with refuses("chunks"):
        found(path, "mag")
    np.savez_compressed(path, **arrays(still))
    with refuses("chunks"):
        found(path)


def test_a_converted_log(still, tmp_path):
    np.savez(tmp_path / "log.npz", **arrays(still))
    log = jaxcal.io.convert(tmp_path / "log.npz", tmp_path / "out.npz", quiet=True)
    same(tmp_path / "out.npz", ["gyro"], log.gyro)


def test_hdf5(still, tmp_path, refuses):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name, value in arrays(still).items():
            file[f"imu/{name}"] = value
        file["other"] = np.zeros(7)
    same(tmp_path / "log.h5", ["imu/gyro"], still.gyro)
    with refuses("chunks"):
        found(tmp_path / "log.h5")


def test_parquet(still, tmp_path, refuses):
    pl = pytest.importorskip("polars")
    path = tmp_path / "log.parquet"
    pl.DataFrame({"time": still.time, "gx": still.gyro[:, 0], "gy": still.gyro[:, 1], "note": ["a"] * 400}).write_parquet(path)
    same(path, None, still.gyro[:, :2])
    same(path, "gy", still.gyro[:, 1])
    with refuses("chunks"):
        found(path, ["note"])


@pytest.mark.parametrize("content", [b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + bytes(40), b"#ROSBAG V2.0\n", b"ULog\x01\x12\x35"])
def test_other_logs_are_converted_first(content, tmp_path, refuses):
    (tmp_path / "log").write_bytes(content)
    with refuses("chunks"):
        found(tmp_path / "log")


def test_a_text_table_is_converted_by_the_line_that_its_refusal_shows(still, tmp_path):
    pl = pytest.importorskip("polars")
    path = tmp_path / "my log.csv"
    pl.DataFrame({"time": still.time} | {f"g{axis}": column for axis, column in zip("xyz", still.gyro.T, strict=True)}).write_csv(path)
    with pytest.raises(jaxcal.DataError) as error:
        found(path)
    subprocess.run(str(error.value).partition("once: ")[2], shell=True, check=True)
    same(path.with_suffix(".parquet"), None, still.gyro)
