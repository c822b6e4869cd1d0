"""`columns=`, `units=` and `topics=` as given by a caller or typed on a command line."""

import re
from collections.abc import Mapping
from typing import Any

from .._errors import DataError, UnitError
from .._units import factor, find_unit, quantities, si_unit, to_si

SENSORS = ("gyro", "accel", "mag")
AXES = "xyz"

Column = int | str
#: quantity -> its columns (by number or name), or None to leave it out
Columns = dict[str, list[Column] | None]


def parse_columns(given: Mapping[str, Any] | str | None) -> Columns:
    """Columns by quantity, from a mapping or a string.

    Examples
    --------
    >>> from jaxcal.io._options import parse_columns
    >>> parse_columns("time=0,gyro=1:3,accel_x=ax,accel_y=ay,accel_z=az")
    {'time': [0], 'gyro': ['1:3'], 'accel': ['ax', 'ay', 'az']}
    >>> parse_columns({"time": None, "gyro": [1, 2, 3]})
    {'time': None, 'gyro': [1, 2, 3]}
    """
    found: Columns = {}
    axes: dict[str, dict[str, Column]] = {}
    for name, value in _pairs(given, "columns").items():
        values = None if value is None or value == "none" else [_column(v) for v in (value if isinstance(value, list | tuple) else [value])]
        sensor, _, axis = name.rpartition("_")
        if sensor in SENSORS and axis in AXES:
            if values is None or len(values) != 1:
                raise DataError(f"columns=: {name} is one column, but got {value!r}")
            axes.setdefault(sensor, {})[axis] = values[0]
        elif name in quantities():
            found[name] = values
        else:
            allowed = ", ".join(quantities())
            raise DataError(f"columns=: unknown quantity {name!r}; use {allowed}, or one axis as in gyro_x")
    for sensor, columns in axes.items():
        wanted = AXES[: len(columns)]
        if set(columns) != set(wanted):
            raise DataError(f"columns=: {sensor} has only {', '.join(sorted(columns))}; give x, or x and y, or all three axes")
        found[sensor] = [columns[axis] for axis in wanted]
    return found


def parse_units(given: Mapping[str, Any] | str | None) -> dict[str, str]:
    """Units by quantity; each is checked, and a bare number means SI units per count.

    Examples
    --------
    >>> from jaxcal.io._options import parse_units
    >>> parse_units("gyro=0.05 deg/s,accel=g")
    {'gyro': '0.05 deg/s', 'accel': 'g'}
    """
    found = {}
    for name, value in _pairs(given, "units").items():
        if name not in quantities():
            raise DataError(f"units=: unknown quantity {name!r}; use {', '.join(quantities())}")
        unit = f"{value:.17g} {si_unit(name)}" if isinstance(value, int | float) else str(value).strip()
        scale(unit, name)
        found[name] = unit
    return found


def parse_topics(given: Any) -> list[str] | None:
    """Topic names, from a list or a string with commas."""
    if given is None:
        return None
    topics = [t.strip() for t in given.split(",")] if isinstance(given, str) else [str(t) for t in given]
    if not all(topics):
        raise DataError(f"topics={given!r} holds an empty name")
    return topics


def scale(unit: str, quantity: str) -> tuple[float, float]:
    """Factor and offset from `unit`, which may carry a number ("0.05 deg/s"), to SI.

    Examples
    --------
    >>> from jaxcal.io._options import scale
    >>> scale("2 g", "accel")
    (19.6133, 0.0)
    """
    number, rest = 1.0, unit
    match = re.match(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*[ *]?\s*(.*)", unit)
    if match and find_unit(unit, quantity) is None:
        number, rest = float(match[1]), match[2] or si_unit(quantity)
    if number == 0.0:
        raise UnitError(f"units=: {unit!r} makes every value of {quantity} zero")
    try:
        return number * factor(rest, quantity), float(to_si(0.0, rest, quantity))
    except UnitError as error:
        raise UnitError(f"units=: {error}; raw counts need their size, as in units={{'{quantity}': '0.05 {si_unit(quantity)}'}}") from None


def _pairs(given: Mapping[str, Any] | str | None, option: str) -> dict[str, Any]:
    if given is None:
        return {}
    if isinstance(given, Mapping):
        return dict(given)
    if not isinstance(given, str):
        raise DataError(f"{option}= takes a dict or a string such as 'gyro=...', not {type(given).__name__}")
    found: dict[str, Any] = {}
    last = ""
    for part in given.split(","):
        name, equals, value = part.partition("=")
        if equals:
            last = name.strip()
            found[last] = value.strip()
        elif last and option == "columns":
            # a list: gyro=1,2,3
            before = found[last]
            found[last] = [*(before if isinstance(before, list) else [before]), part.strip()]
        else:
            raise DataError(f"{option}={given!r}: {part!r} is not of the form quantity=value")
    return found


def _column(value: Any) -> Column:
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise DataError(f"columns=: {value!r} is neither the number of a column (from 0) nor its name")
    return int(value) if isinstance(value, str) and value.isdecimal() else value
