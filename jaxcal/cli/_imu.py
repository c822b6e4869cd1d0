"""`jaxcal imu`: both triads from a log of still poses and the turns between them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from .._units import STANDARD_GRAVITY, number
from ._cache import keep_compiled
from ._export import FILES
from ._options import WRITING, CallError, Reading, Running, read_log, stem
from ._outputs import Maker, Outputs, exports, outputs, save_json, save_picture, save_report, staged
from ._screen import Screen, progress, show_log, show_written

_CONVENTIONS = ("upper", "lower", "full")
_METHODS = ("joint", "imu_tk")
_AXES = "xyz"
#: format of --export -> name of the file where none is given
_EXPORTS = {name: FILES[name] for name in ("c", "csv")}


@Parameter(name="*", group=WRITING)
@dataclass(frozen=True, kw_only=True)
class ImuWriting:
    """Where results go. Without any of these, into the folder LOG-imu, all of them.

    Attributes
    ----------
    out
        Folder for the files, made if it is missing.
    json
        Triads, intervals, residuals and verdict as JSON.
    report
        Report as one HTML file.
    calibration
        Calibration file, for jaxcal apply and jaxcal export.
    export
        File for another tool: c, csv, or such as c=FILE. Repeatable; jaxcal export writes the other formats.
    """

    out: Path | None = None
    json: Path | None = None
    report: Path | None = None
    calibration: Path | None = None
    export: Annotated[tuple[str, ...] | None, Parameter(name="--export")] = None


def imu(
    log: Path,
    /,
    *,
    gravity: float | None = None,
    latitude: float | None = None,
    height: float = 0.0,
    convention: str = "upper",
    method: str = "joint",
    initial: float | None = None,
    without_rest: bool = False,
    raw: bool = False,
    without_g_sensitivity: bool = False,
    earth_rate: bool = False,
    reading: Reading = Reading(),
    writing: ImuWriting = ImuWriting(),
    running: Running = Running(),
) -> None:
    """Calibrate accelerometer and gyroscope by hand, without a turntable.

    The log begins with a rest of 30 s. Then hold the sensor still for 3 s
    or more on each face, each edge and some corners, 18 to 50 poses, and
    turn it smoothly from one to the next.

    Parameters
    ----------
    log
        The log: CSV, NPZ, Parquet, ROS bag.
    gravity
        Gravity at the place, in m/s^2; else from --latitude and --height, else standard gravity.
    latitude
        Latitude of the place, in degrees.
    height
        Height of the place above sea level, in m.
    convention
        Frame of the result: upper, lower or full.
    method
        joint, or imu_tk: the two steps of that program.
    initial
        Length of the rest at the beginning, in s; 30 unless given.
    without_rest
        There is no rest at the beginning.
    raw
        The log holds counts; their scale is found from the data.
    without_g_sensitivity
        Leave out the gyroscope's sensitivity to acceleration.
    earth_rate
        Account for the Earth's rate, with --latitude; for tactical units.
    """
    for name, value, known in (("convention", convention, _CONVENTIONS), ("method", method, _METHODS)):
        if value not in known:
            raise CallError(f"--{name} {value}: expected one of {', '.join(known)}")
    if latitude is not None and not -90.0 <= latitude <= 90.0:
        raise CallError(f"--latitude {latitude:g}: expected degrees between -90 and 90")
    if earth_rate and latitude is None:
        raise CallError("--earth-rate needs --latitude")
    plan, folder = _outputs(log, writing)
    screen = Screen(running.quiet)
    with staged(plan, inputs=[log], folder=folder) as places:
        with progress(f"reading {log.name}", running.quiet):
            options = {
                "gravity": gravity, "latitude": latitude, "height": height, "earth_rate": earth_rate, "convention": convention,
                "method": method, "raw": raw, "initial": initial, "without_rest": without_rest,
                "without_g_sensitivity": without_g_sensitivity,
            }  # fmt: skip
            from ._provenance import signed

            data = signed(read_log(log, reading), "jaxcal imu", reading, options)
        show_log(screen, data)
        with progress("fitting", running.quiet):
            keep_compiled()
            import jaxcal

            size, notes = _gravity(gravity, latitude, height)
            found = jaxcal.imu.multi_position(
                data, gravity=size, convention=convention, method=method, raw=raw, g_sensitivity=not without_g_sensitivity,
                initial=None if without_rest else 30.0 if initial is None else initial,
                latitude=math.radians(latitude) if earth_rate and latitude is not None else None,
            )  # fmt: skip
            if found.verdict == "refused":
                raise jaxcal.DataError(found.reason)
            said = [sentence for target, make in plan.items() for sentence in make(places[target], found, data)]
        written = [target for target, place in places.items() if place.exists()]
    _tables(screen, found, raw)
    screen.line()
    screen.line(f"{found.verdict}: {found.reason}")
    screen.sentences("Warnings", [*data.warnings, *notes, *found.warnings, *said])
    show_written(screen, written)


def _gravity(gravity: float | None, latitude: float | None, height: float) -> tuple[float, list[str]]:
    import jaxcal

    if gravity is not None:
        return gravity, []
    if latitude is not None:
        return float(jaxcal.imu.gravity(math.radians(latitude), height)), []
    return STANDARD_GRAVITY, [
        f"Gravity was taken as {STANDARD_GRAVITY} m/s^2; it differs by up to 0.3 % between places, and the accelerometer's scale with it. "
        "Give --latitude and --height, or --gravity."
    ]


def _tables(screen: Screen, found: Any, raw: bool) -> None:
    """Scale errors, misalignment and bias of every axis with intervals of 95 %."""
    for sensor, name, first in (("accel", "accelerometer", 0), ("gyro", "gyroscope", 12)):
        if getattr(found, sensor) is None:
            continue
        unit = "counts" if raw else {"accel": "m/s^2", "gyro": "rad/s"}[sensor]
        rows = []
        for i, axis in enumerate(_AXES):
            cells = [_cell(found, first + 3 * i + j) for j in range(3)] + [_cell(found, first + 9 + i)]
            rows.append([axis, *cells])
        screen.table(f"{name}: 95 % interval below", ["", "matrix x", "matrix y", "matrix z", f"bias\n{unit}"], rows)
    if found.gyro is not None and found.gyro.g_sensitivity.any():
        rows = [[axis, *(_cell(found, 24 + 3 * i + j) for j in range(3))] for i, axis in enumerate(_AXES)]
        unit = "counts per m/s^2" if raw else "rad/s per m/s^2"
        screen.table(f"gyroscope, sensitivity to specific force ({unit})", ["", "x", "y", "z"], rows)


def _cell(found: Any, i: int) -> str:
    value, (low, high) = float(found.values[i]), (float(limit) for limit in found.interval[i])
    half = (high - low) / 2
    if not half > 0:
        return f"{value:.4g}\nfixed"
    if 0 < max(abs(value), half) < 1e-3:
        return f"{value:.3g}\n{low:.3g} to {high:.3g}"
    return f"{number(value, half)}\n{number(low, half)} to {number(high, half)}"


def _outputs(path: Path, writing: ImuWriting) -> Outputs:
    names: dict[str, Maker] = {
        "imu.png": partial(save_picture, draw="imu"), "report.html": save_report, "imu.json": save_json, "calibration.json": _calibration,
    }  # fmt: skip
    asked = [
        (writing.json, save_json), (writing.report, save_report), (writing.calibration, _calibration),
        *exports(writing.export, _EXPORTS, _export, writing.out),
    ]  # fmt: skip
    return outputs(asked, names, out=writing.out, default=f"{stem(path)}-imu")


def _export(place: Path, found: Any, log: Any, format: str) -> Sequence[str]:
    import jaxcal

    return [
        f"{place.name}: {sentence}"
        for sentence in jaxcal.export.write(jaxcal.Calibration(imu=found, provenance=log.provenance), place, format=format)
    ]


def _calibration(place: Path, found: Any, log: Any) -> Sequence[str]:
    import jaxcal

    jaxcal.Calibration(imu=found, provenance=log.provenance).save(place)
    return ()
