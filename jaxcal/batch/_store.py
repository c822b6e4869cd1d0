"""The folder of a run: a lock, one result file per log, and the files about all logs."""

import contextlib
import csv
import hashlib
import io
import json
import math
import os
import pathlib
import platform
import re
import sys
from collections.abc import Iterator, Sequence
from typing import Any

from .._answer import Number
from .._errors import DataError, ExportError
from .._files import clear_hidden, json_text, version_of, write_atomically
from ._fleet import Entry

SCHEMA = "jaxcal.batch/1"
#: the first columns of the table, and their types in Parquet
_FIRST = dict.fromkeys(("log", "topics", "status", "reason", "date", "sha256"), "String") | {"seconds": "Float64", "warnings": "Int64"}


class Store:
    """Result files in `folder`/results; each is complete or absent. With `reports` there is a page beside each."""

    def __init__(self, folder: pathlib.Path, reports: bool) -> None:
        self.folder, self.reports = folder, reports
        self.results = folder / "results"

    def file_of(self, log: str | os.PathLike[str], topics: str = "") -> pathlib.Path:
        """The result file of a log, or of one of its IMUs.

        Its name is the log's name in plain characters, plus a part of the hash of the path, so that logs of one name in two folders differ.
        """
        path = os.path.abspath(log)
        name = re.sub(r"[^A-Za-z0-9_-]+", "_", os.path.basename(path).rsplit(".", 1)[0]).strip("_")[:80] or "log"
        key = os.fsencode(path) + (b"\0" + topics.encode() if topics else b"")
        return self.results / f"{name}-{hashlib.sha256(key).hexdigest()[:10]}.json"

    def page_of(self, log: str | os.PathLike[str], topics: str = "") -> pathlib.Path:
        """The page of a log, which exists if reports were asked for."""
        return self.file_of(log, topics).with_suffix(".html")

    def new_page(self, log: str | os.PathLike[str], topics: str) -> str | None:
        """Where to write a page for a new result, if at all. The page of an earlier result is removed."""
        (page := self.page_of(log, topics)).unlink(missing_ok=True)
        return str(page) if self.reports else None

    def load(self, log: str | os.PathLike[str], topics: str = "") -> dict[str, Any] | None:
        """The result of a log; None if there is none, or the file was not written by jaxcal."""
        try:
            document = json.loads(self.file_of(log, topics).read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return None
        ours = isinstance(document, dict) and document.get("schema") == SCHEMA and document.get("status") in ("done", "failed")
        return document if ours else None

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Make the folders, and lock them until the block ends: other runs get a `DataError`. The lock ends with the process."""
        try:
            self.results.mkdir(parents=True, exist_ok=True)
            handle = os.open(self.folder / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise ExportError(f"cannot write into {self.folder}: {reason}; give another folder", code="not_written") from error
        if not _locked(handle):
            os.close(handle)
            raise DataError(f"another run is writing into {self.folder}; wait for its end, or give another folder", code="busy")
        try:
            for folder in (self.folder, self.results):
                clear_hidden(folder)  # left over from a run that was killed while writing
            for left in self.results.glob(".*.part"):
                with contextlib.suppress(OSError):
                    left.unlink()
            yield
        finally:
            os.close(handle)


def _locked(handle: int) -> bool:
    try:
        if os.name == "nt":
            import msvcrt

            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # pyright: ignore[reportAttributeAccessIssue]
        else:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):  # both calls raise these for a lock that another process holds
        return False
    return True


def write_manifest(folder: pathlib.Path, entries: Sequence[Entry], identity: dict[str, Any], logs: int) -> None:
    """Write the manifest: the task, the versions, and every log with its status, reason and result file."""
    rows = [
        {
            "log": _text(os.path.abspath(entry.path)), "topics": entry.topics,
            "status": entry.status, "reason": entry.reason, "again": entry.again,
            "sha256": entry.sha256, "date": entry.date, "seconds": None if entry.seconds is None else round(entry.seconds, 3),
            "result": None if entry.file is None else f"{entry.file.parent.name}/{entry.file.name}",
        }
        for entry in entries
    ]  # fmt: skip
    done = sum(entry.status == "done" for entry in entries)
    packages = {name: version_of(name) for name in ("jaxcal", "jax", "jaxlib", "numpy", "scipy")}
    count = {"logs": logs, "done": done, "failed": len(entries) - done, "left": logs - len(entries)}
    document = {
        "schema": "jaxcal.fleet/1", "task": identity, "count": count,
        "versions": {**packages, "python": platform.python_version(), "platform": sys.platform}, "logs": rows,
    }  # fmt: skip
    write_atomically(folder / "manifest.json", json_text(document))


def write_summary(folder: pathlib.Path, entries: Sequence[Entry]) -> None:
    """Write `summary.csv`, and with polars `summary.parquet`: one row per log, up to three columns per coefficient."""
    names = list(dict.fromkeys(name for entry in entries for name in entry.coefficients))
    # leave out the columns of intervals that no log has
    bounded = {name for entry in entries for name, one in entry.coefficients.items() if not (math.isnan(one.low) and math.isnan(one.high))}
    kinds = _FIRST | {column: "Float64" for name in names for column in _columns(name, name in bounded)}
    rows = []
    for entry in entries:
        row = [_text(entry.path), entry.topics, entry.status, entry.reason, entry.date, entry.sha256, entry.seconds, len(entry.warnings)]
        for name in names:
            one = entry.coefficients.get(name, Number(name, math.nan))
            row += [None if math.isnan(x) else x for x in ((one.value, one.low, one.high) if name in bounded else (one.value,))]
        rows.append(row)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(kinds)
    writer.writerows([_cell(value) for value in row] for row in rows)
    write_atomically(folder / "summary.csv", text.getvalue())
    try:
        import polars as pl
    except ImportError:
        return
    buffer = io.BytesIO()
    pl.DataFrame(rows, {name: getattr(pl, kind) for name, kind in kinds.items()}, orient="row").write_parquet(buffer)
    write_atomically(folder / "summary.parquet", buffer.getvalue())


def _columns(name: str, bounded: bool) -> list[str]:
    name = f"result.{name}" if name in _FIRST else name
    return [name, f"{name}.low", f"{name}.high"] if bounded else [name]


def _cell(value: Any) -> Any:
    """A cell that a spreadsheet cannot mistake for a formula."""
    return f"'{value}" if isinstance(value, str) and value.startswith(("=", "+", "-", "@")) else value


def _text(path: str | os.PathLike[str]) -> str:
    """A path as text, even if its bytes are not valid text."""
    return os.fsencode(path).decode("utf-8", "backslashreplace")
