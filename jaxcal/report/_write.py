"""`write`: write results as one HTML page."""

import datetime
import pathlib
from collections.abc import Sequence
from typing import Any

from .._answer import Reader
from .._errors import DataError
from .._files import version_of, write_atomically
from .._log import Log
from .._types import Checked, Given, PathLike
from ._answer import answer_page, badge
from ._html import Markup, inside, join, recorded, section, table, tag
from ._page import page

_TITLES = {"Noise": "Sensor noise", "Alignment": "Alignment on a turntable"}  # if neither device nor file is known


def write(
    results: Given | Sequence[Any], path: PathLike, *, log: Checked[Log] | None = None, device: str | None = None, reader: Reader = "python"
) -> None:  # fmt: skip
    """Write a report: one self-contained HTML file for light and dark screens, phones and paper.

    The report begins with the verdict, the main picture, the warnings that matter most, and the numbers with their intervals. Further
    curves, the signal with what was set aside, the numbers as other tools read them, notes and the provenance follow. Several results of
    one device make one page, which begins with a table of verdicts.

    Parameters
    ----------
    results : channel -> `NoiseFit` (from `jaxcal.noise.characterise`), channel -> `TemperatureFit` (from
        `jaxcal.temperature.characterise`), channel -> `Deviation`, channel -> `Spectrum`, an `ImuFit`, a `MagFit`, a
        `DeviceFit` or an `AlignmentFit`. Or a list of these, or of pairs (result, log), from one device.
    path : file to write; an existing file is replaced atomically.
    log : the `Log`, for its summary, notes, warnings and provenance. With a list, it is the log of every result without its own.
    device : name of the device for the title; the default is the file name of the log.
    reader : "python" or "terminal": how the page spells the options that it advises, `latitude=` or `--latitude`.

    Raises
    ------
    DataError
        If there are no results, or `log` has the wrong type.
    ExportError
        If the file cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxcal
    >>> y = jaxcal.noise.Noise(N=1e-4).simulate(5000, rate=100.0, seed=0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "report.html")
    ...     jaxcal.report.write({"gyro_x": jaxcal.noise.fit(y, rate=100.0)}, path)
    ...     path.read_text()[:15]
    '<!DOCTYPE html>'

    Two results of one device, each with its log:

    >>> from jaxcal.magnetometer import body_field, scenario
    >>> mag = jaxcal.Log(None, mag=body_field(scenario("all"), 50e-6), rate=50.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "device.html")
    ...     noise = {"gyro_x": jaxcal.noise.fit(y, rate=100.0)}
    ...     jaxcal.report.write([noise, (jaxcal.magnetometer.fit(mag.mag), mag)], path, device="unit 7")
    ...     "<h1>unit 7</h1>" in path.read_text(encoding="utf-8")
    True
    """
    version = version_of("jaxcal")
    if isinstance(results, (list, tuple)):
        pairs = _pairs(results, log)
        title, lead, body = _device(pairs, device, version, reader)
        log = pairs[0][1] if log is None else log
    else:
        title, lead, body = _content(results, log, version, device, reader)
    write_atomically(path, page(title, lead, body, f"Written by jaxcal {version}", _facts(log, device, version)))


def _facts(log: Any, device: str | None, version: str) -> list[tuple[str, str]]:
    """Facts for the top of the page: device, file, dates, command and version, if known."""
    origin = {} if log is None else log.provenance
    known = {
        "Device": device or origin.get("device"), "File": origin.get("file"), "Recorded": recorded(log),
        "Written": f"{datetime.date.today():%Y-%m-%d}", "Command": origin.get("command"), "Version": f"jaxcal {version}",
    }  # fmt: skip
    return [(name, str(value)) for name, value in known.items() if value]


def _as_one(results: Any) -> Any:
    """A dictionary channel -> result as one result, where these have a common class."""
    first = next(iter(results.values()), None) if isinstance(results, dict) else None
    several = getattr(first, "_several", None)
    if several is None:
        if hasattr(results, "findings"):
            return results
        found = "an empty dictionary" if results == {} else type(results if first is None else first).__name__
        raise DataError(f"{found} is no result; give what a fit returns, or a dictionary channel -> fit", code="no_results")
    if other := {type(one).__name__ for one in results.values()} - {type(first).__name__}:
        raise DataError(f"the channels have results of several kinds, {type(first).__name__} and {', '.join(sorted(other))}", code="kinds")
    return several(results)


def _content(results: Any, log: Any, version: str, device: str | None, reader: Reader, described: bool = True) -> tuple[str, str, Markup]:
    """Title, subtitle and sections of a page."""
    if not (log is None or (hasattr(log, "findings") and hasattr(log, "provenance"))):
        raise DataError(f"log is {type(log).__name__}; give the Log that was read, or leave it out", code="log")
    what, lead, body = answer_page(_as_one(results), log, version, reader, described)
    file = None if log is None else log.provenance.get("file")
    if device is None and file:
        device = pathlib.PurePath(str(file)).name
    title = f"{what} of {device}" if device is not None else str(_TITLES.get(what, what))
    return title, lead, body


def _pairs(results: Any, log: Any) -> list[tuple[Any, Any]]:
    """Pair every result with its own log if it has one, else with the common log."""
    found = []
    for item in results:
        own = isinstance(item, (list, tuple)) and len(item) == 2
        result, its = item if own else (item, log)
        if isinstance(result, (Log, list, tuple)) or type(result).__name__ == "Readings":
            raise DataError(f"{type(result).__name__} is no result; give a list of these, or of pairs (result, log)", code="no_results")
        found.append((result, its))
    if not found:
        raise DataError("there are no results; give at least one, or a list of pairs (result, log)", code="no_results")
    return found


def _device(parts: list[tuple[Any, Any]], device: str | None, version: str, reader: Reader) -> tuple[str, str, Markup]:
    """Title, subtitle and body of a page on several results: a table of verdicts, then one part for each result."""
    articles, rows, told = [], [], set()
    for number, (part, log) in enumerate(parts, start=1):
        results = _as_one(part)
        title, lead, body = _content(results, log, version, None, reader, id(log) not in told)  # each recording is described once
        told.add(id(log))
        name = f"part-{number}"
        head = join((tag("h2", title, id=name), tag("p", lead, class_="lead")))
        articles.append(tag("article", head, inside(f"{name}-", body), aria_labelledby=name))
        rows.append((tag("a", title, href=f"#{name}"), badge(results.verdict), results.headline))
    verdicts = section("Verdicts", "verdicts", table(("Part", "Verdict", "What was found"), rows, class_="verdicts"))
    return device or "Device", f"{len(parts)} result{'s' * (len(parts) != 1)}", join((verdicts, *articles))
