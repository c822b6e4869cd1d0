"""`jaxcal info`: show what is in a log, and how jaxcal reads it."""

import shlex
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import jaxcal

from .._files import json_text, write_atomically
from ._options import WRITING, Log, Plain, Source, must_be_log, reading_options
from ._outputs import staged
from ._readings import holds_positions
from ._screen import Screen, progress, show_written


def info(
    log: Log,
    /,
    *,
    json: Annotated[Path | None, Parameter(group=WRITING, help="All of it as JSON.")] = None,
    reading: Source = Source(),
    running: Plain = Plain(),
) -> None:
    """Show what is in a log, how it is read and why, and which commands suit it.

    Every choice is shown with the options that change it. Try these options
    here, then give them to the other commands. The status is 1 if the log
    cannot be read with them.
    """
    must_be_log(log, "info")
    screen = Screen(running.quiet)
    targets = [json] if json else []
    if not log.is_dir() and holds_positions(log, sure=True):
        screen.line(f"{log.name}: a table of readings on a turntable, one row for each position")
        screen.lines(["Commands that suit, the best first", f"  jaxcal north {shlex.quote(str(log))} --latitude ..."])
        return
    with staged(targets, inputs=[log], force=running.force) as places:
        with progress(f"reading {log.name}", running.quiet):
            found = jaxcal.io.inspect(log, **reading_options(reading))
        if json:
            write_atomically(places[json], json_text(found.to_dict()))
    screen.lines(found.summary("terminal", 80).splitlines())
    show_written(screen, targets)
    if found.error is not None:
        raise found.error
