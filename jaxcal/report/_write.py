"""`write`: results as one HTML page; `document`: as JSON can say them."""

import datetime
import importlib
import importlib.metadata
import os
import pathlib
import sys
from typing import TYPE_CHECKING, Any

from .._errors import DataError
from .._files import write_atomically
from .._log import Log
from ._html import Markup, inside, join, recorded, recording, section, table, tag
from ._page import page

if TYPE_CHECKING:
    from ..alignment import Readings
else:
    Readings = Any  # a page does not read the parts of the package that it is not about

_PACKAGE = __name__.partition(".")[0]
#: kind of result -> module of the package with its `document`, its `page` and its `summary`; and of a dictionary channel -> result
_KINDS = {("alignment", "AlignmentFit"): "_north", ("imu", "ImuFit"): "_imu", ("magnetometer", "MagFit"): "_magnetometer",
          ("device", "DeviceFit"): "_device"}  # fmt: skip
_BY_CHANNEL = {("temperature", "TemperatureFit"): "_thermal", ("allan", "Deviation"): "_curves", ("spectrum", "Spectrum"): "_curves"}
_TITLES = {"Noise": "Sensor noise", "Alignment": "Alignment on a turntable"}  # where neither device nor file is known
_BADGES = {"good": " present", "ok": " present", "fitted": " present"}


def write(results: Any, path: str | os.PathLike[str], *, log: Log | Readings | None = None, device: str | None = None) -> None:
    """Write a report: one HTML file that needs nothing else, for screens light and dark, phones and paper.

    It says first what was found, with intervals, then shows the figures and the numbers behind them, the warnings, what the
    words mean, and where everything comes from. Several results of one device make one page, with a table of verdicts first.

    Parameters
    ----------
    results : channel -> `NoiseFit`, as `jaxcal.noise.characterise` returns them, channel -> `TemperatureFit`, as
        `jaxcal.temperature.characterise` does, channel -> `Deviation` or channel -> `Spectrum`, the `ImuFit` of an IMU, the `MagFit` of a
        magnetometer, the `DeviceFit` of all three, or the `AlignmentFit` of a turntable. Or a list of these, or of pairs (result, its
        log), of one device.
    path : file to write; an existing one is replaced in one step.
    log : the recording, for its summary, notes, warnings and provenance; with an `AlignmentFit` the `Readings` that were fitted, which
        its page shows. With a list it is the log of every result that comes without one, but not of an `AlignmentFit`.
    device : name of the device, for the title; by default the name of the log's file.

    Raises
    ------
    DataError
        If there are no results, a calibration was refused, or `log` is not what belongs to the results.
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

    Two results of one device, each with the log that it comes from:

    >>> from jaxcal.magnetometer import body_field, scenario
    >>> mag = jaxcal.Log(None, mag=body_field(scenario("all"), 50e-6), rate=50.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "device.html")
    ...     noise = {"gyro_x": jaxcal.noise.fit(y, rate=100.0)}
    ...     jaxcal.report.write([noise, (jaxcal.magnetometer.fit(mag.mag), mag)], path, device="unit 7")
    ...     "<h1>unit 7</h1>" in path.read_text(encoding="utf-8")
    True
    """
    version = importlib.metadata.version("jaxcal")
    if isinstance(results, (list, tuple)):
        title, lead, body = _device(_pairs(results, log), device, version)
    elif _is(results, "imu", "ImuFit") and results.accel is None:
        raise DataError(f"there is nothing to report: the calibration was refused. {results.reason}")
    else:
        title, lead, body = _content(results, log, version, device)
    first = log if log is not None or not isinstance(results, (list, tuple)) else _pairs(results, log)[0][1]
    write_atomically(path, page(title, lead, body, f"Written by jaxcal {version}", _facts(first, device, version)))


def _facts(log: Any, device: str | None, version: str) -> list[tuple[str, str]]:
    """What stands at the top: device, file, dates, command and version, as far as they are known."""
    origin = log.provenance if isinstance(log, Log) else {}
    known = {
        "Device": device or origin.get("device"), "File": origin.get("file"), "Recorded": recorded(log) if isinstance(log, Log) else None,
        "Written": f"{datetime.date.today():%Y-%m-%d}", "Command": origin.get("command"), "Version": f"jaxcal {version}",
    }  # fmt: skip
    return [(name, str(value)) for name, value in known.items() if value]


