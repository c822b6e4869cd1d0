"""`write`: write a calibration as a file for another tool."""

import os
import pathlib
from collections.abc import Iterator, Sequence
from typing import Any

from .._answer import Finding
from .._errors import ExportError
from .._files import check_replaceable, version_of, write_atomically
from .._message import Message
from ..calibration import Calibration
from ..calibration._parts import COUNTS
from ..imu import ThermalTriad
from ._findings import FINDINGS
from ._formats import FORMATS, Format, checked_options
from ._options import comment


def write(
    calibration: Calibration | Sequence[Calibration], path: str | os.PathLike[str], *, format: str = "kalibr", force: bool = False,
    provenance: bool = True, **options: Any,
) -> tuple[Finding, ...]:  # fmt: skip
    """Write a calibration as a file that another tool reads.

    Noise N is written as the noise density and K as the random walk; bias instability B is never written as a random walk.

    Parameters
    ----------
    calibration : the `Calibration` to write; for "px4" and "ardupilot" also a list of them, one for each instance of the sensors.
    path : file to write, in one step.
    format : "kalibr" (`imu.yaml`), "openvins" (`kalibr_imu_chain.yaml`, with its matrices), "vins" (lines for VINS-Mono and
        VINS-Fusion), "orbslam3" (lines), "gtsam" (Python), "px4" (`.params`), "ardupilot" (`.param`), "ros" (YAML), "motioncal"
        (68 bytes), "fusion" and "magneto" (lines of C), "inav" and "betaflight" (lines), "c" (C99 header), "csv" (one row per number). Most
        formats state the units beside the numbers or in comments.
    force : True also replaces a file that jaxcal did not write, or wrote for another log, and writes a calibration whose verdict is "weak"
        or "refused".
    provenance : whether to begin with comments on origin, units and omissions. motioncal and csv have no comments.
    options : those of the format:

        - kalibr, openvins, vins, orbslam3: `axis` ("worst" of the three axes, or "rms", their root mean square; a comment lists all three),
          `motion` (a `jaxcal.budget.Motion`: N is then the noise to expect in increments over `window` s under it, with the errors of
          the calibration), `random_walk` (where no K was found: "upper_limit", None to refuse, or a number for a sensor, as
          {"gyro": 2e-6}, in rad/s^2/sqrt(Hz) or m/s^3/sqrt(Hz), which also replaces a fitted K), `rate` (true sampling rate in Hz; else
          that of the log). Except orbslam3: `topic` (ROS topic).
        - vins: `gravity` (m/s^2), `convention` ("midpoint" writes N sqrt(2 rate), "per_sample" N sqrt(rate); the file states the other).
        - gtsam: `motion`, `window`, `random_walk`, `gravity`, `frame` ("up" or "down", the direction of the z axis).
        - px4, ardupilot: `instance` (index of the sensors on the vehicle, from 0). ardupilot: `gyro_bias` (True also writes the bias of the
          gyroscope, which the firmware estimates again at every start).
        - ros: `motion`, `window`, `rate`.
        - c: `prefix` (of the names), `solver` (True also writes the code that collects readings of a magnetometer, accelerometer or
          gyroscope on a microcontroller and solves for a calibration there; an empty `Calibration()` is enough), `double` (True for
          double precision), `earlier` (an earlier `Calibration` of the device, with a date: biases then go on to change as since then).

    Returns
    -------
    tuple of Finding
        What the file omits, and values that do not come from the fit.

    Raises
    ------
    ExportError
        If the calibration lacks something that the format needs, its verdict is "weak" or "refused" without `force`, an option is
        wrong ("option") or not used by the format ("no_such_option"), or the file cannot be written or replaced.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxcal
    >>> gyro = {"unit": "rad/s", "Q": None, "N": [1e-4] * 3, "B": None, "K": [2e-6] * 3, "R": None}
    >>> accel = {"unit": "m/s^2", "Q": None, "N": [2e-3] * 3, "B": None, "K": [3e-5] * 3, "R": None}
    >>> device = jaxcal.Calibration(noise={"rate": 200.0, "gyro": gyro, "accel": accel})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "imu.yaml")
    ...     findings = jaxcal.export.write(device, path, provenance=False)
    ...     print(path.read_text().splitlines()[-1])
    update_rate: 200.0   # Hz
    """
    chosen = checked_options(format, options)
    devices = _devices(calibration, FORMATS[format], format)
    content, found = rendered(devices, format, chosen, force=force, provenance=provenance)
    digest = (devices[0].provenance or {}).get("sha256", "") if len(devices) == 1 else ""
    check_replaceable(path, digest, force=force or _holds(pathlib.Path(path), content))
    write_atomically(path, content)
    return found


