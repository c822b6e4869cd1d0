"""Profiles of devices and apps whose tables do not state everything that jaxcal needs.

A profile defines the quantity and the unit of columns. The values are still checked against gravity, the field and known sensors, so that
a wrong profile is detected.

Sources: the data sheets and manuals of the makers (VectorNav: gauss, m/s^2, rad/s), sensor_msgs of ROS (REP 103: SI), and the
description of Gyroflow's .gcsv (docs.gyroflow.xyz).
"""

import contextlib
import dataclasses
import math
import re
from collections.abc import Iterator

from ._names import Name

_XYZ = "([xyz])"


@dataclasses.dataclass(frozen=True)
class Profile:
    """One device or app.

    `needs` are patterns of column names that must all be present; `preamble` is a pattern of the text above the table, `file` one of the
    file name. `columns` are (pattern, optionally with the axis as a group; kind; unit), where unit None means inferred from the values.
    `sign` describes a peculiarity of the device. `unit_from` takes the size of a unit from the preamble.
    """

    name: str
    needs: tuple[str, ...]
    columns: tuple[tuple[str, str, str | None], ...]
    preamble: str = ""
    file: str = ""
    sign: str = ""
    unit_from: tuple[tuple[str, str, str, bool], ...] = ()  # kind, pattern in the preamble, unit, whether one over the number counts


def _sensor_logger(file: str, kind: str, unit: str | None, sign: str = "") -> Profile:
    needs, columns = ("time", "seconds_elapsed", "x", "y", "z"), ((_XYZ, kind, unit), ("seconds_elapsed", "time", "s"))
    return Profile("Sensor Logger", needs, columns, file=rf"{file}(?:Uncalibrated)?(?:[ _(-]?\d.*)?", sign=sign)


_IPHONE = "an iPhone states acceleration with gravity as -1 g on the axis that points up, the opposite of specific force"
PROFILES = (
    _sensor_logger("AccelerometerUncalibrated", "accel", None, _IPHONE), _sensor_logger("Gyroscope", "gyro", "rad/s"),
    _sensor_logger("Magnetometer", "mag", "uT"), _sensor_logger("Accelerometer", "linear", "m/s^2"),
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
    *(Profile(
        "Xsens MT", needs,
        ((rf"acc_{_XYZ}", "accel", "m/s^2"), (rf"gyr_{_XYZ}", "gyro", "rad/s"), (rf"freeacc_{_XYZ}", "linear", "m/s^2"),
         (r"mag_[xyz]", "motion", None)),
        preamble=preamble, sign="its magnetometer is relative to the field in which it was calibrated, and is not read",
    ) for needs, preamble in (
        (("packetcounter",), r"Update Rate|Sample Rate|Filter Profile|Option Flags|Firmware Version"),
        (("(?:packet)?counter", r"acc_x|gyr_x", r"mat\[1\]\[1\]|mag_x"), ""),
    )),
    Profile(
        "VectorNav", ("timestartup|timegpspps",),
        ((rf"(?:uncomp)?(?:gyro|angularrate)\.?{_XYZ}", "gyro", "rad/s"), (rf"(?:uncomp)?accel\.?{_XYZ}", "accel", "m/s^2"),
         (rf"(?:uncomp)?mag\.?{_XYZ}", "mag", "G"), ("timestartup", "time", "ns")),
    ),
    Profile("MAVLink in SI", (r".*(?:hil_sensor|highres_imu)\.xgyro",), (
        (rf".*\.{_XYZ}gyro", "gyro", "rad/s"), (rf".*\.{_XYZ}acc", "accel", "m/s^2"), (rf".*\.{_XYZ}mag", "mag", "G"),
    )),
    Profile(
        "MAVLink", (rf"(?:.*\.)?{_XYZ}gyro", rf"(?:.*\.)?{_XYZ}acc"),
        ((rf"(?:.*\.)?{_XYZ}gyro", "gyro", "mrad/s"), (rf"(?:.*\.)?{_XYZ}acc", "accel", "mg"), (rf"(?:.*\.)?{_XYZ}mag", "mag", "mG"),
         ("time_boot_ms", "time", "ms"), ("time_usec", "time", "us")),
    ),
    Profile(
        "ArduPilot", ("timeus", "gyrx", "accx"),
        ((rf"gyr{_XYZ}", "gyro", "rad/s"), (rf"acc{_XYZ}", "accel", "m/s^2"), (rf"mag{_XYZ}", "mag", "mG"), ("timeus", "time", "us")),
    ),
    Profile(
        "Betaflight blackbox", (r"gyroadc\[0\].*",),
        ((r"gyroadc\[([012])\].*", "gyro", "deg/s"), (r"accsmooth\[([012])\].*", "accel", None),
         (r"gyrounfilt\[([012])\].*", "gyro", "deg/s"),
         (r"magadc\[([012])\].*", "mag", None), (r"time(?: \(us\))?", "time", "us")),
        unit_from=(("accel", r"acc_1G\W+(\d+)", "g", True),),
    ),
    Profile(
        "Kalibr", ("timestamp", "omega_x", "alpha_x"),
        ((rf"omega_{_XYZ}", "gyro", "rad/s"), (rf"alpha_{_XYZ}", "accel", "m/s^2"), ("timestamp", "time", None)),
    ),
    Profile(
        "ROS", (r".*angular_velocity[._/]x", r".*(?:header|covariance|frame_id|__time|%time).*"),
        ((rf".*angular_velocity[._/]{_XYZ}", "gyro", "rad/s"), (rf".*linear_acceleration[._/]{_XYZ}", "accel or linear", "m/s^2"),
         (rf".*magnetic_field[._/]{_XYZ}", "mag", "T")),
    ),
    Profile(
        "Gyroflow", ("t", "gx", "gy", "gz"),
        (("t", "time", None), (rf"g{_XYZ}", "gyro", None), (rf"a{_XYZ}", "accel", None), (rf"m{_XYZ}", "motion", None)),
        preamble="GYROFLOW IMU LOG",
        unit_from=(("time", r"tscale,([\d.eE+-]+)", "s", False), ("gyro", r"gscale,([\d.eE+-]+)", "rad/s", False),
                   ("accel", r"ascale,([\d.eE+-]+)", "g", False)),
    ),
)  # fmt: skip

