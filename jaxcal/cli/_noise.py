"""`jaxcal noise`: noise coefficients of every axis of a static log."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from ._apply import corrected
from ._cache import ahead, keep_compiled
from ._export import FILES
from ._options import WRITING, CallError, Reading, Running, read_log, stem
from ._outputs import Maker, Outputs, exports, outputs, save_json, save_picture, save_report, staged
from ._screen import Screen, progress, show_log, show_written
from ._tables import by_channel, decides, left_out, longer_record, noise_tables

_METHODS = ("whittle", "gls", "edf", "wavelet")
#: format of --export -> name of the file where none is given
_EXPORTS = {name: FILES[name] for name in ("kalibr", "openvins", "vins", "orbslam3", "gtsam", "ros", "csv")}


@Parameter(name="*", group=WRITING)
@dataclass(frozen=True, kw_only=True)
class Writing:
    """Where results go. Without any of these, into the folder LOG-noise, all of them.

    Attributes
    ----------
    out
        Folder for the files, made if it is missing.
    json
        Coefficients, intervals and verdicts as JSON, in SI units.
    report
        Report as one HTML file.
    export
        File for another tool: kalibr, openvins, vins, orbslam3, gtsam, ros or csv, or kalibr=FILE. Repeatable.
    """

    out: Path | None = None
    json: Path | None = None
    report: Path | None = None
    export: Annotated[tuple[str, ...] | None, Parameter(name="--export")] = None


def noise(
    log: Path,
    /,
    *,
    terms: str = "QNBK",
    confidence: float = 0.95,
    band: tuple[float, float] | None = None,
    method: str = "whittle",
    calibration: Path | None = None,
    reading: Reading = Reading(),
    writing: Writing = Writing(),
    running: Running = Running(),
) -> None:
    """Noise coefficients of every axis, from a log of a sensor at rest.

    Q quantisation, N random walk (two-sided: a data-sheet density is
    sqrt(2) N), B bias instability, K rate random walk and, if asked for,
    R ramp: with intervals, and an upper limit where a term is not there.

    Parameters
    ----------
    log
        The log: CSV, NPZ, Parquet, ROS bag.
    terms
        Terms to fit, as letters of QNBKRM; M is a Gauss-Markov process.
    confidence
        Level of the intervals and limits.
    band
        Shortest and longest cluster time to use, in s; by default those at which the model holds.
    method
        How to fit: whittle, or on the Allan variance gls, edf or wavelet.
    calibration
        Calibration of the device as JSON, from another recording: the log is corrected with it before the fit.
    """
    if method not in _METHODS:
        raise CallError(f"--method {method}: expected one of {', '.join(_METHODS)}")
    if calibration is not None and not calibration.exists():
        raise CallError(f"--calibration {calibration} does not exist")
    characterise(log, terms, confidence, band, reading, writing, running, method=method, calibration=calibration)


def characterise(
    path: Path,
    terms: str,
    confidence: float,
    band: tuple[float, float] | None,
    reading: Reading,
    writing: Writing,
    running: Running,
    truth: dict[str, Any] | None = None,
    method: str = "whittle",
    calibration: Path | None = None,
) -> dict[str, Any]:
    """Read, fit, write and print; `truth` (sensor -> `Noise`) is compared where a log was simulated. Gives the fits."""
    chosen = _terms(terms)
    _check(confidence, band)
    plan, folder = _outputs(path, writing)
    screen = Screen(running.quiet)
    with staged(plan, inputs=[path], folder=folder) as places:
        with progress(f"reading {path.name}", running.quiet):
            log = read_log(path, reading)
            log = log if calibration is None else corrected(calibration, log)
            options = {"terms": terms, "confidence": confidence, "band": band, "method": method, "calibration": calibration}
            from ._provenance import signed

            log = signed(log, "jaxcal noise", reading, options)
        show_log(screen, log)
        with progress("fitting", running.quiet) as move:
            keep_compiled()
            import jaxcal

            fit = jaxcal.noise.characterise
            ahead("jaxcal.report", "matplotlib.backends.backend_svg", "matplotlib.backends.backend_agg")
            fits = fit(log, method=method, terms=chosen, confidence=confidence, band=band, progress=move)
            said = [sentence for target, make in plan.items() for sentence in make(places[target], fits, log)]
        written = [target for target, place in places.items() if place.exists()]
    noise_tables(screen, fits, truth)
    screen.sentences("Record length at which a term is known to 10 %, worst axis", longer_record(fits))
    screen.sentences("Record length that would decide on a term not detected", decides(fits))
    screen.sentences("Left out of the fit", left_out(fits))
    screen.sentences("Warnings", [*log.warnings, *by_channel({channel: fit.warnings for channel, fit in fits.items()}), *said])
    screen.sentences("Notes", by_channel({channel: fit.notes for channel, fit in fits.items()}))
    show_written(screen, written)
    return fits


def _terms(text: str) -> tuple[str, ...]:
    terms = tuple(text.replace(",", "").upper())
    if not terms or set(terms) - set("QNBKRM") or len(set(terms)) != len(terms):
        raise CallError(f"--terms {text}: expected letters of QNBKRM, each once, such as QNBK")
    return tuple("markov" if term == "M" else term for term in terms)


def _check(confidence: float, band: tuple[float, float] | None) -> None:
    if not 0.0 < confidence < 1.0:
        raise CallError(f"--confidence {confidence:g}: expected a level between 0 and 1; 0.95 is 95 %")
    if band is not None and not 0.0 < band[0] < band[1]:
        raise CallError(f"--band {band[0]:g} {band[1]:g}: expected the shortest and the longest cluster time in s, the shortest first")


def _outputs(path: Path, writing: Writing) -> Outputs:
    names: dict[str, Maker] = {
        "allan.png": partial(save_picture, draw="allan"), "report.html": save_report, "noise.json": save_json,
        "calibration.json": _calibration, "imu.yaml": _kalibr_if_possible,
    }  # fmt: skip
    asked = [(writing.json, save_json), (writing.report, save_report), *exports(writing.export, _EXPORTS, _export, writing.out)]
    return outputs(asked, names, out=writing.out, default=f"{stem(path)}-noise")


def _calibration(place: Path, fits: dict[str, Any], log: Any) -> Sequence[str]:
    _device(fits, log).save(place)
    return ()


def _kalibr_if_possible(place: Path, fits: dict[str, Any], log: Any) -> Sequence[str]:
    import jaxcal

    try:
        return _export(place, fits, log, "kalibr")
    except jaxcal.ExportError as error:
        return (f"{place.name} is not written: {error}",)


def _export(place: Path, fits: dict[str, Any], log: Any, format: str) -> Sequence[str]:
    import jaxcal

    # a filter needs some noise and some random walk: where none was found the upper limit is safe, and file and warning say so
    said = jaxcal.export.write(_device(fits, log), place, format=format, density="upper_limit", random_walk="upper_limit")
    return [f"{place.name}: {sentence}" for sentence in said]


def _device(fits: dict[str, Any], log: Any) -> Any:
    import jaxcal

    return jaxcal.Calibration(noise=fits, provenance=log.provenance)
