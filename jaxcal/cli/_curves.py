"""`jaxcal allan` and `jaxcal psd`: a curve with intervals for every axis."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

import jaxcal

from .._answer import Finding, joined
from .._files import write_atomically
from .._message import Message
from ._options import CallError, Files, Level, Log, Reading, Running, stem
from ._outputs import File, Outputs, figure, outputs, save_json, save_report
from ._work import carry_out

Kind = Literal[
    "adev", "oadev", "mdev", "tdev", "hdev", "ohdev", "totdev", "mtotdev", "ttotdev", "htotdev", "theo1"
]  # fmt: skip
_GRIDS = ("log", "octave", "decade", "all")


@dataclass(frozen=True, kw_only=True)
class Writing(Files):
    """Files with the curves."""

    export: Annotated[tuple[str, ...] | None, Parameter(name="--export", help="The curves as a table: csv, or csv=FILE.")] = None


def allan(
    log: Log,
    /,
    *,
    kind: Kind = "oadev",
    m: str = "log",
    confidence: Level = 0.95,
    bias_corrected: bool = False,
    alpha: Literal[-2, -1, 0, 1, 2] | None = None,
    clock: bool = False,
    reading: Reading = Reading(),
    writing: Writing = Writing(),
    running: Running = Running(),
) -> None:
    """Allan deviation of every axis, with intervals.

    Parameters
    ----------
    kind
        Statistic: Allan (adev, overlapping oadev), modified Allan (mdev), time (tdev), Hadamard (hdev, overlapping ohdev), their
        total forms (totdev, mtotdev, ttotdev, htotdev), Theo1 (theo1).
    m
        Cluster sizes: log (15 per decade), octave, decade, all, or numbers of samples as 1,10,100.
    bias_corrected
        Remove the bias of the total statistics and of Theo1 for the identified noise type.
    alpha
        Noise type for the intervals, instead of the identified one: 2 white phase, 1 flicker phase, 0 white frequency, -1 flicker
        frequency, -2 random walk of frequency.
    clock
        The log is a column of fractional frequencies, or with --data phase of time errors in s, of clocks or oscillators (one to three
        columns with --columns gyro=0:2): deviations have no unit, tdev is in s.
    """
    options: dict[str, Any] = {
        "kind": kind, "m": _sizes(m), "confidence": confidence, "bias_corrected": bias_corrected, "alpha": alpha,
    }  # fmt: skip
    asked = dict(options)

    change = None
    if clock:
        # read a column without a unit as rad/s, whose factor is one; the files name what was asked for
        options |= {"clock": True, "columns": reading.columns, "units": reading.units}
        reading = replace(reading, keep=("all",), columns=reading.columns or ("gyro=0",), units=("gyro=rad/s", *(reading.units or ())))
        change = _as_clock

    def compute(recording: Any, _: Any) -> Any:
        from ..batch._tasks import deviations

        return deviations(recording, "clock" if clock else "", **asked)

    plan = _outputs(log, writing, "allan", ("tau", "m", "deviation", "lower", "upper", "edf"), "tau_s", lambda plot: plot.allan)
    done = carry_out(log, reading, running, plan, compute, doing="computing", change=change, command="jaxcal allan", options=options)
    done.end(running)


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
    writing: Writing = Writing(),
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

    def compute(recording: Any, _: Any) -> Any:
        import numpy as np

        from .._arrays import longest_run
        from ..evidence._values import at_own_rate

        found, refused = {}, []
        for channel, values in recording.channels().items():
            if channel.partition("_")[0] in ("gyro", "accel", "mag"):
                values, rate = at_own_rate(values[:, None], recording.rate)
                values = values[:, 0]
                if "set_aside" in recording.codes:  # a spectrum needs a record without gaps
                    first, last = longest_run(np.isfinite(values))
                    values = values[first:last]
                try:
                    found[channel] = jaxcal.spectrum.density(values, rate, **options)
                except jaxcal.DataError as error:
                    if not isinstance(error.args[0], Finding):
                        raise error.of(channel) from error
                    refused.append(_from_the_start(error.args[0], recording).of(channel))
        if not found:
            raise jaxcal.DataError(joined(refused)[0], code=refused[0].code) if refused else _nothing()
        return jaxcal.spectrum.Spectra(found, refused)

    plan = _outputs(
        log, writing, "psd", ("frequency", "count", "density", "lower", "upper", "edf"), "frequency_hz", lambda plot: plot.spectrum
    )
    carry_out(log, reading, running, plan, compute, doing="computing", command="jaxcal psd", options=options).end(running)


def _from_the_start(finding: Finding, recording: Any) -> Finding:
    """The finding with times that count from the start of the file, as the options do, and not from that of the selected part."""
    since = recording.provenance.get("selected", (0.0,))[0]
    times = {name: since + finding.facts[name] for name in ("start", "stop") if name in finding.facts}
    return replace(finding, facts={**finding.facts, **times})


def _nothing() -> jaxcal.DataError:
    message = Message("the log holds neither gyroscope, accelerometer nor magnetometer; name their columns with {option.columns}")
    return jaxcal.DataError(message, code="no_sensor")


def _as_clock(log: Any) -> Any:
    """The log with a provenance that says what its column holds, in place of the units of a sensor."""
    import equinox as eqx

    known = {name: value for name, value in log.provenance.items() if name not in ("units", "columns")}
    return eqx.tree_at(lambda one: one.provenance, log, known | {"quantity": "clock"})


def _sizes(text: str) -> Any:
    if text in _GRIDS:
        return text
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise CallError(f"--m {text}: expected {', '.join(_GRIDS)}, or numbers of samples such as 1,10,100") from None


def _outputs(
    log: Path, writing: Writing, what: str, names: tuple[str, ...], abscissa: str, draw: Callable[[Any], Callable[..., Any]]
) -> Outputs:
    """Output files: JSON, a table with the arrays `names` of every channel, a picture, and a report."""
    files: list[File] = [
        ("json", "", save_json),
        ("plot", "", figure(lambda plot, found, _: draw(plot)(found))),
        ("report", "", save_report),
    ]
    header = ("channel", "unit", abscissa, *names[1:])
    return outputs(writing, files, formats={"csv": f"{stem(log)}-{what}.csv"}, export=partial(_csv, header=header, names=names))


def _csv(place: Path, found: Any, log: Any, format: str, *, header: tuple[str, ...], names: tuple[str, ...]) -> None:
    lines = [",".join(header)]
    for channel, fields in found.to_dict()["channels"].items():
        for row in zip(*(fields[name] for name in names), strict=True):
            lines.append(f"{channel},{fields['unit']}," + ",".join("" if value is None else str(value) for value in row))
    write_atomically(place, "\n".join(lines) + "\n")
