"""MATLAB and HDF5 files, which the tests write with SciPy and h5py."""

import numpy as np
import pytest
import scipy.io

from jaxcal import read

h5py = pytest.importorskip("h5py")


def plain(still):
    return {"time": still.time, "gyro": still.gyro, "accel": still.accel, "mag": still.mag, "temperature": still.temperature}


def check(log, still):
    for name in ("gyro", "accel", "mag", "temperature"):
        np.testing.assert_allclose(getattr(log, name), getattr(still, name), rtol=1e-12)
    assert (log.rate, log.gaps) == (100.0, ())


@pytest.mark.parametrize("options", [{"format": "4"}, {"format": "5"}, {"format": "5", "do_compression": True}, {"oned_as": "column"}])
@pytest.mark.parametrize("way", ["rows", "columns", "struct"])
def test_matlab(options, way, still, tmp_path):
    arrays = plain(still)
    if way == "columns":
        arrays = {name: np.atleast_2d(value.T) for name, value in arrays.items()}
    if way == "struct":
        if options.get("format") == "4":
            pytest.skip("version 4 has no structs")
        arrays = {"note": "made in a test", "log": {"imu": arrays}}
    scipy.io.savemat(tmp_path / "log.mat", arrays, **options)
    log = read(tmp_path / "log.mat", quiet=True)
    check(log, still)
    assert log.provenance["format"] == "mat"


def test_a_matrix_is_a_table(still, tmp_path, refuses):
    scipy.io.savemat(tmp_path / "log.mat", {"data": np.column_stack([still.time, still.gyro, still.accel]), "fs": 100.0})
    log = read(tmp_path / "log.mat", quiet=True)
    np.testing.assert_array_equal(log.accel, still.accel)
    scipy.io.savemat(tmp_path / "odd.mat", {"data": np.column_stack([still.time, still.gyro, still.accel[:, 0]])})
    with refuses("columns_unclear"):
        read(tmp_path / "odd.mat", quiet=True)
    assert read(tmp_path / "odd.mat", columns="time=0,gyro=1:3", quiet=True).rate == 100.0


@pytest.mark.parametrize("content", [{"name": "text"}, {"cells": np.array([1, "a"], dtype=object)}])
def test_matlab_without_numbers(content, tmp_path, refuses):
    scipy.io.savemat(tmp_path / "log.mat", content)
    with refuses("no_sensor"):
        read(tmp_path / "log.mat", quiet=True)


@pytest.mark.parametrize("inside", ["", "a/deep/place/"])
@pytest.mark.parametrize("options", [{}, {"compression": "gzip", "shuffle": True, "chunks": True}])
def test_hdf5(inside, options, still, tmp_path):
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name, value in plain(still).items():
            file.create_dataset(inside + name, data=value, **options)
    check(read(tmp_path / "log.h5", quiet=True), still)


def test_units_of_hdf5_are_attributes(still, tmp_path):
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["t"] = np.arange(400) * 10
        file["t"].attrs["units"] = "ms"
        file["gyro"] = np.degrees(still.gyro)
        file["gyro"].attrs["units"] = np.bytes_("deg/s")
    log = read(tmp_path / "log.h5", quiet=True)
    np.testing.assert_allclose(log.gyro, still.gyro, rtol=1e-14)
    assert (log.rate, log.provenance["units"]) == (100.0, {"time": "ms", "gyro": "deg/s"})


def test_groups_need_a_choice(still, tmp_path, refuses):
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["time"] = still.time
        for k in (0, 1):
            file[f"imu{k}/gyro"] = still.gyro * (k + 1)
    with refuses("several"):
        read(tmp_path / "log.h5", quiet=True)
    np.testing.assert_array_equal(read(tmp_path / "log.h5", topics="/imu1", quiet=True).gyro, 2 * still.gyro)
    with refuses("topics"):
        read(tmp_path / "log.h5", topics="imu2", quiet=True)


