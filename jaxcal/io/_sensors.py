"""Recordings in several files: a table for each sensor, as from phone apps."""

import pathlib
from collections.abc import Callable
from typing import Any

import numpy as np

from .._errors import DataError
from .._message import Message, joined_messages
from ._findings import READ
from ._readers._streams import Part, join
from ._table import Signals


def read_sensors(files: list[pathlib.Path], read: Callable[[pathlib.Path], Signals]) -> Signals:
    """Join the sensors of all files on the time stamps of the fastest sensor; unusable files are left out with a warning."""
    parts: list[Part] = []
    signals = Signals(None, {})
    refused: list[tuple[str, Any]] = []
    for file in sorted(files, key=lambda one: (len(one.name), one.name)):  # Accelerometer before AccelerometerUncalibrated
        try:
            one = read(file)
        except DataError as error:
            refused.append((file.name, error))
            continue
        # what is said about the clock or the rows of a file is about this file
        signals.findings += [finding.of(*(finding.subject or (file.name,))) for finding in one.findings]
        if one.time is None:
            refused.append((file.name, "it has no time column, so that its samples have no place beside those of other sensors"))
            continue
        for name, values in one.sensors.items():
            if name in {part.name for part in parts}:
                signals.findings.append(READ("not_read", what=f"{name} of {file.name}, since another file holds it"))
                continue
            # the values are already in SI
            parts.append(Part(name, file.name, _stamps(one), values, {"gyro": "rad/s", "accel": "m/s^2", "mag": "T"}.get(name, "degC")))
            signals.units[name] = one.units[name]
            signals.columns[name] = [file.name, *one.columns[name]]
    if not parts:
        raise DataError(joined_messages([Message("{file}: {why}", file=file, why=why) for file, why in refused]), code="no_sensor")
    signals.findings += [READ("file_not_read", file=file, why=why) for file, why in refused]
    stated = dict(signals.units)
    join(parts, {}, signals)
    signals.units |= stated
    signals.findings.append(READ("joined", count=len({part.source for part in parts}), which="one for each sensor"))
    return signals


def _stamps(one: Signals) -> np.ndarray:
    """Time stamps in ns."""
    time = one.time
    assert time is not None
    if time.dtype.kind == "M":
        return time.astype("datetime64[ns]").astype(np.int64)
    if not np.isfinite(time).all():
        raise DataError("some rows have no time stamp; leave them out of the file", code="folder")
    whole = np.floor(time)
    return whole.astype(np.int64) * 10**9 + np.round((time - whole) * 1e9).astype(np.int64) + one.epoch_ns
