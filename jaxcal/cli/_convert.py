"""`jaxcal convert`: a log as .npz or Parquet, read back at once."""

from pathlib import Path

from ._options import CallError, Reading, Running, read_log
from ._outputs import staged
from ._screen import Screen, progress, show_log, show_written


def convert(
    log: Path,
    out: Path,
    /,
    *,
    reading: Reading = Reading(),
    running: Running = Running(),
) -> None:
    """Write a log as .npz or Parquet, in SI units, so that reading it again takes no time and no guess.

    Parameters
    ----------
    log
        Any log that can be read.
    out
        File to write: FILE.npz or FILE.parquet.
    """
    from ..io._convert import SUFFIXES, save

    if out.suffix not in SUFFIXES:
        raise CallError(f"{out}: expected a name that ends in {' or '.join(SUFFIXES)}")
    screen = Screen(running.quiet)
    with staged([out], inputs=[log]) as places:
        with progress(f"reading {log.name}", running.quiet):
            recording = read_log(log, reading)
        with progress(f"writing {out.name}", running.quiet):
            save(recording, places[out])
    show_log(screen, recording)
    screen.sentences("Warnings", recording.warnings)
    show_written(screen, [out])
