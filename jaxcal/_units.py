"""Units: text to SI factors, and the units in which noise coefficients are quoted.

jaxcal always computes in SI: rad/s, m/s^2, T, s, degC. The factors of the noise coefficients are those of IEEE Std 952 and of
inertial data sheets. A random walk coefficient N is two-sided; the "noise density" of a data sheet is one-sided and
sqrt(2) larger.
"""

import math
import re
from collections.abc import Sequence

from ._errors import UnitError

STANDARD_GRAVITY = 9.80665
EARTH_RATE = 7.292115e-5  # rad/s, of the Earth against the stars (WGS 84)
#: what there is on the surface of the Earth, in SI: gravity from the highest mountain at the equator to the poles, and the magnetic field
ON_EARTH = {"gravity": (9.76, 9.84), "field": (20e-6, 70e-6)}
#: SI, beyond the range of any sensor: larger readings are counts, or in another unit
BEYOND = {"mag": 1e-3, "accel": 4e3, "gyro": 1e3}
_DEG = math.pi / 180.0

#: quantity of a log or of a result -> {unit: SI value of one unit}; the first unit is the SI unit
_QUANTITIES: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "ps": 1e-12, "min": 60.0, "h": 3600.0, "d": 86400.0, "mjd": 86400.0},
    "gyro": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": _DEG, "mdeg/s": _DEG * 1e-3, "deg/h": _DEG / 3600.0, "rpm": 2.0 * math.pi / 60.0},
    "accel": {
        "m/s^2": 1.0, "mm/s^2": 1e-3, "cm/s^2": 1e-2, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY * 1e-3,
        "ug": STANDARD_GRAVITY * 1e-6, "ft/s^2": 0.3048,
    },
    "mag": {"T": 1.0, "mT": 1e-3, "uT": 1e-6, "nT": 1e-9, "G": 1e-4, "mG": 1e-7},
    "temperature": {"degC": 1.0, "K": 1.0, "degF": 5.0 / 9.0},
    "angle": {"rad": 1.0, "deg": _DEG, "mrad": 1e-3, "arcmin": _DEG / 60, "arcsec": _DEG / 3600},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "speed": {"m/s": 1.0, "cm/s": 1e-2},
    "frequency": {"Hz": 1.0, "mHz": 1e-3, "uHz": 1e-6, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9},
    "delay": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "gyro/accel": {"rad/s per m/s^2": 1.0, "deg/s/g": _DEG / STANDARD_GRAVITY, "deg/h/g": _DEG / 3600 / STANDARD_GRAVITY},
    "ratio": {"": 1.0, "%": 1e-2, "ppm": 1e-6, "ppb": 1e-9, "ppt": 1e-12},
    "gyro^2/Hz": {"(rad/s)^2/Hz": 1.0, "(deg/s)^2/Hz": _DEG**2, "(deg/h)^2/Hz": (_DEG / 3600) ** 2},
    "accel^2/Hz": {"(m/s^2)^2/Hz": 1.0, "mg^2/Hz": (STANDARD_GRAVITY * 1e-3) ** 2, "ug^2/Hz": (STANDARD_GRAVITY * 1e-6) ** 2},
    "mag^2/Hz": {"T^2/Hz": 1.0, "uT^2/Hz": 1e-12, "nT^2/Hz": 1e-18},
}  # fmt: skip
_OF_LOGS = ("time", "gyro", "accel", "mag", "temperature")
#: the Modified Julian Date counts from 1858-11-17, 40587 days before 1970
_OFFSETS = {"K": -273.15, "degF": -160.0 / 9.0, "mjd": -40587.0 * 86400.0}

