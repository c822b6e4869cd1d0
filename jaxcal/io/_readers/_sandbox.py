"""Read files in a separate process, with libraries that a damaged file can crash.

polars aborts the process (which cannot be caught) if a page of a Parquet file declares more values than memory can hold, as in one of
2000 mutated files; scipy's reader of MATLAB files accesses invalid memory in one of 1500; the HDF5 library never returns in one of 1000,
and so does pyulog, which jaxcal does not use. The process starts with the first such file, serves all later files, and is replaced when
it dies; its memory and its time for each file are limited. It runs this file itself, which therefore imports jaxcal only inside functions
of the requesting side. The answer is a description in JSON and plain bytes, never a pickle.
"""

import atexit
import contextlib
import importlib
import json
import math
import mmap
import os
import re
import subprocess
import sys
import threading
import time
from typing import Any

import numpy as np

#: libraries by format; they are imported before the time of the first file begins, which a busy machine would spend on that
_LIBRARIES = {"parquet": "polars", "mat": "scipy.io.matlab", "hdf5": "h5py", "xlsx": "python_calamine", "tdms": "nptdms"}
#: limits of time (s; a good file takes 0.1) and of memory in use (bytes, of which the libraries take a third) for a file of few bytes; one
#: of 12 MiB may use twice as much, and so on. The memory is looked at from outside: threads reserve many times the addresses that they use,
#: and where addresses were limited, a busy machine refused four of five good Parquet files
_SECONDS, _MEMORY = 8.0, 1 << 29
#: s between two looks at the memory
_LOOK = 0.02
_SIZE = 3 << 22
#: MATLAB classes whose layout is not public
_OPAQUE = ("table", "timetable", "datetime", "duration", "string")


# the side that reads


def _serve() -> None:
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output printed by a library must not get into the answers
    for line in sys.stdin:
        request = json.loads(line)
        with contextlib.suppress(ImportError):
            importlib.import_module(_LIBRARIES[request["kind"]])
        answers.write(b"!")
        answers.flush()
        try:
            about, arrays = {"parquet": _parquet, "mat": _mat, "hdf5": _hdf5, "xlsx": _xlsx, "tdms": _tdms}[request["kind"]](request)
            arrays = [np.ascontiguousarray(array) for array in arrays]
            about["arrays"] = [(array.dtype.str, array.shape) for array in arrays]
        except BaseException as error:
            # a panic inside polars is not an Exception
            if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
                raise
            about, arrays = {"error": type(error).__name__, "said": str(error)[:500]}, []
        head = json.dumps(about).encode()
        answers.write(len(head).to_bytes(8, "little") + head)
        for array in arrays:
            if array.size:
                answers.write(array.reshape(-1).view(np.uint8).data)
        answers.flush()


def _parquet(request: dict[str, Any]) -> tuple[dict[str, Any], list[np.ndarray]]:
    import polars as pl

    path = request["path"]
    saved = pl.read_parquet_metadata(path).get("jaxcal")
    lazy = pl.scan_parquet(path, glob=False)
    schema = lazy.collect_schema()
    rows = lazy.select(pl.len()).collect().item()
    declared = 8 * rows * len(schema)
    if declared > request["allowed"]:
        return {"declared": declared}, []
    frame = lazy.collect(engine="streaming")
    columns, arrays = [], []
    for name, kind in schema.items():
        series = frame.drop_in_place(name)
        if kind.is_temporal() and kind != pl.Time:
            series = series.dt.total_nanoseconds() if kind == pl.Duration else series.cast(pl.Datetime("ns"))
        elif kind.is_decimal():
            series = series.cast(pl.Float64)
        array = series.to_numpy()
        words = []
        if array.dtype.kind not in "iufbM":  # words, and which of them stands in each row
            text = series.cast(pl.String, strict=False).fill_null("").str.slice(0, 100)
            words = text.unique(maintain_order=True).to_list()
            words = words if len(words) <= request["most"] else words[:1]
            array = text.replace_strict(words, range(len(words)), default=0, return_dtype=pl.Int16).to_numpy()
        dates = array.dtype.kind == "M"
        columns.append({"name": name, "integer": kind.is_integer(), "dates": dates, "words": words})
        arrays.append(array.view(np.int64) if dates else array)
    return {"columns": columns, "rows": rows, "saved": saved}, arrays


