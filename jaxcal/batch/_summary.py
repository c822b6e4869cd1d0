"""The files about a whole run: manifest, and a table with a row for each log."""

import csv
import importlib.metadata
import io
import os
import pathlib
import platform
import sys
from collections.abc import Sequence
from typing import Any

from .._files import json_text, write_atomically
from ._fleet import Entry

SCHEMA = "jaxcal.fleet/1"
_FIRST = ("log", "status", "reason", "date", "sha256", "seconds", "warnings")


def write_manifest(folder: pathlib.Path, entries: Sequence[Entry], identity: dict[str, Any], logs: int) -> None:
    """What was run, with which versions, and every log with its status, reason and result file."""
    rows = [
        {
            "log": _text(os.path.abspath(entry.path)), "status": entry.status, "reason": entry.reason, "again": entry.again,
            "sha256": entry.sha256, "date": entry.date, "seconds": None if entry.seconds is None else round(entry.seconds, 3),
            "result": None if entry.file is None else f"{entry.file.parent.name}/{entry.file.name}",
        }
        for entry in entries
    ]  # fmt: skip
    done = sum(entry.status == "done" for entry in entries)
    packages = {name: importlib.metadata.version(name) for name in ("jaxcal", "jax", "jaxlib", "numpy", "scipy")}
    count = {"logs": logs, "done": done, "failed": len(entries) - done, "left": logs - len(entries)}
    document = {
        "schema": SCHEMA, "task": identity, "count": count,
        "versions": {**packages, "python": platform.python_version(), "platform": sys.platform}, "logs": rows,
    }  # fmt: skip
    write_atomically(folder / "manifest.json", json_text(document))


def write_summary(folder: pathlib.Path, entries: Sequence[Entry]) -> None:
    """`summary.csv`, and `summary.parquet` where polars is there: a row for each log, three columns for each coefficient."""
    names = list(dict.fromkeys(name for entry in entries for name in entry.coefficients))
    # an interval that no log has would be empty columns
    bounded = {name for entry in entries for name, one in entry.coefficients.items() if one.low is not None or one.high is not None}
    table: dict[str, list[Any]] = {name: [] for name in _FIRST}
    for name in names:
        table |= {column: [] for column in ((name, f"{name}.low", f"{name}.high") if name in bounded else (name,))}
    for entry in entries:
        row = (_text(entry.path), entry.status, entry.reason, entry.date, entry.sha256, entry.seconds, len(entry.warnings))
        for column, value in zip(_FIRST, row, strict=True):
            table[column].append(value)
        for name in names:
            one = entry.coefficients.get(name)
            table[name].append(None if one is None else one.value)
            if name in bounded:
                table[f"{name}.low"].append(None if one is None else one.low)
                table[f"{name}.high"].append(None if one is None else one.high)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*([_cell(value) for value in column] for column in table.values()), strict=True))
    write_atomically(folder / "summary.csv", text.getvalue())
    _write_parquet(folder / "summary.parquet", table)


def _cell(value: Any) -> Any:
    """What a spreadsheet cannot take for a formula."""
    return f"'{value}" if isinstance(value, str) and value.startswith(("=", "+", "-", "@")) else value


def _text(path: str | os.PathLike[str]) -> str:
    """A path as text; the name of a file need not be."""
    return os.fsencode(path).decode("utf-8", "backslashreplace")


def _write_parquet(path: pathlib.Path, table: dict[str, list[Any]]) -> None:
    try:
        import polars as pl
    except ImportError:
        return
    text = {"log", "status", "reason", "date", "sha256"}
    kinds = {name: pl.String if name in text else pl.Int64 if name == "warnings" else pl.Float64 for name in table}
    buffer = io.BytesIO()
    pl.DataFrame(table, schema=kinds).write_parquet(buffer)
    write_atomically(path, buffer.getvalue())
