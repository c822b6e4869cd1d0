"""`columns=`, `units=`, `axes=` and `topics=` in all their forms."""

import numpy as np
import pytest

from jaxcal import UnitError, read

HEADER = "Time (s),wx,wy,wz,Acc X,Acc Y,Acc Z"


@pytest.fixture
def path(still, tmp_path):
    rows = np.column_stack([still.time, still.gyro, still.accel])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=HEADER, comments="")
    return tmp_path / "log.csv"


@pytest.mark.parametrize(
    ("given", "found"),
    [
        ("time=0,gyro=1:3", {"time": [0], "gyro": [1, 2, 3]}),
        ("time=0,gyro=1,2,3", {"time": [0], "gyro": [1, 2, 3]}),
        ("gyro=wx:wz", {"gyro": [1, 2, 3], "time": [0]}),
        ("gyro=wz:wy:wx", {"gyro": [3, 2, 1], "time": [0]}),
        ("accel=4:6", {"accel": [4, 5, 6], "time": [0]}),
        ("accel=acc x,Acc Y,ACC_Z", {"accel": [4, 5, 6], "time": [0]}),
        ({"time": 0, "gyro": [1, 2, 3]}, {"time": [0], "gyro": [1, 2, 3]}),
        ({"gyro": ("wx", "wy", "wz"), "time": None}, {"gyro": [1, 2, 3]}),
        ({"gyro": ["wx", -5, 3]}, {"gyro": [1, 2, 3], "time": [0]}),
        ({"gyro": "wy"}, {"gyro": [2], "time": [0]}),
        ({"time": "time"}, {"time": [0], "gyro": [1, 2, 3], "accel": [4, 5, 6]}),
        (None, {"time": [0], "gyro": [1, 2, 3], "accel": [4, 5, 6]}),
    ],
)
def test_columns(given, found, path):
    rate = 100.0 if "time" not in found else None
    assert read(path, columns=given, rate=rate, quiet=True).provenance["columns"] == found


@pytest.mark.parametrize(
    "given",
    [
        "gyroscope=1:3", "1:3", {"gyro": [0, 1, 7]}, {"gyro": ["wx", "wy", "w"]}, {"gyro": [1, 1, 2]}, {"gyro": "1:5"},
        {"temperature": [1, 2]}, {"gyro_y": 2}, {"time": True},
    ],
)  # fmt: skip
def test_columns_that_make_no_sense(given, path, refuses):
    with refuses("columns"):
        read(path, columns=given, quiet=True)


@pytest.mark.parametrize("given", ["gyro=y,-x,z", {"gyro": "y,-x,z"}, {"gyro": ["y", "-x", "+z"]}])
def test_axes(given, path, still, refuses):
    log = read(path, axes=given, quiet=True)
    np.testing.assert_allclose(log.gyro, still.gyro[:, [1, 0, 2]] * [1, -1, 1])
    np.testing.assert_allclose(log.accel, still.accel)
    assert log.provenance["axes"] == {"gyro": ["y", "-x", "z"]}
    for bad in ("gyro=x,x,z", "gyro=x,y", "temperature=x,y,z", "mag=x,z,y"):
        with refuses("axes"):
            read(path, axes=bad, quiet=True)


@pytest.mark.parametrize(
    ("given", "stated", "factor"),
    [
        ("gyro=deg/s,accel=g,time=us", {"gyro": "deg/s", "accel": "g", "time": "us"}, 9.80665),
        ({"gyro": 0.05, "accel": "0.5 g"}, {"gyro": "0.050000000000000003 rad/s", "accel": "0.5 g", "time": "s"}, 4.903325),
        ("gyro=1e-3 deg/s,accel=1e-3 m/s^2", {"gyro": "1e-3 deg/s", "accel": "1e-3 m/s^2", "time": "s"}, 1e-3),
    ],
)
def test_units(given, stated, factor, path, still):
    log = read(path, units=given, quiet=True)
    assert log.provenance["units"] == stated
    np.testing.assert_allclose(log.accel, still.accel * factor, rtol=1e-12)


def test_a_unit_with_an_offset(path, still):
    log = read(path, columns="temperature=4", units="temperature=K", quiet=True)
    np.testing.assert_allclose(log.temperature, still.accel[:, 0] - 273.15, rtol=1e-12)


@pytest.mark.parametrize("given", ["gyro=furlong", "gyro=counts", {"gyro": "0 deg/s"}])
def test_units_that_make_no_sense(given, path, refuses):
    with refuses("units", UnitError):
        read(path, units=given, quiet=True)