#: spellings found in headers and on command lines -> the unit above
_SPELLINGS = {
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "msec": "ms", "millis": "ms", "usec": "us", "micros": "us",
    "nsec": "ns", "nanos": "ns", "hour": "h", "hours": "h", "day": "d", "days": "d",
    "rps": "rad/s", "rads": "rad/s", "rad_s": "rad/s", "radps": "rad/s", "rad/sec": "rad/s",
    "dps": "deg/s", "degs": "deg/s", "deg_s": "deg/s", "deg/sec": "deg/s", "degps": "deg/s", "\u00b0/s": "deg/s",
    "mdps": "mdeg/s", "dph": "deg/h", "deg/hr": "deg/h", "\u00b0/h": "deg/h",
    "m/s2": "m/s^2", "m/s/s": "m/s^2", "m/sec^2": "m/s^2", "m/sec2": "m/s^2",
    "m/s**2": "m/s^2", "m/s\u00b2": "m/s^2", "mps2": "m/s^2", "ms2": "m/s^2",
    "m_s2": "m/s^2", "m_s_2": "m/s^2", "ms-2": "m/s^2", "m s^-2": "m/s^2", "gal": "cm/s^2", "gs": "g", "gee": "g",
    "milli-g": "mg", "ft/s2": "ft/s^2",
    "tesla": "T", "ut": "uT", "\u00b5t": "uT", "\u03bct": "uT", "nt": "nT", "mt": "mT", "t": "T",
    "gauss": "G", "ga": "G", "mgauss": "mG", "mga": "mG", "milligauss": "mG",
    "c": "degC", "\u00b0c": "degC", "celsius": "degC", "degc": "degC", "k": "K", "kelvin": "K",
    "f": "degF", "\u00b0f": "degF", "degf": "degF", "fahrenheit": "degF",
}  # fmt: skip


def on_earth(quantity: str, value: float | int) -> bool:
    """Whether a place on the Earth has this "gravity" (m/s^2) or "field" (T).

    Examples
    --------
    >>> from jaxcal._units import on_earth
    >>> on_earth("gravity", 9.81), on_earth("gravity", 1.0), on_earth("field", 4.8e-5)
    (True, False, True)
    """
    low, high = ON_EARTH[quantity]
    return low <= float(value) <= high


def quantities() -> tuple[str, ...]:
    """Names of the physical quantities of a log: time, gyro, accel, mag, temperature."""
    return _OF_LOGS


def si_unit(quantity: str) -> str:
    """SI unit of a quantity, as text."""
    return next(iter(_QUANTITIES[quantity]))


def units_of(quantity: str) -> dict[str, float]:
    """Units of a quantity with the SI value of one.

    Examples
    --------
    >>> from jaxcal._units import units_of
    >>> units_of("accel")["g"]
    9.80665
    """
    return dict(_QUANTITIES[quantity])


def find_unit(text: str, quantity: str) -> str | None:
    """Canonical unit that `text` means for `quantity`, or None.

    Examples
    --------
    >>> from jaxcal._units import find_unit
    >>> find_unit("dps", "gyro"), find_unit("m/s2", "accel"), find_unit("dps", "accel")
    ('deg/s', 'm/s^2', None)
    """
    table = _QUANTITIES[quantity]
    text = re.sub(r"\s+", " ", text.strip())
    for candidate in (text, _SPELLINGS.get(text.lower(), "")):
        if candidate in table:
            return candidate
    lowered = {unit.lower(): unit for unit in table}
    # accept other cases only where they are unambiguous: mT and mt, G and g mean different things
    return lowered.get(text.lower()) if quantity in ("time", "gyro", "accel") else None


def factor(unit: str, quantity: str) -> float:
    """SI value of one `unit` of `quantity`; for temperature, of one degree (`to_si` adds the offset)."""
    found = find_unit(unit, quantity)
    if found is None:
        raise UnitError(f"{unit!r} is not a unit of {quantity}; use one of {', '.join(_QUANTITIES[quantity])}", code="unit_unknown")
    return _QUANTITIES[quantity][found]


def to_si(values, unit: str, quantity: str):
    """Convert values of `quantity` from `unit` to SI (rad/s, m/s^2, T, s, degC)."""
    scale = factor(unit, quantity)
    offset = _OFFSETS.get(find_unit(unit, quantity) or "", 0.0) if quantity in ("temperature", "time") else 0.0
    return values if scale == 1.0 and offset == 0.0 else values * scale + offset


