"""`jaxcal device`: calibrate accelerometer, gyroscope and magnetometer together from one log of motion by hand."""

import math
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import jaxcal

from . import _options as opt
from ._outputs import standard
from ._work import carry_out


def device(
    log: opt.Log,
    /,
    *,
    gravity: opt.Gravity | None = None,
    latitude: opt.Latitude | None = None,
    height: opt.Height = 0.0,
    field: opt.Field | None = None,
    noise: opt.Noise = None,
    name: opt.Name = None,
    g_sensitivity: Annotated[bool, Parameter(help="Fit the gyroscope's sensitivity to acceleration.")] = False,
    lever: Annotated[bool, Parameter(help="Fit the positions of the accelerometer's sensing elements.")] = False,
    reading: opt.Reading = opt.Reading(),
    writing: opt.Calibrated = opt.Calibrated(),
    running: opt.Running = opt.Running(),
) -> None:
    """Calibrate accelerometer, gyroscope and magnetometer together.

    Stay in one place and move the device by hand for three minutes
    through all attitudes, far from iron. Lay it down several times:
    rests make the accelerometer's result ten times more accurate.
    """
    options = opt.asked(locals())
    known = opt.read_noise(noise)

    def calibration(place: Path, found: Any, data: Any) -> None:
        usable = {sensor for sensor, verdict in found.verdicts.items() if verdict != "refused"}
        parts = {"imu": found} if usable & {"accel", "gyro"} else {}
        parts |= {"magnetometer": found} if "magnetometer" in usable else {}
        jaxcal.Calibration(**parts, device=name, provenance=data.provenance).save(place)

    plan = standard(writing, "device", log, ("calibration", "calibration.json", calibration))

    def compute(data: Any, _: Any) -> Any:
        if data.accel is None or data.gyro is None or data.mag is None:
            raise opt.CallError(
                "jaxcal device needs accelerometer, gyroscope and magnetometer in one log; name their columns with --columns", "no_sensor"
            )
        size = gravity
        if size is None and latitude is not None:
            size = float(jaxcal.imu.gravity(math.radians(latitude), height))
        return jaxcal.device.fit(
            data, gravity=size, field=None if field is None else 1e-6 * field, g_sensitivity=g_sensitivity, lever=lever,
            latitude=None if latitude is None else math.radians(latitude), noise=known,
        )  # fmt: skip

    carry_out(log, reading, running, plan, compute, command="device", options=options).end()
