"""`jaxcal info`: show what is in a log, and how jaxcal reads it."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import jaxcal

from .._files import json_text, write_atomically
from ._options import WRITING, Log, Plain, Reading, must_be_log, reading_options
from ._outputs import staged
from ._readings import holds_positions
from ._screen import Screen, progress, show_written


@Parameter(name="*", group=WRITING)
@dataclass(frozen=True, kw_only=True)
class InfoFiles:
    """Where the result goes."""

    json: Annotated[Path | None, Parameter(help="All of it as JSON.")] = None


def info(log: Log, /, *, files: InfoFiles = InfoFiles(), reading: Reading = Reading(), running: Plain = Plain()) -> None:
    """Show what is in a log, how it is read and why, and which commands suit it.

    Every choice is shown with the options that change it. Try these options
    here, then give them to the other commands. The status is 1 if the log
    cannot be read with them.
    """
    must_be_log(log, "info")
    screen = Screen(running.quiet)
    targets = [files.json] if files.json else []
    if not log.is_dir() and holds_positions(log, sure=True):
        screen.line(f"{log.name}: a table of readings on a turntable, one row for each position")
        screen.path(f"Commands that suit, the best first\n  jaxcal north {shlex.quote(str(log))}")
        return
    with staged(targets, inputs=[log], force=running.force) as places:
        with progress(f"reading {log.name}", running.quiet):
            found = jaxcal.io.inspect(log, **reading_options(reading))
        if files.json:
            write_atomically(places[files.json], json_text(found.to_dict()))
    _show(screen, found)
    show_written(screen, targets)
    if found.error is not None:
        raise found.error


def _show(screen: Screen, found: Any) -> None:
    size = f", {found.size} bytes" if found.size is not None else ""
    screen.path(f"{found.file}: {found.format or 'format not known'}{size}")
    if found.rate is not None:
        gaps = f"{found.gaps} gaps, {found.missing} samples missing" if found.gaps else "no gaps"
        screen.line(f"{found.samples} samples at {found.rate:.6g} Hz, {found.duration:.6g} s, {gaps}")
    screen.sentences("Read as", [
        f"{one.quantity}: {', '.join(one.columns)} in {one.unit} ({one.reason if one.certain else f'a guess: {one.reason}'}); "
        + one.option.spelt("terminal") for one in found.choices
    ])  # fmt: skip
    if found.columns:
        rows = [[str(one.number), one.name, one.holds, *("" if value is None else f"{value:.6g}" for value in (one.low, one.high))]
                for one in found.columns]  # fmt: skip
        screen.table("Columns", ["", "name", "holds", "least", "largest"], rows)
    screen.sentences("Topics", found.sources)
    # how each quantity is read stands above
    said = [one for one in found.findings if one.code not in ("read_as", "assumed")]
    screen.sentences("To know", [one.spelt("terminal") for one in sorted(said, key=lambda one: -one.severity)])
    from ..evidence._findings import timeline  # with NumPy, which the help does not need

    screen.sentences("Not the sensor", timeline(found.evidence))
    suited = [one for one in found.commands if one.suits]
    if suited:
        screen.line()
        screen.path("Commands that suit, the best first")
    for one in suited:
        screen.path(f"  {one.line}")
        screen.path(f"      {one.reason}")
    screen.sentences("Other commands", [f"{one.command}: {one.reason}" for one in found.commands if not one.suits])
