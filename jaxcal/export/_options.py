"""Shared by the formats: the user's options, the result of a writer, and conversion of numbers to and from text."""

import dataclasses
import math
from typing import Any

import equinox as eqx
import numpy as np

from .._errors import DataError, ExportError
from .._message import Message
from .._units import STANDARD_GRAVITY

#: a filter's name for a noise term -> sensor -> SI unit
UNITS = {
    "density": {"gyro": "rad/s/sqrt(Hz)", "accel": "m/s^2/sqrt(Hz)"},
    "random_walk": {"gyro": "rad/s^2/sqrt(Hz)", "accel": "m/s^3/sqrt(Hz)"},
}
SENSORS = {"gyro": "gyroscope", "accel": "accelerometer"}
_CHOICES = {
    "axis": {"worst": "the largest of the three axes", "rms": "their root mean square"},
    "convention": {"midpoint": "N sqrt(2 rate)", "per_sample": "N sqrt(rate)"},
    "model": {"kalibr": "lower triangles", "rpng": "upper triangles"},
    "frame": {"up": "z up", "down": "z down"},
    "flavour": {
        "ros2": "parameters of a ROS 2 node", "imu_calib": "dpkoch/imu_calib", "dlio": "direct_lidar_inertial_odometry",
        "madgwick": "imu_filter_madgwick",
    },
}  # fmt: skip
INSTANCE = "the number of the sensor on its vehicle, from 0"
_LARGEST = 3e38  # of float32
LARGEST_READ = 1e15  # a larger number means that the file is damaged


class Options(eqx.Module):
    """Options of all formats; see `jaxcal.export.write`."""

    topic: str = "/imu0"
    axis: str = "worst"
    inflate: float | int = 1.0
    density: Any = "upper_limit"
    random_walk: Any = "upper_limit"
    rate: Any = None
    gravity: float | int = STANDARD_GRAVITY
    convention: str = "midpoint"
    model: str = "kalibr"
    frame: str = "up"
    flavour: str = "ros2"
    instance: int = 0
    gyro_bias: bool = False
    prefix: str = "JAXCAL_"
    accumulator: bool = False

    def __check_init__(self):
        for name, known in _CHOICES.items():
            self._check(name, getattr(self, name) in known, " or ".join(f'"{key}" ({text})' for key, text in known.items()))
        self._check("inflate", is_positive(self.inflate), "a number above 0 by which the noise is multiplied")
        self._check("rate", self.rate is None or is_positive(self.rate), "the true sampling rate of the sensor in Hz")
        self._check("gravity", is_positive(self.gravity), "the local gravity in m/s^2")
        self._check("instance", is_instance(self.instance), INSTANCE)
        self._check("prefix", self.prefix.isascii() and self.prefix.isidentifier(), 'the beginning of a name in C, such as "JAXCAL_"')
        for quantity in UNITS:
            asked = getattr(self, quantity)
            for sensor, value in (asked if isinstance(asked, dict) else dict.fromkeys(SENSORS, asked)).items():
                if sensor not in SENSORS:
                    raise ExportError(f"{quantity} names {sensor!r}; expected {' or '.join(SENSORS)}", code="option")
                if value not in (None, "upper_limit") and not is_positive(value):
                    raise ExportError(
                        f'{quantity}={value!r}: expected "upper_limit", a number above 0, or one of these for each sensor as '
                        '{"gyro": ..., "accel": ...}',
                        code="option",
                    )

    def _check(self, name: str, right: bool, expected: str) -> None:
        if not right:
            template = f"{{option.{name}:{{value}}}}: expected {{expected}}"
            raise ExportError(Message(template, value=str(getattr(self, name)), expected=expected), code="option")

    def chosen(self) -> list[str]:
        """Names of the options that differ from their defaults."""
        return [field.name for field in dataclasses.fields(self) if getattr(self, field.name) != field.default]


class Product(eqx.Module):
    """Result of a writer: the text (or bytes, or a dictionary file suffix -> text), warnings, and facts for the comments."""

    content: Any
    warnings: tuple[str, ...] = ()
    facts: tuple[str, ...] = ()


def is_positive(value: Any) -> bool:
    """Whether a value is a finite number above 0."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value) and value > 0


def is_instance(value: Any) -> bool:
    """Whether a value is a valid index of a sensor on its vehicle."""
    return not isinstance(value, bool) and 0 <= value <= 4


def plain(value: float | int, digits: int = 9) -> str:
    """Format with nine digits, exact for float32, without negative zero; refuse a value outside the range of float32."""
    if isinstance(value, int):
        return str(value)
    if not (math.isfinite(value) and abs(value) < _LARGEST):
        raise ExportError(
            f"{value} cannot be written: the tool reads it as a 32-bit number; look at the calibration it comes from", code="too_large"
        )
    return f"{value + 0.0:.{digits}g}"


def number(value: float | int) -> str:
    """Format like `plain`, but with a decimal point: "4.0e-06", because YAML readers take `4e-06` for a string."""
    text = plain(float(value))
    if "." in text:
        return text
    mantissa, exponent, power = text.partition("e")
    return f"{mantissa}.0{exponent}{power}"


def numbers(values: Any) -> str:
    """Format the numbers of a vector or matrix, row by row, separated by commas."""
    return ", ".join(number(float(value)) for value in np.ravel(values))


def listed(values: Any) -> str:
    """Format numbers as a list for YAML and Python."""
    return f"[{numbers(values)}]"


def comment(text: str, mark: str = "#") -> str:
    """Format a text as one comment line; line breaks become spaces."""
    return f"{mark} {' '.join(text.split())}"


def finite(text: str, what: str) -> float:
    """Convert a text to a number; refuse a text that is not a plausible number. `what` names it in the message."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) < LARGEST_READ:
        raise DataError(f"{what} is {text!r:.80}; expected a number", code="unreadable")
    return value