#: (term, sensor) -> {unit: SI value of one unit}; the first entry is used for printing
_NOISE: dict[tuple[str, str], dict[str, float]] = {
    ("Q", "gyro"): {"arcsec": _DEG / 3600, "deg": _DEG, "rad": 1.0},
    ("N", "gyro"): {"deg/sqrt(h)": _DEG / 60, "deg/sqrt(s)": _DEG, "deg/s/sqrt(Hz)": _DEG, "rad/sqrt(s)": 1.0},
    ("B", "gyro"): {"deg/h": _DEG / 3600, "deg/s": _DEG, "rad/s": 1.0},
    ("K", "gyro"): {
        "deg/h/sqrt(s)": _DEG / 3600, "deg/h/sqrt(h)": _DEG * 3600**-1.5, "deg/h^(3/2)": _DEG * 3600**-1.5, "deg/s/sqrt(s)": _DEG,
        "rad/s/sqrt(s)": 1.0,
    },
    ("R", "gyro"): {"deg/h^2": _DEG / 3600**2, "deg/h/s": _DEG / 3600, "rad/s^2": 1.0},
    ("Q", "accel"): {"um/s": 1e-6, "m/s": 1.0},
    ("N", "accel"): {
        "m/s/sqrt(h)": 1 / 60, "ug/sqrt(Hz)": STANDARD_GRAVITY * 1e-6, "mg/sqrt(Hz)": STANDARD_GRAVITY * 1e-3, "m/s/sqrt(s)": 1.0,
        "m/s^2/sqrt(Hz)": 1.0,
    },
    ("B", "accel"): {"mg": STANDARD_GRAVITY * 1e-3, "ug": STANDARD_GRAVITY * 1e-6, "m/s^2": 1.0},
    ("K", "accel"): {"m/s/h^(3/2)": 3600**-1.5, "mg/sqrt(s)": STANDARD_GRAVITY * 1e-3, "m/s^2/sqrt(s)": 1.0},
    ("R", "accel"): {"mg/h": STANDARD_GRAVITY * 1e-3 / 3600, "m/s^3": 1.0},
    ("Q", "mag"): {"uT s": 1e-6, "T s": 1.0},
    ("N", "mag"): {"nT/sqrt(Hz)": 1e-9, "uT/sqrt(Hz)": 1e-6, "T/sqrt(Hz)": 1.0},
    ("B", "mag"): {"nT": 1e-9, "uT": 1e-6, "T": 1.0},
    ("K", "mag"): {"nT/sqrt(s)": 1e-9, "uT/sqrt(s)": 1e-6, "T/sqrt(s)": 1.0},
    ("R", "mag"): {"nT/h": 1e-9 / 3600, "uT/h": 1e-6 / 3600, "T/s": 1.0},
}  # fmt: skip


def noise_units(term: str, sensor: str) -> tuple[str, ...]:
    """Units in which a noise coefficient is quoted: first the printed one, last the SI unit. A user's term has "SI" only."""
    return tuple(_noise_table(term, sensor))


def noise_factor(term: str, sensor: str, unit: str) -> float:
    """SI value of one `unit`, as listed by `noise_units`, of the coefficient of a term.

    Examples
    --------
    9.07 m/s/h^(3/2) is 4.1991e-5 m/s^2/sqrt(s):

    >>> from jaxcal._units import noise_factor
    >>> round(9.07 * noise_factor("K", "accel", "m/s/h^(3/2)"), 9)
    4.1991e-05
    """
    table = _noise_table(term, sensor)
    if unit not in table:
        raise UnitError(f"{unit!r} is not a unit of {term} of a {sensor}; use one of {', '.join(table)}", code="unit_unknown")
    return table[unit]


