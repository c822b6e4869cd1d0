"""Refuse tables with more than one recording: alternating rows of several devices, or sensors with different clocks."""

import re
from typing import Any

import numpy as np

from .._errors import DataError
from .._message import Message
from ._columns import SENSORS
from ._names import plain

#: names of columns that identify the device of a row, and names that may do so
_DEVICE = re.compile(r".*(?:device|sensor|node|mac|address|board|imu)(?:id|name|number|no|nr|index|type)?")
_PERHAPS = re.compile(
    r"id|type|source|name|tag|place|location|position|side|foot|limb|hand|leg|unit|channel|port|.*(?:subject|user|person)(?:id)?"
)
_LOOK, _MOST = 20_000, 64
#: share of the rows at which the value changes; above it devices alternate, while a label of an activity changes seldom
_TURNS = 0.2


def refuse_mixed(table, columns: dict[str, list[int]]) -> None:
    """Refuse alternating rows of several devices, whose time stamps and values belong to different sensors."""
    used = {i for indices in columns.values() for i in indices}
    chosen = [i for name in SENSORS for i in columns.get(name, ())]
    for i, column in enumerate(table.columns):
        if i in used or not chosen or column.dtype.kind not in "Oiuf" or i in table.clocks:
            continue
        values = column[:_LOOK]
        if len(values) < 20:
            return
        name = plain(table.names[i])
        device, perhaps = bool(_DEVICE.fullmatch(name)), bool(_PERHAPS.fullmatch(name))
        if column.dtype.kind != "O" and not device and not perhaps and table.names[i]:
            continue
        code = _codes(values)
        if code is None:
            continue
        kinds = int(code.max()) + 1
        turns = np.diff(code) != 0
        if not 2 <= kinds <= _MOST or np.mean(turns) < _TURNS:
            continue
        smooth = _smoother(table, chosen, code)
        # an id may also be a counter that starts again, so the values must confirm it
        if (
            smooth > 3.0
            or (device and (smooth > 0.8 or np.mean(turns) > 0.9))
            or (perhaps and kinds <= 8 and (smooth > 1.3 or (kinds <= 4 and np.mean(turns) > 0.9)))
        ):
            shown = ", ".join(sorted({f"{value:g}" if isinstance(value, float) else str(value) for value in values.tolist()})[:6])
            raise DataError(
                f"column {i} ({table.names[i] or 'no name'}) names {kinds} devices or sensors whose rows take turns ({shown}): they are "
                "recordings of their own, mixed in one table; keep the rows of one of them in a file and read that", code="mixed",
            )  # fmt: skip


def own_rows(
    raw: dict[str, list[np.ndarray]], time: np.ndarray | None, problems: list[Any]
) -> tuple[dict[str, list[np.ndarray]], np.ndarray | None]:
    """Leave out rows of other sensors, in which all chosen ones are empty; report sensors that no row holds together."""
    held = {name: np.any([np.isfinite(column) for column in raw[name]], axis=0) for name in SENSORS if name in raw}
    shares = {name: float(rows.mean()) for name, rows in held.items()}
    if not held or min(shares.values()) > 0.8:
        return raw, time
    names = [name for name, share in shares.items() if share > 0.1]
    if len(names) > 1 and not np.any(held[names[0]] & held[names[1]]):
        said = (
            "no row holds both {one} and {two}: the rows of several sensors take turns; read them one by one, as with "
            "{option.columns:{one}=...}"
        )
        problems.append(Message(said, one=names[0], two=names[1]))
    rows = np.any(list(held.values()), axis=0)
    if time is None or not rows.any() or rows.mean() > 0.8:
        return raw, time
    return {name: [column[rows] for column in columns] for name, columns in raw.items()}, time[rows]


def _codes(values: np.ndarray) -> np.ndarray | None:
    """Replace the values of a column by indices of its distinct values; None if there are too many."""
    if values.dtype.kind == "O":
        known: dict[str, int] = {}
        code = np.array([known.setdefault(str(value), len(known)) for value in values.tolist()])
        return code if len(known) <= _MOST else None
    if values.dtype.kind == "f" and not np.array_equal(values, np.round(values)):
        return None
    seen, code = np.unique(values, return_inverse=True)
    return code if len(seen) <= _MOST else None


def _smoother(table, chosen: list[int], code: np.ndarray) -> float:
    """Ratio of the typical step between rows to that between rows of one device; the median over the channels."""
    ratios = []
    for i in chosen:
        values = np.asarray(table.columns[i][: len(code)], np.float64)
        own = np.concatenate([np.abs(np.diff(values[code == k])) for k in range(int(code.max()) + 1)])
        all_rows, own = np.abs(np.diff(values)), own[np.isfinite(own)]
        all_rows = all_rows[np.isfinite(all_rows)]
        # not the median, because one of two devices may be dead
        if len(own) and len(all_rows) and (typical := np.quantile(own, 0.75)) > 0:
            ratios.append(float(np.quantile(all_rows, 0.75) / typical))
    return float(np.median(ratios)) if ratios else 1.0


def own_clocks(table, found, clock) -> Message | None:
    """Message on sensors with their own, different clocks, whose samples do not belong into one row; or None."""
    if clock is None or len(clock.columns) > 1:
        return None
    base = clock.columns[0]
    said = []
    for name in SENSORS:
        own = _clock_of_sensor(table, found, name)
        if own is None or own == base:
            continue
        column = table.columns[own]
        if column.dtype.kind not in "iufM" or (column.dtype.kind == "M") != (table.columns[base].dtype.kind == "M"):
            continue
        if not _same(column, table.columns[base]):
            said.append((name, table.names[own]))
    if not said:
        return None
    text = (
        "the sensors of the table have clocks of their own, which differ ({clocks}; the others by {base}): what stands in one row was not "
        "sampled together; read them one by one, as with {option.columns:time={clock},{name}=...}"
    )
    clocks = ", ".join(f"{name} by {own}" for name, own in said)
    return Message(text, clocks=clocks, base=table.names[base], clock=said[0][1], name=said[0][0])


def _clock_of_sensor(table, found, name: str) -> int | None:
    """The time column that is named after a sensor, or None."""
    if name not in found.columns:
        return None
    word = {"gyro": "gyr", "accel": "acc", "mag": "mag"}[name]
    for i, text in enumerate(table.names):
        low = re.sub(r"[\[(].*?[\])]", "", text).lower()
        named = re.search(rf"(?<![a-z]){word}", low) or (low.startswith(("time", "t_")) and word in low)
        if named and re.search(r"time|stamp|(?<![a-z])t(?:s|_us|_ms|_ns)?(?![a-z])", low) and not _is_read(found, i):
            return i
    return None


def _is_read(found, index: int) -> bool:
    """Whether a column is read as part of a sensor."""
    return any(index in found.columns.get(name, ()) for name in SENSORS)


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two columns of time stamps agree up to a constant and to small differences compared with a step."""
    if one.dtype.kind == "M":
        one, other = one.astype(np.int64), other.astype(np.int64)
    one, other = one.astype(np.float64), other.astype(np.float64)
    both = np.isfinite(one) & np.isfinite(other)
    if np.mean(both) < 0.95:
        return bool(np.mean(np.isfinite(one) == np.isfinite(other)) > 0.95)
    steps = np.diff(one[both])
    steps = steps[steps > 0]
    if not len(steps):
        return True
    apart = one[both] - other[both]
    apart = apart - np.median(apart)
    return bool(np.quantile(np.abs(apart), 0.95) < 2.0 * np.median(steps))
