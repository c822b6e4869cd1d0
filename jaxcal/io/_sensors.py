"""Recordings in several tables, one for each sensor, as from phone apps: files, sheets of a workbook, or rows that take turns."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from .._errors import DataError
from .._message import Message, joined_messages
from .._units import si_unit
from ._columns import SENSORS
from ._findings import READ
from ._mixed import KINDS, TURNS
from ._readers._streams import Part, join
from ._table import Signals, Table
from ._triples import file_kind


def by_sensor(table: Table) -> dict[str, Table]:
    """One table for each sensor that a column of words names in turn, as apps write; none if no column does."""
    for i, column in enumerate(table.columns):
        if column.dtype.kind != "O" or len(words := dict.fromkeys(column.tolist())) > KINDS or None in words:
            continue
        kinds, turns = [file_kind(str(word)) for word in words], float(np.mean(column[1:] != column[:-1])) if len(column) > 1 else 0.0
        # the words of an activity may be like those of a sensor, but do not take turns
        if len(words) < 2 or not set(kinds) & set(SENSORS) or (None in kinds and turns < TURNS):
            continue
        found = {}
        for word in words:
            rows = column == word
            parts = {j: one[rows] for j, one in enumerate(table.columns) if j != i}
            held = [j for j, one in parts.items() if one.dtype.kind != "f" or np.isfinite(one).any()]
            places = {j: k for k, j in enumerate(held)}
            of = [{places[j] for j in one if j in places} for one in (table.integer, table.clocks, table.days)]
            columns, names = [parts[j] for j in held], [table.names[j] for j in held]
            found[str(word)] = Table(columns, names, of[0], clocks=of[1], days=of[2], preamble=table.preamble, stem=str(word))
        return found
    return {}


def read_sensors(tables: Mapping[str, Callable[[], Signals]]) -> Signals:
    """Join the sensors of all tables on the time stamps of the fastest sensor; unusable tables are left out with a warning."""
    parts: list[Part] = []
    signals = Signals(None, {})
    refused: list[tuple[str, Any]] = []
    for file in sorted(tables, key=lambda one: (len(one), one)):  # Accelerometer before AccelerometerUncalibrated
        try:
            one = tables[file]()
        except DataError as error:
            refused.append((file, error))
            continue
        # what is said about the clock or the rows of a file is about this file
        signals.findings += [finding.of(*(finding.subject or (file,))) for finding in one.findings]
        if one.time is None:
            refused.append((file, "it has no time column, so that its samples have no place beside those of other sensors"))
            continue
        for name, values in one.sensors.items():
            if name in {part.name for part in parts}:
                signals.findings.append(READ("not_read", what=f"{name} of {file}, since another file holds it"))
                continue
            # the values are already in SI
            parts.append(Part(name, file, _stamps(one), values, si_unit(name)))
            signals.units[name] = one.units[name]
            signals.columns[name] = [file, *one.columns[name]]
    if not parts:
        raise DataError(joined_messages([Message("{file}: {why}", file=file, why=why) for file, why in refused]), code="no_sensor")
    signals.findings += [READ("file_not_read", file=file, why=why) for file, why in refused]
    stated = dict(signals.units)
    join(parts, {}, signals, topics=False)
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
