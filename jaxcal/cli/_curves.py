"""`jaxcal allan` and `jaxcal psd`: a curve with intervals for every axis."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

import jaxcal

from .._answer import Finding, joined
from .._files import write_atomically
from ._options import CallError, Level, Log, Pictured, Reading, Running, read_clock, stem
from ._outputs import Outputs, standard
from ._work import carry_out

Kind = Literal["adev", "oadev", "mdev", "tdev", "hdev", "ohdev", "mtie", "tierms"]
_GRIDS = ("log", "octave", "decade", "all")


@dataclass(frozen=True, kw_only=True)
class Writing(Pictured):
    """Files with the curves."""

    export: Annotated[tuple[str, ...] | None, Parameter(name="--export", help="The curves as a table: csv, or csv=FILE.")] = None


def allan(
    log: Log,
    /,
    *,
    kind: Kind = "oadev",
    m: str = "log",
    confidence: Level = 0.95,
    alpha: Literal[-2, -1, 0, 1, 2] | None = None,
    clock: bool = False,
    nominal: float | None = None,
    reading: Reading = Reading(),
    writing: Writing = Writing(),
    running: Running = Running(),
) -> None:
    """Allan deviation of every axis, with intervals.

    Parameters
    ----------
    kind
        Statistic: Allan (adev, overlapping oadev), modified Allan (mdev), time (tdev), Hadamard (hdev, overlapping ohdev),
        time interval error (mtie, tierms).
    m
        Cluster sizes: log (15 per decade), octave, decade, all, or numbers of samples as 1,10,100.
    alpha
        Noise type for the intervals, instead of the identified one: 2 white phase, 1 flicker phase, 0 white frequency, -1 flicker
        frequency, -2 random walk of frequency.
    clock
        The log is the phase or the frequency of a clock or oscillator: --columns phase=1 (or frequency=1), --units phase=ns (or
        frequency=Hz), else from the names, the header (as of Stable32) and the values. Deviations have no unit; tdev, mtie and tierms
        are in s.
    nominal
        Nominal frequency in Hz of a clock whose readings are in Hz, such as 10e6.
    """
    asked = {"kind": kind, "m": _sizes(m), "confidence": confidence, "alpha": alpha}
    options: dict[str, Any] = dict(asked)

    if clock:
        options |= {"clock": True, "nominal": nominal}

    def compute(recording: Any, _: Any) -> Any:
        from ..batch._tasks import deviations

        return deviations(recording, "clock" if clock else "", **asked)

    plan = _outputs(log, writing, "allan", ("tau", "m", "deviation", "lower", "upper", "edf"), "tau_s")
    read = partial(read_clock, log, reading, nominal) if clock else None
    carry_out(log, reading, running, plan, compute, doing="computing", read=read, command="allan", options=options).end()


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
        from ..batch._tasks import no_sensor
        from ..evidence._findings import unrest
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
            raise jaxcal.DataError(joined(refused)[0], code=refused[0].code) if refused else no_sensor()
        return jaxcal.spectrum.Spectra(found, [*refused, *unrest(recording)])

    plan = _outputs(log, writing, "psd", ("frequency", "count", "density", "lower", "upper", "edf"), "frequency_hz")
    carry_out(log, reading, running, plan, compute, doing="computing", command="psd", options=options).end()


def _from_the_start(finding: Finding, recording: Any) -> Finding:
    """The finding with times that count from the start of the file, as the options do, and not from that of the selected part."""
    since = recording.provenance.get("selected", (0.0,))[0]
    times = {name: since + finding.facts[name] for name in ("start", "stop") if name in finding.facts}
    return replace(finding, facts={**finding.facts, **times})


def _sizes(text: str) -> Any:
    if text in _GRIDS:
        return text
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise CallError(f"--m {text}: expected {', '.join(_GRIDS)}, or numbers of samples such as 1,10,100") from None


def _outputs(log: Path, writing: Writing, what: str, names: tuple[str, ...], abscissa: str) -> Outputs:
    """Output files: those of every result, and a table with the arrays `names` of every channel."""
    table = partial(_csv, header=("channel", "unit", abscissa, *names[1:]), names=names)
    return standard(writing, what, log, formats={"csv": f"{stem(log)}-{what}.csv"}, export=table)


def _csv(place: Path, found: Any, log: Any, format: str, *, header: tuple[str, ...], names: tuple[str, ...]) -> None:
    lines = [",".join(header)]
    for channel, fields in found.to_dict()["channels"].items():
        for row in zip(*(fields[name] for name in names), strict=True):
            lines.append(f"{channel},{fields['unit']}," + ",".join("" if value is None else str(value) for value in row))
    write_atomically(place, "\n".join(lines) + "\n")
