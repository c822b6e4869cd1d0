"""`write`: results as one HTML page."""

import importlib.metadata
import os
import pathlib
from typing import Any

from .._files import write_atomically
from .._log import Log
from ..imu import ImuFit
from ..magnetometer import MagFit
from ..plot._labels import duration_label
from ..temperature import TemperatureFit
from ._document import check_results
from ._html import join
from ._imu import imu_sections
from ._magnetometer import mag_body
from ._noise import meaning, plots, provenance, recording, remarks, verdict
from ._page import page
from ._thermal import check_thermal, thermal_body


def write(results: Any, path: str | os.PathLike[str], *, log: Log | None = None) -> None:
    """Write a report: one HTML file that needs nothing else, for screens light and dark, phones and paper.

    It says first what was found, with intervals, then shows the Allan deviations and their numbers, the warnings, what the
    coefficients mean, and where everything comes from.

    Parameters
    ----------
    results : channel -> `NoiseFit`, as `jaxcal.noise.characterise` returns them, channel -> `TemperatureFit`, as
        `jaxcal.temperature.characterise` does, the `ImuFit` of an IMU, or the `MagFit` of a magnetometer.
    path : file to write; an existing one is replaced in one step.
    log : the recording, for its summary, notes, warnings and provenance.

    Raises
    ------
    DataError
        If there are no results, or a calibration was refused.
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
    if isinstance(results, ImuFit):
        lead = f"{len(results.residual_norm)} poses, {len(results.residual_turn)} turns at {results.rate:.6g} Hz"
        body = imu_sections(results, log, version)
        write_atomically(path, page(_title(log, "Calibration"), lead, body, f"Written by jaxcal {version}"))
        return
    if isinstance(results, MagFit):
        body, lead = mag_body(results, log), f"{len(results.residual)} readings: {results.verdict}"
        write_atomically(path, page(_title(log, "Magnetometer"), lead, body, f"Written by jaxcal {version}"))
        return
    if isinstance(results, dict) and any(isinstance(fit, TemperatureFit) for fit in results.values()):
        check_thermal(results)
        lead = f"{len(results)} channel{'s' * (len(results) != 1)}"
        body = join((thermal_body(results, log), recording(log)))
        write_atomically(path, page(_title(log, "Bias and temperature"), lead, body, f"Written by jaxcal {version}"))
        return
    check_results(results)
    first = next(iter(results.values()))
    count = f"{len(results)} channel{'s' * (len(results) != 1)}"
    lead = f"{count}, {duration_label(first.duration)} at {first.deviation.rate:.6g} Hz"
    body = join(
        (
            verdict(results, log),
            plots(results),
            remarks(results, log),
            recording(log),
            meaning(results),
            provenance(results, log, version),
        )
    )
    write_atomically(path, page(_title(log, "Noise"), lead, body, f"Written by jaxcal {version}"))


def _title(log: Log | None, what: str) -> str:
    file = None if log is None else log.provenance.get("file")
    if file:
        return f"{what} of {pathlib.PurePath(str(file)).name}"
    return "Sensor noise" if what == "Noise" else what
