"""Read tables of turntable readings with one row per position, and raw logs with the table angle."""

import csv
import dataclasses
import re
from pathlib import Path
from typing import Any

from .._answer import NOTE, Finding, Kind, table
from .._errors import DataError
from .._units import factor, find_unit, shown_in
from ._options import Part, read_log

_NAMES = {
    "angle": ("angle", "table_angle", "tau", "azimuth_of_table"),
    "mounting": ("mounting", "mount", "axis"),
    "dwell": ("dwell", "duration", "time_on_position"),
    "start": ("start", "time", "t"),
    "accel": ("accel", "acceleration", "specific_force", "a"),
    "gyro": ("gyro", "rate", "angular_rate", "w"),
}
_HEADER = re.compile(r"\s*([A-Za-z_ ]+?)\s*(?:[\[(]\s*(.+?)\s*[\])])?\s*")
_EXPECTED = "expected a header such as: angle [deg],mounting,dwell [s],accel [m/s^2],gyro [deg/h]"


FINDINGS = table(
    angle_column=Kind(NOTE, "The table's angle is column {column!r}, in {unit}."),
    angle_unit=Kind(NOTE, "The table's angle is column {column!r}; its name has no unit, and it is taken as deg.", guess=True),
    unused=Kind(NOTE, "Column {column!r} is not used."),
    no_unit=Kind(NOTE, "Column {column} has no unit in its header and is taken as {unit}.", guess=True),
    no_column=Kind(NOTE, "There is no column {column}: {value} is taken at every position.", guess=True),
)

#: a table with more rows and without dwells and mountings is a log
_MOST = 200


@dataclasses.dataclass(frozen=True)
class ReadingsTable:
    """A table of readings, with what a recording has: columns in SI by name, findings, provenance, and no evidence."""

    values: dict[str, Any]
    findings: tuple[Finding, ...]
    provenance: dict[str, Any]
    evidence: tuple[Any, ...] = ()

    def head(self) -> str:
        """Number of positions, and time at them."""
        return f"{len(self.values['angle'])} positions, {sum(self.values['dwell']):g} s in all"

    summary = head

    def _replaced(self, **changes: Any) -> "ReadingsTable":
        return dataclasses.replace(self, **changes)


def holds_positions(path: Path, sure: bool = False) -> bool:
    """Whether a file is a table with one row per position rather than a log; if `sure`, its header must say so."""
    if not path.is_file() or not path.stat().st_size:  # pipes, and files of the kernel, block
        return False
    if path.suffix.lower() not in (".csv", ".txt", ".tsv", ""):
        return False
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = [line for _, line in zip(range(_MOST + 2), file, strict=False) if line.strip() and not line.lstrip().startswith("#")]
    except UnicodeDecodeError:
        return False
    names = set() if not lines else {_named(cell)[0] for cell in next(csv.reader(lines[:1]))}
    return bool({"dwell", "mounting"} & names) or (len(lines) <= _MOST and (not sure or "angle" in names))


def _named(cell: str) -> tuple[str | None, str | None]:
    """The quantity named in a cell of the header, and the unit in its brackets."""
    found = _HEADER.fullmatch(" ".join(cell[:200].split()))
    word, unit = (found.group(1).lower().replace(" ", "_"), found.group(2)) if found else ("", None)
    return next((name for name, words in _NAMES.items() if word in words), None), unit


def read_table_log(path: Path, options: Part, column: str | None) -> tuple[Any, Any]:
    """Read a raw log; return it, and the table angle of its samples in rad (None without such a column)."""
    log = read_log(path, options, "north")
    cell = _angle_cell(path, column)
    if cell is None:
        return log, None
    values = column_of(path, options, cell, len(log.time), "deg")
    unit = _named(cell)[1]
    said = FINDINGS("angle_column" if unit else "angle_unit", column=cell, unit=unit)
    return log._replaced(findings=(*log.findings, said)), values


def column_of(path: Path, options: Part, cell: str, count: int, unit: str | None) -> Any:
    """Read a column that is not a sensor quantity, (count,), on the samples of the log.

    If `unit` is "deg", the column has angles in the unit in brackets in its name, or else in degrees; they are returned in rad.
    """
    import jaxcal

    from ..io._columns import parse_columns, parse_units

    scale = 1.0 if unit is None else _angle(path, _named(cell)[1] or unit)
    # a log cannot hold such a column, so read it as a temperature, the only quantity without axes, on the same grid
    columns = {name: one for name, one in parse_columns(",".join(options.columns or ()) or None).items() if name == "time"}
    units = {name: one for name, one in parse_units(",".join(options.units or ()) or None).items() if name == "time"}
    found = jaxcal.read(
        path, columns=columns | {"temperature": cell}, units=units | {"temperature": "degC"}, quiet=True, format=options.format,
        rate=options.rate, missing=options.missing,
    )  # fmt: skip
    if options.start is not None or options.stop is not None:
        found = found.select(options.start, options.stop)
    values = found.temperature
    if values is None or len(values) != count:
        raise DataError(f"{path}: column {cell!r} is not on the samples of the sensors; give one row per sample")
    return values * scale


