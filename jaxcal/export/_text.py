"""Numbers and comments as other tools read them, and numbers as they are read back."""

import math
from collections.abc import Iterable

from .._errors import DataError, ExportError

_LARGEST = 3e38  # float32
LARGEST_READ = 1e15  # a number above this is damage


def plain(value: float | int, digits: int = 9) -> str:
    """Nine digits, exact for float32, and no negative zero; an error where float32 does not hold the value."""
    if isinstance(value, int):
        return str(value)
    if not (math.isfinite(value) and abs(value) < _LARGEST):
        raise ExportError(f"{value} cannot be written: the tool reads it as a 32-bit number; look at the calibration it comes from")
    return f"{value + 0.0:.{digits}g}"


def number(value: float | int) -> str:
    """Nine digits, exact for float32, with a point: YAML readers take `4e-06` for a word.

    Examples
    --------
    >>> from jaxcal.export._text import number
    >>> number(4e-6), number(200), number(0.0021)
    ('4.0e-06', '200.0', '0.0021')
    """
    text = plain(float(value))
    if "." in text:
        return text
    mantissa, exponent, power = text.partition("e")
    return f"{mantissa}.0{exponent}{power}"


def numbers(values: Iterable[float]) -> str:
    """Numbers separated by commas."""
    return ", ".join(number(float(value)) for value in values)


def listed(values: Iterable[float]) -> str:
    """Numbers as a list in YAML and Python."""
    return f"[{numbers(values)}]"


def comment(text: str, mark: str = "#") -> str:
    """One line of comment, whatever the text holds."""
    return f"{mark} {' '.join(text.split())}"


def finite(text: str, what: str) -> float:
    """The number that a text is; an error where it is none, or none that a calibration can have. `what` says where it stands."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) < LARGEST_READ:
        raise DataError(f"{what} is {text!r:.80}; expected a number")
    return value
