"""The steps of a command from a log to its files: read, compute, print the result, and write."""

import datetime
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from .._answer import NOTE, tables, things_to_know
from .._errors import DataError
from .._message import Message
from ._cache import keep_compiled
from ._options import Part, Running, read_log
from ._outputs import Outputs, replaceable, staged
from ._screen import Screen, progress, show_written


class Done(NamedTuple):
    """Data for the last lines of output: the log, the results, sentences from writing the files, and the files written."""

    running: Running
    screen: Screen
    log: Any
    found: Any
    said: list[Any]
    written: list[Path]

    def end(self) -> None:
        """Print the last lines of an answer: the three things that matter most, and the files."""
        more = "-v" + (", or the report" if any(path.name == "report.html" for path in self.written) else "")
        # how the log was read asks for no action: it stands in the report, and above the tables where it is a guess that matters
        read = [one for one in self.log.findings if self.running.verbose or one.severity > NOTE]
        self.screen.lines(things_to_know([*read, *self.found.findings, *self.said], more=more, **self.running.how))
        show_written(self.screen, self.written)
        self.screen.end()


def date_of(log: Any, path: Path) -> str:
    """Time when a log was recorded (UTC): from its time stamps, or else the modification time of its file."""
    from ..calibration import provenance

    return provenance(log, "").get("date") or f"{datetime.datetime.fromtimestamp(path.stat().st_mtime, datetime.UTC):%Y-%m-%dT%H:%M:%SZ}"


def carry_out(
    path: Path, reading: Part, running: Running, plan: Outputs, compute: Callable[[Any, Any], Any], *, command: str,
    options: Mapping[str, Any], doing: str = "fitting", change: Callable[[Any], Any] | None = None, read: Callable[[], Any] | None = None,
) -> Done:  # fmt: skip
    """Read the log at `path`, print what was read, compute, print the result, and write the files of `plan`: all of them or none.

    Parameters
    ----------
    path, reading, running, plan : the log, the options of the command, and its `outputs`.
    compute : (log, function that updates the progress bar) -> results, which are passed to the makers of the files.
    command, options : stored with the log, so that every file made from it names them and the versions.
    doing : word for the progress bar.
    change : function applied to the log before everything else.
    read : reads what the command takes in place of a log that suits it, with findings and provenance.

    What was read, the guesses that matter, the verdict and the tables are printed before the files are written, so that the user need not
    wait for them.

    Raises
    ------
    DataError
        If the result is refused, unless --force is given; its lines are printed, and nothing is written.
    """
    screen, (targets, folder) = Screen(running.quiet), plan
    with staged(targets, inputs=[path], folder=folder, force=running.force) as places:
        with progress(f"reading {path.name}", running.quiet):
            log = read_log(path, reading, command) if read is None else read()
            log = log if change is None else change(log)
            if read is None:
                check_suited(command, log, path)
            replaceable(targets, log.provenance.get("sha256") or "", force=running.force)
            log = log if not targets else _signed(path, log, command, reading, options)
        with progress(doing, running.quiet) as move:
            keep_compiled()
            found = compute(log, move)
        _show(screen, path, log, found, running)
        if not found.usable and not running.force:
            screen.lines(things_to_know(found.findings, **running.how))
            raise DataError("the result is refused, and nothing is written; the reason stands above", code="refused")
        screen.flush()
        with progress("writing", running.quiet):
            said = [sentence for target, make in targets.items() for sentence in make(places[target], found, log) or ()]
        written = [target for target, place in places.items() if place.exists()]
    return Done(running, screen, log, found, said, written)


def _show(screen: Screen, path: Path, log: Any, found: Any, running: Running) -> None:
    """Print what was read, and the first part of the answer."""
    screen.line(f"{path.name}: {log.head()}")
    if running.verbose:
        screen.line(log.summary())
    screen.lines(["", *tables(found.verdict, found.headline, found.sections(), [*log.findings, *found.findings], **running.how)])


def check_suited(command: str, log: Any, path: Path) -> None:
    """Refuse a log that does not suit the command, before any fit."""
    from ..io._suited import unsuited

    if wrong := unsuited(command, log, str(path)):
        raise DataError(Message("{name}: {why}", name=path.name or path, why=wrong), code="unsuited")


def _signed(path: Path, log: Any, command: str, reading: Part, options: Mapping[str, Any]) -> Any:
    """Add command, options, versions and date to the provenance of the log; without time stamps, the date is that of the file."""
    from ..calibration import provenance

    found = provenance(log, f"jaxcal {command}", {**reading.asked(), **options}, rate_given=reading.rate is not None)
    if "date" not in found:
        found |= {"date": date_of(log, path), "date_from": "time of the file"}
    return log._replaced(provenance=found)
