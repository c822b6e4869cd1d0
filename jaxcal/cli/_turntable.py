"""`jaxcal rate-table` and `jaxcal vibration`: raw logs of a gyroscope on a rate table, and of both sensors on a shaker."""

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import jaxcal

from .._files import json_text, write_atomically
from .._units import number
from ._options import WRITING, CallError, Latitude, Log, Name, Reading, Running, must_exist, stem
from ._outputs import File, outputs, save_calibration
from ._screen import Screen
from ._work import carry_out


@Parameter(name="*", group=WRITING)
@dataclass(frozen=True, kw_only=True)
class ResultWriting:
    """Where results go. By default all go into a folder named after the log."""

    out: Annotated[Path | None, Parameter(help="Folder for the files, made if it is missing.")] = None
    json: Annotated[Path | None, Parameter(help="All figures as JSON, in SI units.")] = None


@Parameter(name="*", group=WRITING)
@dataclass(frozen=True, kw_only=True)
class RateWriting(ResultWriting):
    """Where results go, including the calibration of the gyroscope."""

    calibration: Annotated[Path | None, Parameter(help="Calibration file, for jaxcal apply and jaxcal export.")] = None


def rate_table(
    log: Log,
    /,
    *,
    rates: Annotated[str | None, Parameter(help="Rates of the table in deg/s, without sign: 10,50,100.")] = None,
    regions: Annotated[Path | None, Parameter(help="Instead: JSON or CSV of stretches, labelled such as z +100 (deg/s) or rest.")] = None,
    latitude: Latitude | None = None,
    servo: Annotated[float, Parameter(help="Standard error of the table's rate, in ppm.")] = 0.0,
    name: Name = None,
    reading: Reading = Reading(),
    writing: RateWriting = RateWriting(),
    running: Running = Running(),
) -> None:
    """Calibrate a gyroscope from the raw log of a rate table.

    Turn about each axis at several rates of both signs, each for 3 s or more,
    first with increasing, then with decreasing rates. jaxcal finds the
    stretches of constant rate in the log.
    """
    if (rates is None) == (regions is None):
        raise CallError("give either --rates, those that the table was set to, or --regions")
    must_exist(regions)
    try:
        known = None if rates is None else [math.radians(float(word)) for word in rates.split(",")]
    except ValueError:
        raise CallError(f"--rates {rates}: expected numbers in deg/s, such as 10,50,100") from None

    def compute(data: Any, _: Any) -> Any:
        labelled = None if regions is None else jaxcal.imu.read_regions(regions, data.rate)
        angle = None if latitude is None else math.radians(latitude)
        return jaxcal.imu.rate_test(data, known, regions=labelled, latitude=angle, servo=servo * 1e-6)

    def store(place: Path, found: Any, data: Any) -> tuple[str, ...]:
        if found.gyro is None:
            return (f"{place.name} is not written: {found.reason}",)
        save_calibration(place, found, data, part="imu", device=name)
        return ()

    files: list[File] = [("json", "rate_table.json", _save_json), ("calibration", "calibration.json", store)]
    options = {"rates": rates, "regions": regions and str(regions), "latitude": latitude, "servo": servo}
    done = carry_out(
        log, reading, running, outputs(writing, files, f"{stem(log)}-rate-table"), compute, show=_show_rates, command="jaxcal rate-table",
        options=options,
    )  # fmt: skip
    done.tell(done.found.warnings)


def vibration(
    log: Log,
    /,
    *,
    window: Annotated[float, Parameter(help="Length of the windows whose means are compared, in s.")] = 2.0,
    reading: Reading = Reading(),
    writing: ResultWriting = ResultWriting(),
    running: Running = Running(),
) -> None:
    """Estimate vibration rectification, the bias caused by vibration, on a shaker.

    Record the sensor in one attitude: with the shaker at rest, at one or more
    levels, and at rest again.
    """
    files: list[File] = [("json", "vibration.json", _save_json)]
    done = carry_out(
        log, reading, running, outputs(writing, files, f"{stem(log)}-vibration"),
        lambda data, _: jaxcal.imu.vibration_rectification(data, window=window), show=partial(_show, "bias for mean square vibration"),
        command="jaxcal vibration", options={"window": window},
    )  # fmt: skip
    done.tell(done.found.warnings)


def _save_json(place: Path, found: Any, log: Any) -> None:
    write_atomically(place, json_text(found.to_dict() | {"provenance": log.provenance}))


def _show(title: str, screen: Screen, found: Any) -> None:
    rows = []
    for row in found._rows():
        half = (row.high - row.low) / 2
        between = f"{number(row.low, half)} to {number(row.high, half)}" if half > 0 else ""
        rows.append([row.name, number(row.value, half), between, row.unit, row.remark])
    screen.table(f"{title}, with intervals of 95 %", ["", "value", "interval", "unit", ""], rows)
    screen.line()
    screen.line(f"{found.verdict}: {found.reason}")


def _show_rates(screen: Screen, found: Any) -> None:
    if found.fit is not None:
        triad = found.fit.triad
        rows = [
            [axis, *(f"{x:.6g}" for x in triad.matrix[i]), f"{triad.bias[i]:.4g}", *(f"{x:.3g}" for x in triad.g_sensitivity[i])]
            for i, axis in enumerate("xyz")
        ]
        header = ["", "matrix x", "matrix y", "matrix z", "bias\nrad/s", "g-sens. x\nrad/s per m/s^2", "g-sens. y", "g-sens. z"]
        screen.table("gyroscope", header, rows)
    _show("scale factor", screen, found)
