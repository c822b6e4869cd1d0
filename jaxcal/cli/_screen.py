"""Output of a command: sentences and tables on standard output, progress on standard error."""

import contextlib
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from .._message import printable

_WAIT = 1.0  # s until a progress bar appears


class _Pipe(Console):
    """A console that leaves it to the command what a closed pipe means; rich would end the command before its files are written."""

    def on_broken_pipe(self) -> None:
        raise  # the error that is being handled


class Screen:
    """Standard output of one command; silent if `quiet`."""

    def __init__(self, quiet: bool = False):
        # sentences contain brackets and numbers, so switch off markup and automatic colours
        self._console = _Pipe(markup=False, highlight=False, emoji=False)
        self._quiet = quiet
        self._gone: BrokenPipeError | None = None
        self._begun = False

    def line(self, text: str = "") -> None:
        """Print one sentence, wrapped."""
        self._print(text)

    def lines(self, lines: Iterable[str]) -> None:
        """Print lines as they are, without breaking them, so that a path in them can be copied."""
        for line in lines:
            self._print(line, soft_wrap=True)

    def flush(self) -> None:
        """Flush the output, so that it can be read while the command continues; a closed pipe does not stop the files."""
        try:
            self._console.file.flush()
        except BrokenPipeError as error:
            self._gone = error

    def end(self) -> None:
        """Raise the error of a closed pipe, if any, at the end of the command, as with `jaxcal noise LOG | head`."""
        if self._gone is not None:
            raise self._gone

    def _print(self, *what: Any, **how: Any) -> None:
        if self._quiet or self._gone is not None or not (self._begun or any(what)):
            return  # an answer begins without a blank line
        self._begun = True
        what = tuple("\n".join(map(printable, one.split("\n"))) if isinstance(one, str) else one for one in what)
        try:
            with self._console.capture() as captured:
                self._console.print(*what, **how)
            text = captured.get()
            if not self._console.is_terminal:  # remove trailing blanks in a file
                text = "\n".join(line.rstrip() for line in text.split("\n"))
            self._console.file.write(text)
        except BrokenPipeError as error:
            self._gone = error


@contextlib.contextmanager
def progress(what: str, quiet: bool = False) -> Iterator[Callable[[int, int, str], None]]:
    """Show a progress bar on standard error for work of more than a second, on a terminal only.

    Yields a function (done, total, name) that updates the bar.
    """
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield lambda done, total, name: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    bar = Progress(*columns, console=console, transient=True, redirect_stdout=False, redirect_stderr=False)
    task = bar.add_task(what, total=None)
    timer = threading.Timer(_WAIT, bar.start)
    timer.daemon = True
    timer.start()

    def move(done: int, total: int, name: str) -> None:
        bar.update(task, completed=done, total=total, description=f"{what} {name}" if name else "writing")

    try:
        yield move
    finally:
        timer.cancel()
        timer.join()
        bar.stop()


def show_written(screen: Screen, written: Sequence[Path]) -> None:
    """Print the files that a command wrote: one line for each folder, which no terminal breaks."""
    folders: dict[Path, list[str]] = {}
    for path in written:
        folders.setdefault(path.parent, []).append(path.name)
    if written:
        screen.line()
    for folder, names in folders.items():
        several = len(names) > 1 and folder != Path()
        screen.lines([f"wrote {folder}/: {', '.join(names)}" if several else f"wrote {', '.join(str(folder / name) for name in names)}"])
