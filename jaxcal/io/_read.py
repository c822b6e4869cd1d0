"""`read`: read any supported recording into a `Log`; `convert`: write it in jaxcal's own layout."""

import concurrent.futures
import contextlib
import hashlib
import os
import pathlib
import sys
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from .._errors import DataError, ExportError, JaxcalError
from .._files import clear_hidden, hidden_name, shown, version_of
from .._log import Log
from .._message import Message
from .._types import AxesOf, ColumnsOf, UnitsOf
from .._units import si_unit
from ._archive import unpacked
from ._columns import SENSORS, in_axes, parse_axes, parse_columns, parse_topics, parse_units, wrong
from ._find import FORMATS, find
from ._findings import READ
from ._frames import table_of
from ._readers._arrays import read_hdf5, read_mat, read_npy, read_npz, read_parquet, read_tdms
from ._readers._csv import read_csv, read_workbook
from ._readers._dataflash import read_ardupilot
from ._readers._json import read_json
from ._readers._px4 import read_px4
from ._readers._ros import read_ros
from ._saved import SUFFIXES, offsets_of, save
from ._sensors import by_sensor, read_sensors
from ._table import Choice, Signals, Table, interpret

#: readers of tables (columns= chooses), of trees of arrays (topics= names a group), and of logs of messages (topics= chooses)
_TABLES = {"csv": read_csv, "npy": read_npy, "npz": read_npz, "parquet": read_parquet, "json": read_json}
_TREES = {"mat": read_mat, "hdf5": read_hdf5, "tdms": read_tdms, "xlsx": read_workbook}
_LOGS = {"ulog": read_px4, "dataflash": read_ardupilot}
_SI = {name: si_unit(name) for name in (*SENSORS, "temperature")}
_NAMES = {
    "csv": "a text table", "npy": "a NumPy array", "npz": "NumPy arrays", "parquet": "Parquet", "rosbag1": "a ROS 1 bag",
    "rosbag2": "a ROS 2 recording", "mat": "a MATLAB file", "hdf5": "HDF5", "ulog": "a PX4 ULog",
    "dataflash": "an ArduPilot DataFlash log", "sensors": "a folder with a table for each sensor",
    "json": "JSON", "xlsx": "a workbook", "tdms": "LabVIEW TDMS",
}  # fmt: skip


