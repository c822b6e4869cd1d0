"""`jaxcal temperature`: thermal models of every axis from a log of a sensor at rest."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from cyclopts import Parameter

import jaxcal

from ._export import FILES, IDS, ids_of
from ._options import Calibrated, CallError, Level, Log, Plot, Reading, Running, exported
from ._outputs import standard
from ._work import carry_out

#: format of --export -> default name of the file
_EXPORTS = {name: FILES[name] for name in ("px4", "ardupilot", "c", "csv")}


@dataclass(frozen=True, kw_only=True)
class Writing(Calibrated):
    """Where results go. By default all except exports go into the folder LOG-temperature."""

    plot: Plot = None
    export: Annotated[tuple[str, ...] | None, exported(*_EXPORTS)] = None
    ids: Annotated[str | None, Parameter(help="Ids by which the vehicle finds its sensors: gyro=NUMBER,accel=NUMBER.")] = None


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
    plan = standard(writing, "temperature", log, part="temperature", device=dict.fromkeys(IDS, ids) if ids else None, formats=_EXPORTS)
    fit = lambda data, move: jaxcal.temperature.characterise(data, progress=move, **options)  # noqa: E731
    carry_out(log, reading, running, plan, fit, command="temperature", options=options).end()


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
