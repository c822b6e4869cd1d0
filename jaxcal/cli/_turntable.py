"""`jaxcal rate-table`: calibrate a gyroscope from its raw log on a rate table."""

import math
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import jaxcal

from ._options import Calibrated, Latitude, Log, Name, Part, Running, asked, numbers
from ._outputs import save_calibration, standard
from ._work import carry_out


def rate_table(
    log: Log,
    /,
    *,
    rates: Annotated[str, Parameter(help="Rates of the table in deg/s, without sign: 10,50,100.")],
    latitude: Latitude | None = None,
    servo: Annotated[float, Parameter(help="Standard error of the table's rate, in ppm.")] = 0.0,
    name: Name = None,
    reading: Part = Part(),
    writing: Calibrated = Calibrated(),
    running: Running = Running(),
) -> None:
    """Calibrate a gyroscope from the raw log of a rate table.

    Turn about each axis at several rates of both signs, each for 3 s or more,
    first with increasing, then with decreasing rates. jaxcal finds the
    stretches of constant rate in the log.
    """
    options = asked(locals())
    known = [math.radians(rate) for rate in numbers("--rates", rates, "10,50,100")]

    def compute(data: Any, _: Any) -> Any:
        angle = None if latitude is None else math.radians(latitude)
        return jaxcal.imu.rate_test(data, known, latitude=angle, servo=servo * 1e-6)

    plan = standard(writing, "rate-table", log, ("calibration", "calibration.json", partial(_save_gyro, device=name)))
    carry_out(log, reading, running, plan, compute, command="rate-table", options=options).end()


def _save_gyro(place: Path, found: Any, data: Any, device: str | None) -> None:
    """Write the calibration, unless an axis was not turned both ways, as a finding says."""
    if found.gyro is not None:
        save_calibration(place, found, data, part="imu", device=device)
