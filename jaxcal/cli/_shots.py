"""Further inputs of `jaxcal mag`: known headings, currents, held-out readings; and logs without times or names."""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

from ._options import CallError, Reading, in_counts, read_log
from ._readings import column_of

_PEEK, _SMALL = 20_000, 5_000_000  # bytes
_NO_TIMES = "there are no times, and a fit of norms needs none: the rows stand 1 s apart; give them with --rate"
_COUNTS = "whole numbers without a unit are counts, and so are all results; give it with --units mag=uT"


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
    """Options to read a log without named columns or times, with notes; a fit of field magnitudes needs neither times nor a unit."""
    if not path.is_file() or path.stat().st_size > _SMALL:
        return reading, []
    said: list[str] = []
    if not needs_time and not reading.columns and reading.format in (None, "csv", "json"):
        reading, said = _by_position(path, reading)
    timeless = [] if needs_time or reading.rate is not None else [({"rate": 1.0}, [_NO_TIMES])]
    units = in_counts(reading, "mag").units
    counted = [] if units == reading.units else [({"units": units}, [_COUNTS])]
    both = [({**one, **other}, [*word, *more]) for one, word in counted for other, more in timeless]
    for options, words in [({}, []), *timeless, *counted, *both]:
        tried = dataclasses.replace(reading, **options)
        if _has_readings(path, tried, "units" in options):
            return tried, [*said, *words]
    return reading, said  # reading by the command will report the reason


def _has_readings(path: Path, reading: Reading, whole: bool) -> bool:
    """Whether a log can be read with these options and has a magnetometer with three axes (`whole`: of whole numbers, for counts)."""
    import numpy as np

    import jaxcal

    try:
        mag = read_log(path, reading, "mag").mag
    except (jaxcal.DataError, jaxcal.UnitError):
        return False
    return mag is not None and mag.shape[1] == 3 and not (whole and np.any(mag[np.isfinite(mag)] % 1))


def _by_position(path: Path, reading: Reading) -> tuple[Reading, list[str]]:
    """Read three columns without names, or called x, y and z, as the magnetometer."""
    import numpy as np

    chosen: dict[str, Any] = {}
    if path.suffix.lower() == ".json":
        import jaxcal

        from ..io._readers._json import read_json

        try:
            table = read_json(path)
        except jaxcal.DataError:
            return reading, []  # reading by the command will report the reason
        bare = len(table.names) == 3 and not any(table.names)
        if not bare and not {"x", "y", "z"} <= set(table.names):
            return reading, []
        numbers = [0, 1, 2] if bare else [table.names.index(axis) for axis in "xyz"]
        values = np.stack([table.columns[i] for i in numbers], axis=1)
        chosen["columns"] = ("mag=0:2" if bare else "mag=x,y,z",)
    else:
        with path.open("rb") as file:
            lines = file.read(_PEEK).decode("utf-8", errors="replace").splitlines()[:-1]
        cells = [line.replace(",", " ").replace(";", " ").split() for line in lines if line.strip()]
        try:
            values = np.array(cells, dtype=float)
        except ValueError:
            return reading, []
        if values.ndim != 2 or values.shape[1] != 3:
            return reading, []
        chosen["columns"] = ("mag=0:2",)
    said = ["three columns of numbers are readings of the magnetometer"]
    if not reading.units and not np.any(values % 1):
        chosen["units"] = ("mag=1 T",)
        said.append(_COUNTS)
    return dataclasses.replace(reading, **chosen), said
