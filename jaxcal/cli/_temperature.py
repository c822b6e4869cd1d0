"""`jaxcal temperature`: thermal models of every axis of a log of a sensor at rest."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from .._units import noise_factor, noise_units, number
from ._cache import keep_compiled
from ._export import FILES
from ._options import WRITING, CallError, Reading, Running, read_log, stem
from ._outputs import Maker, Outputs, check_picture, exports, outputs, save_json, save_picture, save_report, staged
from ._screen import Screen, progress, show_log, show_written
from ._tables import by_channel

Model = Literal["auto", "polynomial", "table", "pchip", "spline", "steps"]
_SENSORS = {"gyro": "gyroscope", "accel": "accelerometer", "mag": "magnetometer"}
#: format of --export -> name of the file where none is given
_EXPORTS = {name: FILES[name] for name in ("px4", "ardupilot", "c", "csv")}


@Parameter(name="*", group=WRITING)
@dataclass(frozen=True, kw_only=True)
class Writing:
    """Where results go. Without any of these, into the folder LOG-temperature, all but exports.

    Attributes
    ----------
    out
        Folder for the files, made if it is missing.
    json
        Models, residuals, jumps and curves as JSON, in SI units.
    calibration
        Calibration that jaxcal apply and jaxcal noise --calibration read.
    report
        Report as one HTML file.
    plot
        Picture: FILE.png, FILE.svg or FILE.pdf.
    export
        File for another tool: px4, ardupilot, c or csv, or px4=FILE. Repeatable.
    ids
        Ids by which it finds the sensors, as gyro=1310988,accel=1310988.
    """

    out: Path | None = None
    json: Path | None = None
    calibration: Path | None = None
    report: Path | None = None
    plot: Path | None = None
    export: Annotated[tuple[str, ...] | None, Parameter(name="--export")] = None
    ids: str | None = None


def temperature(
    log: Path,
    /,
    *,
    model: Model = "auto",
    degree: int | None = None,
    lag: str | None = None,
    play: str | None = None,
    confidence: float = 0.95,
    reading: Reading = Reading(),
    writing: Writing = Writing(),
    running: Running = Running(),
) -> None:
    """Bias against temperature of every axis, from a log of a sensor that rests while it warms and cools.

    Jumps of the bias at a temperature and hysteresis are followed; what a
    polynomial leaves of them is said.

    Parameters
    ----------
    log
        The log: CSV, NPZ, Parquet, ROS bag; with a temperature.
    model
        auto compares polynomials, jumps and a spline on held-out data.
    degree
        Degree with --model polynomial; by default chosen.
    lag
        Seconds by which the sensor follows the thermometer, or auto.
    play
        Half-width of the backlash between them in degC, or auto.
    confidence
        Level of the intervals.
    """
    if not 0.0 < confidence < 1.0:
        raise CallError(f"--confidence {confidence:g}: expected a level between 0 and 1; 0.95 is 95 %")
    if degree is not None and model != "polynomial":
        raise CallError(f"--degree {degree} goes with --model polynomial")
    options: dict[str, Any] = {
        "model": model, "degree": degree, "confidence": confidence, "lag": _amount("lag", lag), "play": _amount("play", play),
    }  # fmt: skip
    plan, folder = _outputs(log, writing)
    screen = Screen(running.quiet)
    with staged(plan, inputs=[log], folder=folder) as places:
        with progress(f"reading {log.name}", running.quiet):
            from ._provenance import signed

            recording = signed(read_log(log, reading), "jaxcal temperature", reading, options)
        show_log(screen, recording)
        with progress("fitting", running.quiet) as move:
            keep_compiled()
            import jaxcal

            fits = jaxcal.temperature.characterise(recording, progress=move, **options)
            said = [sentence for target, make in plan.items() for sentence in make(places[target], fits, recording)]
        written = [target for target, place in places.items() if place.exists()]
    for sensor, name in _SENSORS.items():
        axes = {channel: fit for channel, fit in fits.items() if channel.startswith(f"{sensor}_")}
        if axes:
            _table(screen, sensor, name, axes)
    screen.sentences("Warnings", [*recording.warnings, *by_channel({channel: fit.warnings for channel, fit in fits.items()}), *said])
    screen.sentences("Notes", by_channel({channel: fit.notes for channel, fit in fits.items()}))
    show_written(screen, written)


def _amount(name: str, text: str | None) -> Any:
    if text is None or text == "auto":
        return text
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value < float("inf"):
        raise CallError(f"--{name} {text}: expected auto, or a number from 0")
    return value


def _ids(text: str | None) -> dict[str, int]:
    found = {}
    for word in (text or "").split(",") if text else ():
        sensor, _, value = word.partition("=")
        if sensor not in ("gyro", "accel") or not value.isdigit():
            raise CallError(f"--ids {text}: expected gyro=NUMBER,accel=NUMBER, as in the parameter list of the vehicle")
        found[f"{sensor}_id"] = int(value)
    return found


def _outputs(log: Path, writing: Writing) -> Outputs:
    check_picture("--plot", writing.plot)
    picture, export = partial(save_picture, draw="temperature"), partial(_export, ids=_ids(writing.ids))
    names: dict[str, Maker] = {
        "temperature.png": picture, "report.html": save_report, "temperature.json": save_json, "calibration.json": _calibration,
    }  # fmt: skip
    asked = [
        (writing.json, save_json), (writing.calibration, _calibration), (writing.report, save_report), (writing.plot, picture),
        *exports(writing.export, _EXPORTS, export, writing.out),
    ]  # fmt: skip
    return outputs(asked, names, out=writing.out, default=f"{stem(log)}-temperature")


def _calibration(place: Path, fits: dict[str, Any], log: Any) -> Sequence[str]:
    import jaxcal

    jaxcal.Calibration(temperature=fits, provenance=log.provenance).save(place)
    return ()


def _export(place: Path, fits: dict[str, Any], log: Any, format: str, ids: dict[str, int]) -> Sequence[str]:
    import jaxcal

    device = jaxcal.Calibration(
        temperature=fits, device={"name": stem(Path(log.provenance.get("file", "log"))), format: ids}, provenance=log.provenance
    )
    return [f"{place.name}: {sentence}" for sentence in jaxcal.export.write(device, place, format=format)]


def _table(screen: Screen, sensor: str, name: str, axes: dict[str, Any]) -> None:
    unit = noise_units("B", sensor)[0]
    scale = noise_factor("B", sensor, unit)
    rows = []
    for channel, fit in axes.items():
        model = [fit.kind if fit.degree is None or fit.steps else f"{fit.kind} {fit.degree}"]
        for step in fit.steps:
            height = number(step.height / scale, step.height_error / scale)
            model.append(f"jump {height} at {step.centre:.2f} +- {1.96 * step.centre_error:.2g} degC")
        model += [f"lag {fit.model.lag:.0f} s"] * (fit.model.lag > 0) + [f"play {fit.model.play:.2f} degC"] * (fit.model.play > 0)
        worst = f"{fit.worst / scale:.3g} at {fit.worst_at:.1f} degC"
        span = f"{fit.model.low:.1f} to {fit.model.high:.1f}"
        rows.append([channel.removeprefix(f"{sensor}_"), "\n".join(model), f"{fit.rms / scale:.3g}", worst, span])
    screen.table(f"{name}: bias against temperature, {unit}", ["", "model", "rms left", "worst degree", "range degC"], rows)
