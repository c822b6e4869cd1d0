"""`jaxcal imu`: both triads from a log of still poses and the turns between them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cyclopts import Parameter

from .._files import json_text, write_atomically
from .._units import STANDARD_GRAVITY
from ._cache import keep_compiled
from ._options import WRITING, CallError, Reading, Running, distinct, read_log, stem
from ._outputs import staged
from ._screen import Screen, progress, show_log, show_written
from ._tables import number

_CONVENTIONS = ("upper", "lower", "full")
_METHODS = ("joint", "imu_tk")
_AXES = "xyz"


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
    """

    out: Path | None = None
    json: Path | None = None
    report: Path | None = None
    calibration: Path | None = None


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
    plan, folder = _plan(log, writing)
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
            for target, make in plan.items():
                make(places[target], found, data)
        written = [target for target, place in places.items() if place.exists()]
    _tables(screen, found, raw)
    screen.line()
    screen.line(f"{found.verdict}: {found.reason}")
    screen.sentences("Warnings", [*data.warnings, *notes, *found.warnings])
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


Maker = Callable[[Path, Any, Any], None]


def _plan(path: Path, writing: ImuWriting) -> tuple[dict[Path, Maker], Path | None]:
    """Target -> what makes it, and the folder that may have to be made."""
    folder = writing.out
    if writing.json is None and writing.report is None and writing.calibration is None:
        folder = folder or Path(f"{stem(path)}-imu")
        names: dict[str, Maker] = {"imu.png": _picture, "report.html": _report, "imu.json": _json, "calibration.json": _calibration}
        return {folder / name: make for name, make in names.items()}, folder
    asked: list[tuple[Path, Any]] = []
    if writing.json is not None:
        asked.append((writing.json, _json))
    if writing.report is not None:
        asked.append((writing.report, _report))
    if writing.calibration is not None:
        asked.append((writing.calibration, _calibration))
    return distinct(asked), folder


def _picture(place: Path, found: Any, log: Any) -> None:
    import jaxcal

    jaxcal.plot.save(jaxcal.plot.imu(found), place)


def _report(place: Path, found: Any, log: Any) -> None:
    import jaxcal

    jaxcal.report.write(found, place, log=log)


def _calibration(place: Path, found: Any, log: Any) -> None:
    import jaxcal

    jaxcal.Calibration(imu=found, provenance=log.provenance).save(place)


def _json(place: Path, found: Any, log: Any) -> None:
    write_atomically(place, json_text(document(found, log)))


def document(found: Any, log: Any) -> dict[str, Any]:
    """Schema "jaxcal.imu/1"."""
    import jaxcal

    sensors = {}
    for sensor, first, last in (("accel", 0, 12), ("gyro", 12, 33)):
        triad = getattr(found, sensor)
        if triad is not None:
            names = [name.removeprefix(f"{sensor}.") for name in found.names[first:last]]
            limits = _listed(found.interval[first:last])
            sensors[sensor] = {
                "matrix": _listed(triad.matrix), "bias": _listed(triad.bias), "g_sensitivity": _listed(triad.g_sensitivity),
                "intervals": dict(zip(names, limits, strict=True)),
            }  # fmt: skip
    return {
        "schema": "jaxcal.imu/1", "version": jaxcal.__version__, "verdict": found.verdict, "reason": found.reason,
        "warnings": list(found.warnings), "convention": found.convention, "method": found.method, "gravity": found.gravity,
        "rate": found.rate, "poses": len(found.residual_norm), "turns": len(found.residual_turn), "sensors": sensors,
        "residuals": {"norm": _listed(found.residual_norm), "turn": _listed(found.residual_turn), "rest": _listed(found.residual_rest)},
        "held_out": {"norm": _listed(found.held_out[0]), "turn": _listed(found.held_out[1])},
        "condition": _listed(found.observability.condition), "temperature": _listed(found.temperature), "provenance": log.provenance,
    }  # fmt: skip


def _listed(value: Any) -> Any:
    """Numbers as JSON can say them; NaN and infinity are null."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Sequence):
        return [_listed(item) for item in value]
    return value if math.isfinite(value) else None
