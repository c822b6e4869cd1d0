"""Provenance of a calibration: the recording, the versions, and the options of the command."""

import datetime
import platform
from collections.abc import Mapping
from typing import Any

import numpy as np

from .._answer import plain
from .._files import version_of
from .._log import Log
from .._types import Checked

_PACKAGES = ("jax", "numpy", "scipy")
_FIRST = np.datetime64("2000", "ns").astype(int)  # smaller stamps count from the start of the device


def date_of(known: Mapping[str, Any]) -> datetime.datetime | None:
    """Time (UTC) of the first sample by the provenance of a log; None if its stamps do not tell."""
    epoch = known.get("epoch_ns")
    return datetime.datetime.fromtimestamp(epoch // 10**9, datetime.UTC) if isinstance(epoch, int) and epoch >= _FIRST else None


def provenance(log: Checked[Log], command: str, options: Mapping[str, Any] | None = None, *, rate_given: bool = False) -> dict[str, Any]:
    """Provenance of a calibration made from a log, for `Calibration(provenance=...)`.

    Parameters
    ----------
    log : recording; its own provenance (file, size, SHA-256, format) is included.
    command : the command that made the calibration, such as "jaxcal imu".
    options : options of the command; values that JSON cannot store become text.
    rate_given : whether the user gave the sampling rate. Otherwise exports warn that it is an estimate.

    Returns
    -------
    Dictionary for JSON: the provenance of the log; "date" of its first sample (UTC) if its stamps tell; "applied" (sentences) if the device
    had already corrected the readings; "rate" ("given" or "estimated"), "command", "options", "version" and "versions".

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> log = jaxcal.Log(None, gyro=np.zeros((4, 3)) + np.arange(4.0)[:, None], rate=10.0, provenance={"file": "a.csv"})
    >>> found = jaxcal.calibration.provenance(log, "jaxcal noise", {"band": (1.0, 9.0)}, rate_given=True)
    >>> found["file"], found["rate"], found["options"]
    ('a.csv', 'given', {'band': [1.0, 9.0]})
    """
    held = plain(log.provenance)
    # what the readers of flight logs say about corrections that the device made before it logged
    applied = [str(one) for one in log.findings if one.code == "applied"]
    if applied and "applied" not in held:
        held["applied"] = applied
    if "date" not in held and (when := date_of(log.provenance)) is not None:
        held["date"] = f"{when:%Y-%m-%dT%H:%M:%SZ}"
    versions = {name: version_of(name) for name in _PACKAGES}
    return {
        **held,
        "rate": "given" if rate_given else "estimated",
        "command": command,
        "options": plain(dict(options or {})),
        "version": version_of("jaxcal"),
        "versions": {"python": platform.python_version(), **versions},
    }
