"""`jaxcal temperature`: thermal models of every axis from a log of a sensor at rest."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

import jaxcal

from ._export import FILES, ids_of
from ._options import CalibrationFile, CallError, Folder, Level, Log, Reading, Running, exported, folder, stem
from ._outputs import File, figure, outputs, save_calibration, save_export, save_json, save_report
from ._work import carry_out

#: format of --export -> default name of the file
_EXPORTS = {name: FILES[name] for name in ("px4", "ardupilot", "c", "csv")}


@dataclass(frozen=True, kw_only=True)
class Writing(Folder):
    """Where results go. By default all except exports go into the folder LOG-temperature."""

    calibration: CalibrationFile = None
    export: Annotated[tuple[str, ...] | None, exported(*_EXPORTS)] = None
    ids: Annotated[str | None, Parameter(help="Ids by which it finds the sensors, as gyro=1310988,accel=1310988.")] = None


def temperature(
    log: Log,
    /,
    *,
    model: Annotated[
        Literal["auto", "polynomial", "table"],
        Parameter(help="auto is as smooth as the data ask for, with jumps, hysteresis and rate of change where they are."),
    ] = "auto",
    degree: Annotated[int | None, Parameter(help="Degree of --model polynomial.")] = None,
    lag: Annotated[str | None, Parameter(help="Seconds by which the sensor follows the thermometer, or auto.")] = None,
    play: Annotated[str | None, Parameter(help="Half-width of the backlash between them in degC, or auto.")] = None,
    confidence: Level = 0.95,
    reading: Reading = Reading(),
    writing: Writing = Writing(),
    running: Running = Running(),
) -> None:
    """Fit the bias of every axis over temperature, from a log of a sensor at rest.

    Record the sensor while it warms up and cools down. The automatic model
    includes jumps of the bias and hysteresis; with a polynomial, a warning
    reports jumps that it does not follow.
    """
    if (degree is None) == (model == "polynomial"):
        raise CallError("--model polynomial and --degree go together; --model auto has as much freedom as the data support", "degree")
    options: dict[str, Any] = {
        "model": model, "degree": degree, "confidence": confidence, "lag": _amount("lag", lag), "play": _amount("play", play),
    }  # fmt: skip
    ids = ids_of(writing.ids, ("gyro", "accel"))

    def export(place: Path, fits: Any, data: Any, format: str) -> list[Any]:
        device = {"name": stem(Path(data.provenance.get("file", "log"))), format: ids}
        return save_export(place, fits, data, format, part="temperature", device=device)

    files: list[File] = [
        ("plot", "", figure(lambda plot, fits, _: plot.temperature(fits))), ("report", "report.html", save_report),
        ("json", "temperature.json", save_json), ("calibration", "calibration.json", partial(save_calibration, part="temperature")),
    ]  # fmt: skip
    done = carry_out(
        log, reading, running, outputs(writing, files, folder(log, "temperature"), formats=_EXPORTS, export=export),
        lambda data, move: jaxcal.temperature.characterise(data, progress=move, **options), command="jaxcal temperature", options=options,
    )  # fmt: skip
    done.end(running)


def _amount(name: str, text: str | None) -> Any:
    if text is None or text == "auto":
        return text
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value < float("inf"):
        raise CallError(f"--{name} {text}: expected auto, or a number from 0", name)
    return value