def test_compound_types(still, tmp_path):
    rows = np.zeros(400, [("time", "f8"), ("gx", "f4"), ("gy", "f4"), ("gz", "f4"), ("note", "S4")])
    rows["time"] = still.time
    rows["gx"], rows["gy"], rows["gz"] = still.gyro.T
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["imu/rows"] = rows
    np.testing.assert_array_equal(read(tmp_path / "log.h5", quiet=True).gyro, still.gyro.astype(np.float32))


def axes(values):
    return dict(zip("xyz", values.T, strict=True))


STRUCTS = {
    "structs of axes": lambda one: {"imu": {"time": one.time, "acc": axes(one.accel), "gyro": axes(one.gyro)}},
    "a clock in each": lambda one: {"imu": {"acc": axes(one.accel) | {"t": one.time}, "gyr": axes(one.gyro) | {"t": one.time}}},
    "data of a timeseries": lambda one: {"acc": {"Time": one.time, "Data": one.accel}, "gyro": {"Time": one.time, "Data": one.gyro}},
    "a message of ROS": lambda one: {"imu": {
        "Header": {"Stamp": {"Sec": 1.7e9 + np.floor(one.time), "Nsec": one.time % 1 * 1e9}},
        "LinearAcceleration": axes(one.accel), "AngularVelocity": axes(one.gyro)}},
    "an array of structs": lambda one: {"imu": np.array(
        [(t, *a, *w) for t, a, w in zip(one.time, one.accel, one.gyro, strict=True)],
        dtype=[(name, "O") for name in ("t", "ax", "ay", "az", "gx", "gy", "gz")])},
}  # fmt: skip


@pytest.mark.parametrize("which", STRUCTS)
def test_structs_of_matlab(which, still, tmp_path):
    scipy.io.savemat(tmp_path / "log.mat", STRUCTS[which](still))
    log = read(tmp_path / "log.mat", units="gyro=rad/s", quiet=True)
    assert log.rate == pytest.approx(100.0)
    np.testing.assert_allclose(log.accel, still.accel)
    np.testing.assert_allclose(log.gyro, still.gyro)


def test_matlab_73(still, tmp_path):
    with h5py.File(tmp_path / "log.mat", "w", userblock_size=512) as file:
        for name, value in plain(still).items():
            file["log/" + name] = np.atleast_2d(value.T)  # MATLAB's columns are HDF5's rows
            file["log/" + name].attrs["MATLAB_class"] = np.bytes_("double")
        file["log/name"] = np.frombuffer(b"a\0b\0", "<u2").reshape(-1, 1)
        file["log/name"].attrs["MATLAB_class"] = np.bytes_("char")
        file["#refs#/a"] = np.zeros(3)
    with (tmp_path / "log.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\x02IM")
    log = read(tmp_path / "log.mat", quiet=True)
    check(log, still)
    assert log.provenance["format"] == "hdf5"


def test_a_matlab_table_is_named(tmp_path, refuses):
    with h5py.File(tmp_path / "log.mat", "w") as file:
        file["T"] = np.zeros((1, 6), "u4")
        file["T"].attrs["MATLAB_class"] = np.bytes_("timetable")
    with refuses("no_sensor"):
        read(tmp_path / "log.mat", quiet=True)


def test_hdf5_opens_no_other_file(still, tmp_path, refuses):
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["gyro"] = still.gyro
    (tmp_path / "secret.raw").write_bytes(still.gyro.tobytes())
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["time"] = still.time
        file["gyro"] = h5py.ExternalLink("secret.h5", "/gyro")
        file.create_dataset("accel", (400, 3), "f8", external=[(str(tmp_path / "secret.raw"), 0, 9600)])
        virtual = h5py.VirtualLayout((400, 3), "f8")
        virtual[:] = h5py.VirtualSource(str(tmp_path / "secret.h5"), "gyro", (400, 3))
        file.create_virtual_dataset("mag", virtual)
        file["loop"] = file["/"]
    with refuses("columns_unclear"):
        read(tmp_path / "log.h5", quiet=True)


def test_an_array_of_terabytes_that_was_never_written(tmp_path, refuses):
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file.create_dataset("gyro", (10**12, 3), "f8", chunks=(1000, 3))
    with refuses("too_large"):
        read(tmp_path / "log.h5", quiet=True)
