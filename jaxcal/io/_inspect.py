"""`inspect`: show what is in a log, how and why jaxcal would read it, and which commands suit it."""

import dataclasses
import os
import pathlib
from typing import Any

import numpy as np

from .._answer import Finding, Reader, plain
from .._answer._text import aligned, bullets, titled
from .._errors import JaxcalError
from .._files import shown
from ..evidence import Stretch
from ..evidence._findings import timeline
from ._names import parse
from ._read import asked, finished, named, opened
from ._suited import Suitability, ranked
from ._table import Choice, Table

#: descriptions of columns that are not read into a log
_KINDS = {
    "linear": "acceleration without gravity", "gravity": "gravity", "attitude": "an attitude", "motion": "a position or velocity",
    "counter": "a counter", "accel or linear": "acceleration, with or without gravity",
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Column:
    """One column: its number, its name, the meaning of its name, and the range of its values."""

    number: int
    name: str
    holds: str
    low: float | None
    high: float | None


@dataclasses.dataclass(frozen=True)
class Inspection:
    r"""Content of a log, and how `jaxcal.read` would read it.

    Attributes
    ----------
    file, format, size : name, format and number of bytes; format and size are None if unknown.
    columns : columns of a table.
    sources : topics or records of a recording of messages, with their counts and rates.
    choices : for every quantity the columns, unit, reason, whether there is evidence, and the options that change the choice.
    error : the error of reading the log with these options; None if it can be read. `refusal` is its sentence.
    samples, rate, duration : number of samples, Hz and s of the uniform grid; None if the log cannot be read.
    gaps, missing : number of gaps, and total number of missing samples.
    findings : what `jaxcal.read` says about the log: `Log.findings`.
    evidence : what in it is not the sensor under test: `Log.evidence`.
    commands : every command for a log, those that suit first: whether it suits, why, and the line to type.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxcal
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "log.csv")
    ...     _ = path.write_text("time [s],gyro_x [deg/s]\n" + "".join(f"{i / 10},{i % 3}\n" for i in range(50)))
    ...     found = jaxcal.io.inspect(path)
    >>> found.rate, [(one.quantity, one.unit) for one in found.choices]
    (10.0, [('time', 's'), ('gyro', 'deg/s')])
    """

    file: str
    format: str | None
    size: int | None
    columns: tuple[Column, ...]
    sources: tuple[str, ...]
    choices: tuple[Choice, ...]
    error: JaxcalError | None
    samples: int | None = None
    rate: float | None = None
    duration: float | None = None
    gaps: int | None = None
    missing: int | None = None
    findings: tuple[Finding, ...] = ()
    evidence: tuple[Stretch, ...] = ()
    commands: tuple[Suitability, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as a dictionary for JSON."""
        held = {field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.name != "error"}
        return {"schema": "jaxcal.info/1"} | plain(held | {"refusal": self.refusal})

    @property
    def refusal(self) -> str | None:
        """Why the log cannot be read with these options; None if it can."""
        return None if self.error is None else str(self.error)

    def summary(self, reader: Reader = "python", width: int = 100) -> str:
        """All of it as text: options as the reader types them, sentences in lines of at most `width` characters."""
        size = f", {self.size} bytes" if self.size is not None else ""
        lines = [f"{self.file}: {self.format or 'format not known'}{size}"]
        if self.rate is not None and self.duration is not None:
            gaps = f"{self.gaps} gaps, {self.missing} samples missing" if self.gaps else "no gaps"
            lines.append(f"{self.samples} samples at {self.rate:.6g} Hz, {self.duration:.6g} s, {gaps}")
        # options have lines of their own, so that they can be copied
        read = [line for one in self.choices for line in (
            *bullets([f"{one.quantity}: {', '.join(one.columns)} in {one.unit} ({'' if one.certain else 'a guess: '}{one.reason})"], width),
            f"     {one.option.spelt(reader)}",
        )]  # fmt: skip
        table = [("", "name", "holds", "least", "largest")]
        table += [
            (str(one.number), one.name, one.holds, *("" if x is None else f"{x:.6g}" for x in (one.low, one.high))) for one in self.columns
        ]
        # how each quantity is read stands above
        said = sorted((one for one in self.findings if one.code not in ("stated", "read_as", "assumed")), key=lambda one: -one.severity)
        refused = [self.refusal] if self.refusal and reader == "python" else []  # a command ends with the error
        others = (f"{one.command}: {one.reason}" for one in self.commands if not one.suits)
        for title, rows in (
            ("Not read", bullets(refused, width)), ("Read as", read), ("Columns", aligned(table if self.columns else [])),
            ("Topics", bullets(self.sources, width)), ("To know", bullets((one.spelt(reader) for one in said), width)),
            ("Not the sensor", bullets(timeline(self.evidence), width)),
            ("Commands that suit, the best first", [f"  {one.line}\n      {one.reason}" for one in self.commands if one.suits]),
            ("Other commands", bullets(others, width)),
        ):  # fmt: skip
            lines += titled(title, rows)
        return "\n".join(lines)

    def __repr__(self) -> str:
        return self.summary()


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def inspect(path: str | os.PathLike[str], **options: Any) -> Inspection:
    r"""Show what is in a log, how and why `jaxcal.read` would read it, and which commands suit it.

    A log that cannot be read raises no error: `refusal` gives the reason, and the result still has the columns or topics.

    Parameters
    ----------
    path : the log.
    options : those of `jaxcal.read`, except `quiet`.

    Returns
    -------
    Inspection
        Columns or topics, every choice with its reason and the option that changes it, rate, gaps, duration, warnings, and suitable
        commands. Use `summary()` for text and `to_dict()` for JSON.

    Raises
    ------
    DataError
        If an option is invalid.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxcal
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "log.csv")
    ...     _ = path.write_text("n,acc_x [g],acc_y [g],acc_z [g]\n" + "".join(f"{i},0,{i % 3 / 100},1\n" for i in range(50)))
    ...     found = jaxcal.io.inspect(path)
    ...     again = jaxcal.io.inspect(path, rate=50)
    >>> "n counts rows and is no time" in found.refusal
    True
    >>> again.rate, again.choices[0].quantity, again.choices[0].unit
    (50.0, 'accel', 'g')
    """
    path = pathlib.Path(path)
    given = asked(**options)
    held: list[Column] = []
    sources: tuple[str, ...] = ()
    origin: dict[str, Any] = {}
    choices: list[Choice] = []
    log, refused = None, None
    try:
        with named(path), opened(path, given) as (found, origin):
            held, sources = (_columns(found), ()) if isinstance(found, Table) else ([], tuple(found.sources))
            log = finished(found, origin, given, choices)
    except JaxcalError as error:
        refused = error
    known = (shown(path), origin.get("format"), origin.get("size"), tuple(held), sources, tuple(choices), refused)
    if log is None:
        return Inspection(*known)
    grid = len(log.time), log.rate, log.duration, len(log.gaps), sum(gap.samples for gap in log.gaps)
    return Inspection(*known, *grid, log.findings, log.evidence, ranked(log, os.fspath(path)))


def _columns(table: Table) -> list[Column]:
    found = []
    for number, (name, values) in enumerate(zip(table.names, table.columns, strict=True)):
        meaning = parse(name) if name else None
        holds = "numbers" if values.dtype.kind in "iufb" else "dates" if values.dtype.kind == "M" else "text"
        if number in table.clocks:
            holds = "times of day"
        if meaning is not None:
            what = _KINDS.get(meaning.kind, meaning.kind)
            unit = f" in {meaning.unit}" if meaning.unit and meaning.unit != "sampletimefine" else ""
            holds = f"{what}{' ' + meaning.axis if meaning.axis else ''}{unit}" + ("" if holds == "numbers" else f", as {holds}")
        low = high = None
        if values.dtype.kind in "iuf" and number not in table.clocks:
            finite = values[np.isfinite(values)]
            holds += "" if len(finite) else ", all missing"
            low, high = (float(finite.min()), float(finite.max())) if len(finite) else (None, None)
        found.append(Column(number, name, holds, low, high))
    return found