def _mat(request: dict[str, Any]) -> tuple[dict[str, Any], list[np.ndarray]]:
    import warnings

    import scipy.io
    import scipy.io.matlab

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings on duplicate names, and on objects, which `opaque` reports
        variables = scipy.io.loadmat(request["path"], simplify_cells=True, appendmat=False)
    names: list[str] = []
    arrays: list[np.ndarray] = []
    opaque = "__function_workspace__" in variables or "None" in variables

    def collect(path: str, value: Any, depth: int) -> None:
        nonlocal opaque
        if isinstance(value, dict):
            for name, inner in value.items():
                if depth < 32 and not name.startswith("_"):
                    collect(f"{path}/{name}" if path else name, inner, depth + 1)
        elif len(records := [one for one in value if isinstance(one, dict)] if isinstance(value, list) else []) > 1:
            for name in records[0]:  # an array of structs, one for each sample
                column = [one.get(name) for one in records]
                if all(isinstance(one, float | int) for one in column):
                    collect(f"{path}/{name}", np.array(column, float), depth + 1)
        elif isinstance(value, scipy.io.matlab.MatlabOpaque | scipy.io.matlab.MatlabFunction):
            opaque = True
        elif isinstance(value, np.ndarray | float | int | np.number) and np.asarray(value).dtype.kind in "iufb":
            names.append(path)
            arrays.append(np.asarray(value))

    collect("", variables, 0)
    return {"names": names, "opaque": opaque}, arrays


def _xlsx(request: dict[str, Any]) -> tuple[dict[str, Any], list[np.ndarray]]:
    """The sheets of a workbook as text tables."""
    import csv
    import io

    import python_calamine

    names, arrays, left = [], [], request["allowed"]
    with open(request["path"], "rb") as file, python_calamine.CalamineWorkbook.from_filelike(file) as book:
        for name in book.sheet_names[: request["most"]]:
            text = io.StringIO()
            write = csv.writer(text, lineterminator="\n")
            for row in book.get_sheet_by_name(name).iter_rows():
                write.writerow([str(one) for one in row])
                if text.tell() > left:
                    return {"declared": request["allowed"] + 1}, []
            left -= text.tell()
            names.append(name)
            arrays.append(np.frombuffer(text.getvalue().encode(), np.uint8))
    return {"names": names}, arrays


def _tdms(request: dict[str, Any]) -> tuple[dict[str, Any], list[np.ndarray]]:
    import nptdms

    names, units, attributes, arrays = [], {}, {}, []
    with nptdms.TdmsFile.open(request["path"]) as file:
        channels = [channel for group in file.groups() for channel in group.channels()][: request["most"]]
        declared = sum(8 * len(channel) for channel in channels)
        if declared > request["allowed"]:
            return {"declared": declared}, []
        for channel in channels:
            name, values = f"{channel.group_name}/{channel.name}", np.asarray(channel[:])
            if values.dtype.kind not in "iufbM":
                continue
            names.append(name)
            arrays.append(values.astype("datetime64[ns]").astype(np.int64) if values.dtype.kind == "M" else values)
            units[name] = "ns" if values.dtype.kind == "M" else str(channel.properties.get("unit_string") or "")
            if step := channel.properties.get("wf_increment"):
                attributes[f"{name}/rate"] = 1.0 / float(step)
    return {"names": names, "units": units, "opaque": [], "attributes": attributes}, arrays


def _hdf5(request: dict[str, Any]) -> tuple[dict[str, Any], list[np.ndarray]]:
    import h5py

    names: list[str] = []
    units: dict[str, str] = {}
    attributes: dict[str, float] = {}
    opaque: list[tuple[str, str]] = []
    arrays: list[np.ndarray] = []
    declared = count = 0

    def text(dataset: Any, name: str) -> str:
        value = dataset.attrs.get(name)
        return value.decode("latin-1") if isinstance(value, bytes) else value if isinstance(value, str) else ""

    def take(path: str, item: Any) -> bool | None:
        """Read one item; anything but None ends the walk, which follows no links: a log must not make its reader open other files."""
        nonlocal declared, count, units
        count += 1
        if count > request["most"] or declared > request["allowed"]:
            return True
        for name in list(item.attrs)[:100]:
            value = item.attrs.get(name)
            if isinstance(value, np.ndarray | np.number) and np.size(value) == 1 and value.dtype.kind in "iuf":
                attributes[f"{path}/{name}"] = float(np.reshape(value, ()))
        if not isinstance(item, h5py.Dataset) or "#" in path or item.external or item.is_virtual:
            return None
        kind, fields = text(item, "MATLAB_class"), item.dtype.names
        if kind in _OPAQUE or "MATLAB_object_decode" in item.attrs:
            opaque.append((path, kind))
        elif kind not in ("char", "cell") and item.shape is not None and (fields or item.dtype.kind in "iufb"):
            declared += math.prod(item.shape) * item.dtype.itemsize
            if declared > request["allowed"]:
                return True
            array = item[()]
            unit = next((found for name in ("units", "unit", "Units", "Unit", "UNITS") if (found := text(item, name))), "")
            for field in fields or ("",):
                column = np.asarray(array[field] if field else array)
                if column.dtype.kind in "iufb":
                    names.append(f"{path}/{field}" if field else path)
                    arrays.append(column)
                    units |= {names[-1]: unit} if unit else {}
        return None

    with h5py.File(request["path"], "r", locking="best-effort") as file:
        take("", file)
        file.visititems(take)
    if count > request["most"]:
        return {"many": True}, []
    if declared > request["allowed"]:
        return {"declared": declared}, []
    return {"names": names, "units": units, "opaque": opaque, "attributes": attributes}, arrays