def document(results: Any, log: Any = None) -> dict[str, Any]:
    """Results as a dictionary for JSON, in SI units and degC. What is infinite or not known is None.

    Parameters
    ----------
    results : one result, as for `write`.
    log : the recording, for its provenance, notes and warnings; the readings of a turntable add nothing.

    Returns
    -------
    Dictionary with `schema`, `version`, and by the kind of results:

    - "jaxcal.noise/1": `rate` (Hz), `duration` (s), `provenance`, `notes`, `warnings` (of the log) and `channels`. Each channel holds for
      every term `value`, `low`, `high`, `upper_limit`, `verdict`, `significance`, `longer_record` (s to reach 10 %), `decides` (s that
      would decide whether it is there) and `unit`; then `method`, `confidence`, `band` (s), `left_out`, `goodness`, `warnings`, `notes`,
      `markov` (strength, correlation time in s) and `sinusoid` (amplitude, Hz).
    - "jaxcal.allan/1", "jaxcal.psd/1": `provenance`, `notes`, `warnings` and `channels`, each with the fields of its result.
    - "jaxcal.temperature/1": `provenance`, `notes`, `warnings` and `channels`. Each channel holds `kind`, `degree`, `unit`, `minimum`,
      `maximum`, `lag`, `play`, `rms`, `worst`, `worst_at`, `coefficients` (of the powers of T) with `coefficient_error`, `steps`,
      `candidates`, `curve` (temperature, bias, low, high at 101 temperatures), `warnings` and `notes`.
    - "jaxcal.imu/1": `verdict`, `reason`, `warnings`, `convention`, `method`, `gravity`, `rate`, `poses`, `turns`, `sensors` (each with
      `matrix`, `bias`, `g_sensitivity`, `intervals`), `residuals`, `held_out`, `condition`, `temperature` and `provenance`.
    - "jaxcal.mag/1", in the units of the readings: `verdict`, `reason`, `method`, `model`, `hard_iron`, `hard_iron_error`, `soft_iron`,
      `soft_iron_error`, `field`, `noise`, `heading_error` (rad, level and at 20 degrees of tilt), `inclination` (rad),
      `covariance` (`parameters`, `values`),
      `coverage`, `needed`, `outliers`, `readings`, `alignment`, `terms` (of currents: value, error), `check`, `warnings`, `provenance`
      and `notes`.
    - "jaxcal.device/1": `verdict`, `reason`, `verdicts` (of each sensor), `parameters` (name -> `value`, `low`, `high` at 95 %, or None
      where the recording does not determine it), `undetermined`, `covariance` (`parameters`, `values`), `noise`, `reach` (m), `speed`
      (m/s), `disagreement`, `disturbed` and `rests` (start, stop in s), `contribution` (kind of motion -> share in each parameter),
      `gravity`, `rate`, `duration`, `warnings`, `notes` and `provenance`.
    - "jaxcal.north/1": `verdict`, `reason`, `parameters` (name -> `value`, `std`, `low`, `high` at 95 %, `unit`), `rank`, `unobservable`,
      `undetermined`, `chi_square`, `degrees_of_freedom`, `p_value` and `notes`.

    Raises
    ------
    DataError
        If there are no results, or a channel has no known sensor.

    Examples
    --------
    >>> import jaxcal
    >>> from jaxcal.magnetometer import body_field, scenario
    >>> jaxcal.report.document(jaxcal.magnetometer.fit(body_field(scenario("all"), 50e-6)))["verdict"]
    'good'
    """
    return _kind(results).document(results, log)


def _is(result: Any, home: str, name: str) -> bool:
    """Whether it is of a class of the package; a class whose module was never read has no results."""
    module = sys.modules.get(f"{_PACKAGE}.{home}")
    return module is not None and isinstance(result, getattr(module, name))


def _kind(results: Any) -> Any:
    """The module that knows this kind of result; what is none of them is refused as noise."""
    many = isinstance(results, dict)
    first = next(iter(results.values()), None) if many else results
    kinds = _BY_CHANNEL if many else _KINDS
    name = next((module for (home, one), module in kinds.items() if _is(first, home, one)), "_noise")
    return importlib.import_module(f".{name}", __package__)


def _content(results: Any, log: Any, version: str, device: str | None) -> tuple[str, str, Markup]:
    """Title, line below it, and the sections of a page."""
    if not (log is None or isinstance(log, Log) or _is(results, "alignment", "AlignmentFit")):
        raise DataError(f"log is {type(log).__name__}; give the Log that was read, or leave it out")
    what, lead, body = _kind(results).page(results, log, version)
    file = log.provenance.get("file") if isinstance(log, Log) else None
    if device is None and file:
        device = pathlib.PurePath(str(file)).name
    title = f"{what} of {device}" if device is not None else str(_TITLES.get(what, what))
    return title, lead, body


def _pairs(results: Any, log: Any) -> list[tuple[Any, Any]]:
    """Every result with its log: its own where it comes as a pair, else the common one."""
    found = []
    for item in results:
        own = isinstance(item, (list, tuple)) and len(item) == 2
        result, its = item if own else (item, None if _is(item, "alignment", "AlignmentFit") else log)
        if isinstance(result, (Log, list, tuple)) or _is(result, "alignment", "Readings"):
            raise DataError(f"{type(result).__name__} is not a result; give a list of results, or of pairs (result, log)")
        found.append((result, its))
    if not found:
        raise DataError("there are no results; give at least one, or a list of pairs (result, log)")
    return found


def _device(parts: list[tuple[Any, Any]], device: str | None, version: str) -> tuple[str, str, Markup]:
    """Title, line below it, and the body of a page on several results: the verdicts in a table, then each result as a part."""
    articles, rows, told = [], [], set()
    for number, (results, log) in enumerate(parts, start=1):
        title, lead, body = _content(results, log, version, None)
        if isinstance(log, Log) and id(log) in told:  # a recording is described once
            body = Markup(body.replace(recording(log), ""))
        told.add(id(log))
        name = f"part-{number}"
        head = join((tag("h2", title, id=name), tag("p", lead, class_="lead")))
        articles.append(tag("article", head, inside(f"{name}-", body), aria_labelledby=name))
        for what, verdict, sentence in _kind(results).summary(results):
            badge = tag("span", verdict, class_=f"badge{_BADGES.get(verdict, ' hint')}")
            rows.append((tag("a", what, href=f"#{name}"), badge, sentence))
    verdicts = section("Verdicts", "verdicts", table(("Part", "Verdict", "What was found"), rows, class_="verdicts"))
    return device or "Device", f"{len(parts)} result{'s' * (len(parts) != 1)}", join((verdicts, *articles))
