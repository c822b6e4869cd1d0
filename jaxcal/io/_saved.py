"""Logs in jaxcal's own layout of .npz or Parquet: SI values on the grid with a description, from which the same log can be restored."""

import dataclasses
import json
import math
import pathlib
from typing import Any

import numpy as np

from .._errors import DataError, ExportError
from .._log import Log, gaps_of
from .._results import plain
from .._units import si_unit
from ._columns import AXES, SENSORS
from ._readers._bounds import require

#: suffixes that are written
SUFFIXES = (".npz", ".parquet")
#: version of the description
_SCHEMA = 1
_LONGEST = 1 << 20
#: beginning of the names of columns with `Log.offset`; they are the last ones
_OFFSET = "offset_"


def save(log: Log, place: pathlib.Path) -> None:
    """Write a log to a .npz or .parquet file."""
    try:
        _write(log, place)
    except Exception as error:
        # polars raises its own exceptions, for example if the disk is full
        if not isinstance(error, OSError) and "os error" not in str(error):
            raise
        reason = getattr(error, "strerror", None) or str(error)
        raise ExportError(
            f"cannot write a file {place.suffix} into {place.parent}: {reason.lower()}; give a name in another folder"
        ) from error


def _write(log: Log, place: pathlib.Path) -> None:
    sensors = {name: value for name in (*SENSORS, "temperature") if (value := getattr(log, name)) is not None}
    about = json.dumps({"schema": _SCHEMA} | {name: plain(getattr(log, name)) for name in ("rate", "notes", "warnings", "provenance")})
    if place.suffix == ".npz":
        with place.open("wb") as file:
            own = {_OFFSET + name: values for name, values in log.offset.items()}
            np.savez(file, allow_pickle=False, time=log.time, **sensors, **own, jaxcal=np.array(about))
        return
    require("polars", "writing Parquet", "parquet")
    import polars as pl

    columns = {"time [s]": log.time}
    for name, values in sensors.items():
        for j, channel in enumerate(values.reshape(len(values), -1).T):
            suffix = "" if name == "temperature" else f"_{AXES[j]}"
            columns[f"{name}{suffix} [{si_unit(name)}]"] = np.ascontiguousarray(channel)
    columns |= {f"{_OFFSET}{name} [s]": values for name, values in log.offset.items()}
    pl.DataFrame(columns).write_parquet(place, metadata={"jaxcal": about})


@dataclasses.dataclass(frozen=True)
class Saved:
    """The description of a converted log."""

    rate: float
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    provenance: dict[str, Any]

    def restore(self, sensors: dict[str, Any], offset: dict[str, Any], where: dict[str, Any]) -> Log:
        """Restore the log from `sensors` (SI, on the grid) with its original notes and warnings, without adding new ones.

        `where` describes the converted file; `provenance` names it in addition to the original file.
        """
        log, provenance = Log(None, **sensors, rate=self.rate), self.provenance | {"converted": where}
        gaps = gaps_of(log._sensors(), offset, self.rate, [])
        return log._replaced(offset=offset, gaps=gaps, notes=self.notes, warnings=self.warnings, provenance=provenance)


def offsets_of(names: list[str], columns: list[np.ndarray]) -> dict[str, np.ndarray]:
    """Take the columns with `Log.offset` out of those of a converted log."""
    offset = {}
    while names and names[-1].startswith(_OFFSET):
        offset[names.pop().removeprefix(_OFFSET).removesuffix(" [s]")] = columns.pop().astype(float)
    return dict(reversed(offset.items()))


def parse_saved(text: str) -> Saved:
    """Parse and check the description written by `save`."""
    schema, rate, notes, warnings, provenance = map(_parsed(text).get, ("schema", "rate", "notes", "warnings", "provenance"))
    if isinstance(schema, int) and schema > _SCHEMA:
        raise DataError("it was written by a later version of jaxcal; update jaxcal, or convert the log again")
    whole = (
        schema == _SCHEMA
        and all(isinstance(words, list) and all(isinstance(word, str) for word in words) for words in (notes, warnings))
        and isinstance(rate, float | int)
        and not isinstance(rate, bool)
        and 0 < rate < math.inf
        and isinstance(provenance, dict)
        and type(provenance.get("epoch_ns")) is int
    )
    if not whole:
        raise DataError("it was written by jaxcal convert, but its description is damaged: convert the log again")
    if isinstance(provenance.get("selected"), list):
        provenance["selected"] = tuple(provenance["selected"])
    return Saved(float(rate), tuple(notes), tuple(warnings), provenance)


def _parsed(text: str) -> Any:
    try:
        about = json.loads(text) if len(text) <= _LONGEST else None
    except (ValueError, RecursionError):
        about = None
    return about if isinstance(about, dict) else {}
