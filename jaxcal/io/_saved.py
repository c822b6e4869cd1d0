"""Logs in jaxcal's own layout of .npz or Parquet: SI values on the grid with a description, from which the same log can be restored."""

import contextlib
import dataclasses
import json
import math
import pathlib
from typing import Any

import numpy as np

from .._answer import NOTE, Finding, Kind, Quantity, Severity, plain, table
from .._errors import DataError, ExportError
from .._log import Log
from .._log_findings import LOG
from .._units import si_unit
from ..evidence._gaps import gaps_of
from ._columns import AXES, SENSORS
from ._findings import READ
from ._readers._bounds import require

#: suffixes that are written
SUFFIXES = (".npz", ".parquet")
#: version of the description
_SCHEMA = 2
_EARLIER = table(earlier=Kind(NOTE, "{text}"))
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
        said = f"cannot write a file {place.suffix} into {place.parent}: {reason.lower()}; give a name in another folder"
        raise ExportError(said, code="not_written") from error


def _write(log: Log, place: pathlib.Path) -> None:
    sensors = {name: value for name in (*SENSORS, "temperature") if (value := getattr(log, name)) is not None}
    held = {"rate": log.rate, "findings": [_kept(one) for one in log.findings], "provenance": plain(log.provenance)}
    about = json.dumps({"schema": _SCHEMA} | held)
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
    findings: tuple[Finding, ...]
    provenance: dict[str, Any]

    def restore(self, sensors: dict[str, Any], offset: dict[str, Any], where: dict[str, Any]) -> Log:
        """Restore the log from `sensors` (SI, on the grid) with its original findings, without adding new ones.

        `where` describes the converted file; `provenance` names it in addition to the original file.
        """
        log, provenance = Log(None, **sensors, rate=self.rate), self.provenance | {"converted": where}
        gaps = gaps_of(log._sensors(), offset, self.rate, [])
        return log._replaced(offset=offset, gaps=gaps, findings=self.findings, provenance=provenance)


def offsets_of(names: list[str], columns: list[np.ndarray]) -> dict[str, np.ndarray]:
    """Take the columns with `Log.offset` out of those of a converted log."""
    offset = {}
    while names and names[-1].startswith(_OFFSET):
        offset[names.pop().removeprefix(_OFFSET).removesuffix(" [s]")] = columns.pop().astype(float)
    return dict(reversed(offset.items()))


def parse_saved(text: str) -> Saved:
    """Parse and check the description written by `save`."""
    about: dict[str, Any] = {}
    with contextlib.suppress(KeyError, TypeError, ValueError, AttributeError, IndexError, RecursionError):
        about |= json.loads(text)
        about["findings"] = tuple(map(_again, about["findings"]))
    held: list[Any] = [about.get(name) for name in ("schema", "rate", "provenance", "findings")]
    schema, rate, provenance, findings = held
    if isinstance(schema, int) and schema > _SCHEMA:
        raise DataError("it was written by a later version of jaxcal; update jaxcal, or convert the log again", code="later_version")
    positive = isinstance(rate, float | int) and not isinstance(rate, bool) and 0 < rate < math.inf
    known = isinstance(provenance, dict) and type(provenance.get("epoch_ns")) is int
    if schema != _SCHEMA or not isinstance(findings, tuple) or not (positive and known):
        raise DataError("it was written by jaxcal convert, but its description is damaged: convert the log again", code="damaged")
    if isinstance(provenance.get("selected"), list):
        provenance["selected"] = tuple(provenance["selected"])
    return Saved(float(rate), findings, provenance)


def _kept(one: Finding) -> dict[str, Any]:
    """A finding in a form from which `_again` makes it again."""
    facts = {name: fact if isinstance(fact, str | int | float | bool) else str(fact) for name, fact in plain(dict(one.facts)).items()}
    facts |= {name: vars(fact) for name, fact in one.facts.items() if isinstance(fact, Quantity)}
    own = {"code": one.code, "severity": int(one.severity), "subject": list(one.subject), "cost": one.cost}
    return own | {"facts": facts, "text": str(one)}


def _again(one: dict[str, Any]) -> Finding:
    facts = {name: Quantity(**fact) if isinstance(fact, dict) else fact for name, fact in one["facts"].items()}
    subject, severity = [str(name) for name in one["subject"]], Severity(one["severity"])
    known = next((table for table in (READ, LOG) if one["code"] in table), None)
    found = None if known is None else known(one["code"], subject, one["cost"], severity, **facts)
    # a later version may say something else about the same facts, or need others
    with contextlib.suppress(KeyError, TypeError, ValueError):
        if found and str(found) == one["text"]:
            return found
    return _EARLIER("earlier", cost=one["cost"], severity=severity, text=str(one["text"]))
