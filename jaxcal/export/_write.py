"""`write`: a calibration as a file for another tool."""

import importlib.metadata
import os
from collections.abc import Callable
from typing import Any

from .._errors import ExportError
from .._files import write_atomically
from ..calibration import Calibration
from ._ardupilot import ardupilot
from ._c import header
from ._kalibr import kalibr
from ._options import Options
from ._px4 import px4
from ._text import comment

#: format -> (function that gives its text and warnings, its comment mark)
_FORMATS: dict[str, tuple[Callable[[Calibration, Options], tuple[str, tuple[str, ...]]], str]] = {
    "kalibr": (kalibr, "#"),
    "px4": (px4, "#"),
    "ardupilot": (ardupilot, "#"),
    "c": (header, "//"),
}


def write(
    calibration: Calibration,
    path: str | os.PathLike[str],
    *,
    format: str = "kalibr",
    topic: str = "/imu0",
    axis: str = "worst",
    inflate: float | int = 1.0,
    density: Any = None,
    random_walk: Any = None,
    provenance: bool = True,
) -> tuple[str, ...]:
    """Write a calibration as a file that another tool reads.

    The noise of three axes becomes one number: N the noise density, K the random walk, both continuous in time. Bias instability
    B is never written as a random walk.

    Parameters
    ----------
    calibration : the `Calibration` to write.
    path : file to write; an existing one is replaced in one step.
    format : "kalibr" (`imu.yaml`: rad/s/sqrt(Hz), rad/s^2/sqrt(Hz), m/s^2/sqrt(Hz), m/s^3/sqrt(Hz)); "px4" (`.params`) and
        "ardupilot" (`.param`): biases, scale factors, magnetometer and thermal model, found by the ids in `calibration.device`. Any
        thermal model becomes a cubic there; what that loses is said. "c" is a C header with the magnetometer's correction and an
        accumulator for the next calibration; the options below are not for it.
    topic : ROS topic of the sensor.
    axis : "worst", the largest of the three axes, or "rms", their root mean square. The file lists the three in a comment.
    inflate : factor on all noise; the file says so.
    density : what to write where a fit did not find N: "upper_limit", a number (rad/s/sqrt(Hz) or m/s^2/sqrt(Hz)) for the one
        sensor that lacks it, or {"gyro": ..., "accel": ...}, which also replaces an N that was found. The file says so.
    random_walk : the same for K, in rad/s^2/sqrt(Hz) or m/s^3/sqrt(Hz).
    provenance : whether to begin with comments on origin and on what was left out.

    Returns
    -------
    Sentences on what the file leaves out or takes from elsewhere than the fit.

    Raises
    ------
    ExportError
        If the calibration lacks something that the format needs, an option is wrong, or the file cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxcal
    >>> gyro = {"unit": "rad/s", "Q": None, "N": [1e-4] * 3, "B": None, "K": [2e-6] * 3, "R": None}
    >>> accel = {"unit": "m/s^2", "Q": None, "N": [2e-3] * 3, "B": None, "K": [3e-5] * 3, "R": None}
    >>> device = jaxcal.Calibration(noise={"rate": 200.0, "gyro": gyro, "accel": accel})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "imu.yaml")
    ...     warnings = jaxcal.export.write(device, path, provenance=False)
    ...     print(path.read_text().splitlines()[-1])
    update_rate: 200.0   # Hz
    """
    if format not in _FORMATS:
        raise ExportError(f"unknown format {format!r}; expected one of {', '.join(_FORMATS)}")
    make, mark = _FORMATS[format]
    options = Options(topic=topic, axis=axis, inflate=inflate, density=density, random_walk=random_walk)
    text, warnings = make(calibration, options)
    if provenance:
        text = "".join(comment(line, mark) + "\n" for line in (*_origin(calibration, format), *warnings)) + text
    write_atomically(path, text)
    return warnings


def _origin(calibration: Calibration, format: str) -> list[str]:
    lines = [f"{format} file written by jaxcal {importlib.metadata.version('jaxcal')}"]
    name = (calibration.device or {}).get("name")
    if name:
        lines.append(f"device: {name}")
    origin = calibration.provenance or {}
    if origin.get("file"):
        lines.append(f"recording: {origin['file']}" + (f", SHA-256 {origin['sha256']}" if origin.get("sha256") else ""))
    return lines
