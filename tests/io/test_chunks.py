"""Records in chunks: equal to the same arrays read whole."""

import numpy as np
import pytest

import jaxcal
from jaxcal import DataError
from jaxcal.io._chunks import open_chunks


def whole(chunks, length=37):
    return np.concatenate(list(chunks.of(length)))


def arrays(still):
    return {
        "time": still.time,
        "gyro": np.asfortranarray(still.gyro),
        "accel": still.accel.astype(np.float32),
        "temperature": still.temperature,
    }


def test_npz(still, tmp_path):
    np.savez(tmp_path / "log.npz", **arrays(still), rate=100.0)
    chunks = open_chunks(tmp_path / "log.npz", None)
    expected = np.column_stack([still.gyro, still.accel.astype(np.float32), still.temperature])
    np.testing.assert_array_equal(whole(chunks), expected)
    np.testing.assert_array_equal(whole(open_chunks(tmp_path / "log.npz", ["gyro"])), still.gyro)
    assert open_chunks(tmp_path / "log.npz", "temperature").flat
    with pytest.raises(DataError, match=r"columns mag: not in the file; arrays of numbers are time, gyro, accel, temperature"):
        open_chunks(tmp_path / "log.npz", "mag")
    np.savez_compressed(tmp_path / "log.npz", **arrays(still))
    with pytest.raises(DataError, match="the arrays are compressed"):
        open_chunks(tmp_path / "log.npz", None)


def test_a_converted_log(still, tmp_path):
    np.savez(tmp_path / "log.npz", **arrays(still))
    log = jaxcal.io.convert(tmp_path / "log.npz", tmp_path / "out.npz", quiet=True)
    np.testing.assert_array_equal(whole(open_chunks(tmp_path / "out.npz", ["gyro"])), log.gyro)


def test_hdf5(still, tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name, value in arrays(still).items():
            file[f"imu/{name}"] = value
        file["other"] = np.zeros(7)
    np.testing.assert_array_equal(whole(open_chunks(tmp_path / "log.h5", ["imu/gyro"])), still.gyro)
    with pytest.raises(DataError, match=r"the arrays have different lengths \(imu/accel \(400, 3\), .*other \(7,\)\)"):
        open_chunks(tmp_path / "log.h5", None)


def test_other_logs_are_converted_first(tmp_path):
    (tmp_path / "log.csv").write_text("t,gx\n0,1\n1,2\n")
    with pytest.raises(DataError, match=r"this is csv, which is not read in chunks; convert it once with `jaxcal convert LOG LOG.npz`"):
        open_chunks(tmp_path / "log.csv", None)
