"""`columns=`, `units=` and `topics=` in all their forms."""

import pytest

from jaxcal import DataError, UnitError
from jaxcal.io._columns import resolve
from jaxcal.io._options import parse_columns, parse_topics, parse_units, scale

NAMES = ["Time (s)", "wx", "wy", "wz", "Acc X", "Acc Y", "Acc Z"]


@pytest.mark.parametrize(
    ("given", "found"),
    [
        ("time=0,gyro=1:3", {"time": [0], "gyro": [1, 2, 3]}),
        ("time=0,gyro=1,2,3", {"time": [0], "gyro": [1, 2, 3]}),
        ("gyro=wx:wz", {"gyro": [1, 2, 3]}),
        ("gyro=wz:wy:wx", {"gyro": [3, 2, 1]}),
        ("accel=4:6", {"accel": [4, 5, 6]}),
        ("accel_x=acc x,accel_y=Acc Y,accel_z=ACC_Z", {"accel": [4, 5, 6]}),
        ({"time": 0, "gyro": [1, 2, 3]}, {"time": [0], "gyro": [1, 2, 3]}),
        ({"gyro": ("wx", "wy", "wz"), "time": None}, {"gyro": [1, 2, 3]}),
        ({"gyro_z": 3, "gyro_x": "wx", "gyro_y": -5}, {"gyro": [1, 2, 3]}),
        ({"gyro_x": "wy"}, {"gyro": [2]}),
        ({"time": "time"}, {"time": [0]}),
        (None, {}),
    ],
)
def test_columns(given, found):
    assert resolve(parse_columns(given), NAMES, 7) == found


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("gyroscope=1:3", "unknown quantity 'gyroscope'; use time, gyro, accel, mag, temperature"),
        ("1:3", "'1:3' is not of the form quantity=value"),
        ({"gyro": [0, 1, 7]}, r"gyro wants column 7; there are 0 \(Time \(s\)\), 1 \(wx\)"),
        ({"gyro": ["wx", "wy", "w"]}, "there is no column 'w' for gyro; there are"),
        ({"gyro": [1, 1, 2]}, "give 1 to 3 different ones"),
        ({"gyro": "1:5"}, "give 1 to 3 different ones"),
        ({"temperature": [1, 2]}, "give 1 different ones"),
        ({"gyro_y": 2}, "gyro has only y; give x, or x and y, or all three"),
        ({"gyro_x": [1, 2]}, "gyro_x is one column"),
        ({"time": 1.5}, "1.5 is neither the number of a column"),
    ],
)
def test_columns_that_make_no_sense(given, said):
    with pytest.raises(DataError, match=said):
        resolve(parse_columns(given), NAMES, 7)


def test_units():
    assert parse_units("gyro=deg/s,accel=g,time=us") == {"gyro": "deg/s", "accel": "g", "time": "us"}
    assert parse_units({"gyro": 0.05}) == {"gyro": "0.050000000000000003 rad/s"}
    assert scale("0.5 g", "accel") == (4.903325, 0.0)
    assert scale("1e-3 deg/s", "gyro")[0] == pytest.approx(1.7453292519943296e-05)
    assert scale("K", "temperature") == (1.0, -273.15)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("gyro=furlong", r"'furlong' is not a unit of gyro; use one of rad/s.*need their size, as in units={'gyro': '0.05 rad/s'}"),
        ("gyro=counts", "raw counts need their size"),
        ({"gyro": "0 deg/s"}, "makes every value of gyro zero"),
    ],
)
def test_units_that_make_no_sense(given, said):
    with pytest.raises(UnitError, match=said):
        parse_units(given)


@pytest.mark.parametrize(("given", "said"), [({"rate": "Hz"}, "unknown quantity 'rate'"), ("deg/s", "is not of the form quantity=value")])
def test_units_of_nothing(given, said):
    with pytest.raises(DataError, match=said):
        parse_units(given)


def test_topics():
    assert parse_topics("/a, /b") == ["/a", "/b"]
    assert parse_topics(["/a"]) == ["/a"]
    with pytest.raises(DataError, match="holds an empty name"):
        parse_topics("/a,")
