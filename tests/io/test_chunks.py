"""Records in chunks: equal to the same arrays read whole."""

import gzip

import numpy as np
import pytest

import jaxcal
from jaxcal import DataError
from jaxcal.io import _text
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
    (tmp_path / "log.ulg").write_bytes(b"ULog\x01\x12\x35" + bytes(40))
    with pytest.raises(DataError, match=r"this is ulog, which is not read in chunks; convert it once with `jaxcal convert LOG LOG.npz`"):
        open_chunks(tmp_path / "log.ulg", None)


def test_text(still, tmp_path, monkeypatch):
    monkeypatch.setattr(_text, "_BLOCK", 1500)
    names = "time [s],gyro_x,gyro_y,gyro_z,note"
    rows = [f"{t!r},{x!r},{y!r},{z!r},a" for t, (x, y, z) in zip(still.time.tolist(), still.gyro.tolist(), strict=True)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join([names, *rows]) + "\n\n")
    for length in (37, 400, 1000):
        np.testing.assert_array_equal(whole(open_chunks(path, None), length), still.gyro)
    chunks = open_chunks(path, "gyro_y")
    assert chunks.flat
    np.testing.assert_array_equal(whole(chunks)[:, 0], still.gyro[:, 1])
    np.testing.assert_array_equal(open_chunks(path, [3, 1]).read(150, 152), still.gyro[150:152, [2, 0]])
    with pytest.raises(DataError, match=r"choose among those that hold numbers, 0 \(time \[s\]\), 1 \(gyro_x\)"):
        open_chunks(path, ["note"])
    found = jaxcal.batch.deviation(path, 100.0, m=[1, 4], chunk=64)
    np.testing.assert_allclose(found.deviation, jaxcal.allan.deviation(still.gyro, 100.0, m=[1, 4]).deviation, rtol=1e-11)


def test_text_in_which_something_is_wrong_is_not_read_in_chunks(tmp_path, monkeypatch):
    monkeypatch.setattr(_text, "_BLOCK", 300)
    path = tmp_path / "log.csv"
    lines = ["time,gx", *(f"{i / 10},{i % 7}" for i in range(500))]
    lines[321] += ",9,9"
    path.write_text("\n".join(lines))
    with pytest.raises(DataError, match=r"1 of \d+ rows do not have 2 fields; the first is line 322: '32.0,5,9,9'; convert it once"):
        open_chunks(path, None)
    path.write_text("\n".join(lines[1:]))
    with pytest.raises(DataError, match=r"2 columns without names, numbered from 0; choose those of the record by number"):
        open_chunks(path, None)
    path.write_bytes(gzip.compress(path.read_bytes()))
    with pytest.raises(DataError, match="text that is packed, or not UTF-8, is not read in chunks; convert it once"):
        open_chunks(path, None)
