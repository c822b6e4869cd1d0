"""Further inputs of `jaxcal mag`: known headings, currents, held-out readings; and logs without times or names."""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

from ._options import CallError, Reading, in_counts, read_log
from ._readings import column_of

_SMALL = 5_000_000  # bytes
NO_TIMES = "there are no times, and a fit of norms needs none: the rows count as 1 s apart; give them with --rate"
COUNTS = "whole numbers without a unit are counts, and so are all results; give it with --units mag=uT"


class Shots(NamedTuple):
    """Known headings in rad (n,), specific force from known attitudes (n, 3), currents by name (n,), flags of held-out readings (n,)."""

    headings: Any
    up: Any
    currents: dict[str, Any]
    held: Any


def shots(path: Path, reading: Reading, log: Any, headings: str | None, currents: str | None, check: int | None) -> Shots:
    """Read the requested columns on the samples of the log."""
    import numpy as np

    from ..magnetometer import body_field

    angle = up = None
    if headings is not None:
        names = [name.strip() for name in headings.split(",")]
        if len(names) not in (1, 3):
            raise CallError(f"--headings {headings}: expected one column, or three: heading,roll,pitch")
        angles = [column_of(path, reading, name, len(log.time), "deg") for name in names]
        angle = angles[0]
        if len(names) == 3:
            attitudes = np.stack([angle, angles[2], angles[1]], axis=1)
            up = -9.80665 * np.asarray(body_field(np.nan_to_num(attitudes), 1.0, np.pi / 2))
            angle = np.where(np.isfinite(attitudes).all(axis=1), angle, np.nan)
    wanted = [name.strip() for name in currents.split(",")] if currents else []
    own = {"time": log.time, "temperature": None if log.temperature is None else np.ravel(log.temperature)}
    found = {name: column_of(path, reading, name, len(log.time), None) if own.get(name) is None else own[name] for name in wanted}
    held = np.zeros(len(log.time), dtype=bool)
    if check is not None:
        # hold out all readings of a pose together
        pose = np.arange(len(held)) if angle is None else np.cumsum(np.diff(angle, prepend=np.nan) != 0)
        held = pose % check == check - 1
    return Shots(angle, up, found, held)


def ready(path: Path, reading: Reading, needs_time: bool) -> tuple[Reading, list[str]]:
    """Options to read a log without times or a unit, with notes; a fit of field magnitudes needs neither."""
    import numpy as np

    import jaxcal

    if not path.is_file() or path.stat().st_size > _SMALL:
        return reading, []
    for units, said in ((reading.units, []), (in_counts(reading, "mag").units, [COUNTS])):
        tried = dataclasses.replace(reading, units=units)
        try:
            log = read_log(path, tried, "mag")
        except (jaxcal.DataError, jaxcal.UnitError):
            continue
        if log.mag is None or log.mag.shape[1] != 3 or (said and np.any(log.mag[np.isfinite(log.mag)] % 1)):
            continue
        if "no_clock" in log.codes and not needs_time:
            return dataclasses.replace(tried, rate=1.0), [*said, NO_TIMES]
        return tried, said
    return reading, []  # reading by the command will report the reason
