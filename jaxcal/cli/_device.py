"""`jaxcal device`: calibrate accelerometer, gyroscope and magnetometer together from one log of motion by hand."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import jaxcal

from .._units import STANDARD_GRAVITY, number
from ._noise_file import read_noise
from ._options import CallError, Field, Gravity, Height, Latitude, Log, Name, Noise, Reading, Running, must_exist, stem
from ._outputs import File, outputs, save_json, save_report
from ._screen import Screen
from ._work import carry_out

_AXES = "xyz"
_SENSORS = (
    ("accel", "accelerometer", "matrix", "bias", "bias\nm/s^2", 1.0),
    ("gyro", "gyroscope", "matrix", "bias", "bias\ndeg/s", math.degrees(1.0)),
    ("magnetometer", "magnetometer", "soft_iron", "hard_iron", "hard iron\nuT", 1e6),
)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class DeviceWriting:
    """Where results go. By default all go into the folder LOG-device."""

    out: Annotated[Path | None, Parameter(help="Folder for the files, made if it is missing.")] = None
    json: Annotated[Path | None, Parameter(help="Models, intervals, attitude, residuals and verdicts as JSON.")] = None
    report: Annotated[Path | None, Parameter(help="Report as one HTML file.")] = None
    calibration: Annotated[Path | None, Parameter(help="Calibration file, for jaxcal apply and jaxcal export.")] = None


def device(
    log: Log,
    /,
    *,
    gravity: Gravity | None = None,
    latitude: Latitude | None = None,
    height: Height = 0.0,
    field: Field | None = None,
    noise: Noise = None,
    name: Name = None,
    g_sensitivity: Annotated[bool, Parameter(help="Fit the gyroscope's sensitivity to acceleration.")] = False,
    lever: Annotated[bool, Parameter(help="Fit the positions of the accelerometer's sensing elements.")] = False,
    reading: Reading = Reading(),
    writing: DeviceWriting = DeviceWriting(),
    running: Running = Running(),
) -> None:
    """Calibrate accelerometer, gyroscope and magnetometer together.

    Stay in one place and move the device by hand for three minutes
    through all attitudes, far from iron. Lay it down several times:
    rests make the accelerometer's result ten times more accurate.
    """
    options = {"gravity": gravity, "latitude": latitude, "height": height, "field": field, "name": name, "lever": lever}
    options |= {"g_sensitivity": g_sensitivity, "noise": noise and str(noise)}
    must_exist(noise)
    known = None if noise is None else read_noise(noise)
    notes: list[str] = []

    def calibration(place: Path, found: Any, data: Any) -> Sequence[str] | None:
        parts = {"imu": found} if {"good", "weak"} & {found.verdicts["accel"], found.verdicts["gyro"]} else {}
        parts |= {"magnetometer": found} if found.verdicts["magnetometer"] != "refused" else {}
        jaxcal.Calibration(**parts, device=name, provenance=data.provenance).save(place)
        return None

    files: list[File] = [
        ("report", "report.html", save_report), ("json", "device.json", save_json), ("calibration", "calibration.json", calibration),
    ]  # fmt: skip
    plan = outputs(writing, files, f"{stem(log)}-device")

    def compute(data: Any, _: Any) -> Any:
        if data.accel is None or data.gyro is None or data.mag is None:
            raise CallError("jaxcal device needs accelerometer, gyroscope and magnetometer in one log; name their columns with --columns")
        size = gravity
        if size is None and latitude is not None:
            size = float(jaxcal.imu.gravity(math.radians(latitude), height))
        if size is None:
            size = STANDARD_GRAVITY
            notes.append(
                f"Gravity was taken as {size} m/s^2; it differs by up to 0.3 % between places, and the accelerometer's scale with it. "
                "Give --latitude and --height, or --gravity."
            )
        found = jaxcal.device.fit(
            data, gravity=size, field=None if field is None else 1e-6 * field, g_sensitivity=g_sensitivity, lever=lever,
            latitude=None if latitude is None else math.radians(latitude), noise=known,
        )  # fmt: skip
        if all(word == "refused" for word in found.verdicts.values()):
            raise jaxcal.DataError(" ".join(["the calibration is refused, and nothing was written.", found.reason, *found.warnings]))
        return found

    done = carry_out(log, reading, running, plan, compute, show=_tables, command="jaxcal device", options=options)
    done.tell([*notes, *done.found.warnings])


def _tables(screen: Screen, found: Any) -> None:
    """Print matrix and offset of every sensor with its verdict, delays, dip and field, and the overall verdict."""
    known = {row.name: row for row in found._rows()}

    def cell(key: str, size: float = 1.0) -> str:
        if key not in known:
            return "not seen" if key in found.undetermined else "0\nfixed"
        value, low, high = (size * float(x) for x in known[key][1:4])
        half = (high - low) / 2
        return f"{number(value, half)}\n{number(low, half)} to {number(high, half)}"

    for sensor, title, matrix, offset, unit, size in _SENSORS:
        rows = [
            [_AXES[i], *(cell(f"{sensor}.{matrix}[{i},{j}]") for j in range(3)), cell(f"{sensor}.{offset}[{i}]", size)] for i in range(3)
        ]
        screen.table(f"{title} ({found.verdicts[sensor]}): 95 % interval below", ["", "matrix x", "matrix y", "matrix z", unit], rows)
    shared = [("gyro_delay", "delay of the gyroscope", 1e3, "ms"), ("mag_delay", "delay of the magnetometer", 1e3, "ms")]
    shared += [("dip", "dip of the field", math.degrees(1.0), "deg"), ("field", "size of the field", 1e6, "uT")]
    screen.table(
        "between the sensors", ["", "value", "unit"], [[title, cell(key, size), unit] for key, title, size, unit in shared if key in known]
    )
    screen.line()
    screen.line(f"{found.verdict}: {found.reason}")
