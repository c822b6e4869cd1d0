"""The table of formats: sections of a calibration that each uses, its options, and the name of its file.

It loads no other module of this package, so that the help of the command line is quick.
"""

import importlib
import math
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any, NamedTuple

from .._errors import ExportError, JaxcalError
from .._message import Message
from .._units import STANDARD_GRAVITY

SENSORS = {"gyro": "gyroscope", "accel": "accelerometer"}


def is_positive(value: Any) -> bool:
    """Whether a value is a finite number above 0."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value) and value > 0


def is_instance(value: Any) -> bool:
    """Whether a value can be the number of a sensor on its vehicle."""
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def is_walk(value: Any) -> bool:
    """Whether a value says what to write for K that was not found."""
    if isinstance(value, Mapping):
        return bool(value) and set(value) <= set(SENSORS) and all(map(is_positive, value.values()))
    return value is None or value == "upper_limit"


def is_name(value: Any) -> bool:
    """Whether a value can begin the names of a C program."""
    return isinstance(value, str) and value.isascii() and value.isidentifier()


def is_topic(value: Any) -> bool:
    """Whether a value can be the name of a ROS topic; such a name needs no escape in YAML between quotes."""
    return is_name(str(value).removeprefix("~").removeprefix("/").replace("/", "_"))


class Option(NamedTuple):
    """An option of some formats: default, whether a value is right or the values that are, what is expected, and help."""

    default: Any
    right: Callable[[Any], bool] | tuple[str, ...]
    expected: str
    help: str


OPTIONS = {
    "axis": Option("worst", ("worst", "rms"), "", "One number for three axes: the largest (worst), or their root mean square (rms)."),
    "motion": Option(
        None, lambda motion: motion is None or hasattr(motion, "attitude"), "a jaxcal.budget.Motion",
        "Log of the motion in use: N is that to be expected in increments under it, with the errors of the calibration; the file says how.",
    ),
    "window": Option(1.0, is_positive, "s above 0", "Time in s between the updates of the filter, for --for."),
    "random_walk": Option(
        "upper_limit", is_walk, 'a number above 0 for each sensor named, "upper_limit", or none',
        "K in place of that of the fit, in SI: gyro=2e-6,accel=3e-5. Else, where no K was found, its upper limit.",
    ),
    "rate": Option(None, lambda rate: rate is None or is_positive(rate), "Hz above 0", "True sampling rate in Hz; else that of the log."),
    "topic": Option("/imu0", is_topic, 'a name such as "/imu0"', "ROS topic of the sensor."),
    "gravity": Option(STANDARD_GRAVITY, is_positive, "m/s^2 above 0", "Local gravity in m/s^2."),
    "convention": Option(
        "midpoint", ("midpoint", "per_sample"), "", "Meaning of the noise: N sqrt(2 rate) (midpoint), or N sqrt(rate) (per_sample)."
    ),
    "frame": Option("up", ("up", "down"), "", "Direction of the z axis."),
    "instance": Option(0, is_instance, "0 for the first", "Number of the sensors on the vehicle, from 0."),
    "gyro_bias": Option(False, lambda value: isinstance(value, bool), "True or False",
                        "Also the bias of the gyroscope, which the firmware learns at every start."),
    "solver": Option(False, lambda value: isinstance(value, bool), "True or False",
                     "Also the code that collects readings on the device and solves for a calibration; needs no calibration."),
    "double": Option(False, lambda value: isinstance(value, bool), "True or False", "Double precision in place of single."),
    "earlier": Option(
        None, lambda one: one is None or hasattr(one, "provenance"), "a Calibration",
        "Earlier calibration of the device: the change of a bias since then, where it is certain, goes on with the days.",
    ),
    "prefix": Option("JAXCAL_", is_name, "the beginning of a name in C", "Prefix of the names in the header."),
}  # fmt: skip


class Format(NamedTuple):
    """One format. Its module has `write_NAME(calibration, options)`, with a list of calibrations if `many`, and perhaps `read_NAME`."""

    file: str  # usual name
    module: str
    sections: tuple[str, ...]  # sections of the calibration that it uses
    options: tuple[str, ...] = ()
    mark: str = "#"  # of a comment line; "" if the format has no comments
    head: str = ""  # line that stands before the first comment
    many: bool = False  # whether a file can hold several instances of a sensor
    counts: bool = False  # whether a magnetometer in counts has a place
    warm: bool = False  # whether a matrix over temperature has a place
    readable: bool = False  # whether `read` takes it: what a device has now

    def function(self, name: str) -> Callable[..., Any]:
        """The writer or reader."""
        return getattr(importlib.import_module(f".{self.module}", __package__), name)


_NOISE = ("axis", "motion", "window", "random_walk", "rate")
_PARTS = ("imu", "magnetometer")
_FIELDS = (*_PARTS, "temperature")
FORMATS = {
    "kalibr": Format("imu.yaml", "_filters", ("noise",), (*_NOISE, "topic")),
    "openvins": Format("kalibr_imu_chain.yaml", "_filters", ("noise", "imu"), (*_NOISE, "topic"), head="%YAML:1.0\n"),
    "vins": Format("vins.yaml", "_filters", ("noise",), (*_NOISE, "topic", "gravity", "convention")),
    "orbslam3": Format("orbslam3.yaml", "_filters", ("noise",), _NOISE),
    "gtsam": Format("gtsam_imu.py", "_filters", ("noise",), ("motion", "window", "random_walk", "gravity", "frame")),
    "px4": Format("px4.params", "_flight_controllers", _FIELDS, ("instance",), many=True, readable=True),
    "ardupilot": Format("ardupilot.param", "_flight_controllers", _FIELDS, ("instance", "gyro_bias"), many=True, readable=True),
    "ros": Format("calibration.yaml", "_ros", ("noise", *_PARTS), ("motion", "window", "rate")),
    "motioncal": Format("motioncal.bin", "_motioncal", ("magnetometer",), mark="", readable=True),
    "fusion": Format("fusion.c", "_compass", ("magnetometer",), mark="//", counts=True),
    "magneto": Format("magneto.c", "_compass", ("magnetometer",), mark="//", counts=True),
    "inav": Format("inav.txt", "_compass", ("magnetometer",), counts=True),
    "betaflight": Format("betaflight.txt", "_compass", ("magnetometer",), counts=True),
    "c": Format("calibration.h", "_c", _FIELDS, ("prefix", "solver", "double", "earlier"), mark="//", counts=True, warm=True),
    "csv": Format("calibration.csv", "_csv", ("noise", *_FIELDS), mark="", counts=True),
}


def checked_options(name: str, given: Mapping[str, Any]) -> SimpleNamespace:
    """The options of a format, with defaults; an error if the format is unknown, or has no such option or value."""
    if name not in FORMATS:
        raise ExportError(f"unknown format {name!r}; expected one of {', '.join(FORMATS)}", code="format")
    own = FORMATS[name].options
    for key, value in given.items():
        if key not in own:
            known = [other for other, one in FORMATS.items() if key in one.options]
            has = f"it is for {', '.join(known)}" if known else f"its options are {', '.join(own)}" if own else "it has no options"
            raise ExportError(Message(f"{{option.{key}}} means nothing to {{name}}; {{has}}", name=name, has=has), code="no_such_option")
        check_option(key, value, ExportError)
    return SimpleNamespace(**{key: given.get(key, OPTIONS[key].default) for key in own})


def check_option(key: str, value: Any, error: type[JaxcalError]) -> None:
    """Raise an `error` if an option cannot have this value."""
    right = OPTIONS[key].right
    if not (value in right if isinstance(right, tuple) else right(value)):
        expected = " or ".join(right) if isinstance(right, tuple) else OPTIONS[key].expected
        raise error(Message(f"{{option.{key}:{{value}}}}: expected {{expected}}", value=str(value), expected=expected), code="option")
