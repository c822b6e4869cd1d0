"""`jaxcal imu`: calibrate both triads from a log of still poses and the turns between them."""

import json
import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

import jaxcal

from .._units import STANDARD_GRAVITY, number
from ._export import FILES
from ._noise_file import read_noise
from ._options import CallError, Files, Gravity, Height, Latitude, Log, Name, Noise, Reading, Running, in_counts, must_exist, stem
from ._outputs import File, figure, outputs, save_calibration, save_export, save_json, save_report
from ._screen import Screen
from ._work import carry_out

_AXES = "xyz"
_TURNS = 14  # least number of turns to estimate a delay
_LATE = 1e-3  # s; a longer delay is reported
#: format of --export -> default name of the file
_EXPORTS = {name: FILES[name] for name in ("c", "csv")}
_OTHER = "File for another tool: c, csv, or such as c=FILE. Repeatable; jaxcal export writes the other formats."


@dataclass(frozen=True, kw_only=True)
class ImuWriting(Files):
    """Where results go. By default all go into the folder LOG-imu."""

    json: Annotated[Path | None, Parameter(help="Triads, intervals, residuals and verdict as JSON.")] = None
    calibration: Annotated[Path | None, Parameter(help="Calibration file, for jaxcal apply and jaxcal export.")] = None
    export: Annotated[tuple[str, ...] | None, Parameter(name="--export", help=_OTHER)] = None


def imu(
    log: Log,
    /,
    *,
    gravity: Gravity | None = None,
    latitude: Latitude | None = None,
    height: Height = 0.0,
    convention: Annotated[Literal["upper", "lower", "full"], Parameter(help="Frame of the result: upper, lower or full.")] = "upper",
    method: Annotated[
        Literal["joint", "imu_tk", "six_position"],
        Parameter(
            help="joint; imu_tk: the two steps of that program; six_position: a squared block on its six faces, accelerometer alone."
        ),
    ] = "joint",
    initial: Annotated[float | None, Parameter(help="Length of a rest at the beginning, in s; else rests are found anywhere.")] = None,
    regions: Annotated[
        Path | None, Parameter(help="JSON or CSV of labelled regions: faces and turns of a box (x_p, x_a, ..., z_rot), or rests.")
    ] = None,
    noise: Noise = None,
    prior: Annotated[
        Path | None, Parameter(help="What is known before: an earlier calibration, or a data sheet as JSON; fewer poses then suffice.")
    ] = None,
    terms: Annotated[
        str, Parameter(help="Further terms: auto for what the log asks for, or names such as accel.quadratic,gyro.cubic.")
    ] = "",
    name: Name = None,
    counts: Annotated[bool, Parameter(help="The log holds counts; their scale is found from the data.")] = False,
    without_g_sensitivity: Annotated[bool, Parameter(help="Leave out the gyroscope's sensitivity to acceleration.")] = False,
    earth_rate: Annotated[bool, Parameter(help="Account for the Earth's rate, with --latitude; for tactical units.")] = False,
    reading: Reading = Reading(),
    writing: ImuWriting = ImuWriting(),
    running: Running = Running(),
) -> None:
    """Calibrate accelerometer and gyroscope by hand, without a turntable.

    Leave the sensor alone for 30 s. Then hold it still for 3 s or more on
    each face, each edge and some corners, 18 to 50 poses, and turn it
    smoothly from one to the next.
    """
    if earth_rate and latitude is None:
        raise CallError("--earth-rate needs --latitude")
    if counts:
        reading = in_counts(reading, "accel", "gyro")
    options = {
        "gravity": gravity, "latitude": latitude, "height": height, "earth_rate": earth_rate, "convention": convention, "method": method,
        "counts": counts, "initial": initial, "regions": regions and str(regions), "without_g_sensitivity": without_g_sensitivity,
        "noise": noise and str(noise), "prior": prior and str(prior), "terms": terms, "name": name,
    }  # fmt: skip
    files: list[File] = [
        ("plot", "", figure(lambda plot, found, _: plot.imu(found))), ("report", "report.html", save_report),
        ("json", "imu.json", save_json), ("calibration", "calibration.json", partial(save_calibration, part="imu", device=name)),
    ]  # fmt: skip
    plan = outputs(writing, files, f"{stem(log)}-imu", formats=_EXPORTS, export=partial(save_export, part="imu", device=name))
    notes: list[str] = []
    must_exist(regions, noise, prior)
    asked = tuple(word for word in terms.replace(" ", "").split(",") if word)
    known = ({} if noise is None else {"noise": read_noise(noise)}) | ({} if prior is None else {"prior": _prior(prior)})
    known |= {} if not asked else {"terms": "auto" if asked == ("auto",) else asked}

    def compute(data: Any, _: Any) -> Any:
        from ..imu._session import rests_among  # imported here, so that the help of a command need not wait for JAX

        labelled = jaxcal.imu.read_regions(regions, data.rate) if regions is not None else None
        if method == "six_position" and labelled is None:
            labelled = jaxcal.imu.faces(data)
        rests = None if labelled is None else rests_among(labelled)
        if method == "six_position" and rests is not None:
            raise CallError("--method six_position needs regions of faces (x_p, x_a, ...); those of --regions are rests")
        if labelled is not None and rests is None:
            if counts or method == "imu_tk" or convention != "upper" or earth_rate or without_g_sensitivity or initial is not None or known:
                words = "--counts, --convention, --earth-rate, --initial, --without-g-sensitivity, --noise, --prior and --terms"
                raise CallError(f"faces of a box take none of {words}")
            return jaxcal.imu.ferraris(data, labelled, gravity=_gravity(gravity, latitude, height, notes))
        found = jaxcal.imu.multi_position(
            data, gravity=_gravity(gravity, latitude, height, notes), convention=convention, method=method, raw=counts, rests=rests,
            g_sensitivity=not without_g_sensitivity, initial=initial,
            latitude=math.radians(latitude) if earth_rate and latitude is not None else None, **known,
        )  # fmt: skip
        if found.verdict == "refused":
            raise jaxcal.DataError(found.reason)
        if found.method == "joint" and found.gyro is not None and len(found.residual_turn) >= _TURNS:
            moved = jaxcal.imu.motion(data, found)
            if moved.delay_interval[0] > _LATE or moved.delay_interval[1] < -_LATE:
                notes.append(f"{moved.reason} The calibration does not depend on it; a filter that uses both sensors does.")
        return found

    def show(screen: Screen, found: Any) -> None:
        _tables(screen, found, counts)
        screen.line()
        screen.line(f"{found.verdict}: {found.reason}")

    done = carry_out(log, reading, running, plan, compute, show=show, command="jaxcal imu", options=options)
    done.tell([*notes, *done.found.warnings])


