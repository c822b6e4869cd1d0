"""A log in jaxcal's own layout of .npz or Parquet: in SI, on its grid, read back as it was and at once."""

import json
import math
import os
import pathlib
import uuid
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._errors import DataError, ExportError
from .._log import Log
from .._units import si_unit
from ._options import AXES, SENSORS
from ._read import read
from ._saved import SCHEMA

#: suffixes that are written
SUFFIXES = (".npz", ".parquet")


def convert(
    path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    format: str | None = None,
    columns: Mapping[str, Any] | str | None = None,
    units: Mapping[str, Any] | str | None = None,
    rate: float | int | None = None,
    topics: Sequence[str] | str | None = None,
    raw: bool = False,
    data: str = "rate",
    missing: float | int | None = None,
    quiet: bool = False,
) -> Log:
    r"""Read a log once and write it as .npz or Parquet, which reads many times faster than bags and text.

    Values are written in SI, on the uniform grid, with missing samples as NaN, and with everything that was said about them: `read`
    gives the same `Log` again, with nothing left to guess, and its `provenance` is that of the original.

    Parameters
    ----------
    path : log, as `jaxcal.read` takes it.
    out : file to write, FILE.npz or FILE.parquet (which needs polars); an existing one is replaced.
    format, columns, units, rate, topics, raw, data, missing, quiet : as of `jaxcal.read`.

    Returns
    -------
    Log
        What was written.

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
        raise ExportError(f"{out.name}: expected a name that ends in {' or '.join(SUFFIXES)}")
    if out.exists() and out.resolve() == pathlib.Path(path).resolve():
        raise ExportError(f"{out.name} is the log that is read; it would be overwritten: give another name")
    log = read(
        path, format=format, columns=columns, units=units, rate=rate, topics=topics, raw=raw, data=data, missing=missing, quiet=quiet
    )
    place = out.with_name(f".{out.stem}-{uuid.uuid4().hex}{out.suffix}")
    try:
        save(log, place)
        os.replace(place, out)
    except OSError as error:
        raise ExportError(f"{out}: {(error.strerror or str(error)).lower()}; give a name in another folder") from error
    finally:
        place.unlink(missing_ok=True)
    return log


def save(log: Log, place: pathlib.Path) -> None:
    """Write a log to a .npz or .parquet file."""
    sensors = {name: value for name in (*SENSORS, "temperature") if (value := getattr(log, name)) is not None}
    about = json.dumps(_about(log), allow_nan=False)
    if place.suffix == ".npz":
        with place.open("wb") as file:
            np.savez(file, allow_pickle=False, time=log.time, **sensors, jaxcal=np.array(about))
        return
    try:
        import polars as pl
    except ImportError as error:
        raise DataError('writing Parquet needs polars: pip install "jaxcal[parquet]"') from error
    columns = {"time [s]": log.time}
    for name, values in sensors.items():
        for j, channel in enumerate(values.reshape(len(values), -1).T):
            suffix = "" if name == "temperature" else f"_{AXES[j]}"
            columns[f"{name}{suffix} [{si_unit(name)}]"] = np.ascontiguousarray(channel)
    pl.DataFrame(columns).write_parquet(place, metadata={"jaxcal": about})


def _about(log: Log) -> dict[str, Any]:
    def plain(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {str(key): plain(inner) for key, inner in value.items()}
        if isinstance(value, list | tuple):
            return [plain(inner) for inner in value]
        if isinstance(value, np.generic):
            value = value.item()
        return value if value is None or isinstance(value, str | bool | int) or math.isfinite(value) else str(value)

    return {
        "schema": SCHEMA,
        "rate": log.rate,
        "notes": list(log.notes),
        "warnings": list(log.warnings),
        "provenance": plain(log.provenance),
    }
