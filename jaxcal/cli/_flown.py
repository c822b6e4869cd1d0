"""Flight logs in `jaxcal mag`: every compass, with the attitudes of the flight controller, and the field at the place that GPS shows."""

import contextlib
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .._errors import DataError
from ._options import CallError, Reading


def flown(path: Path, align: str | None, headings: bool) -> Any:
    """Attitudes, place and compasses of a flight log; None if it is none, or if something else is to give the attitudes."""
    from ..io import flight

    if align == "attitude":
        return flight(path)
    with contextlib.suppress(DataError, OSError):  # reading by the command will report the reason
        return flight(path) if align is None and not headings else None
    return None


def of_place(flight: Any) -> tuple[Any, list[str]]:
    """The field at the place and day of a flight, None if they are not known, and what to say of it."""
    from ..magnetometer import earth_field

    if flight.place is None:
        return None, ["the log has no fix of GPS: give --place and --date, or --inclination, for the dip of the field"]
    latitude, longitude, altitude = flight.place
    where = f"{latitude:.3f} {longitude:.3f} on {flight.date}"
    try:
        return earth_field(latitude, longitude, flight.date, altitude=altitude), [f"field and dip are those of {where}, by GPS"]
    except DataError as error:
        return None, [f"GPS shows {where}, but: {error}"]


def each(run: Callable[[Reading, Any, str], None], flight: Any, reading: Reading, writing: Any, folder: str) -> None:
    """Call `run` for a log, or for every compass of a flight log, each with a folder of its own; none stops the others."""
    compasses = () if flight is None or reading.topics else flight.compasses
    if len(compasses) < 2:
        run(dataclasses.replace(reading, topics=compasses) if compasses else reading, writing, folder)
        return
    if any(value is not None for name, value in vars(writing).items() if name != "out"):
        raise CallError(f"the log has {len(compasses)} compasses: choose one for these files with --topics {compasses[0]}", "several")
    errors: list[tuple[str, DataError]] = []
    for compass in compasses:
        own = Path(writing.out or folder, compass.replace(":", "_"))
        try:
            run(dataclasses.replace(reading, topics=(compass,)), dataclasses.replace(writing, out=own), "")
        except DataError as error:
            errors.append((compass, error))
    if errors:
        raise DataError("; ".join(f"{compass}: {error}" for compass, error in errors), code=errors[-1][1].code)
