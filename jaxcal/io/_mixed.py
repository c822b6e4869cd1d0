"""Refuse tables with more than one recording: alternating rows of several devices."""

import re
from typing import Any

import numpy as np

from .._errors import DataError
from .._message import Message
from ._columns import SENSORS, Raw
from ._names import plain
from ._readers._bounds import PIECE

#: names of columns that identify the device of a row, and names that may do so
_DEVICE = re.compile(r".*(?:device|sensor|node|mac|address|board|imu)(?:id|name|number|no|nr|index|type)?")
_PERHAPS = re.compile(
    r"id|type|source|name|tag|place|location|position|side|foot|limb|hand|leg|unit|channel|port|.*(?:subject|user|person)(?:id)?"
)
KINDS = 64
#: share of the rows at which the value changes; above it devices alternate, while a label of an activity changes seldom
TURNS = 0.2


def refuse_mixed(table, columns: dict[str, list[int]]) -> None:
    """Refuse alternating rows of several devices, whose time stamps and values belong to different sensors."""
    used = {i for indices in columns.values() for i in indices}
    chosen = [i for name in SENSORS for i in columns.get(name, ())]
    for i, column in enumerate(table.columns):
        if i in used or not chosen or column.dtype.kind not in "Oiuf" or i in table.clocks:
            continue
        values = column[:PIECE]
        if len(values) < 20:
            return
        name = plain(table.names[i])
        device, perhaps = bool(_DEVICE.fullmatch(name)), bool(_PERHAPS.fullmatch(name))
        if column.dtype.kind != "O" and not device and not perhaps and table.names[i]:
            continue
        code = _codes(values)
        kinds, turns = int(code.max()) + 1, np.diff(code) != 0
        if not 2 <= kinds <= KINDS or np.mean(turns) < TURNS:
            continue
        smooth = _smoother(table, chosen, code)
        # an id may also be a counter that starts again, so the values must confirm it
        often = np.mean(turns) > 0.9
        if smooth > 3.0 or (device and (smooth > 0.8 or often)) or (perhaps and kinds <= 8 and (smooth > 1.3 or (kinds <= 4 and often))):
            shown = ", ".join(sorted({f"{value:g}" if isinstance(value, float) else str(value) for value in values.tolist()})[:6])
            said = f"column {i} ({table.names[i] or 'no name'}) names {kinds} devices or sensors whose rows take turns ({shown})"
            raise DataError(f"{said}: keep the rows of one of them in a file and read that", code="mixed")


def own_rows(raw: Raw, time: np.ndarray | None, problems: list[Any]) -> tuple[Raw, np.ndarray | None]:
    """Leave out rows of other sensors, in which all chosen ones are empty; report sensors that no row holds together."""
    held = {name: np.any([np.isfinite(column) for column in raw[name]], axis=0) for name in SENSORS if name in raw}
    shares = {name: float(rows.mean()) for name, rows in held.items()}
    if not held or min(shares.values()) > 0.8:
        return raw, time
    names = [name for name, share in shares.items() if share > 0.1]
    if len(names) > 1 and not np.any(held[names[0]] & held[names[1]]):
        said = "no row holds both {one} and {two}, whose rows take turns; read them one by one, as with {option.columns:{one}=...}"
        problems.append(Message(said, one=names[0], two=names[1]))
    rows = np.any(list(held.values()), axis=0)
    if time is None or not rows.any() or rows.mean() > 0.8:
        return raw, time
    return {name: [column[rows] for column in columns] for name, columns in raw.items()}, time[rows]


def _codes(values: np.ndarray) -> np.ndarray:
    """Indices of the distinct values of a column; zeros if there are too many, or decimals among them."""
    if values.dtype.kind == "O":
        known: dict[str, int] = {}
        code = np.array([known.setdefault(str(value), len(known)) for value in values.tolist()])
        return code if len(known) <= KINDS else np.zeros_like(code)
    seen, code = np.unique(values, return_inverse=True)
    return code if len(seen) <= KINDS and np.array_equal(seen, np.round(seen)) else np.zeros_like(code)


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
