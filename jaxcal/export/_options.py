"""Shared by the formats: the result of a writer, and conversion of numbers to and from text."""

import math
from typing import Any, NamedTuple

import numpy as np

from .._answer import Finding
from .._errors import DataError, ExportError
from .._message import printable
from ..calibration._codec import LARGEST

#: term of the noise -> sensor -> SI unit of a filter's number for it
UNITS = {
    "N": {"gyro": "rad/s/sqrt(Hz)", "accel": "m/s^2/sqrt(Hz)"},
    "K": {"gyro": "rad/s^2/sqrt(Hz)", "accel": "m/s^3/sqrt(Hz)"},
}


class Product(NamedTuple):
    """Result of a writer: the text or bytes, findings, and facts for the comments."""

    content: Any
    findings: list[Finding]
    facts: tuple[str, ...] = ()


def plain(value: float | int, digits: int = 9) -> str:
    """Format with nine digits, exact for float32, without negative zero; refuse a value outside the range of float32."""
    if isinstance(value, int):
        return str(value)
    if not abs(value) < np.finfo(np.float32).max:
        raise ExportError(f"{value} cannot be written as a 32-bit number; look at the calibration it comes from", code="too_large")
    return f"{value + 0.0:.{digits}g}"


def number(value: float | int, digits: int = 9) -> str:
    """Format like `plain`, but with a decimal point: "4.0e-06", because YAML readers take `4e-06` for a string."""
    text = plain(float(value), digits)
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
    r"""Format a text as one comment line, which ends there in any language: in C, a backslash at its end takes the next line with it.

    Examples
    --------
    >>> from jaxcal.export._options import comment
    >>> print(comment("IMU" + chr(27) + chr(10) + "left" + chr(92), "//"))
    // IMU left\.
    """
    line = printable(" ".join(text.split()))
    return f"{mark} {line}" + "." * line.endswith(("\\", "??/"))


def finite(text: str, what: str) -> float:
    """Convert a text to a number; refuse a text that is not a plausible number. `what` names it in the message."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) < LARGEST:
        raise DataError(f"{what} is {text!r:.80}; expected a number", code="unreadable")
    return value