#: names of the 40 columns of `ros2 topic echo --csv` for sensor_msgs/Imu, which has no header
ROS2_IMU = (
    "stamp_sec", "stamp_nanosec", "frame_id", *(f"orientation_{k}" for k in "xyzw"),
    *(f"{vector}{part}" for vector in ("orientation", "angular_velocity", "linear_acceleration")
      for part in (*(f"_{k}" for k in "xyz" if vector != "orientation"), *(f"_covariance_{i}{j}" for i in "xyz" for j in "xyz"))),
)  # fmt: skip


def matching(names: list[str], preamble: str, file: str) -> tuple[Profile | None, dict[int, Name]]:
    """The first profile that fits a table, and the meanings of the columns by it."""
    low = [name.strip().lower() for name in names]
    for profile in PROFILES:
        named = all(any(re.fullmatch(need, name) for name in low) for need in profile.needs)
        placed = named and re.search(profile.preamble, preamble, re.IGNORECASE)
        if not (placed and re.fullmatch(profile.file or "(?s:.*)", file, re.IGNORECASE)):
            continue
        sizes = {kind: f"{number:.9g} {unit}" for kind, number, unit in _sizes(profile, preamble)}
        found: dict[int, Name] = {}
        for i, name in enumerate(low):
            for pattern, kind, unit in profile.columns:
                if match := re.fullmatch(pattern, name):
                    axis = match[1] if match.groups() else ""
                    axis = "xyz"["012".index(axis)] if axis in tuple("012") else axis
                    # the columns of one sensor differ only in the axis
                    stem = pattern + (name[: match.start(1)] if match.groups() else "")
                    found[i] = Name(kind, axis, sizes.get(kind, unit), stem)
                    break
        return profile, found
    return None, {}


def _sizes(profile: Profile, preamble: str) -> Iterator[tuple[str, float, str]]:
    """Kind, number and unit from the preamble."""
    for kind, pattern, unit, inverse in profile.unit_from:
        match = re.search(pattern, preamble)
        with contextlib.suppress(ValueError, OverflowError, ZeroDivisionError):
            if match and 0 < (number := 1 / float(match[1]) if inverse else float(match[1])) < math.inf:
                yield kind, number, unit
