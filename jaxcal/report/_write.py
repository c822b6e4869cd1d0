"""`write`: results as one HTML page; `document`: as JSON can say them."""

import importlib.metadata
import os
import pathlib
from typing import Any

from .._errors import DataError
from .._files import write_atomically
from .._log import Log
from ..alignment import AlignmentFit, Readings, verdict_name
from ..imu import ImuFit
from ..magnetometer import MagFit
from ..plot._style import duration_label
from ..temperature import TemperatureFit
from ._device import pairs, part, verdicts
from ._document import check_results, noise_document
from ._html import Markup, join
from ._imu import imu_document, imu_sections
from ._magnetometer import mag_body, mag_document
from ._noise import noise_body, noise_summary, recording
from ._north import north_document, north_page
from ._page import page
from ._thermal import check_thermal, temperature_document, thermal_body, thermal_summary


def write(results: Any, path: str | os.PathLike[str], *, log: Log | Readings | None = None, device: str | None = None) -> None:
    """Write a report: one HTML file that needs nothing else, for screens light and dark, phones and paper.

    It says first what was found, with intervals, then shows the figures and the numbers behind them, the warnings, what the
    words mean, and where everything comes from. Several results of one device make one page, with a table of verdicts first.

    Parameters
    ----------
    results : channel -> `NoiseFit`, as `jaxcal.noise.characterise` returns them, channel -> `TemperatureFit`, as
        `jaxcal.temperature.characterise` does, the `ImuFit` of an IMU, the `MagFit` of a magnetometer, or the `AlignmentFit` of a
        turntable. Or a list of these, or of pairs (result, its log), of one device.
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
        title, lead, body = _device(pairs(results, log), device, version)
    else:
        refused = isinstance(results, ImuFit) and results.accel is None
        if refused:
            raise DataError(f"there is nothing to report: the calibration was refused. {results.reason}")
        title, lead, body = _content(results, log, version, device)
    write_atomically(path, page(title, lead, body, f"Written by jaxcal {version}"))


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
    - "jaxcal.temperature/1": `provenance`, `notes`, `warnings` and `channels`. Each channel holds `kind`, `degree`, `unit`, `minimum`,
      `maximum`, `lag`, `play`, `rms`, `worst`, `worst_at`, `coefficients` (of the powers of T) with `coefficient_error`, `steps`,
      `candidates`, `curve` (temperature, bias, low, high at 101 temperatures), `warnings` and `notes`.
    - "jaxcal.imu/1": `verdict`, `reason`, `warnings`, `convention`, `method`, `gravity`, `rate`, `poses`, `turns`, `sensors` (each with
      `matrix`, `bias`, `g_sensitivity`, `intervals`), `residuals`, `held_out`, `condition`, `temperature` and `provenance`.
    - "jaxcal.mag/1", in the units of the readings: `verdict`, `reason`, `method`, `model`, `hard_iron`, `hard_iron_error`, `soft_iron`,
      `field`, `noise`, `heading_error` (rad, level and at 20 degrees of tilt), `inclination` (rad), `covariance` (`parameters`, `values`),
      `coverage`, `needed`, `outliers`, `readings`, `alignment`, `warnings`, `provenance` and `notes`.
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
    if isinstance(results, AlignmentFit):
        return north_document(results)
    if isinstance(results, ImuFit):
        return imu_document(results, log)
    if isinstance(results, MagFit):
        return mag_document(results, log)
    if _thermal(results):
        return temperature_document(results, log)
    return noise_document(results, log)


def _thermal(results: Any) -> bool:
    return isinstance(results, dict) and any(isinstance(fit, TemperatureFit) for fit in results.values())


def _content(results: Any, log: Any, version: str, device: str | None) -> tuple[str, str, Markup]:
    """Title, line below it, and the sections of a page."""
    if isinstance(results, AlignmentFit):
        return "Alignment on a turntable" if device is None else f"Alignment of {device}", *north_page(results, log)
    if not (log is None or isinstance(log, Log)):
        raise DataError(f"log is {type(log).__name__}; give the Log that was read, or leave it out")
    if isinstance(results, ImuFit):
        lead = f"{len(results.residual_norm)} poses, {len(results.residual_turn)} turns at {results.rate:.6g} Hz"
        return _title(log, "Calibration", device), lead, imu_sections(results, log, version)
    if isinstance(results, MagFit):
        return _title(log, "Magnetometer", device), f"{len(results.residual)} readings: {results.verdict}", mag_body(results, log)
    if _thermal(results):
        check_thermal(results)
        return _title(log, "Bias and temperature", device), _channels(results), join((thermal_body(results, log), recording(log)))
    check_results(results)
    first = next(iter(results.values()))
    lead = f"{_channels(results)}, {duration_label(first.duration)} at {first.deviation.rate:.6g} Hz"
    return _title(log, "Noise", device), lead, noise_body(results, log, version)


def _device(parts: list[tuple[Any, Any]], device: str | None, version: str) -> tuple[str, str, Markup]:
    """Title, line below it, and the body of a page on several results."""
    sections, rows, told = [], [], set()
    for number, (results, log) in enumerate(parts, start=1):
        title, lead, body = _content(results, log, version, None)
        if isinstance(log, Log) and id(log) in told:  # a recording is described once
            body = Markup(body.replace(recording(log), ""))
        told.add(id(log))
        sections.append(part(number, title, lead, body))
        rows += [(number, *row) for row in _summary(results)]
    lead = f"{len(parts)} result{'s' * (len(parts) != 1)}"
    return device or "Device", lead, join((verdicts(rows), *sections))


def _summary(results: Any) -> list[tuple[str, str, Any]]:
    """What a result is of, its verdict in a word, and what that means."""
    if isinstance(results, AlignmentFit):
        return [("Alignment", verdict_name(results.verdict), results.reason)]
    if isinstance(results, ImuFit):
        return [("Accelerometer and gyroscope" if results.gyro is not None else "Accelerometer", results.verdict, results.reason)]
    if isinstance(results, MagFit):
        return [("Magnetometer", results.verdict, results.reason)]
    return thermal_summary(results) if _thermal(results) else noise_summary(results)


def _channels(results: dict[str, Any]) -> str:
    return f"{len(results)} channel{'s' * (len(results) != 1)}"


def _title(log: Log | None, what: str, device: str | None) -> str:
    if device is not None:
        return f"{what} of {device}"
    file = None if log is None else log.provenance.get("file")
    if file:
        return f"{what} of {pathlib.PurePath(str(file)).name}"
    return "Sensor noise" if what == "Noise" else what