def read(
    path: object, *, format: str | None = None, columns: ColumnsOf | None = None, units: UnitsOf | None = None,
    rate: float | int | None = None, topics: Sequence[str] | str | None = None, data: str = "rate", missing: float | int | None = None,
    axes: AxesOf | None = None, quiet: bool = False,
) -> Log:  # fmt: skip
    r"""Read a recording of an inertial or magnetic sensor into a `Log`, in SI and on a uniform time grid.

    The content of a file shows its format: text tables (any delimiter, with or without header, plain or gzipped), JSON, workbooks,
    NumPy .npy and .npz, Parquet, MATLAB files, HDF5, LabVIEW (TDMS, LVM), ROS 1 bags, ROS 2 recordings (sqlite3 or MCAP), PX4 ULog and
    ArduPilot DataFlash. jaxcal infers
    what the file does not state: columns from their names (or from their values if they have no names), the unit of time from the
    size of the steps, units of sensors from gravity, the Earth's field and the size of the rates. `Log.findings` has one entry for
    every inference, with its reason and the option that overrides it.

    Parameters
    ----------
    path : a file; or a folder with a ROS 2 recording, with the numbered parts of a split recording, or with one log. Or a recording in
        memory: a pandas or polars data frame, a dictionary of arrays, or an array (n, columns)
        with its `rate`; `columns` and `units` work as for a file. A `Log` is returned unchanged.
    format : "csv", "json", "xlsx", "npy", "npz", "parquet", "rosbag1", "rosbag2", "mat", "hdf5", "tdms", "ulog" or "dataflash"; the
        default is detected from the first bytes.
    columns : columns of each quantity, by number (from 0) or name: ``{"time": 0, "gyro": ["wx", "wy", "wz"]}``,
        or a string, ``"time=0,gyro=1:3"``, in which ``1:3`` means columns 1 to 3. Sensors that are not named are left out;
        ``{"time": None}`` ignores the time stamps (then give `rate`).
    units : unit of each quantity, ``{"gyro": "deg/s", "accel": "g", "time": "us"}`` or ``"gyro=deg/s,accel=g"``. A number before
        the unit is the size of one count: ``{"gyro": "0.05 deg/s"}``.
    rate : sampling rate, Hz. Required without time stamps; with time stamps, a contradiction of more than 0.5 % is an error.
    topics : what to read if there are several sensors of a kind: ROS topics, ULog topics with their instance
        (``"sensor_gyro:1,sensor_accel:1"``), DataFlash records with their instance (``"IMU:1"``), the sheet of a workbook, or the group
        in a MATLAB, HDF5 or TDMS file.
    data : "rate", or "phase" if the file has the time integral of the measured quantities: angles and velocities, or the phase
        in files of Stable32. jaxcal then uses differences between samples divided by the sampling period; `units` are those of the rate.
    missing : number that marks a missing value in a table (0 in files of Stable32, -999 in others).
    axes : axes of sensors that are exchanged or reversed against those of the device, as ``"gyro=y,x,-z"`` or ``{"gyro": "y,x,-z"}``: the
        device's x is the sensor's y.
    quiet : do not print the findings on stderr.

    Returns
    -------
    Log
        `findings` report what was inferred and what was repaired, `provenance` the file (name, size, sha256), the format, and
        the columns and units used. For a log with several IMUs, `provenance["imus"]` lists the `topics` of each.

    Raises
    ------
    DataError
        If the file cannot be read, or its content is ambiguous; the message names the option that helps.
    UnitError
        If `units` has an unknown unit.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxcal
    >>> rows = "".join(f"{i / 100},{i % 7},{i % 5},1,0.01,{i % 3 / 100},0.99\n" for i in range(500))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "static.csv")
    ...     _ = path.write_text("time_s,gyro_x_dps,gyro_y_dps,gyro_z_dps,ax_g,ay_g,az_g\n" + rows)
    ...     log = jaxcal.read(path, quiet=True)
    >>> log.rate, len(log.time), round(float(log.accel[0, 2]), 4)
    (100.0, 500, 9.7086)
    >>> print(log.findings[0])
    time: column 0 (time_s), s (from the name).
    """
    given: dict[str, Any] = {"columns": columns, "units": units, "rate": rate, "data": data, "missing": missing, "axes": axes}
    if not isinstance(path, str | os.PathLike):
        return _in_memory(path, format or topics, asked(**given))
    log = read_for(None, path, format=format, topics=topics, **given)
    if not quiet:
        for one in log.findings:
            print(f"{'warning' if one.severity else 'note'}: {one}", file=sys.stderr)
    return log


def read_for(wanted: str | None, path: str | os.PathLike[str], **options: Any) -> Log:
    """Read a file with the options of `read` for a command that needs one sensor, `wanted`: "mag", or None."""
    path = pathlib.Path(path)
    with named(path):
        return _read(path, asked(wanted=wanted, **options))


def convert(path: str | os.PathLike[str], out: str | os.PathLike[str], **options: Any) -> Log:
    r"""Read a log once and write it as .npz or Parquet, which jaxcal reads many times faster than bags and text.

    The file has values in SI on the uniform grid, with missing samples as NaN, and all findings. `read` returns the same `Log`
    from it without any inference, with the `provenance` of the original file.

    Parameters
    ----------
    path : log, as for `jaxcal.read`.
    out : file to write, FILE.npz or FILE.parquet (which needs polars); an existing file is replaced.
    options : those of `jaxcal.read`.

    Returns
    -------
    Log
        The log that was written.

    Raises
    ------
    DataError
        If the log cannot be read.
    ExportError
        If `out` has another suffix, is the log itself, or cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxcal
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "log.csv")
    ...     _ = path.write_text("time [s],gyro_x [deg/s]\n" + "".join(f"{i / 10},{i % 3}\n" for i in range(50)))
    ...     log = jaxcal.io.convert(path, path.with_suffix(".npz"), quiet=True)
    ...     again = jaxcal.read(path.with_suffix(".npz"), quiet=True)
    >>> bool((again.gyro == log.gyro).all()), again.provenance["file"]
    (True, 'log.csv')
    """
    out = pathlib.Path(out)
    if out.suffix not in SUFFIXES:
        raise ExportError(f"{out.name}: expected a name that ends in {' or '.join(SUFFIXES)}", code="suffix")
    if out.exists() and out.resolve() == pathlib.Path(path).resolve():
        raise ExportError(f"{out.name} is the log that is read; it would be overwritten: give another name", code="same_file")
    log = read(path, **options)
    clear_hidden(out.parent)
    place = out.with_name(hidden_name(out.suffix))
    try:
        save(log, place)
        os.replace(place, out)
    except OSError as error:
        raise ExportError(f"{out}: {(error.strerror or str(error)).lower()}; give a name in another folder", code="not_written") from error
    finally:
        place.unlink(missing_ok=True)
    return log


