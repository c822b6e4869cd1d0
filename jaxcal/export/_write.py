"""`write`: write a calibration as a file for another tool."""

import importlib.metadata
import os
import pathlib
from collections.abc import Sequence
from typing import Any

from .._errors import ExportError
from .._files import write_atomically
from .._message import Message
from .._units import STANDARD_GRAVITY
from ..calibration import Calibration
from ..calibration._parts import COUNTS
from ._formats import FORMATS, Format, check_options, files_of
from ._options import Options, comment


def write(
    calibration: Calibration | Sequence[Calibration],
    path: str | os.PathLike[str],
    *,
    format: str = "kalibr",
    topic: str = "/imu0",
    axis: str = "worst",
    inflate: float | int = 1.0,
    density: Any = "upper_limit",
    random_walk: Any = "upper_limit",
    rate: float | int | None = None,
    gravity: float | int = STANDARD_GRAVITY,
    convention: str = "midpoint",
    model: str = "kalibr",
    frame: str = "up",
    flavour: str = "ros2",
    instance: int = 0,
    gyro_bias: bool = False,
    prefix: str = "JAXCAL_",
    accumulator: bool = False,
    force: bool = False,
    provenance: bool = True,
) -> tuple[str, ...]:
    """Write a calibration as a file that another tool reads.

    Noise N is written as the noise density and K as the random walk; bias instability B is never written as a random walk. If a tool
    uses one number for three axes, `axis` says how to combine them.

    Parameters
    ----------
    calibration : the `Calibration` to write; for "px4" and "ardupilot" also a list of them, one for each instance of the sensors.
    path : file to write; an existing file is replaced atomically. "imu_tk" writes two files: NAME_acc.calib and NAME_gyro.calib.
    format : "kalibr" (`imu.yaml`), "openvins" (`kalibr_imu_chain.yaml`, with its matrices), "vins" (lines for VINS-Mono and
        VINS-Fusion), "orbslam3" (lines), "gtsam" (Python), "px4" (`.params`), "ardupilot" (`.param`), "ros" (YAML), "imu_tk"
        (`.calib`), "motioncal" (68 bytes), "c" (C99 header), "csv" (one row per number). Most formats state the units beside the numbers
        or in comments.
    topic : ROS topic of the sensor.
    axis : "worst" uses the largest of the three axes, "rms" their root mean square. A comment in the file lists all three.
    inflate : factor applied to all noise; the file states it.
    density : value to write if the fit did not find N: "upper_limit", None to refuse, a number (rad/s/sqrt(Hz) or m/s^2/sqrt(Hz)) for
        the one sensor without N, or {"gyro": ..., "accel": ...}, which also replaces a fitted N. The file states it.
    random_walk : the same for K, in rad/s^2/sqrt(Hz) or m/s^3/sqrt(Hz).
    rate : true sampling rate in Hz; the default is that of the log, with a warning.
    gravity : m/s^2, for "vins" and "gtsam".
    convention : for "vins", "midpoint" writes N sqrt(2 rate), "per_sample" writes N sqrt(rate); the file states the other value, too.
    model : for "openvins", "kalibr" (lower triangles) or "rpng" (upper triangles).
    frame : for "gtsam", "up" or "down", the direction of the z axis.
    flavour : for "ros", "ros2", "imu_calib", "dlio" or "madgwick".
    instance : index of the sensors on the vehicle, from 0.
    gyro_bias : for "ardupilot", whether to write the gyroscope's bias, which the firmware estimates again at every start.
    prefix : prefix of the names in the C header.
    accumulator : whether the C header includes the accumulator for the next magnetometer calibration; see `Moments` and `Admission`.
    force : True also writes a calibration whose verdict is "weak" or "refused".
    provenance : whether to begin with comments on origin, units and omissions. imu_tk, motioncal and csv have no comments.

    Returns
    -------
    tuple of str
        Sentences on what the file omits, and on values that do not come from the fit.

    Raises
    ------
    ExportError
        If the calibration lacks something that the format needs, its verdict is "weak" or "refused" without `force`, an option is
        wrong or not used by the format, or the file cannot be written.

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
    options = Options(
        topic=topic, axis=axis, inflate=inflate, density=density, random_walk=random_walk, rate=rate, gravity=gravity,
        convention=convention, model=model, frame=frame, flavour=flavour, instance=instance, gyro_bias=gyro_bias, prefix=prefix,
        accumulator=accumulator,
    )  # fmt: skip
    kind = check_options(format, options)
    devices = _devices(calibration, kind, format)
    warnings = [sentence for device in devices for sentence in (*_doubts(device, kind, force), *_left_out(device, kind, format))]
    made = kind.make(devices if kind.many else devices[0], options)
    warnings = tuple(dict.fromkeys([*warnings, *made.warnings]))
    files = files_of(pathlib.Path(path), format)
    for suffix, content in (made.content if isinstance(made.content, dict) else {"": made.content}).items():
        if provenance and kind.mark:
            lines = [comment(line, kind.mark) + "\n" for line in (*_origin(devices, format), *made.facts, *warnings)]
            existing = content.splitlines(keepends=True)
            content = "".join((*existing[: kind.after], *lines, *existing[kind.after :]))
        write_atomically(files[suffix], content)
    return warnings


def _devices(calibration: Any, kind: Format, format: str) -> list[Calibration]:
    devices = [calibration] if isinstance(calibration, Calibration) else list(calibration)
    if not devices or not all(isinstance(device, Calibration) for device in devices):
        raise ExportError("expected a Calibration, or a list of them", code="not_a_calibration")
    if len(devices) > 1 and not kind.many:
        several = [name for name, one in FORMATS.items() if one.many]
        raise ExportError(f"{format} holds one device, not {len(devices)}; several go into {' and '.join(several)}", code="several")
    return devices


def _doubts(calibration: Calibration, kind: Format, force: bool) -> list[str]:
    """Warnings on the calibration itself, which apply to every format."""
    said = []
    for name in ("imu", "magnetometer"):
        section = getattr(calibration, name)
        if name not in kind.sections or section is None:
            continue
        if name == "magnetometer" and section.unit == COUNTS and not kind.counts:
            taking = " and ".join(other for other, one in FORMATS.items() if one.counts)
            raise ExportError(f"the magnetometer is calibrated in counts, which only {taking} take", code="counts")
        verdict = section.verdict
        if verdict in ("weak", "refused"):
            reason = f" ({section.verdict_reason})" if section.verdict_reason else ""
            sentence = f"the verdict on the {name} calibration is {verdict!r}{reason}"
            if not force:
                raise ExportError(Message("{sentence}; {option.force:True} writes it all the same", sentence=sentence), code="several")
            said.append(f"{sentence}, and it was forced")
    applied = (calibration.provenance or {}).get("applied")
    if applied and set(kind.sections) & {"imu", "magnetometer", "temperature"}:
        held = ", ".join(applied) if isinstance(applied, (list, dict)) else str(applied)
        said.append(
            f"the readings behind this calibration had the device's own corrections in them already ({held}): it would be applied twice "
            "beside them; compose it with the device's present calibration first (Calibration.compose)"
        )
    return said


def _left_out(calibration: Calibration, kind: Format, format: str) -> list[str]:
    """Warnings on sections and parameters that the format cannot represent."""
    held = [name for name in ("noise", "imu", "magnetometer", "temperature") if getattr(calibration, name) is not None]
    left = [name for name in held if name not in kind.sections]
    said = []
    if left:
        mend = "" if left == ["noise"] else ": correct the data with this calibration before the tool gets them (jaxcal apply)"
        said.append(f"not written, for {format} has no place for it: {', '.join(left)}{mend}")
    parts = {} if calibration.imu is None or "imu" in left else calibration.imu.parts
    if calibration.magnetometer is not None and "magnetometer" not in left:
        parts = {**parts, "magnetometer": calibration.magnetometer}
    for sensor, part in parts.items():
        if type(part.model) is not part.base:
            fields = dict.fromkeys(name.partition("[")[0] for name in part.further)
            what = ", ".join(fields) or "the formula"
            said.append(f"not written, for {format} has no place for it: {what} of the {sensor} ({type(part.model).__name__})")
    return said


def _origin(devices: Sequence[Calibration], format: str) -> list[str]:
    lines = [f"{format} file written by jaxcal {importlib.metadata.version('jaxcal')}"]
    for calibration in devices:
        name = (calibration.device or {}).get("name")
        if name:
            lines.append(f"device: {name}")
        origin = calibration.provenance or {}
        if origin.get("file"):
            lines.append(f"recording: {origin['file']}" + (f", SHA-256 {origin['sha256']}" if origin.get("sha256") else ""))
    return lines
