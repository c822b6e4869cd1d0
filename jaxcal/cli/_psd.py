"""`jaxcal psd`: power spectral density of every axis."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from .._files import json_text, write_atomically
from .._units import factor, number, si_unit
from ._options import WRITING, CallError, Reading, Running, read_log, stem
from ._outputs import Maker, check_picture, exports, outputs, staged
from ._screen import Screen, progress, show_log, show_written
from ._tables import by_channel

Method = Literal["periodogram", "welch", "dct"]
Average = Literal["octave", "log", "none"]
_SENSORS = {"gyro": ("gyroscope", "deg/h"), "accel": ("accelerometer", "mg"), "mag": ("magnetometer", "nT")}
_ROWS = 30  # of a printed table; files hold every frequency
_ARRAYS = ("frequency", "count", "density", "lower", "upper", "edf")


@Parameter(name="*", group=WRITING)
@dataclass(frozen=True, kw_only=True)
class Writing:
    """Where results go; without any of these they are only printed.

    Attributes
    ----------
    json
        Densities, limits, counts and degrees of freedom as JSON, in SI units.
    export
        The same as a table: csv, or csv=FILE.
    plot
        Picture: FILE.png, FILE.svg or FILE.pdf.
    """

    json: Path | None = None
    export: Annotated[tuple[str, ...] | None, Parameter(name="--export")] = None
    plot: Path | None = None


def psd(
    log: Path,
    /,
    *,
    method: Method = "periodogram",
    sided: Literal[2, 1] = 2,
    average: Average = "octave",
    keep_tail: bool = False,
    confidence: float = 0.95,
    reading: Reading = Reading(),
    writing: Writing = Writing(),
    running: Running = Running(),
) -> None:
    """Power spectral density of every axis, with intervals.

    Parameters
    ----------
    log
        The log: CSV, NPZ, Parquet, ROS bag.
    method
        Periodogram, Welch's mean over segments (for records that drift), or DCT (no leakage; one degree of freedom an ordinate).
    sided
        2: two-sided, as every noise coefficient here. 1: one-sided, as in data sheets, twice as high.
    average
        Mean over neighbouring ordinates: octave (16 values to the octave), log (40 to the decade), none.
    keep_tail
        Average the last ordinates too where they do not fill their group.
    confidence
        Level of the intervals.
    """
    if not 0.0 < confidence < 1.0:
        raise CallError(f"--confidence {confidence:g}: expected a level between 0 and 1; 0.95 is 95 %")
    plan = _outputs(log, writing)
    screen = Screen(running.quiet)
    with staged(plan, inputs=[log]) as places:
        with progress(f"reading {log.name}", running.quiet):
            recording = read_log(log, reading)
        show_log(screen, recording)
        with progress("computing", running.quiet):
            found, said = _spectra(
                recording, method=method, sided=sided, average=None if average == "none" else average, keep_tail=keep_tail,
                confidence=confidence,
            )  # fmt: skip
            for target, make in plan.items():
                make(places[target], found, recording)
    for sensor in _SENSORS:
        _table(screen, sensor, {channel: result for channel, result in found.items() if channel.startswith(f"{sensor}_")})
    said |= {channel: result.warnings for channel, result in found.items()}
    screen.sentences("Warnings", [*recording.warnings, *by_channel(said)])
    show_written(screen, list(plan))


def _spectra(recording: Any, **options: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """The spectrum of every channel that has one, and what keeps the others from it.

    Raises
    ------
    DataError
        If no channel has a spectrum.
    """
    import jaxcal

    found, refused = {}, {}
    for channel, values in recording.channels().items():
        if channel.partition("_")[0] in _SENSORS:
            try:
                found[channel] = jaxcal.spectrum.density(values, recording.rate, **options)
            except jaxcal.DataError as error:
                refused[channel] = [str(error)]
    if not found:
        if not refused:
            raise jaxcal.DataError("the log holds neither gyroscope, accelerometer nor magnetometer; name their columns with --columns")
        start = recording.provenance.get("selected", (0.0,))[0]
        offset = f", which count from {start:.6g} s before the part chosen now" if start else ""
        raise jaxcal.DataError(f"{'; '.join(by_channel(refused))} (on the command line: --start and --stop{offset})")
    return found, {channel: [f"left out: {sentence}" for sentence in sentences] for channel, sentences in refused.items()}


def _outputs(log: Path, writing: Writing) -> dict[Path, Maker]:
    check_picture("--plot", writing.plot)
    files = exports(writing.export, {"csv": f"{stem(log)}-psd.csv"}, _csv, None)
    return outputs([(writing.json, _json), *files, (writing.plot, _picture)])[0]


def _table(screen: Screen, sensor: str, results: dict[str, Any]) -> None:
    if not results:
        return
    name, unit = _SENSORS[sensor]
    first = next(iter(results.values()))
    chosen = _rows(first.frequency)
    scale, power = factor(unit, sensor) ** 2, 0
    typical = sorted(float(result.density[i]) / scale for result in results.values() for i in chosen)[len(chosen) * len(results) // 2]
    if 0 < typical < 0.01 or typical >= 1e4:
        power = 3 * math.floor(math.log10(typical) / 3)
    rows = []
    for i in chosen:
        values = [float(result.density[i]) / scale / 10.0**power for result in results.values()]
        # the factors are the same for every channel
        limits = next(((r.lower[i] / r.density[i], r.upper[i] / r.density[i]) for r in results.values() if r.density[i] > 0), ())
        rows.append([f"{first.frequency[i]:.4g}", *(f"{v:.3g}" for v in values), " to ".join(number(end, end / 5) for end in limits)])
    part = f"; {len(chosen)} of {len(first.frequency)} frequencies" if len(chosen) < len(first.frequency) else ""
    unit = f"{f'1e{power} ' if power else ''}({unit})^2/Hz"
    title = f"{name}: {'one' if first.sided == 1 else 'two'}-sided density in {unit}{part}"
    names = [channel.removeprefix(f"{sensor}_") for channel in results]
    screen.table(title, ["f (Hz)", *names, f"{100 * first.confidence:g} % interval, times"], rows)


def _rows(frequency: Any) -> list[int]:
    """Frequencies to print: all of them, or some at equal ratios."""
    if len(frequency) <= _ROWS:
        return list(range(len(frequency)))
    ratio = float(frequency[-1] / frequency[0])
    asked = [float(frequency[0]) * ratio ** (i / (_ROWS - 1)) for i in range(_ROWS)]
    return sorted({int(abs(frequency - f).argmin()) for f in asked})


def _unit(channel: str) -> str:
    return f"({si_unit(channel.partition('_')[0])})^2/Hz"


def _json(place: Path, found: dict[str, Any], log: Any) -> Sequence[str]:
    import jaxcal

    first = next(iter(found.values()))
    channels = {
        channel: {"unit": _unit(channel), **{name: getattr(result, name).tolist() for name in _ARRAYS}} for channel, result in found.items()
    }
    document = {
        "schema": "jaxcal.psd/1", "version": jaxcal.__version__, "method": first.method, "sided": first.sided, "average": first.average,
        "confidence": first.confidence, "rate": log.rate, "duration": log.duration, "channels": channels,
    }  # fmt: skip
    write_atomically(place, json_text(document))
    return ()


def _csv(place: Path, found: dict[str, Any], log: Any, format: str) -> Sequence[str]:
    lines = ["channel,unit,frequency_hz,count,density,lower,upper,edf"]
    for channel, result in found.items():
        columns = (getattr(result, name).tolist() for name in _ARRAYS)
        lines += [f"{channel},{_unit(channel)}," + ",".join(str(v) for v in row) for row in zip(*columns, strict=True)]
    write_atomically(place, "\n".join(lines) + "\n")
    return ()


def _picture(place: Path, found: dict[str, Any], log: Any) -> Sequence[str]:
    import jaxcal

    jaxcal.plot.save(jaxcal.plot.spectrum(found), place)
    return ()
