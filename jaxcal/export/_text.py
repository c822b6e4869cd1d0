"""Numbers and comments as other tools read them."""

import math
from collections.abc import Iterable

from .._errors import ExportError

_LARGEST = 3e38  # float32


def plain(value: float | int, digits: int = 9) -> str:
    """Nine digits, exact for float32, and no negative zero.

    Raises
    ------
    ExportError
        If the value is NaN, infinite, or more than float32 holds.
    """
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
