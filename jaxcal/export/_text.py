"""Numbers and comments as other tools read them."""

from collections.abc import Iterable


def number(value: float | int) -> str:
    """Nine digits, exact for float32, with a point: YAML readers take `4e-06` for a word.

    Examples
    --------
    >>> from jaxcal.export._text import number
    >>> number(4e-6), number(200), number(0.0021)
    ('4.0e-06', '200.0', '0.0021')
    """
    text = f"{value:.9g}"
    if "." in text:
        return text
    mantissa, exponent, power = text.partition("e")
    return f"{mantissa}.0{exponent}{power}"


def numbers(values: Iterable[float]) -> str:
    """Numbers separated by commas."""
    return ", ".join(number(float(value)) for value in values)


def comment(text: str, mark: str = "#") -> str:
    """One line of comment, whatever the text holds."""
    return f"{mark} {' '.join(text.split())}"