def _angle(path: Path, unit: str) -> float:
    """SI value of a unit of angles."""
    known, size = shown_in("angle", [unit])
    if known != unit:
        raise DataError(f"{path}: {unit!r} is not a unit of the angle; use deg or rad", code="unit")
    return size


def _angle_cell(path: Path, column: str | None) -> str | None:
    """Name of the column with the table angle, as in the header: the given column, or a column called angle."""
    if path.suffix.lower() not in (".csv", ".txt", ".tsv", ""):
        return column
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        first = next((line for line in file if line.strip() and not line.lstrip().startswith("#")), "")
    cells = [cell.strip() for cell in re.split(r"[,;\t]", first)]
    if column is None:
        return next((cell for cell in cells if _named(cell)[0] == "angle"), None)
    bare = lambda text: re.sub(r"[\[(].*", "", text).strip().lower()  # noqa: E731
    return next((cell for cell in cells if column in (cell, bare(cell)) or column.lower() == bare(cell)), column)


def read_readings(path: Path) -> ReadingsTable:
    """Read the columns angle, mounting, dwell, start, accel, gyro, with findings on assumptions.

    Raises
    ------
    DataError
        If the header lacks the angle or both sensors, or a cell is not a number.
    """
    from ..io._read import fingerprint

    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = list(csv.reader(line for line in file if line.strip() and not line.lstrip().startswith("#")))
    if not rows:
        raise DataError(f"{path} is empty; {_EXPECTED}")
    columns: dict[str, tuple[int, float]] = {}
    notes = []
    for i, cell in enumerate(rows[0]):
        name, unit = _named(cell)
        if name is None:
            notes.append(FINDINGS("unused", column=cell.strip()))
        elif name in columns:
            raise DataError(f"{path}: two columns hold the {name}; leave one out")
        else:
            columns[name] = (i, _factor(path, name, unit, notes))
    if "angle" not in columns or not {"accel", "gyro"} & set(columns):
        missing = "an angle" if "angle" not in columns else "neither accelerometer nor gyro readings"
        raise DataError(f"{path} has {missing if missing[0] == 'n' else 'no column with ' + missing}; {_EXPECTED}")
    read: dict[str, Any] = {}
    for name, (i, scale) in columns.items():
        read[name] = [_cell(path, rows[0][i], number, row, i, scale, name) for number, row in enumerate(rows[1:], 2)]
    if not read["angle"]:
        raise DataError(f"{path} has a header and no rows; it takes one row per position")
    for name, value in (("mounting", "x"), ("dwell", 1.0)):
        if name not in read:
            read[name] = [value] * len(read["angle"])
            notes.append(FINDINGS("no_column", column=name, value=value if name == "mounting" else "1 s"))
    size, digest = fingerprint([path])
    return ReadingsTable(read, tuple(notes), {"file": str(path), "size": size, "sha256": digest})


def _factor(path: Path, name: str, unit: str | None, notes: list[Finding]) -> float:
    if name == "mounting":
        return 1.0
    if name == "angle":
        if unit is None:
            notes.append(FINDINGS("no_unit", column="angle", unit="deg"))
        return _angle(path, unit or "deg")
    quantity = {"dwell": "time", "start": "time"}.get(name, name)
    if unit is None:
        unit = {"time": "s", "accel": "m/s^2", "gyro": "rad/s"}[quantity]
        notes.append(FINDINGS("no_unit", column=name, unit=unit))
    if find_unit(unit, quantity) is None:
        raise DataError(
            f"{path}: {unit!r} is not a unit of {quantity}; write one in brackets behind the column's name, as in {_EXPECTED[26:]}"
        )
    return factor(unit, quantity)


def _cell(path: Path, column: str, line: int, row: list[str], i: int, scale: float, name: str) -> Any:
    text = row[i].strip() if i < len(row) else ""
    if name == "mounting":
        return text.strip("\"'").lower() or "x"
    if not text and name in ("accel", "gyro"):
        return float("nan")
    try:
        return float(text) * scale
    except ValueError:
        raise DataError(f"{path}, line {line}: {text!r} is not a number ({column.strip()})") from None
