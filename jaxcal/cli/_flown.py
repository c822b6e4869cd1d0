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


def of_place(flight: Any, options: dict[str, Any]) -> tuple[Any, list[str]]:
    """The field at the place and day of a flight, None if they are not known, and what to say; place and day join the `options`."""
    from ..magnetometer import earth_field

    said = [f"the vertical is that of {flight.source}"]
    if flight.place is None:
        return None, [*said, "the log has no fix of GPS: give --place and --date, or --inclination, for the dip of the field"]
    latitude, longitude, altitude = flight.place
    where = f"{latitude:.3f} {longitude:.3f} on {flight.date}"
    try:
        found = earth_field(latitude, longitude, flight.date, altitude=altitude)
    except DataError as error:
        return None, [*said, f"GPS shows {where}, but: {error}"]
    options |= {"place": (latitude, longitude), "date": str(flight.date)}
    return found, [*said, f"field and dip are those of {where}, by GPS"]


def each(run: Callable[[Reading, Any, str, Any], None], flight: Any, reading: Reading, writing: Any, folder: str) -> None:
    """Call `run` for a log, or for every compass of a flight log, each with a folder and an id of its own; none stops the others."""
    known: dict[str, Any] = {} if flight is None else flight.compasses
    compasses = list(known) if not reading.topics else [one for one in known if one in reading.topics]
    if reading.topics or len(compasses) < 2:
        own = reading if reading.topics or not compasses else dataclasses.replace(reading, topics=(compasses[0],))
        run(own, writing, folder, known[compasses[0]] if compasses else None)
        return
    if any(value is not None for name, value in vars(writing).items() if name != "out"):
        raise CallError(f"the log has {len(compasses)} compasses: choose one for these files with --topics {compasses[0]}", "several")
    errors: list[tuple[str, DataError]] = []
    for compass, device in known.items():
        place = Path(writing.out or folder, compass.replace(":", "_"))
        try:
            run(dataclasses.replace(reading, topics=(compass,)), dataclasses.replace(writing, out=place), "", device)
        except DataError as error:
            errors.append((compass, error))
    if errors:
        raise DataError("; ".join(f"{compass}: {error}" for compass, error in errors), code=errors[-1][1].code)
