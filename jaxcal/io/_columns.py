"""Parse the options `columns=`, `units=`, `axes=` and `topics=`."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from .._errors import DataError, UnitError
from .._message import Message
from .._units import factor, find_unit, quantities, si_unit, to_si
from ._names import AXES, plain

SENSORS = ("gyro", "accel", "mag")
_LISTS = ("columns", "axes")  # options whose values are lists: gyro=1,2,3

#: quantity -> the readings of its columns
Raw = dict[str, list[np.ndarray]]
#: quantity -> its columns (by number or name), or None to leave it out
Columns = dict[str, list[int | str] | None]


def wrong(name: str, why: str) -> DataError:
    """Error for a wrong value of the option `name`, which is also its code."""
    return DataError(Message(f"{{option.{name}}}: {{why}}", why=why), code=name)


def parse_columns(given: Mapping[str, Any] | str | None) -> Columns:
    """Parse columns by quantity from a mapping or a string.

    Examples
    --------
    >>> from jaxcal.io._columns import parse_columns
    >>> parse_columns("time=0,gyro=1:3,accel=ax,ay,az")
    {'time': [0], 'gyro': ['1:3'], 'accel': ['ax', 'ay', 'az']}
    """
    found: Columns = {}
    for name, value in pairs(given, "columns").items():
        if name not in quantities():
            raise wrong("columns", f"unknown quantity {name!r}; use {', '.join(quantities())}")
        values = value if isinstance(value, list | tuple) else [value]
        found[name] = None if value in (None, "none", "None") else [_column(one) for one in values]
    return found


def parse_units(given: Mapping[str, Any] | str | None) -> dict[str, str]:
    """Parse and check units by quantity; a number without unit is the size of one count in SI."""
    found = {}
    for name, value in pairs(given, "units").items():
        if name not in quantities():
            raise wrong("units", f"unknown quantity {name!r}; use {', '.join(quantities())}")
        found[name] = f"{value:.17g} {si_unit(name)}" if isinstance(value, int | float) else str(value).strip()
        if name == "gyro" and found[name] in ("deg", "rad"):  # of angles, whose differences over time are rates
            found[name] += "/s"
        scale(found[name], name)
    return found


def parse_axes(given: Mapping[str, Any] | str | None) -> dict[str, list[str]]:
    """Parse the axes of sensors: x, y, z of the device as axes of the sensor.

    Examples
    --------
    >>> from jaxcal.io._columns import parse_axes
    >>> parse_axes("gyro=y,x,-z")
    {'gyro': ['y', 'x', '-z']}
    """
    found = {}
    for name, value in pairs(given, "axes").items():
        axes = [str(axis).strip().removeprefix("+") for axis in (value if isinstance(value, list | tuple) else [value])]
        if name not in SENSORS or sorted(axis.removeprefix("-") for axis in axes) != list(AXES):
            raise wrong("axes", f"{name}={value!r}; expected a sensor and its axes in the order of the device, such as gyro=y,x,-z")
        found[name] = axes
    return found


def in_axes(values: np.ndarray, axes: list[str]) -> np.ndarray:
    """Readings (n, 3) in the axes of the device."""
    return np.stack([-values[:, AXES.index(axis[1])] if axis.startswith("-") else values[:, AXES.index(axis)] for axis in axes], axis=1)


def parse_topics(given: Any) -> list[str] | None:
    """Parse topic names from a list or a comma-separated string."""
    if given is None:
        return None
    topics = [t.strip() for t in given.split(",")] if isinstance(given, str) else [str(t) for t in given]
    if not all(topics):
        raise wrong("topics", f"{given!r} holds an empty name")
    return topics


def scale(unit: str, quantity: str) -> tuple[float, float]:
    """Factor and offset that convert `unit`, which may begin with a number ("0.05 deg/s"), to SI."""
    number, rest = 1.0, unit
    match = re.match(r"\s*([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)\s*[ *]?\s*(.*)", unit)
    if match and find_unit(unit, quantity) is None:
        number, rest = float(match[1]), match[2] or si_unit(quantity)
    if number == 0.0:
        raise UnitError(Message("{option.units}: {unit!r} makes every value of {name} zero", unit=unit, name=quantity), code="units")
    try:
        return number * factor(rest, quantity), float(to_si(0.0, rest, quantity))
    except UnitError as error:
        said = "{option.units}: {error}; raw counts need their size, as in {option.units:{quantity}=0.05 {si}}"
        raise UnitError(Message(said, error=error, quantity=quantity, si=si_unit(quantity)), code="units") from None


def pairs(given: Mapping[str, Any] | str | None, option: str) -> dict[str, Any]:
    """Values by quantity, from a mapping or a string."""
    if given is None:
        return {}
    if isinstance(given, Mapping):  # "1,2" in a dictionary means the same as in a string
        return {name: value.split(",") if option in _LISTS and _is_list(value) else value for name, value in given.items()}
    if not isinstance(given, str):
        raise wrong(option, f"expected a dictionary or a string such as 'gyro=...', not {type(given).__name__}")
    found: dict[str, Any] = {}
    last = ""
    for part in given.split(","):
        name, equals, value = part.partition("=")
        if equals:
            last = name.strip()
            found[last] = value.strip()
        elif last and option in _LISTS:  # a list: gyro=1,2,3
            found[last] = [*(found[last] if isinstance(found[last], list) else [found[last]]), part.strip()]
        else:
            raise wrong(option, f"{part!r} has no quantity before it; expected such as gyro={part.strip()}")
    return found


def _is_list(value: Any) -> bool:
    """Whether a text is a list of column numbers, such as "1,2", or of axes, such as "x,-y,-z"."""
    return isinstance(value, str) and re.fullmatch(r"\d+(?:,\d+)+|[-+xyz]+(?:,[-+xyz]+)+", value) is not None


def _column(value: Any) -> int | str:
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise wrong("columns", f"{value!r} is neither the number of a column (from 0) nor its name")
    return int(value) if isinstance(value, str) and value.isdecimal() else value


def resolve(columns: Columns, names: list[str], count: int) -> dict[str, list[int]]:
    """Resolve the columns in `columns=` to column numbers; ``"1:3"`` means columns 1 to 3, inclusive."""
    found = {}
    for quantity, wanted in columns.items():
        if wanted is None:
            continue
        indices: list[int] = []
        for column in wanted:
            if isinstance(column, str) and column not in names and ":" in column:
                ends = [_find(int(part) if part.isdecimal() else part, names, count, quantity) for part in column.split(":")]
                indices += list(range(ends[0], ends[1] + 1)) if len(ends) == 2 else ends
            else:
                indices.append(_find(column, names, count, quantity))
        limit = {"time": 4, "temperature": 1}.get(quantity, 3)
        if not 1 <= len(indices) <= limit or len(set(indices)) != len(indices):
            raise wrong("columns", f"{quantity} got columns {indices}; give {'1 to 3' if limit == 3 else limit} different ones")
        found[quantity] = indices
    return found


def _find(column: int | str, names: list[str], count: int, quantity: str) -> int:
    if isinstance(column, int):
        if not -count <= column < count:
            raise wrong("columns", f"{quantity} wants column {column}; there are {listing(names, count)}")
        return column % count
    for form in (str, str.lower, plain):
        forms = [form(name) for name in names]
        if form(column) in forms:
            return forms.index(form(column))
    raise wrong("columns", f"there is no column {column!r} for {quantity}; there are {listing(names, count)}")


def listing(names: list[str], count: int) -> str:
    """List the columns of a table, for a message."""
    if any(names):
        shown = [f"{i} ({name})" for i, name in enumerate(names)]
        return ", ".join(shown[:24]) + (f" and {len(shown) - 24} more" if len(shown) > 24 else "")
    return f"{count} column{'s' * (count != 1)} without names, numbered from 0"
