"""What a command did, kept with the log so that every file made from it says so."""

from collections.abc import Mapping
from typing import Any

from ._options import Reading


def signed(log: Any, command: str, reading: Reading, options: Mapping[str, Any]) -> Any:
    """The log with a provenance that names command, options and versions."""
    import equinox as eqx

    from ..calibration import provenance

    found = provenance(log, command, {**options, **reading.asked()}, rate_given=reading.rate is not None)
    return eqx.tree_at(lambda one: one.provenance, log, found)