def _noise_table(term: str, sensor: str) -> dict[str, float]:
    if ("N", sensor) not in _NOISE:
        raise UnitError(f"no noise units of sensor {sensor!r}; sensors are gyro, accel, mag", code="unit_unknown")
    return _NOISE.get((term, sensor), {"SI": 1.0})


#: quantity -> the unit in which every command, report and fleet shows it; quantities not listed are shown in SI
_SHOWN = {"gyro": "deg/s", "mag": "uT", "angle": "deg", "delay": "ms", "gyro/accel": "deg/s/g",
          "gyro^2/Hz": "(deg/h)^2/Hz", "accel^2/Hz": "mg^2/Hz", "mag^2/Hz": "nT^2/Hz"}  # fmt: skip


def _units_of(name: str) -> tuple[dict[str, float], str, str]:
    """Units of a quantity of a result, such as "gyro" or "N.gyro", the SI one and the usual one; any other text is a unit by itself."""
    term, _, sensor = name.partition(".")
    if sensor and ("N", sensor) in _NOISE:
        units = _noise_table(term, sensor)
        return units, [*units][-1], next(iter(units))
    units = _QUANTITIES.get(name, {name: 1.0})
    si = next(iter(units))
    return units, si, _SHOWN.get(name, si)


def si_unit_of(name: str) -> str:
    """SI unit of a quantity of a result, as text.

    Examples
    --------
    >>> from jaxcal._units import si_unit_of
    >>> si_unit_of("gyro"), si_unit_of("N.accel"), si_unit_of("angle"), si_unit_of("counts")
    ('rad/s', 'm/s^2/sqrt(Hz)', 'rad', 'counts')
    """
    return _units_of(name)[1]


def shown_in(name: str, wanted: Sequence[str] = ()) -> tuple[str, float]:
    """Unit in which a quantity of a result is shown, and its SI value: the first wanted unit that fits, or the usual one.

    Examples
    --------
    >>> from jaxcal._units import shown_in
    >>> shown_in("mag"), shown_in("mag", ["mg", "nT"]), shown_in("counts")
    (('uT', 1e-06), ('nT', 1e-09), ('counts', 1.0))
    """
    units, _, usual = _units_of(name)
    unit = next((one for one in wanted if one in units), usual)
    return unit, units[unit]


def known_units() -> set[str]:
    """All units in which a quantity of a result can be shown."""
    return {unit for table in (*_QUANTITIES.values(), *_NOISE.values()) for unit in table if unit}


def number(value: float, uncertainty: float) -> str:
    """A number with decimals down to the second digit of its uncertainty.

    Examples
    --------
    >>> from jaxcal._units import number
    >>> number(0.250131, 0.0004), number(7.6123, 1.5), number(1234.5, 300.0), number(-0.001, 0.5), number(2.5e-6, 1e-8)
    ('0.25013', '7.6', '1234', '0.00', '2.500e-06')
    """
    if not (math.isfinite(value) and math.isfinite(uncertainty) and uncertainty > 0):
        return f"{value:.4g}"
    decimals = max(0, 1 - math.floor(math.log10(uncertainty)))
    if decimals > 5 and abs(value) < 1e-3:
        return f"{value:.{max(0, math.floor(math.log10(max(abs(value), uncertainty))) + decimals)}e}"
    # adding zero turns a negative zero into zero
    return f"{round(value, min(decimals, 9)) + 0.0:.{min(decimals, 9)}f}"


def unit_label(unit: str) -> str:
    """A unit as pictures and pages print it: "deg/sqrt(h)" as °/√h, "m/s/h^(3/2)" as m/s/(h√h).

    "deg" alone stays, since ° alone is hard to see.
    """
    if unit == "deg":
        return unit
    for plain, pretty in (("h^(3/2)", "(h√h)"), ("^2", "²"), ("^3", "³"), ("deg", "°"), ("ug", "µg"), ("uT", "µT")):
        unit = unit.replace(plain, pretty)
    return re.sub(r"sqrt\(([^)]*)\)", r"√\1", unit)
