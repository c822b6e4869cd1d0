"""`jaxcal noise`: noise coefficients of every axis of a static log."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

import jaxcal

from ._apply import corrected
from ._export import FILES
from ._options import CallError, Folder, Level, Log, Plot, Reading, Running, exported, must_be_calibration, must_exist, read_log
from ._outputs import save_calibration, save_export, standard, tried
from ._screen import Screen
from ._work import Done, carry_out, check_suited

#: format of --export -> default name of the file
_EXPORTS = {name: FILES[name] for name in ("kalibr", "openvins", "vins", "orbslam3", "gtsam", "ros", "csv")}


@dataclass(frozen=True, kw_only=True)
class Writing(Folder):
    """Where results go. By default all go into the folder LOG-noise."""

    plot: Plot = None
    export: Annotated[tuple[str, ...] | None, exported(*_EXPORTS)] = None


def noise(
    log: Log,
    /,
    *,
    terms: Annotated[str, Parameter(help="Terms to fit, as letters of QNBKRM; M is a Gauss-Markov process.")] = "QNBK",
    confidence: Annotated[Level, Parameter(help="Level of the intervals and limits.")] = 0.95,
    band: Annotated[
        tuple[float, float] | None,
        Parameter(help="Shortest and longest cluster time to use, in s; by default those at which the model holds."),
    ] = None,
    method: Annotated[
        Literal["whittle", "gls"], Parameter(help="How to fit: by the likelihood (whittle), or on the Allan variance (gls).")
    ] = "whittle",
    calibration: Annotated[
        Path | None,
        Parameter(help="Calibration of the device as JSON, from another recording: the log is corrected with it before the fit."),
    ] = None,
    also: Annotated[
        tuple[Path, ...] | None,
        Parameter(
            name="--also", help="Another recording of the same device. Repeatable: adds a table with intervals for the next recording."
        ),
    ] = None,
    compare: Annotated[
        bool, Parameter(help="Ask which process the slow noise is: a table of likelihoods for each channel, instead of the fit.")
    ] = False,
    conservative: Annotated[
        bool,
        Parameter(help="Write upper bounds instead of the coefficients, for a filter that must not be optimistic; adds a table of them."),
    ] = False,
    reading: Reading = Reading(),
    writing: Writing = Writing(),
    running: Running = Running(),
) -> None:
    """Fit the noise coefficients of every axis to a log of a sensor at rest.

    The terms are Q quantisation, N random walk (two-sided: a data-sheet
    density is sqrt(2) N), B bias instability, K rate random walk and, with
    --terms, R ramp. Each has an interval, or an upper limit if not detected.
    """
    must_be_calibration(calibration, option="--calibration")
    must_exist(*also or (), option="--also")
    if compare:
        recording, screen = read_log(log, reading, "noise"), Screen(running.quiet)
        check_suited("noise", recording, log)
        for name, values in recording.channels().items():
            if name != "temperature":
                screen.lines([name, *str(jaxcal.noise.compare(values, recording.rate)).splitlines(), ""])
        screen.flush()
        return
    characterise(log, terms, confidence, band, reading, writing, running, method, calibration, also or (), conservative).end()


def characterise(
    path: Path, terms: str, confidence: float, band: tuple[float, float] | None, reading: Reading, writing: Writing, running: Running,
    method: str = "whittle", calibration: Path | None = None, also: tuple[Path, ...] = (), conservative: bool = False,
) -> Done:  # fmt: skip
    """Read, fit, print the tables and write. The recordings `also` are fitted too, for a table of the next recording.

    If `conservative`, files for other tools and the calibration hold upper bounds, which a table shows.
    """
    from .._answer import grid_lines
    from ..noise._overbound import conservative as bounded
    from ..noise._recordings import grids_of
    from ..noise._sections import grids

    chosen = tuple(terms.replace(",", "").upper())
    if not chosen or set(chosen) - set("QNBKRM") or len(set(chosen)) != len(chosen):
        raise CallError(f"--terms {terms}: expected letters of QNBKRM, each once, such as QNBK")
    if band is not None and not 0.0 < band[0] < band[1]:
        raise CallError(f"--band {band[0]:g} {band[1]:g}: expected the shortest and the longest cluster time in s, the shortest first")

    change = None if calibration is None else partial(corrected, calibration)
    options = {"terms": terms, "confidence": confidence, "band": band, "method": method, "calibration": calibration,
               "conservative": conservative}  # fmt: skip
    recordings: list[Any] = []

    def compute(log: Any, move: Any) -> Any:
        names = tuple("markov" if term == "M" else term for term in chosen)
        fit = partial(jaxcal.noise.characterise, method=method, terms=names, confidence=confidence, band=band, progress=move)
        recordings.append(fit(log))
        for other in also:
            log = read_log(other, reading, "noise")
            log = log if change is None else change(log)
            check_suited("noise", log, other)
            recordings.append(fit(log))
        return recordings[0]

    def of(write: Any) -> Any:
        return (lambda place, fits, *others, **more: write(place, bounded(fits), *others, **more)) if conservative else write

    export = of(partial(save_export, part="noise"))
    calibrated = ("", "calibration.json", of(partial(save_calibration, part="noise")))
    filtered = ("", "imu.yaml", tried(partial(export, format="kalibr"), jaxcal.ExportError))
    plan = standard(writing, "noise", path, calibrated, filtered, formats=_EXPORTS, export=export)
    done = carry_out(path, reading, running, plan, compute, change=change, command="noise", options=options)
    shown = grids_of(recordings, confidence) if also else []
    shown += grids(bounded(recordings[0]), "bound", "upper bound for a filter") if conservative else []
    done.screen.lines([line for grid in shown for line in ("", *grid_lines(grid, running.unit))])
    return done
