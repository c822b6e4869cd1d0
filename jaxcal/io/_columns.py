"""Which column holds what, in which unit: as `columns=`, `units=` and `topics=` say, or as the names of the columns tell."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from .._errors import DataError, UnitError
from .._units import factor, find_unit, quantities, si_unit, to_si

SENSORS = ("gyro", "accel", "mag")
AXES = "xyz"

#: quantity -> its columns (by number or name), or None to leave it out
Columns = dict[str, list[int | str] | None]

_TIME = {"t", "time", "timestamp", "timestamps", "stamp", "ts", "clock", "elapsed", "elapsedtime", "datetime", "utc"}
#: names that are a unit at the same time
_TIME_UNITS = {
    "s": "s", "sec": "s", "secs": "s", "seconds": "s", "ms": "ms", "msec": "ms", "millis": "ms", "milliseconds": "ms",
    "us": "us", "usec": "us", "micros": "us", "microseconds": "us",
    "ns": "ns", "nsec": "ns", "nsecs": "ns", "nanosec": "ns", "nanos": "ns", "nanoseconds": "ns",
}  # fmt: skip
_SENSOR = {
    "gyro": re.compile("g|gyr|gyro|gyros|gyroscope|w|omega|angularvelocity|angvel|rate|angularrate|wrss"),
    "accel": re.compile("a|acc|accel|accelerometer|acceleration|f|specificforce|linearacceleration|linacc|arss"),
    "mag": re.compile("m|mag|magn|magnetometer|b|field|magneticfield"),
}
_TEMPERATURE = {"temp", "temperature", "imutemp", "imutemperature"}
#: words that say where a column comes from, not what it is
_NOISE_WORDS = re.compile(r"imu\d*|field|header|msg|data|sensor|raw|cal|uncal|value")
_COUNTER = re.compile(r"index|idx|i|n|id|no|row|line|seq|frame|counter|count|packetcounter|packet|sample|samples|samplenumber")


def parse_columns(given: Mapping[str, Any] | str | None) -> Columns:
    """Columns by quantity, from a mapping or a string.

    Examples
    --------
    >>> from jaxcal.io._columns import parse_columns
    >>> parse_columns("time=0,gyro=1:3,accel_x=ax,accel_y=ay,accel_z=az")
    {'time': [0], 'gyro': ['1:3'], 'accel': ['ax', 'ay', 'az']}
    """
    found: Columns = {}
    axes: dict[str, dict[str, int | str]] = {}
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
            raise DataError(f"columns=: unknown quantity {name!r}; use {', '.join(quantities())}, or one axis as in gyro_x")
    for sensor, columns in axes.items():
        wanted = AXES[: len(columns)]
        if set(columns) != set(wanted):
            raise DataError(f"columns=: {sensor} has only {', '.join(sorted(columns))}; give x, or x and y, or all three axes")
        found[sensor] = [columns[axis] for axis in wanted]
    return found


def parse_units(given: Mapping[str, Any] | str | None) -> dict[str, str]:
    """Units by quantity; each is checked, and a bare number means SI units per count."""
    found = {}
    for name, value in _pairs(given, "units").items():
        if name not in quantities():
            raise DataError(f"units=: unknown quantity {name!r}; use {', '.join(quantities())}")
        found[name] = f"{value:.17g} {si_unit(name)}" if isinstance(value, int | float) else str(value).strip()
        scale(found[name], name)
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
    """Factor and offset from `unit`, which may carry a number ("0.05 deg/s"), to SI."""
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
        elif last and option == "columns":  # a list: gyro=1,2,3
            found[last] = [*(found[last] if isinstance(found[last], list) else [found[last]]), part.strip()]
        else:
            raise DataError(f"{option}={given!r}: {part!r} is not of the form quantity=value")
    return found


def _column(value: Any) -> int | str:
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise DataError(f"columns=: {value!r} is neither the number of a column (from 0) nor its name")
    return int(value) if isinstance(value, str) and value.isdecimal() else value


def bracketed_unit(name: str) -> str | None:
    """Text in the brackets of a column name, or None."""
    match = re.search(r"\[([^\]]*)\]|\(([^)]*)\)", name)
    return match and (match[1] if match[1] is not None else match[2]).strip()


def unit_of(text: str, quantity: str) -> str | None:
    """Unit that a header spells, or None; exponents such as ``rad s^-1`` and ``m s-2`` are understood."""
    if quantity == "mag" and text.strip() == "g":
        return "G"
    text = text.replace("\u207b\u00b9", "-1").replace("\u207b\u00b2", "-2").replace("\u00b7", " ").replace("*", " ")
    text = re.sub(r"[ _.]s(ec)?\^?\(?-1\)?$", "/s", text.strip())
    text = re.sub(r"[ _.]s(ec)?\^?\(?-2\)?$", "/s^2", text)
    return find_unit(text, quantity)


def parse_name(name: str) -> tuple[str, str, str | None] | None:
    """Quantity, axis (x, y, z, or "" where there is none; "nsec" for the second half of a stamp) and unit of a column name.

    Examples
    --------
    >>> from jaxcal.io._columns import parse_name
    >>> parse_name("gyro_x_dps"), parse_name("a_RS_S_z [m s^-2]"), parse_name("TimeUS"), parse_name("Notes")
    (('gyro', 'x', 'deg/s'), ('accel', 'z', 'm/s^2'), ('time', '', 'us'), None)
    """
    inside = bracketed_unit(name)
    bare = re.sub(r"\[[^\]]*\]|\([^)]*\)", " ", name)
    words = [word.lower() for word in re.findall(r"[0-9A-Za-z\u00b0\u00b5\u03bc]+", bare)]
    while words:
        found = _time(words) or _sensor(words) or _temperature(words)
        if found:
            quantity, axis, unit = found
            return quantity, axis, (unit_of(inside, quantity) if inside else None) or unit
        # an origin may stand before the name, or among its words
        at = next((i for i, word in enumerate(words) if _NOISE_WORDS.fullmatch(word)), None)
        if at is None:
            return None
        del words[at]
    return None


def _time(words: list[str]) -> tuple[str, str, str | None] | None:
    joined, head, last = "".join(words), "".join(words[:-1]), words[-1]
    if joined == "sampletimefine":
        return "time", "", "1e-4 s"
    if joined in _TIME:
        return "time", "", None
    # a column that is called "s" is something else
    if last in _TIME_UNITS and (head in _TIME or (not head and last != "s")):
        return "time", "nsec" if last in ("nsec", "nsecs", "nanosec") else "", _TIME_UNITS[last]
    match = re.fullmatch(r"(?:time|timestamp|timestamps?ample)(us|ms|ns|sec|s)", joined)
    return ("time", "", _TIME_UNITS[match[1]]) if match else None


def _sensor(words: list[str]) -> tuple[str, str, str | None] | None:
    for sensor, bases in _SENSOR.items():
        for end in range(len(words), 0, -1):
            head, tail = "".join(words[:end]), words[end:]
            unit = next((u for glue in ("_", "/", " ") if (u := unit_of(glue.join(tail), sensor))), None) if tail else None
            if tail and unit is None:
                continue
            if head[-1] in AXES and bases.fullmatch(head[:-1]):
                return sensor, head[-1], unit
            if head[0] in AXES and len(head) > 3 and bases.fullmatch(head[1:]):
                return sensor, head[0], unit
        # the unit may stand before the axis: gyro_dps_x
        if len(words) == 3 and words[2] in tuple(AXES) and bases.fullmatch(words[0]) and unit_of(words[1], sensor):
            return sensor, words[2], unit_of(words[1], sensor)
    return None


def _temperature(words: list[str]) -> tuple[str, str, str | None] | None:
    joined = "".join(words)
    if joined in _TEMPERATURE:
        return "temperature", "", None
    unit = unit_of(words[-1], "temperature")
    if unit and ("".join(words[:-1]) in _TEMPERATURE or words[:-1] == ["t"]):
        return "temperature", "", unit
    return ("temperature", "", "degC") if joined == "tempc" else None


def resolve(columns: Columns, names: list[str], count: int) -> dict[str, list[int]]:
    """Numbers of the columns that `columns=` names; ``"1:3"`` is the range from 1 to 3, ends included."""
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
        limit = {"time": 2, "temperature": 1}.get(quantity, 3)
        if not 1 <= len(indices) <= limit or len(set(indices)) != len(indices):
            raise DataError(f"columns=: {quantity} got columns {indices}; give {'1 to 3' if limit == 3 else limit} different ones")
        found[quantity] = indices
    return found


def _find(column: int | str, names: list[str], count: int, quantity: str) -> int:
    if isinstance(column, int):
        if not -count <= column < count:
            raise DataError(f"columns=: {quantity} wants column {column}; there are {listing(names, count)}")
        return column % count
    for form in (str, str.lower, _plain):
        forms = [form(name) for name in names]
        if form(column) in forms:
            return forms.index(form(column))
    raise DataError(f"columns=: there is no column {column!r} for {quantity}; there are {listing(names, count)}")


def _plain(name: str) -> str:
    return re.sub(r"[\[(].*?[\])]|[^0-9a-z]", "", name.lower())


def listing(names: list[str], count: int) -> str:
    """The columns of a table, for a message."""
    if any(names):
        shown = [f"{i} ({name})" for i, name in enumerate(names)]
        return ", ".join(shown[:24]) + (f" and {len(shown) - 24} more" if len(shown) > 24 else "")
    return f"{count} column{'s' * (count != 1)} without names, numbered from 0"


def by_name(names: list[str]) -> tuple[dict[str, list[int]], dict[str, str]]:
    """Columns and units that the names tell: first match wins."""
    found: dict[tuple[str, str], int] = {}
    units: dict[str, str] = {}
    for i, name in enumerate(names):
        parsed = parse_name(name)
        if parsed and parsed[:2] not in found:
            quantity, axis, unit = parsed
            found[quantity, axis] = i
            if unit and axis != "nsec":
                units.setdefault(quantity, unit)
    lowered = [_plain(name) for name in names]
    if ("gyro", "x") not in found and all(axis in lowered for axis in "pqr"):
        found |= {("gyro", axis): lowered.index(name) for axis, name in zip(AXES, "pqr", strict=True)}

    columns: dict[str, list[int]] = {}
    if ("time", "") in found:
        columns["time"] = [found["time", ""]]
        if ("time", "nsec") in found and units.get("time") == "s":
            columns["time"].append(found["time", "nsec"])
    elif ("time", "nsec") in found:
        columns["time"], units["time"] = [found["time", "nsec"]], "ns"
    for sensor in SENSORS:
        axes = [axis for axis in AXES if (sensor, axis) in found]
        if axes and axes != list(AXES[: len(axes)]):
            raise DataError(
                f"only the axes {', '.join(axes)} of {sensor} are recognised in the columns {listing(names, len(names))}; "
                f"name them with columns={{'{sensor}': [...]}} (--columns {sensor}=...)"
            )
        if axes:
            columns[sensor] = [found[sensor, axis] for axis in axes]
    if ("temperature", "") in found:
        columns["temperature"] = [found["temperature", ""]]
    return columns, units


def increasing(values: np.ndarray) -> bool:
    """Whether a column rises as time does: nearly all steps up."""
    steps = np.diff(values)
    return bool(len(steps) and np.count_nonzero(np.greater(steps, steps.dtype.type(0))) >= 0.95 * len(steps))


def is_counter(name: str) -> bool:
    """Whether a name is that of a row or packet counter, which is no time."""
    return bool(_COUNTER.fullmatch(_plain(name)))
