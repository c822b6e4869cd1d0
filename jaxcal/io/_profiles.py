"""Devices and apps whose tables do not say all that is needed: one row for each.

A row says which columns hold what, in which unit; values are still compared with what is known of gravity, the field and of
sensors, so that a row that is wrong for a file is contradicted rather than believed. What a table says by itself (EuRoC, TUM-VI, phyphox,
AndroSensor, WitMotion, Physics Toolbox by the units in its header) needs no row.
"""

import dataclasses
import re

from ._names import Name

_XYZ = "([xyz])"


@dataclasses.dataclass(frozen=True)
class Profile:
    """One device or app.

    `needs` are patterns of column names that must all be there, `preamble` one of the text above the table, `file` one of the file's
    name. `columns` are (pattern with the axis as a group, or none, kind, unit), where the unit may be None: told from the values.
    `sign` says what the device does differently, `rate` takes the sampling rate from the preamble.
    """

    name: str
    needs: tuple[str, ...]
    columns: tuple[tuple[str, str, str | None], ...]
    preamble: str = ""
    file: str = ""
    sign: str = ""
    unit_from: tuple[str, str, str] | None = None  # kind, pattern in the preamble, what its number is the reciprocal of


def _sensor_logger(file: str, kind: str, unit: str | None, sign: str = "") -> Profile:
    return Profile(
        f"Sensor Logger, {file}", ("time", "seconds_elapsed", "x", "y", "z"), ((_XYZ, kind, unit), ("seconds_elapsed", "time", "s")),
        file=rf"{file}(?:[ _(-]?\d.*)?", sign=sign,
    )  # fmt: skip


_IPHONE = "an iPhone states acceleration with gravity as -1 g on the axis that points up, the opposite of specific force"
PROFILES = (
    _sensor_logger("Accelerometer", "linear", "m/s^2"),
    _sensor_logger("AccelerometerUncalibrated", "accel", None, _IPHONE),
    _sensor_logger("TotalAcceleration", "accel", "m/s^2"),
    _sensor_logger("Gravity", "gravity", None),
    _sensor_logger("Gyroscope(?:Uncalibrated)?", "gyro", "rad/s"),
    _sensor_logger("Magnetometer(?:Uncalibrated)?", "mag", "uT"),
    Profile(
        "MicroStrain", (rf"{_XYZ} (?:accel|gyro) \[x800[45]\]",),
        ((rf"{_XYZ} accel \[x8004\]", "accel", "g"), (rf"{_XYZ} gyro \[x8005\]", "gyro", "rad/s"), (rf"{_XYZ} mag \[x8006\]", "mag", "G"),
         ("gps tow", "time", "s")),
    ),
    Profile(
        "Xsens DOT", ("packetcounter",),
        ((rf"acc_{_XYZ}", "accel", "m/s^2"), (rf"gyr_{_XYZ}", "gyro", "deg/s"), (rf"freeacc_{_XYZ}", "linear", "m/s^2"),
         (r"dv\[?[123]\]?|dq_.*", "attitude", None)),
        preamble=r"DeviceTag|OutputRate|Xsens DOT|Movella",
    ),
    Profile(
        "Xsens MT", ("packetcounter",),
        ((rf"acc_{_XYZ}", "accel", "m/s^2"), (rf"gyr_{_XYZ}", "gyro", "rad/s"), (rf"freeacc_{_XYZ}", "linear", "m/s^2")),
        preamble=r"Update Rate|Filter Profile|Option Flags|Firmware Version",
    ),
    Profile(
        "Physics Toolbox", (rf"gf{_XYZ}",),
        ((rf"gf{_XYZ}", "accel", "g"), (rf"a{_XYZ}", "linear", "m/s^2"), (rf"w{_XYZ}", "gyro", "rad/s"), (rf"b{_XYZ}", "mag", "uT"),
         ("time", "time", None)),
    ),
    Profile(
        "VectorNav", ("timestartup|timegpspps",),
        ((rf"(?:uncomp)?(?:gyro|angularrate){_XYZ}", "gyro", "rad/s"), (rf"(?:uncomp)?accel{_XYZ}", "accel", "m/s^2"),
         (rf"(?:uncomp)?mag{_XYZ}", "mag", "G"), ("timestartup", "time", "ns")),
    ),
    Profile(
        "Betaflight blackbox", (r"gyroadc\[0\].*",),
        ((r"gyroadc\[([012])\].*", "gyro", "deg/s"), (r"accsmooth\[([012])\].*", "accel", None),
         (r"gyrounfilt\[([012])\].*", "gyro", "deg/s"),
         (r"magadc\[([012])\].*", "mag", None), (r"time(?: \(us\))?", "time", "us")),
        unit_from=("accel", r"acc_1G\W+(\d+)", "g"),
    ),
    Profile("NaveGo", ("fb_?x", "wb_?x"), ((rf"fb_?{_XYZ}", "accel", "m/s^2"), (rf"wb_?{_XYZ}", "gyro", "rad/s"))),
    Profile(
        "KITTI oxts", ("oxts_wx",),
        ((rf"oxts_a{_XYZ}", "accel", "m/s^2"), (rf"oxts_w{_XYZ}", "gyro", "rad/s"), ("timestamp", "time", None)),
    ),
    Profile(
        "x-IMU", ("packet number", rf"gyroscope {_XYZ} \(deg/s\)"),
        ((rf"gyroscope {_XYZ} \(deg/s\)", "gyro", "deg/s"), (rf"accelerometer {_XYZ} \(g\)", "accel", "g"),
         (rf"magnetometer {_XYZ} \(g\)", "mag", "G")),
    ),
    Profile(
        "eSense", ("timestamp", rf"gyro_{_XYZ}_deg_per_s"),
        ((rf"accel_{_XYZ}_g", "accel", "g"), (rf"gyro_{_XYZ}_deg_per_s", "gyro", "deg/s")),
    ),
)  # fmt: skip

#: names of the 30 columns of a KITTI oxts file, which has no header
OXTS = tuple(
    "oxts_" + word
    for words in (
        "lat lon alt roll pitch yaw vn ve vf vl vu ax ay az af al au wx wy wz wf wl wu",
        "pos_accuracy vel_accuracy navstat numsats posmode velmode orimode",
    )
    for word in words.split()
)


def matching(names: list[str], preamble: str, file: str) -> tuple[Profile | None, dict[int, Name]]:
    """The first profile that fits a table, and what it says of the columns."""
    low = [name.strip().lower() for name in names]
    for profile in PROFILES:
        if not all(any(re.fullmatch(need, name) for name in low) for need in profile.needs):
            continue
        if profile.preamble and not re.search(profile.preamble, preamble, re.IGNORECASE):
            continue
        if profile.file and not re.fullmatch(profile.file, file, re.IGNORECASE):
            continue
        unit_from = profile.unit_from and re.search(profile.unit_from[1], preamble)
        found: dict[int, Name] = {}
        for i, name in enumerate(low):
            for pattern, kind, unit in profile.columns:
                if match := re.fullmatch(pattern, name):
                    axis = match[1] if match.groups() else ""
                    axis = "xyz"["012".index(axis)] if axis in tuple("012") else axis
                    if unit_from and profile.unit_from and kind == profile.unit_from[0]:
                        unit = f"{1 / float(unit_from[1]):.9g} {profile.unit_from[2]}" if float(unit_from[1]) else unit
                    found[i] = Name(kind, axis, unit, 0, pattern)
                    break
        return profile, found
    return None, {}
