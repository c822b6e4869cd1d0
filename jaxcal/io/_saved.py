"""Logs that `convert` wrote: the description beside their numbers, checked, and the `Log` as it was."""

import dataclasses
import json
import math
from typing import Any

from .._errors import DataError
from .._log import Log

#: version of the description
SCHEMA = 1
_LONGEST = 1 << 20


@dataclasses.dataclass(frozen=True)
class Saved:
    """What `convert` wrote beside the numbers."""

    rate: float
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    provenance: dict[str, Any]


def parse_saved(text: str) -> Saved:
    """Description of a converted log.

    Raises
    ------
    DataError
        If it is damaged, or of a later version.
    """
    damaged = DataError("it was written by jaxcal convert, but its description is damaged: convert the log again")
    if len(text) > _LONGEST:
        raise damaged
    try:
        about = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise damaged from error
    if not isinstance(about, dict):
        raise damaged
    if isinstance(about.get("schema"), int) and about["schema"] > SCHEMA:
        raise DataError("it was written by a later version of jaxcal; update jaxcal, or convert the log again")
    rate, provenance = about.get("rate"), about.get("provenance")
    notes, warnings = _sentences(about.get("notes")), _sentences(about.get("warnings"))
    if not (isinstance(rate, float | int) and not isinstance(rate, bool) and 0 < rate < math.inf and isinstance(provenance, dict)):
        raise damaged
    if notes is None or warnings is None:
        raise damaged
    epoch = provenance.get("epoch_ns")
    if about.get("schema") != SCHEMA or not isinstance(epoch, int) or isinstance(epoch, bool):
        raise damaged
    selected = provenance.get("selected")
    if isinstance(selected, list):
        provenance["selected"] = tuple(selected)
    return Saved(float(rate), notes, warnings, provenance)


def _sentences(value: Any) -> tuple[str, ...] | None:
    return tuple(value) if isinstance(value, list) and all(isinstance(word, str) for word in value) else None


def restore(saved: Saved, sensors: dict[str, Any], where: dict[str, Any]) -> Log:
    """The log as it was converted: its own sentences, since those that looking again would add are among them.

    Parameters
    ----------
    sensors : in SI, on the grid.
    where : the converted file, which `provenance` names beside the original.
    """
    log = Log(None, **sensors, rate=saved.rate, provenance=saved.provenance)
    object.__setattr__(log, "notes", saved.notes)
    object.__setattr__(log, "warnings", saved.warnings)
    object.__setattr__(log, "provenance", saved.provenance | {"converted": where})
    return log