def _prior(path: Path) -> Any:
    """Read an earlier calibration, or a data sheet from a JSON file."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, ValueError) as error:
        raise jaxcal.DataError(f"{path} is no JSON; --prior takes a calibration, or a data sheet") from error
    return jaxcal.Calibration.load(path) if isinstance(document, dict) and "schema" in document else document


def _gravity(gravity: float | None, latitude: float | None, height: float, notes: list[str]) -> float:
    if gravity is not None:
        return gravity
    if latitude is not None:
        return float(jaxcal.imu.gravity(math.radians(latitude), height))
    notes.append(
        f"Gravity was taken as {STANDARD_GRAVITY} m/s^2; it differs by up to 0.3 % between places, and the accelerometer's scale with it. "
        "Give --latitude and --height, or --gravity."
    )
    return STANDARD_GRAVITY


def _tables(screen: Screen, found: Any, counts: bool) -> None:
    """Print matrix, bias and further parameters of every axis with 95 % intervals."""
    for sensor, name, first in (("accel", "accelerometer", 0), ("gyro", "gyroscope", 12)):
        if getattr(found, sensor) is None:
            continue
        unit = "counts" if counts else {"accel": "m/s^2", "gyro": "rad/s"}[sensor]
        places = [[first + 3 * i, first + 3 * i + 1, first + 3 * i + 2, first + 9 + i] for i in range(3)]
        rows = [[axis, *(_cell(found, place) for place in row)] for axis, row in zip(_AXES, places, strict=True)]
        screen.table(f"{name}: 95 % interval below", ["", "matrix x", "matrix y", "matrix z", f"bias\n{unit}"], rows)
    if found.gyro is not None and found.gyro.g_sensitivity.any():
        rows = [[axis, *(_cell(found, 24 + 3 * i + j) for j in range(3))] for i, axis in enumerate(_AXES)]
        unit = "counts per m/s^2" if counts else "rad/s per m/s^2"
        screen.table(f"gyroscope, sensitivity to specific force ({unit})", ["", "x", "y", "z"], rows)
    if further := range(33, len(found.names)):
        rows = [[found.names[i], *_cell(found, i).split("\n")] for i in further]
        screen.table("further terms, reading per power of SI units", ["", "value", "interval of 95 %"], rows)


def _cell(found: Any, i: int) -> str:
    value, (low, high) = float(found.values[i]), (float(limit) for limit in found.interval[i])
    half = (high - low) / 2
    if not half > 0:
        return f"{value:.4g}\nfixed"
    if 0 < max(abs(value), half) < 1e-3:
        return f"{value:.3g}\n{low:.3g} to {high:.3g}"
    return f"{number(value, half)}\n{number(low, half)} to {number(high, half)}"
