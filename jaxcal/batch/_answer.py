"""The work of a worker on one log: read it, perform the task, and report. A faulty log never raises an exception out of this module."""

import contextlib
import datetime
import functools
import os
import pathlib
import time
import traceback
from typing import Any

from .._errors import DataError, JaxcalError
from .._files import json_text, shown, version_of
from .._log import Log
from ..calibration._provenance import date_of
from ..io import read
from ..io._find import find
from ..io._read import fingerprint as fingerprint_of
from ..io._readers._streams import SeveralError
from ._store import SCHEMA
from ._tasks import identity, perform, reading_options


def answer(
    path: str, task: Any, options: dict[str, Any], reading: dict[str, Any], each: bool = False, topics: str = "", page: str | None = None
) -> tuple[str, float]:
    """Result file of the log at `path`, as text, and the seconds it took; a report is written to `page`.

    With `each` the result names the other IMUs of the log; they are then read in turn with their `topics`.

    A log that fails gives a result too: `status` is then "failed" and `reason` a sentence. `again` is True if the reason may be gone the
    next time (a missing file, memory), so that a resumed run tries the log again.
    """
    begin = time.perf_counter()
    begun = functools.partial(_begun, path, task, options, reading, topics)
    document = begun()
    try:
        before = _stat(pathlib.Path(path))
        known, (start, stop) = reading_options(reading)
        log, others = _read(path, known | ({"topics": topics} if topics else {}), each and not topics)
        document["log"] |= {"each": each, "others": others}
        if _stat(pathlib.Path(path)) != before:
            raise _Changed("the file changed while it was read; run again when it is complete")
        document["log"] |= {"sha256": log.provenance["sha256"], "bytes": log.provenance["size"], "date": _date(log.provenance, before)}
        if start is not None or stop is not None:
            log = log.select(start, stop)
        document |= {"status": "done", "reason": None, "again": False} | perform(task, log, options, page)
        text = json_text(document)
    except (KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as fault:  # a panic of a reader is no Exception, and a task may end with SystemExit
        text = json_text(_failed(begun() | {"log": document["log"]}, fault, path))
    return text, time.perf_counter() - begin


def _read(path: str, known: dict[str, Any], each: bool) -> tuple[Log, list[str]]:
    """The log, by default of its first IMU, and with `each` the topics of its other IMUs."""
    if not each or known.get("topics") is not None:
        return read(path, quiet=True, **known), []
    try:
        log = read(path, quiet=True, **known)
    except SeveralError as several:
        if not several.imus:
            raise
        first: dict[str, Any] = {"topics": several.imus[0]}
        return read(path, quiet=True, **known | first), several.imus[1:]
    taken = set(log.provenance["columns"].get("topics", ()))
    return log, [one for one in log.provenance.get("imus", ()) if set(one.split(",")) != taken]


def lost(path: str, task: Any, options: dict[str, Any], reading: dict[str, Any], topics: str = "", *, reason: str) -> str:
    """Result file, as text, of a log whose worker gave no answer."""
    return json_text(_failed(_begun(path, task, options, reading, topics), _Changed(reason), path))


def fingerprint(path: str | os.PathLike[str]) -> tuple[int | None, str | None]:
    """Size and SHA-256 of a log as in its result file; None if the log cannot be read."""
    sources = [pathlib.Path(path)]
    try:
        with contextlib.suppress(DataError):
            sources = find(sources[0])[1]  # the same files that `read` takes from a folder
        return fingerprint_of(sources)
    except OSError:
        return None, None


class _Changed(DataError):
    """An error whose reason may be gone the next time."""


def _begun(path: str, task: Any, options: dict[str, Any], reading: dict[str, Any], topics: str) -> dict[str, Any]:
    full = os.fsencode(os.path.abspath(path)).decode("utf-8", "backslashreplace")  # a file name need not be text
    known = {"path": full, "name": os.path.basename(full), "topics": topics, "each": False, "others": []}
    known |= dict.fromkeys(("bytes", "sha256", "date"))
    versions = {name: version_of(name) for name in ("jaxcal", "jax", "numpy")}
    return {"schema": SCHEMA, "log": known, "task": identity(task, options, reading), "versions": versions}


def _failed(document: dict[str, Any], fault: BaseException, path: str) -> dict[str, Any]:
    known = document["log"]
    if known["sha256"] is None:
        known["bytes"], known["sha256"] = fingerprint(path)
    again = not isinstance(fault, JaxcalError) or isinstance(fault, _Changed) or known["sha256"] is None
    reason = str(fault).strip() if isinstance(fault, JaxcalError) else _sentence(fault)
    document |= {"status": "failed", "reason": reason, "again": again}
    if isinstance(fault, JaxcalError):
        document["typed"] = fault.spelt("terminal")
    if not isinstance(fault, JaxcalError | OSError | MemoryError):
        document["trace"] = traceback.format_exception(fault)[-12:]
    return document | {"findings": [], "numbers": {}, "result": None}


def _sentence(fault: BaseException) -> str:
    if isinstance(fault, MemoryError):
        return "there is not enough memory for this log; use fewer workers, or a part of it (start, stop)"
    if isinstance(fault, OSError):
        return f"it cannot be read: {(fault.strerror or str(fault) or type(fault).__name__).lower()}"
    said = str(fault).strip().splitlines()
    return f"the task ended with {type(fault).__name__}{': ' + said[0] if said else ''}"


def _stat(path: pathlib.Path) -> list[tuple[str, int, int]]:
    """Name, size and time of last change of a file, or of every file in a folder."""
    try:
        files = sorted(path.iterdir()) if path.is_dir() else [path]
        return [(file.name, state.st_size, state.st_mtime_ns) for file in files for state in [file.stat()]]
    except FileNotFoundError:
        raise _Changed(f"{shown(path)}: there is no such file; check the path, or leave it out") from None
    except PermissionError:
        raise _Changed(f"{shown(path)}: no permission to read it; change its mode") from None


def _date(provenance: dict[str, Any], files: list[tuple[str, int, int]]) -> list[str]:
    """When the log was recorded, and the source of that: its time stamps if they are absolute times, otherwise the time of its file."""
    known = date_of(provenance)
    written = datetime.datetime.fromtimestamp(max(changed for _, _, changed in files) / 1e9, datetime.UTC)
    return [(known or written).isoformat(timespec="seconds"), "file" if known is None else "stamps"]
