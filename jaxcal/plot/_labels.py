"""Numbers and units as people read them: 7.6 °/h, 1.8×10⁻⁵ m/s²."""

import math

from .._units import noise_factor, noise_units

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def unit_label(unit: str) -> str:
    """A unit as it is printed.

    Examples
    --------
    >>> from jaxcal.plot._labels import unit_label
    >>> unit_label("deg/sqrt(h)"), unit_label("m/s/h^(3/2)"), unit_label("ug/sqrt(Hz)")
    ('°/√h', 'm/s/(h√h)', 'µg/√Hz')
    """
    for plain, pretty in (("h^(3/2)", "(h√h)"), ("^2", "²"), ("^3", "³"), ("deg", "°"), ("ug", "µg"), ("uT", "µT")):
        unit = unit.replace(plain, pretty)
    while "sqrt(" in unit:
        before, _, rest = unit.partition("sqrt(")
        inside, _, after = rest.partition(")")
        unit = f"{before}√{inside}{after}"
    return unit


def interval_labels(value: float, low: float, high: float) -> tuple[str, str, str]:
    """A value and its interval, all three down to the first digit of the half width: 2 to 4 digits of the value.

    Examples
    --------
    >>> from jaxcal.plot._labels import interval_labels
    >>> interval_labels(0.25013, 0.24961, 0.25064), interval_labels(7.61, 0.0, 9.2)
    (('0.2501', '0.2496', '0.2506'), ('7.6', '0', '9.2'))
    """
    half = (high - low) / 2
    digits = 3
    if 0 < value < math.inf and 0 < half < math.inf:
        digits = min(max(_power(value) - _power(half) + 1, 2), 4)

    def like(end: float) -> str:
        """As many decimals as the value has."""
        return number_label(end, digits + _power(end) - _power(value)) if 0 < end < math.inf and value > 0 else number_label(end)

    return number_label(value, digits), like(low), like(high)


def _power(value: float) -> int:
    return math.floor(math.log10(value))


def number_label(value: float, digits: int = 3) -> str:
    """A number with so many significant digits, with a power of ten only where it saves zeros.

    Examples
    --------
    >>> from jaxcal.plot._labels import number_label
    >>> number_label(0.24519), number_label(1.8e-7, 2), number_label(1e4), number_label(0.0)
    ('0.245', '1.8×10⁻⁷', '10000', '0')
    """
    if not math.isfinite(value):
        return "∞" if value > 0 else "\u2013"
    if value == 0:
        return "0"
    digits = max(digits, 1)
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    exponent = int(power)
    if -4 < exponent < 5:
        return f"{float(f'{mantissa}e{exponent}'):.{max(digits - 1 - exponent, 0)}f}"
    return f"{mantissa}\u00d710{str(exponent).translate(_SUPERSCRIPT)}"


def display_unit(term: str, sensor: str | None) -> tuple[float, str]:
    """SI value and label of the unit in which a coefficient is shown; (1, "") for a sensor that is not known."""
    if sensor is None:
        return 1.0, ""
    unit = noise_units(term, sensor)[0]
    return noise_factor(term, sensor, unit), unit_label(unit)


def duration_label(seconds: float) -> str:
    """A length of time in the unit that people would take.

    Examples
    --------
    >>> from jaxcal.plot._labels import duration_label
    >>> duration_label(0.5), duration_label(600.0), duration_label(10_000.0), duration_label(1e6), duration_label(float("inf"))
    ('0.5 s', '10 min', '2.8 h', '12 days', '∞')
    """
    if not math.isfinite(seconds):
        return "∞"
    for size, name in ((86400.0 * 365.25, "years"), (86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2 * size:
            return f"{_brief(seconds / size)} {name}"
    return f"{_brief(seconds)} s"


def _brief(value: float) -> str:
    return f"{value:.0f}" if value >= 9.95 else f"{value:.2g}"
