"""What a command prints: sentences and tables on standard output, progress on standard error."""

import contextlib
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

_WAIT = 1.0  # s of work before a progress bar appears


class Screen:
    """Standard output of one command; silent if `quiet`."""

    def __init__(self, quiet: bool = False):
        # sentences hold brackets and numbers of their own: no markup, no colouring by guess
        self._console = Console(markup=False, highlight=False, emoji=False)
        self._quiet = quiet
        self._gone: BrokenPipeError | None = None

    def line(self, text: str = "") -> None:
        """One sentence, wrapped."""
        self._print(text)

    def path(self, text: str) -> None:
        """A line that is never broken, so that a path in it can be copied."""
        self._print(text, soft_wrap=True)

    def sentences(self, title: str, sentences: Iterable[str]) -> None:
        """A title and a bullet for every sentence; nothing where there is none."""
        bullets = Table.grid(padding=(0, 1))
        for sentence in dict.fromkeys(sentences):
            bullets.add_row(" -", sentence)
        if bullets.rows:
            self._print()
            self._print(title, style="bold")
            self._print(bullets)

    def table(self, title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
        """A table whose cells may hold several lines; set to the left, so that the lines of a cell stay together."""
        table = Table(box=None, pad_edge=False, padding=(0, 3, 0, 0), header_style="bold")
        for name in header:
            table.add_column(name, overflow="fold")
        for row in rows:
            table.add_row(*row)
        self._print()
        self._print(title, style="bold")
        self._print(table)

    def flush(self) -> None:
        """Hand on what was printed, so that it is read while the command goes on; who reads may have gone: the files still come."""
        try:
            self._console.file.flush()
        except BrokenPipeError as error:
            self._gone = error

    def end(self) -> None:
        """Complain at last that nobody read on, as `jaxcal noise LOG | head` does."""
        if self._gone is not None:
            raise self._gone

    def _print(self, *what: Any, **how: Any) -> None:
        if self._quiet or self._gone is not None:
            return
        with self._console.capture() as captured:
            self._console.print(*what, **how)
        text = captured.get()
        if not self._console.is_terminal:  # what fills a column is of no use in a file
            text = "\n".join(line.rstrip() for line in text.split("\n"))
        try:
            self._console.file.write(text)
        except BrokenPipeError as error:
            self._gone = error


@contextlib.contextmanager
def progress(what: str, quiet: bool = False) -> Iterator[Callable[[int, int, str], None]]:
    """A bar on standard error for work that takes more than a second, on a terminal only.

    Yields a function (done, total, name) that moves the bar.
    """
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield lambda done, total, name: None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    bar = Progress(
        TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), console=console, transient=True,
        redirect_stdout=False, redirect_stderr=False,
    )  # fmt: skip
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


def show_log(screen: Screen, log: Any) -> None:
    """What was read, and what was guessed about it."""
    screen.line(log.summary())
    screen.sentences("How it was read", log.notes)


def show_written(screen: Screen, written: Sequence[Path]) -> None:
    """The files that a command wrote."""
    if written:
        screen.line()
    for path in written:
        screen.path(f"wrote {path}")
