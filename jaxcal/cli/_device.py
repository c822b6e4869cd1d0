"""`jaxcal device`: calibrate accelerometer, gyroscope and magnetometer together from one log of motion by hand."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import jaxcal

from ._noise_file import read_noise
from ._options import CallError, Field, Gravity, Height, Latitude, Log, Name, Noise, Reading, Running, must_exist, stem
from ._outputs import File, outputs, save_json, save_report
from ._work import carry_out


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class DeviceWriting:
    """Where results go. By default all go into the folder LOG-device."""

    out: Annotated[Path | None, Parameter(help="Folder for the files, made if it is missing.")] = None
    json: Annotated[Path | None, Parameter(help="Parameters, intervals, attitude, residuals and findings as JSON.")] = None
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

    def calibration(place: Path, found: Any, data: Any) -> None:
        usable = {sensor for sensor, verdict in found.verdicts.items() if verdict != "refused"}
        parts = {"imu": found} if usable & {"accel", "gyro"} else {}
        parts |= {"magnetometer": found} if "magnetometer" in usable else {}
        jaxcal.Calibration(**parts, device=name, provenance=data.provenance).save(place)

    files: list[File] = [
        ("report", "report.html", save_report), ("json", "device.json", save_json), ("calibration", "calibration.json", calibration),
    ]  # fmt: skip
    plan = outputs(writing, files, f"{stem(log)}-device")

    def compute(data: Any, _: Any) -> Any:
        if data.accel is None or data.gyro is None or data.mag is None:
            raise CallError(
                "jaxcal device needs accelerometer, gyroscope and magnetometer in one log; name their columns with --columns", "no_sensor"
            )
        size = gravity
        if size is None and latitude is not None:
            size = float(jaxcal.imu.gravity(math.radians(latitude), height))
        return jaxcal.device.fit(
            data, gravity=size, field=None if field is None else 1e-6 * field, g_sensitivity=g_sensitivity, lever=lever,
            latitude=None if latitude is None else math.radians(latitude), noise=known,
        )  # fmt: skip

    carry_out(log, reading, running, plan, compute, command="jaxcal device", options=options).end(running)