def rendered(devices: Sequence[Calibration], format: str, chosen: Any, *, force: bool, provenance: bool) -> tuple[Any, tuple[Finding, ...]]:
    """Content of the file, and what the format omits."""
    kind = FORMATS[format]
    found = [one for device in devices for one in (*_doubts(device, kind, force), *_left_out(device, kind, format))]
    made = kind.function(f"write_{format}")(devices if kind.many else devices[0], chosen)
    found = tuple(dict.fromkeys([*found, *made.findings]))
    if not (provenance and kind.mark):
        return made.content, found
    lines = [comment(line, kind.mark) + "\n" for line in (*_origin(devices, format), *made.facts, *map(str, found))]
    return "".join((kind.head, *lines, made.content.removeprefix(kind.head))), found


def _holds(path: pathlib.Path, content: str | bytes) -> bool:
    """Whether a file has this content already: a cell of a notebook that is run again loses nothing, also without `provenance`."""
    return path.is_file() and path.read_bytes() == (content if isinstance(content, bytes) else content.encode())


def _devices(calibration: Any, kind: Format, format: str) -> list[Calibration]:
    devices = [calibration] if isinstance(calibration, Calibration) else list(calibration)
    if not devices or not all(isinstance(device, Calibration) for device in devices):
        raise ExportError("expected a Calibration, or a list of them", code="not_a_calibration")
    if len(devices) > 1 and not kind.many:
        several = [name for name, one in FORMATS.items() if one.many]
        raise ExportError(f"{format} holds one device, not {len(devices)}; several go into {' and '.join(several)}", code="several")
    return devices


def _doubts(calibration: Calibration, kind: Format, force: bool) -> Iterator[Finding]:
    """What is wrong with the calibration itself, for every format."""
    for name in ("imu", "magnetometer"):
        section = getattr(calibration, name)
        if name not in kind.sections or section is None:
            continue
        if name == "magnetometer" and section.unit == COUNTS and not kind.counts:
            taking = " and ".join(other for other, one in FORMATS.items() if one.counts)
            raise ExportError(f"the magnetometer is calibrated in counts, which only {taking} take", code="counts")
        if section.verdict in ("weak", "refused"):
            facts = {"part": name, "verdict": section.verdict, "reason": section.verdict_reason or ""}
            if not force:
                said = "the calibration of the {part} is {verdict} ({reason}); {option.force:True} writes it all the same"
                raise ExportError(Message(said, **facts), code="doubtful")
            yield FINDINGS("forced", **facts)
    applied = (calibration.provenance or {}).get("applied")
    if applied and set(kind.sections) & {"imu", "magnetometer", "temperature"}:
        yield FINDINGS("applied_twice", applied=", ".join(applied) if isinstance(applied, (list, dict)) else str(applied))


def _left_out(calibration: Calibration, kind: Format, format: str) -> Iterator[Finding]:
    """Sections and parameters that the format cannot represent."""
    left = [name for name in ("imu", "magnetometer", "temperature") if getattr(calibration, name) is not None and name not in kind.sections]
    if left:
        yield FINDINGS("sections_left_out", tool=format, sections=", ".join(left))
    parts = {} if calibration.imu is None or "imu" in left else calibration.imu.parts
    if calibration.magnetometer is not None and "magnetometer" not in left:
        parts = {**parts, "mag": calibration.magnetometer}
    for sensor, part in parts.items():
        if type(part.model) is not part.base and not (kind.warm and isinstance(part.model, ThermalTriad)):
            fields = dict.fromkeys(name.partition("[")[0] for name in part.further)
            yield FINDINGS(
                "fields_left_out", sensor, tool=format, fields=", ".join(fields) or "the formula", model=type(part.model).__name__
            )


def _origin(devices: Sequence[Calibration], format: str) -> list[str]:
    lines = [f"{format} file written by jaxcal {version_of('jaxcal')}"]
    for calibration in devices:
        name = (calibration.device or {}).get("name")
        if name:
            lines.append(f"device: {name}")
        origin = calibration.provenance or {}
        if origin.get("file"):
            lines.append(f"recording: {origin['file']}" + (f", SHA-256 {origin['sha256']}" if origin.get("sha256") else ""))
    return lines
