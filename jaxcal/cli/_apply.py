"""`jaxcal apply`: a log without the errors that a calibration knows."""

from pathlib import Path
from typing import Any

from ._options import CallError, Reading, Running, read_log
from ._outputs import staged
from ._screen import Screen, progress, show_log, show_written
from ._simulate import SUFFIXES, save_log


def apply(
    calibration: Path,
    log: Path,
    /,
    *,
    out: Path,
    reading: Reading = Reading(),
    running: Running = Running(),
) -> None:
    """Correct a log with a calibration: temperature first, then bias, scale factor, misalignment, iron.

    Parameters
    ----------
    calibration
        Calibration as JSON, as the other commands write it.
    log
        The log of the same device.
    out
        File to write: FILE.csv or FILE.npz, in SI units; missing samples stay missing.
    """
    if out.suffix not in SUFFIXES:
        raise CallError(f"--out {out}: expected a name that ends in {' or '.join(SUFFIXES)}")
    if not calibration.exists():
        raise CallError(f"{calibration} does not exist")
    screen = Screen(running.quiet)
    with staged([out], inputs=[log, calibration]) as places:
        with progress(f"reading {log.name}", running.quiet):
            recording = read_log(log, reading)
        with progress("correcting", running.quiet):
            found = corrected(calibration, recording)
            sensors = {name: value for name in ("gyro", "accel", "mag", "temperature") if (value := getattr(found, name)) is not None}
            save_log(places[out], found.time, sensors)
    show_log(screen, found)
    screen.sentences("Warnings", found.warnings)
    show_written(screen, [out])


def corrected(path: Path, log: Any) -> Any:
    """The log, corrected with the calibration at `path`."""
    import jaxcal

    return jaxcal.Calibration.load(path).correct(log)