class Asked(NamedTuple):
    """Options of `read`, parsed; `table` are those of tables."""

    format: str | None
    table: dict[str, Any]
    topics: list[str] | None
    axes: dict[str, list[str]]


def asked(
    *, format: str | None = None, columns: ColumnsOf | None = None, units: UnitsOf | None = None, rate: float | int | None = None,
    topics: Sequence[str] | str | None = None, data: str = "rate", missing: float | int | None = None, axes: AxesOf | None = None,
    wanted: str | None = None,
) -> Asked:  # fmt: skip
    """Parse the options of `read`."""
    if data not in ("rate", "phase"):
        raise wrong("data", f'{data!r}; expected "rate" or "phase"')
    if format is not None and format not in FORMATS:
        raise wrong("format", f"{format!r} is unknown; use one of {', '.join(FORMATS)}")
    table = {"columns": parse_columns(columns), "units": parse_units(units), "rate": rate, "missing": missing}
    table |= {"phase": data == "phase", "wanted": wanted}
    return Asked(format, table, parse_topics(topics), parse_axes(axes))


def _in_memory(source: object, other: object, given: Asked) -> Log:
    """Make a log from an object in memory."""
    if isinstance(source, Log):
        if other or not _plain(given):
            raise DataError("this is a Log already, whose columns and units are chosen; leave the other options out", code="is_log")
        return source
    if other:
        raise DataError("format= and topics= belong to files; leave them out", code="of_files")
    return finished(table_of(source), {"file": f"a {type(source).__name__} in memory", "format": "memory"}, given)


def _plain(given: Asked) -> bool:
    """Whether no option changes how a table is read."""
    return not (given.axes or any(given.table.values()))


# overflow gives infinity or NaN, which counts as missing
@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def _read(path: pathlib.Path, given: Asked) -> Log:
    with opened(path, given) as (found, origin):
        return finished(found, origin, given)


@contextlib.contextmanager
def opened(path: pathlib.Path, given: Asked) -> Iterator[tuple[Table | Signals, dict[str, Any]]]:
    """Content of a file, before columns and units are chosen, and its provenance; a zip file stays unpacked inside the `with` block."""
    _, options, topics, _ = given
    with faults("a recording"):
        kind, sources = find(path)
    kind = given.format or kind
    if kind == "zip":
        with faults("a zip file"), unpacked(path) as folder, opened(folder, given._replace(format=None)) as (found, inner):
            size, sha256 = fingerprint([path])
            inside = {"inside": inner["file"]} if inner["file"] != folder.name else {}
            yield found, inner | {"file": shown(path), "size": size, "sha256": sha256} | inside
        return
    tabular = kind in (*_TABLES, *_TREES, "sensors")
    _belongs("topics", bool(topics) and kind in (*_TABLES, "sensors"), kind, "to recordings of messages; choose with {option.columns}")
    _belongs("columns", bool(options["columns"]) and not tabular, kind, "to tables; choose with {option.topics}")
    for option, value in (("missing", options["missing"] is not None), ("data", options["phase"])):
        _belongs(option, value and not tabular, kind, "to tables; leave it out")
    with faults(_NAMES[kind]), concurrent.futures.ThreadPoolExecutor(1) as pool:
        # hashing releases the interpreter lock, so it runs in parallel to the parsing
        digest = pool.submit(fingerprint, sources)
        found = _parse(kind, sources, topics, options)
        size, sha256 = digest.result()
    if isinstance(found, Table):
        found.stem = found.stem or sources[0].stem
    name = shown(sources[0] if len(sources) == 1 and path.is_dir() else path)
    yield found, {"file": name, "size": size, "sha256": sha256, "format": kind}


def _belongs(option: str, wrong: bool, kind: str, where: str) -> None:
    """Refuse an option that does not belong to the format."""
    if wrong:
        raise DataError(Message(f"this is {_NAMES[kind]}, and {{option.{option}}} belongs {where}"), code=option)


