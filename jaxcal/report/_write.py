"""`write`: results as one HTML page."""

import importlib.metadata
import os
import pathlib
from typing import Any

from .._errors import DataError
from .._files import write_atomically
from .._log import Log
from ..alignment import AlignmentFit, Readings
from ..imu import ImuFit
from ..magnetometer import MagFit
from ..plot._labels import duration_label
from ..temperature import TemperatureFit
from ._document import check_results
from ._html import Markup, join
from ._imu import imu_sections
from ._magnetometer import mag_body
from ._noise import noise_body, recording
from ._north import north_page
from ._page import page
from ._thermal import check_thermal, thermal_body


def write(results: Any, path: str | os.PathLike[str], *, log: Log | Readings | None = None) -> None:
    """Write a report: one HTML file that needs nothing else, for screens light and dark, phones and paper.

    It says first what was found, with intervals, then shows the Allan deviations and their numbers, the warnings, what the
    coefficients mean, and where everything comes from.

    Parameters
    ----------
    results : channel -> `NoiseFit`, as `jaxcal.noise.characterise` returns them, channel -> `TemperatureFit`, as
        `jaxcal.temperature.characterise` does, the `ImuFit` of an IMU, the `MagFit` of a magnetometer, or the `AlignmentFit` of a
        turntable.
    path : file to write; an existing one is replaced in one step.
    log : the recording, for its summary, notes, warnings and provenance; with an `AlignmentFit` the `Readings` that were fitted, which
        its page shows.

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
    """
    version = importlib.metadata.version("jaxcal")
    title, lead, body = _content(results, log, version)
    write_atomically(path, page(title, lead, body, f"Written by jaxcal {version}"))


def _content(results: Any, log: Any, version: str) -> tuple[str, str, Markup]:
    """Title, line below it, and the sections of a page."""
    if isinstance(results, AlignmentFit):
        return "Alignment on a turntable", *north_page(results, log)
    if not (log is None or isinstance(log, Log)):
        raise DataError(f"log is {type(log).__name__}; give the Log that was read, or leave it out")
    if isinstance(results, ImuFit):
        lead = f"{len(results.residual_norm)} poses, {len(results.residual_turn)} turns at {results.rate:.6g} Hz"
        return _title(log, "Calibration"), lead, imu_sections(results, log, version)
    if isinstance(results, MagFit):
        return _title(log, "Magnetometer"), f"{len(results.residual)} readings: {results.verdict}", mag_body(results, log)
    if isinstance(results, dict) and any(isinstance(fit, TemperatureFit) for fit in results.values()):
        check_thermal(results)
        return _title(log, "Bias and temperature"), _channels(results), join((thermal_body(results, log), recording(log)))
    check_results(results)
    first = next(iter(results.values()))
    lead = f"{_channels(results)}, {duration_label(first.duration)} at {first.deviation.rate:.6g} Hz"
    return _title(log, "Noise"), lead, noise_body(results, log, version)


def _channels(results: dict[str, Any]) -> str:
    return f"{len(results)} channel{'s' * (len(results) != 1)}"


def _title(log: Log | None, what: str) -> str:
    file = None if log is None else log.provenance.get("file")
    if file:
        return f"{what} of {pathlib.PurePath(str(file)).name}"
    return "Sensor noise" if what == "Noise" else what
