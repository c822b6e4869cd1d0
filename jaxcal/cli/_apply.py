"""`jaxcal apply` and `jaxcal convert`: correct a log with a calibration, or write it in a layout that is read quickly."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import jaxcal

from .._answer import things_to_know
from ._advice import kind_of
from ._options import CallError, Part, Plain, log_file, must_be_calibration, read_log
from ._outputs import staged
from ._readings import column_of
from ._screen import Screen, progress, show_written
from ._simulate import save_log
from ._work import date_of


def apply(
    calibration: Annotated[Path, Parameter(help="Calibration as JSON, as the other commands write it; or a folder of them, with --name.")],
    log: Annotated[Path, Parameter(help="The log of the same device.")],
    /,
    *,
    out: Annotated[Path, log_file(help="File to write: FILE.csv or FILE.npz, in SI units; missing samples stay missing.")],
    name: Annotated[
        str | None, Parameter(help="Device whose latest calibration, not younger than the log, is taken from the folder.")
    ] = None,
    currents: Annotated[
        str | None, Parameter(help="Columns of the currents whose fields the calibration has, by the names that jaxcal mag got: I1,I2.")
    ] = None,
    reading: Part = Part(),
    running: Plain = Plain(),
) -> None:
    """Correct a log with a calibration: temperature first, then bias, scale factor, misalignment, iron."""
    if kind_of(log) == "calibration" and kind_of(calibration) != "calibration":
        raise CallError(f"the calibration comes first: jaxcal apply {log} {calibration} --out {out}")
    if calibration.is_dir() != (name is not None):
        raise CallError(
            f"{calibration} is a folder; give the calibration in it, or --name NAME to choose the calibration of a device"
            if name is None
            else f"--name goes with a folder of calibrations; {calibration} is none"
        )
    if name is None:
        must_be_calibration(calibration)

    def write(recording: Any, place: Path) -> Any:
        chosen = calibration if name is None else jaxcal.calibration.find(calibration, name, date_of(recording, log))
        names = [one.strip() for one in currents.split(",")] if currents else []
        given = {one: column_of(log, reading, one, len(recording.time), None) for one in names}
        found = corrected(chosen, recording, given)
        save_sensors(found, place)
        return found

    _rewrite([log, calibration], out, "correcting", write, reading, running, "apply")


def convert(
    log: Annotated[Path, Parameter(help="Any log that can be read.")],
    out: Annotated[Path, Parameter(help="File to write: FILE.npz or FILE.parquet.")],
    /,
    *,
    reading: Part = Part(),
    running: Plain = Plain(),
) -> None:
    """Write a log as .npz or Parquet in SI units, so that it can be read quickly and without inference."""
    from ..io._saved import SUFFIXES, save

    if out.exists() and not log.exists():
        raise CallError(f"{log} does not exist; the log comes first: jaxcal convert {out} {log}")
    if out.suffix not in SUFFIXES:
        raise CallError(f"{out}: expected a name that ends in {' or '.join(SUFFIXES)}")

    def write(recording: Any, place: Path) -> Any:
        save(recording, place)
        return recording

    _rewrite([log], out, f"writing {out.name}", write, reading, running, "convert")


def _rewrite(
    inputs: list[Path], out: Path, doing: str, write: Callable[[Any, Path], Any], reading: Part, running: Plain, command: str
) -> None:
    """Read the first of `inputs`, rewrite it, and print a summary."""
    screen = Screen(running.quiet)
    with staged([out], inputs=inputs, force=running.force) as places:
        with progress(f"reading {inputs[0].name}", running.quiet):
            recording = read_log(inputs[0], reading, command)
        with progress(doing, running.quiet):
            written = write(recording, places[out])
    screen.line(written.summary())
    screen.lines(things_to_know(written.findings, reader="terminal", verbose=True))
    show_written(screen, [out])


def corrected(calibration: Path, log: Any, currents: dict[str, Any] | None = None) -> Any:
    """Correct the log with the calibration in a file."""
    return jaxcal.Calibration.load(calibration).correct(log, currents=currents)


def save_sensors(log: Any, place: Path) -> None:
    """Write the sensors of a log as CSV or NPZ."""
    names = ("gyro", "accel", "mag", "temperature")
    save_log(place, log.time, {name: values for name in names if (values := getattr(log, name)) is not None})