# the side that requests


def _watch(process: Any, allowed: float, done: threading.Event, why: list[str], began: list[float]) -> None:
    """End the reading process if it takes too long or uses too much memory, and say which."""
    while not why and not done.wait(_LOOK):
        if time.monotonic() - began[0] > _SECONDS * allowed:
            why.append("time")
        with contextlib.suppress(OSError, ValueError, IndexError), open(f"/proc/{process.pid}/statm") as file:  # of Linux
            if int(file.read().split()[1]) * mmap.PAGESIZE > _MEMORY * allowed:
                why.append("memory")
    if why and not done.is_set():
        process.kill()


class Sandbox:
    """The separate reading process; each process that reads has its own."""

    def __init__(self):
        self._lock = threading.Lock()
        self._process: Any = None
        self._owner = 0

    def read(self, kind: str, path: str, **request: Any) -> tuple[dict[str, Any], list[np.ndarray]]:
        """Read description and arrays of a file; an error if the library refuses the file, takes too long, or crashes."""
        from ..._errors import DataError

        with self._lock:
            process = self._running()
            allowed = 1 + os.path.getsize(path) / _SIZE
            # the time begins when the libraries are there
            done, why, began = threading.Event(), [], [time.monotonic() + 4 * _SECONDS]
            threading.Thread(target=_watch, args=(process, allowed, done, why, began), daemon=True).start()
            try:
                process.stdin.write(json.dumps({"kind": kind, "path": os.path.abspath(path)} | request).encode() + b"\n")
                process.stdin.flush()
                self._take(1)
                began[0] = time.monotonic()
                about = json.loads(self._take(int.from_bytes(self._take(8), "little")))
                arrays = [self._array(*form) for form in about.get("arrays", [])]
            except (EOFError, OSError):
                self.stop()
                if "memory" in why:
                    raise MemoryError(f"more than {_MEMORY * allowed / 1e6:.0f} MB in use") from None
                if why:
                    raise DataError(f"it took more than {_SECONDS * allowed:.0f} s; it is damaged: copy it again", code="damaged") from None
                said = "the library that reads it broke down: it needs more memory than there is, or is damaged"
                raise DataError(f"{said}; close other programs, or copy it again", code="broke_down") from None
            except BaseException:
                self.stop()  # part of an answer is left in the pipe
                raise
            finally:
                done.set()
        if "error" in about:
            if about["error"] == "MemoryError" or re.search("memory|allocat|spawn|temporarily unavailable", about["said"], re.IGNORECASE):
                raise MemoryError(about["said"])
            said = (about["said"].strip().splitlines() or ["no message"])[0]
            raise DataError(f"it cannot be read ({about['error']}: {said}); it may be cut off or damaged: copy it again", code="damaged")
        return about, arrays

    def _running(self) -> Any:
        if self._process is not None and (self._owner != os.getpid() or self._process.poll() is not None):
            self.stop()
        if self._process is None:
            # -P: import no module from the working folder or from this folder
            env, pipe = os.environ | {"RUST_BACKTRACE": "0", "POLARS_MAX_THREADS": "2"}, subprocess.PIPE  # each thread takes memory
            command = [sys.executable, "-P", __file__]
            self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env=env)
            self._owner = os.getpid()
        return self._process

    def _take(self, count: int) -> bytes:
        content = self._process.stdout.read(count)
        if len(content) < count:
            raise EOFError
        return content

    def _array(self, dtype: str, shape: list[int]) -> np.ndarray:
        array = np.empty(shape, dtype)
        if array.size and self._process.stdout.readinto(array.reshape(-1).view(np.uint8).data) < array.nbytes:
            raise EOFError
        return array

    def stop(self) -> None:
        """End the process, if it is running."""
        process, self._process = self._process, None
        if process is None:
            return
        if self._owner == os.getpid():
            process.kill()
            process.wait()
        for stream in (process.stdin, process.stdout):
            with contextlib.suppress(OSError):
                stream.close()


if __name__ == "__main__":
    _serve()
else:
    sandbox = Sandbox()
    atexit.register(sandbox.stop)
