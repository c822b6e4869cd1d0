"""`jaxcal allan`: Allan deviation and its relatives, of every axis."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from .._files import json_text, write_atomically
from .._units import factor, number, si_unit
from ._cache import keep_compiled
from ._options import WRITING, CallError, Reading, Running, read_log, stem
from ._outputs import Maker, check_picture, exports, outputs, staged
from ._screen import Screen, progress, show_log, show_written

Kind = Literal[
    "adev", "oadev", "mdev", "tdev", "hdev", "ohdev", "totdev", "mtotdev", "ttotdev", "htotdev", "theo1", "mtie", "tierms"
]  # fmt: skip
_GRIDS = ("log", "octave", "decade", "all")
_SENSORS = {"gyro": ("gyroscope", "deg/h"), "accel": ("accelerometer", "ug"), "mag": ("magnetometer", "nT")}
_ROWS = 50  # of a printed table; files hold every cluster size


@Parameter(name="*", group=WRITING)
@dataclass(frozen=True, kw_only=True)
class Writing:
    """Where results go; without any of these they are only printed.

    Attributes
    ----------
    json
        Deviations, limits, degrees of freedom and noise types as JSON, in SI units.
    export
        The same as a table: csv, or csv=FILE.
    plot
        Picture: FILE.png, FILE.svg or FILE.pdf.
    """

    json: Path | None = None
    export: Annotated[tuple[str, ...] | None, Parameter(name="--export")] = None
    plot: Path | None = None


def allan(
    log: Path,
    /,
    *,
    kind: Kind = "oadev",
    m: str = "log",
    confidence: float = 0.95,
    bias_corrected: bool = False,
    reading: Reading = Reading(),
    writing: Writing = Writing(),
    running: Running = Running(),
) -> None:
    """Allan deviation of every axis, with intervals.

    Parameters
    ----------
    log
        The log: CSV, NPZ, Parquet, ROS bag.
    kind
        Statistic: Allan (adev, overlapping oadev), modified Allan (mdev), time (tdev), Hadamard (hdev, overlapping ohdev), their
        total forms (totdev, mtotdev, ttotdev, htotdev), Theo1 (theo1), interval error (largest mtie, rms tierms: no interval known).
    m
        Cluster sizes: log (15 per decade), octave, decade, all, or numbers of samples as 1,10,100.
    confidence
        Level of the intervals.
    bias_corrected
        Take off the bias of the total statistics and of Theo1, for the noise type found.
    """
    sizes = _sizes(m)
    if not 0.0 < confidence < 1.0:
        raise CallError(f"--confidence {confidence:g}: expected a level between 0 and 1; 0.95 is 95 %")
    plan = _outputs(log, writing)
    screen = Screen(running.quiet)
    with staged(plan, inputs=[log]) as places:
        with progress(f"reading {log.name}", running.quiet):
            recording = read_log(log, reading)
        show_log(screen, recording)
        with progress("computing", running.quiet):
            keep_compiled()
            import jaxcal

            options: dict[str, Any] = {"kind": kind, "m": sizes, "confidence": confidence, "bias_corrected": bias_corrected}
            found = {
                sensor: jaxcal.allan.deviation(values.reshape(len(values), -1), recording.rate, **options)
                for sensor in _SENSORS
                if (values := getattr(recording, sensor)) is not None
            }
            if not found:
                raise jaxcal.DataError(f"{log} holds neither gyroscope, accelerometer nor magnetometer; name their columns with --columns")
            for target, make in plan.items():
                make(places[target], found, recording)
    for sensor, result in found.items():
        _table(screen, sensor, result)
    warnings = [sentence for result in found.values() for sentence in result.warnings]
    screen.sentences("Warnings", [*recording.warnings, *warnings])
    show_written(screen, list(plan))


def _sizes(text: str) -> Any:
    if text in _GRIDS:
        return text
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise CallError(f"--m {text}: expected {', '.join(_GRIDS)}, or numbers of samples such as 1,10,100") from None


def _outputs(log: Path, writing: Writing) -> dict[Path, Maker]:
    check_picture("--plot", writing.plot)
    files = exports(writing.export, {"csv": f"{stem(log)}-allan.csv"}, _csv, None)
    return outputs([(writing.json, _json), *files, (writing.plot, _picture)])[0]


def _table(screen: Screen, sensor: str, result: Any) -> None:
    import numpy as np

    name, unit = _SENSORS[sensor]
    scale = factor(unit, sensor)
    unit = f"{unit} s" if result.unit_of_phase else unit
    step = -(-len(result.tau) // _ROWS)
    rows = []
    for i in range(0, len(result.tau), step):
        cells = []
        for value, low, high in zip(result.deviation[i], result.lower[i], result.upper[i], strict=True):
            doubt = 5 * (high - low) / scale  # one doubtful digit: there are many rows and they are narrow
            known = not np.isnan(low)
            limits = f" [{number(low / scale, doubt)}, {number(high / scale, doubt)}]" if known else ""
            cells.append(number(value / scale, doubt) + limits)
        rows.append([f"{result.tau[i]:.4g}", *cells])
    every = f"; every {step}th of {len(result.tau)} cluster times" if step > 1 else ""
    interval = "no interval known" if np.isnan(result.lower).all() else f"{100 * result.confidence:g} % interval"
    title = f"{name}: {result.kind} in {unit}, {interval}{every}"
    screen.table(title, ["tau (s)", *"xyz"[: result.deviation.shape[1]]], rows)


def _unit(channel: str, result: Any) -> str:
    sensor = channel.partition("_")[0]
    return {"gyro": "rad", "accel": "m/s", "mag": "T s"}[sensor] if result.unit_of_phase else si_unit(sensor)


def _known(values: Any) -> list[Any]:
    """Numbers for a file, None where there is no number (limits of an interval error)."""
    return [None if value != value else value for value in values.tolist()]


def _channels(found: dict[str, Any]) -> dict[str, Any]:
    return {
        f"{sensor}_{'xyz'[axis]}": result.channel(axis) for sensor, result in found.items() for axis in range(result.deviation.shape[1])
    }


def _json(place: Path, found: dict[str, Any], log: Any) -> Sequence[str]:
    import jaxcal

    names = ("tau", "m", "deviation", "lower", "upper", "edf", "count", "alpha", "bias")
    first = next(iter(found.values()))
    channels = {
        channel: {"unit": _unit(channel, result), **{name: _known(getattr(result, name)) for name in names}}
        for channel, result in _channels(found).items()
    }
    document = {
        "schema": "jaxcal.allan/1", "version": jaxcal.__version__, "kind": first.kind, "confidence": first.confidence,
        "rate": log.rate, "duration": log.duration, "channels": channels,
    }  # fmt: skip
    write_atomically(place, json_text(document))
    return ()


def _csv(place: Path, found: dict[str, Any], log: Any, format: str) -> Sequence[str]:
    lines = ["channel,unit,tau_s,m,deviation,lower,upper,edf"]
    for channel, result in _channels(found).items():
        unit = _unit(channel, result)
        columns = (result.tau, result.m, result.deviation, result.lower, result.upper, result.edf)
        for row in zip(*map(_known, columns), strict=True):
            lines.append(f"{channel},{unit}," + ",".join("" if value is None else str(value) for value in row))
    write_atomically(place, "\n".join(lines) + "\n")
    return ()


def _picture(place: Path, found: dict[str, Any], log: Any) -> Sequence[str]:
    import jaxcal

    jaxcal.plot.save(jaxcal.plot.allan(_channels(found)), place)
    return ()
