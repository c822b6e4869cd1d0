"""`find`: find the calibration of a device in a folder, by name and date."""

import datetime
import json
import os
import pathlib
from typing import Any

from .._errors import DataError
from ._codec import SCHEMA

Date = str | datetime.date | datetime.datetime


def find(folder: str | os.PathLike[str], device: str, date: Date | None = None) -> pathlib.Path:
    """The calibration file of a device that was valid at a date: the latest one that is not newer than the date.

    Parameters
    ----------
    folder : folder to search, with its subfolders, for files written by `Calibration.save`. Other files are ignored.
    device : name of the device, or any id in its dictionary, as in `Calibration(device=...)`; case does not matter.
    date : date of the recording to be corrected: a date, or "2026-03-01", or "2026-03-01T12:00"; UTC unless it has a zone. None takes the
        latest calibration.

    Returns
    -------
    Path, for `Calibration.load`. The date of a calibration is that of its recording, `provenance["date"]`.

    Raises
    ------
    DataError
        If the folder does not exist, it has no calibration of the device, none is old enough, or two have the same date.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxcal
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for month in (1, 5):
    ...         unit = jaxcal.Calibration(device="unit 7", provenance={"date": f"2026-0{month}-10T08:00:00Z"})
    ...         unit.save(pathlib.Path(folder, f"{month}.json"))
    ...     jaxcal.calibration.find(folder, "Unit 7", "2026-03-01").name, jaxcal.calibration.find(folder, "unit 7").name
    ('1.json', '5.json')
    """
    folder = pathlib.Path(folder)
    if not folder.is_dir():
        raise DataError(f"{folder} is no folder; give the one with the calibrations", code="folder")
    held = [(path, document) for path in sorted(folder.rglob("*.json")) if (document := _calibration(path)) is not None]
    own = [(path, _dated(document, path)) for path, document in held if _is_of(document.get("device"), device)]
    if not own:
        known = sorted({str(document["device"].get("name")) for _, document in held if isinstance(document.get("device"), dict)})
        there = f"; there are {', '.join(known)}" if known else ""
        raise DataError(f"{folder} holds {len(held)} calibrations, none of the device {device!r}{there}", code="no_device")
    undated = [path for path, when in own if when is None]
    if undated and (date is not None or len(own) > 1):
        raise DataError(f"{undated[0]} has no date in its provenance; name the file itself", code="no_date")
    if len(own) == 1 and date is None:
        return own[0][0]
    limit = None if date is None else moment(date, "date")
    past = [(when, path) for path, when in own if when is not None and (limit is None or when <= limit)]
    if not past:
        first = min(when for _, when in own if when is not None)
        raise DataError(f"the first calibration of {device!r} in {folder} is of {first:%Y-%m-%d %H:%M} UTC, after {date}", code="too_young")
    latest = max(when for when, _ in past)
    found = [path for when, path in past if when == latest]
    if len(found) > 1:
        raise DataError(f"{found[0]} and {found[1]} are both of {latest:%Y-%m-%d %H:%M:%S} UTC; remove one, or name the file", code="two")
    return found[0]


def _calibration(path: pathlib.Path) -> dict[str, Any] | None:
    """The document of a calibration; None for any other file."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return document if isinstance(document, dict) and str(document.get("schema")).startswith(SCHEMA) else None


def _is_of(held: Any, device: str) -> bool:
    values = held.values() if isinstance(held, dict) else ()
    return any(isinstance(value, str | int) and str(value).strip().casefold() == device.strip().casefold() for value in values)


def _dated(document: dict[str, Any], path: pathlib.Path) -> datetime.datetime | None:
    provenance = document.get("provenance")
    date = provenance.get("date") if isinstance(provenance, dict) else None
    return None if date is None else moment(date, f"{path}: provenance.date")


def moment(date: Any, what: str) -> datetime.datetime:
    """A moment in UTC; a date without a time means its last second, so that a calibration of that day counts."""
    try:
        if isinstance(date, str):
            found = datetime.datetime.fromisoformat(date.strip())
            date = found.date() if len(date.strip()) <= 10 else found
        if not isinstance(date, datetime.datetime):
            date = datetime.datetime.combine(date, datetime.time(23, 59, 59))
    except (TypeError, ValueError) as error:
        raise DataError(f"{what} is {date!r}; expected a date such as 2026-03-01, or 2026-03-01T12:00", code="date") from error
    return date.replace(tzinfo=datetime.UTC) if date.tzinfo is None else date.astimezone(datetime.UTC)
