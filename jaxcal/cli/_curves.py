"""`jaxcal allan` and `jaxcal psd`: a curve with intervals for every axis."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

import jaxcal

from .._files import json_text, write_atomically
from .._units import factor, number, si_unit
from ._options import WRITING, CallError, Level, Log, Reading, Running, picture, stem
from ._outputs import File, Outputs, figure, outputs, save_report
from ._screen import Screen
from ._tables import by_sensor
from ._work import carry_out

Kind = Literal[
    "adev", "oadev", "mdev", "tdev", "hdev", "ohdev", "totdev", "mtotdev", "ttotdev", "htotdev", "theo1", "theoh", "mtie", "tierms"
]  # fmt: skip
_GRIDS = ("log", "octave", "decade", "all")
_DEVIATIONS, _FREQUENCIES = 50, 30  # largest number of rows of a printed table; files have all rows
_NONE = "neither gyroscope, accelerometer nor magnetometer; name their columns with --columns"


@Parameter(name="*", group=WRITING)
@dataclass(frozen=True, kw_only=True)
class Deviations:
    """Files with Allan deviations; without any of these options they are only printed."""

    json: Annotated[Path | None, Parameter(help="Deviations, limits, degrees of freedom and noise types as JSON, in SI units.")] = None
    export: Annotated[tuple[str, ...] | None, Parameter(name="--export", help="The same as a table: csv, or csv=FILE.")] = None
    plot: Annotated[Path | None, picture()] = None
    report: Annotated[Path | None, Parameter(help="Report to explore, as one HTML file.")] = None


@dataclass(frozen=True, kw_only=True)
class Spectra(Deviations):
    """Files with spectra."""

    json: Annotated[Path | None, Parameter(help="Densities, limits, counts and degrees of freedom as JSON, in SI units.")] = None


def allan(
    log: Log,
    /,
    *,
    kind: Kind = "oadev",
    m: str = "log",
    confidence: Level = 0.95,
    bias_corrected: bool = False,
    alpha: Literal[-2, -1, 0, 1, 2] | None = None,
    robust: bool = False,
    clock: bool = False,
    reading: Reading = Reading(),
    writing: Deviations = Deviations(),
    running: Running = Running(),
) -> None:
    """Allan deviation of every axis, with intervals.

    Parameters
    ----------
    kind
        Statistic: Allan (adev, overlapping oadev), modified Allan (mdev), time (tdev), Hadamard (hdev, overlapping ohdev), their
        total forms (totdev, mtotdev, ttotdev, htotdev), Theo1 (theo1), both (theoh: oadev, and Theo1 beyond a tenth of the log), interval
        error (largest mtie, rms tierms: no interval known).
    m
        Cluster sizes: log (15 per decade), octave, decade, all, or numbers of samples as 1,10,100.
    bias_corrected
        Remove the bias of the total statistics and of Theo1 for the identified noise type.
    alpha
        Noise type for the intervals, instead of the identified one: 2 white phase, 1 flicker phase, 0 white frequency, -1 flicker
        frequency, -2 random walk of frequency.
    robust
        Use an M-estimate that is robust against outliers, for adev, oadev, hdev and ohdev.
    clock
        The log is a column of fractional frequencies, or with --data phase of time errors in s, of clocks or oscillators (one to three
        columns with --columns gyro=0:2): deviations have no unit, tdev is in s.
    """
    options: dict[str, Any] = {"kind": kind, "m": _sizes(m), "confidence": confidence, "bias_corrected": bias_corrected}
    options |= {"alpha": alpha, "robust": robust}
    asked = dict(options)

    change = None
    if clock:
        # read a column without a unit as rad/s, whose factor is one; the files name what was asked for
        options |= {"clock": True, "columns": reading.columns, "units": reading.units}
        reading = replace(reading, columns=reading.columns or ("gyro=0",), units=("gyro=rad/s", *(reading.units or ())))
        change = _as_clock

    def compute(recording: Any, _: Any) -> dict[str, Any]:
        found = {}
        for sensor in ("gyro", "accel", "mag"):
            if (values := getattr(recording, sensor)) is not None:
                result = jaxcal.allan.deviation(values.reshape(len(values), -1), recording.rate, **asked)
                name = "clock" if clock else sensor
                found |= {f"{name}_{'xyz'[axis]}": result.channel(axis) for axis in range(result.deviation.shape[1])}
        if not found:
            raise jaxcal.DataError(f"{log} holds {_NONE}")
        return found

    names = ("tau", "m", "deviation", "lower", "upper", "edf")
    plan = _outputs(log, writing, "allan", "tau_s", names, ("count", "alpha", "bias"), ("kind", "confidence"), lambda plot: plot.allan)
    show = partial(_tables, table=_deviations)
    done = carry_out(
        log, reading, running, plan, compute, doing="computing", show=show, change=change, command="jaxcal allan", options=options
    )
    done.tell([sentence for result in done.found.values() for sentence in result.warnings])


def psd(
    log: Log,
    /,
    *,
    method: Literal["periodogram", "welch", "dct"] = "periodogram",
    sided: Literal[2, 1] = 2,
    average: Literal["octave", "log", "none"] = "octave",
    keep_tail: bool = False,
    confidence: Level = 0.95,
    reading: Reading = Reading(),
    writing: Spectra = Spectra(),
    running: Running = Running(),
) -> None:
    """Power spectral density of every axis, with intervals.

    Parameters
    ----------
    method
        Periodogram, Welch's mean over segments (for records that drift), or DCT (no leakage; one degree of freedom per ordinate).
    sided
        2: two-sided, as every noise coefficient here. 1: one-sided, as in data sheets, twice as high.
    average
        Mean over neighbouring ordinates: octave (16 values per octave), log (40 per decade), none.
    keep_tail
        Also average the last ordinates if they do not fill their group.
    """
    mean = None if average == "none" else average
    options: dict[str, Any] = {"method": method, "sided": sided, "average": mean, "keep_tail": keep_tail, "confidence": confidence}
    refused: dict[str, list[str]] = {}

    def compute(recording: Any, _: Any) -> dict[str, Any]:
        from .._results import by_channel

        found = {}
        for channel, values in recording.channels().items():
            if channel.partition("_")[0] in ("gyro", "accel", "mag"):
                try:
                    found[channel] = jaxcal.spectrum.density(values, recording.rate, **options)
                except jaxcal.DataError as error:
                    refused[channel] = [str(error)]
        if not found and not refused:
            raise jaxcal.DataError(f"the log holds {_NONE}")
        if not found:
            start = recording.provenance.get("selected", (0.0,))[0]
            offset = f", which count from {start:.6g} s before the part chosen now" if start else ""
            raise jaxcal.DataError(f"{'; '.join(by_channel(refused))} (on the command line: --start and --stop{offset})")
        return found

    names = ("frequency", "count", "density", "lower", "upper", "edf")
    head = ("method", "sided", "average", "confidence")
    plan = _outputs(log, writing, "psd", "frequency_hz", names, (), head, lambda plot: plot.spectrum)
    show = partial(_tables, table=_densities)
    done = carry_out(log, reading, running, plan, compute, doing="computing", show=show, command="jaxcal psd", options=options)
    from .._results import by_channel

    warnings = {channel: [f"left out: {sentence}" for sentence in sentences] for channel, sentences in refused.items()}
    warnings |= {channel: result.warnings for channel, result in done.found.items()}
    done.tell(by_channel(warnings))


def _as_clock(log: Any) -> Any:
    """The log with a provenance that says what its column holds, in place of the units of a sensor."""
    import equinox as eqx

    known = {name: value for name, value in log.provenance.items() if name not in ("units", "columns")}
    return eqx.tree_at(lambda one: one.provenance, log, known | {"quantity": "clock"})


def _tables(screen: Screen, found: Mapping[str, Any], *, table: Callable[[Screen, str, str, Mapping[str, Any]], None]) -> None:
    for sensor, name, axes in by_sensor(found):
        table(screen, sensor, name, axes)


def _sizes(text: str) -> Any:
    if text in _GRIDS:
        return text
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise CallError(f"--m {text}: expected {', '.join(_GRIDS)}, or numbers of samples such as 1,10,100") from None


def _outputs(
    log: Path, writing: Deviations, what: str, abscissa: str, names: tuple[str, ...], more: tuple[str, ...], head: tuple[str, ...],
    draw: Callable[[Any], Callable[..., Any]],
) -> Outputs:  # fmt: skip
    """Output files: JSON with the arrays `names` and `more` of every channel, a table of `names`, a picture, and a report."""
    files: list[File] = [
        ("json", "", partial(_json, what=what, names=(*names, *more), head=head)),
        ("plot", "", figure(lambda plot, found, _: draw(plot)(found))),
        ("report", "", save_report),
    ]
    header = ("channel", "unit", abscissa, *names[1:])
    return outputs(writing, files, formats={"csv": f"{stem(log)}-{what}.csv"}, export=partial(_csv, header=header, names=names))


def _json(place: Path, found: dict[str, Any], log: Any, *, what: str, names: tuple[str, ...], head: tuple[str, ...]) -> None:
    first = next(iter(found.values()))
    channels = {channel: {"unit": unit, **columns} for channel, unit, columns in _columns(found, names)}
    document = {"schema": f"jaxcal.{what}/1", "version": jaxcal.__version__, **{name: getattr(first, name) for name in head}}
    write_atomically(place, json_text(document | {"rate": log.rate, "duration": log.duration, "channels": channels}))


def _csv(place: Path, found: dict[str, Any], log: Any, format: str, *, header: tuple[str, ...], names: tuple[str, ...]) -> None:
    lines = [",".join(header)]
    for channel, unit, columns in _columns(found, names):
        for row in zip(*columns.values(), strict=True):
            lines.append(f"{channel},{unit}," + ",".join("" if value is None else str(value) for value in row))
    write_atomically(place, "\n".join(lines) + "\n")


def _columns(found: dict[str, Any], names: tuple[str, ...]) -> Iterator[tuple[str, str, dict[str, list[Any]]]]:
    """Channel, unit and arrays as lists, with None for undefined numbers (limits of an interval error)."""
    for channel, result in found.items():
        sensor = channel.partition("_")[0]
        if hasattr(result, "density"):
            unit = f"({si_unit(sensor)})^2/Hz"
        elif result.unit_of_phase:
            unit = {"gyro": "rad", "accel": "m/s", "mag": "T s", "clock": "s"}[sensor]
        else:
            unit = "1" if sensor == "clock" else si_unit(sensor)
        yield channel, unit, {name: [None if x != x else x for x in getattr(result, name).tolist()] for name in names}


def _deviations(screen: Screen, sensor: str, name: str, axes: Mapping[str, Any]) -> None:
    import numpy as np

    first = next(iter(axes.values()))
    if sensor == "clock":
        scale, unit = 1.0, "s" if first.unit_of_phase else "fractions of the frequency"
    else:
        unit = {"gyro": "deg/h", "accel": "ug", "mag": "nT"}[sensor]
        scale, unit = factor(unit, sensor), unit + " s" * first.unit_of_phase
    step = -(-len(first.tau) // _DEVIATIONS)
    rows = []
    for i in range(0, len(first.tau), step):
        cells = []
        for result in axes.values():
            value, low, high = (curve[i] / scale for curve in (result.deviation, result.lower, result.upper))
            doubt = 5 * (high - low)  # print only one uncertain digit, because there are many narrow rows
            limits = "" if np.isnan(low) else f" [{number(low, doubt)}, {number(high, doubt)}]"
            cells.append(number(value, doubt) + limits)
        rows.append([f"{first.tau[i]:.4g}", *cells])
    every = f"; every {step}th of {len(first.tau)} cluster times" if step > 1 else ""
    known = any(np.isfinite(result.lower).any() for result in axes.values())
    interval = f"{100 * first.confidence:g} % interval" if known else "no interval known"
    title = f"{name}: {first.kind} in {unit}, {interval}{every}"
    screen.table(title, ["tau (s)", *(channel.removeprefix(f"{sensor}_") for channel in axes)], rows)


def _densities(screen: Screen, sensor: str, name: str, axes: Mapping[str, Any]) -> None:
    unit = {"gyro": "deg/h", "accel": "mg", "mag": "nT"}[sensor]
    first = next(iter(axes.values()))
    chosen = _rows(first.frequency)
    scale, power = factor(unit, sensor) ** 2, 0
    typical = sorted(float(result.density[i]) / scale for result in axes.values() for i in chosen)[len(chosen) * len(axes) // 2]
    if 0 < typical < 0.01 or typical >= 1e4:
        power = 3 * math.floor(math.log10(typical) / 3)
    rows = []
    for i in chosen:
        values = [float(result.density[i]) / scale / 10.0**power for result in axes.values()]
        # the factors are the same for every channel
        limits = next(((r.lower[i] / r.density[i], r.upper[i] / r.density[i]) for r in axes.values() if r.density[i] > 0), ())
        rows.append([f"{first.frequency[i]:.4g}", *(f"{v:.3g}" for v in values), " to ".join(number(end, end / 5) for end in limits)])
    part = f"; {len(chosen)} of {len(first.frequency)} frequencies" if len(chosen) < len(first.frequency) else ""
    unit = f"{f'1e{power} ' if power else ''}({unit})^2/Hz"
    title = f"{name}: {'one' if first.sided == 1 else 'two'}-sided density in {unit}{part}"
    names = [channel.removeprefix(f"{sensor}_") for channel in axes]
    screen.table(title, ["f (Hz)", *names, f"{100 * first.confidence:g} % interval, times"], rows)


def _rows(frequency: Any) -> list[int]:
    """Indices of the frequencies to print: all, or a subset at equal ratios."""
    if len(frequency) <= _FREQUENCIES:
        return list(range(len(frequency)))
    ratio = float(frequency[-1] / frequency[0])
    asked = [float(frequency[0]) * ratio ** (i / (_FREQUENCIES - 1)) for i in range(_FREQUENCIES)]
    return sorted({int(abs(frequency - f).argmin()) for f in asked})