def finished(found: Table | Signals, origin: dict[str, Any], given: Asked, choices: list[Choice] | None = None) -> Log:
    """Make a log from the content of a file; the choices of columns and units are appended to `choices`."""
    if isinstance(found, Table) and found.saved is not None and _plain(given):
        offset = offsets_of(found.names, found.columns)
        return found.saved.restore(interpret(found, {"time": None}, _SI, found.saved.rate).sensors, offset, origin)
    if isinstance(found, Signals):
        found.rate = given.table["rate"]
        signals = found
    elif parts := {} if given.table["columns"] else by_sensor(found):
        signals = _joined(parts, given.table)
    else:
        signals = interpret(found, **given.table)
    if choices is not None:
        choices += signals.choices
    provenance = origin | {"columns": signals.columns, "units": signals.units, "jaxcal": version_of("jaxcal"), "epoch_ns": signals.epoch_ns}
    if len(signals.imus) > 1:
        provenance["imus"] = signals.imus
    for name, axes in given.axes.items():
        if name not in signals.sensors or np.shape(signals.sensors[name])[1:] != (3,):
            raise wrong("axes", f"the log has no {name} with three axes")
        signals.sensors[name] = in_axes(signals.sensors[name], axes)
        provenance["axes"] = given.axes
    return _build(signals, provenance)


def _parse(kind: str, sources: list[pathlib.Path], topics: list[str] | None, options: dict[str, Any]) -> Table | Signals:
    if kind in _TABLES:
        return _TABLES[kind](sources[0])
    if kind in _LOGS:
        return _LOGS[kind](sources[0], topics, options["units"])
    if kind == "sensors":
        return read_sensors({file.name: lambda file=file: interpret(read_csv(file), **options) for file in sources})
    if kind in _TREES:
        parts = _TREES[kind](sources[0], topics)
        return next(iter(parts.values())) if len(parts) == 1 else _joined(parts, options)
    return read_ros(sources, 1 if kind == "rosbag1" else 2, topics, options["units"])


def _joined(tables: dict[str, Table], options: dict[str, Any]) -> Signals:
    return read_sensors({name: lambda one=one: interpret(one, **options) for name, one in tables.items()})


def _build(signals: Signals, provenance: dict[str, Any]) -> Log:
    said = {"findings": signals.findings, "provenance": provenance}
    log = Log(signals.time, **signals.sensors, rate=signals.rate, own_time=signals.own_time, **said)
    if signals.nominal is None or abs(signals.nominal / log.rate - 1.0) < 0.005:
        return log
    return log._replaced(findings=(*log.findings, READ("rate_differs", source="The file states", stated=signals.nominal, rate=log.rate)))


def fingerprint(sources: list[pathlib.Path]) -> tuple[int, str]:
    """Size and sha256 of a file, of several files, or of the files of a folder in the order of their names."""
    if len(sources) == 1 and sources[0].is_file():
        with sources[0].open("rb") as file:
            return sources[0].stat().st_size, hashlib.file_digest(file, "sha256").hexdigest()
    files = sources if len(sources) > 1 else sorted(file for file in sources[0].iterdir() if file.is_file())
    total, digest = 0, hashlib.sha256()
    for file in files:
        size, inner = fingerprint([file])
        total += size
        digest.update(f"{file.name} {inner}\n".encode())
    return total, digest.hexdigest()


@contextlib.contextmanager
def named(path: pathlib.Path) -> Iterator[None]:
    """Add the name of the file to every error message."""
    try:
        yield
    except JaxcalError as error:
        raise error.of(shown(path)) from error.__cause__


@contextlib.contextmanager
def faults(kind: str) -> Iterator[None]:
    """Convert every exception of a reader library to a `DataError`."""
    try:
        yield
    except JaxcalError:
        raise
    except PermissionError as error:
        raise DataError("no permission to read it; change its mode, or copy it to where you may read", code="permission") from error
    except MemoryError as error:
        raise DataError(f"as {kind} it asks for more memory than there is: give a shorter part of it", code="too_large") from error
    except BaseException as error:
        # a panic inside polars is not an Exception; keyboard interrupts and exits pass through
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        if "allow_pickle" in str(error) or "Python objects" in str(error):
            raise DataError("it holds Python objects (a pickle), which are not loaded; save arrays of numbers", code="pickle") from error
        said = str(getattr(error, "strerror", None) or error).strip().splitlines() or [type(error).__name__]
        why = f"{type(error).__name__}: {said[0]}"
        raise DataError(f"it cannot be read as {kind} ({why}); it may be cut off or damaged: copy it again", code="unreadable") from error
