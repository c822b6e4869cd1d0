"""`inspect`: show what is in a log, how and why jaxcal would read it, and which commands suit it."""

import dataclasses
import os
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._errors import DataError, JaxcalError
from .._files import shown
from .._log import Log
from .._results import plain
from ._columns import parse_columns, parse_topics, parse_units
from ._names import parse
from ._read import finished, named, opened
from ._table import Choice, Table

_MOST = 60
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
class Suitability:
    """Whether a command suits the log, and why."""

    command: str
    suits: bool
    reason: str


@dataclasses.dataclass(frozen=True)
class Inspection:
    r"""Content of a log, and how `jaxcal.read` would read it.

    Attributes
    ----------
    file, format, size : name, format and number of bytes; format and size are None if unknown.
    columns : columns of a table.
    sources : topics or records of a recording of messages, with their counts and rates.
    choices : for every quantity the columns, unit, reason, whether there is evidence, and the options that change the choice.
    refusal : why the log cannot be read with these options; None if it can.
    samples, rate, duration : number of samples, Hz and s of the uniform grid; None if the log cannot be read.
    gaps, missing : number of gaps, and total number of missing samples.
    notes, warnings : notes and warnings of `jaxcal.read`.
    commands : for each command, whether it suits the log, and why.

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
    refusal: str | None
    samples: int | None
    rate: float | None
    duration: float | None
    gaps: int | None
    missing: int | None
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    commands: tuple[Suitability, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as a dictionary for JSON."""
        return {"schema": "jaxcal.info/1"} | plain(dataclasses.asdict(self))

    def summary(self) -> str:
        """Return all fields as lines of text."""
        head = f"{self.file}: {self.format or 'not known'}" + (f", {self.size} bytes" if self.size is not None else "")
        lines = [head]
        if self.rate is not None and self.duration is not None:
            gaps = f"{self.gaps} gaps, {self.missing} samples missing" if self.gaps else "no gaps"
            lines.append(f"{self.samples} samples at {self.rate:.6g} Hz, {self.duration:.6g} s, {gaps}")
        if self.refusal:
            lines.append(f"not read: {self.refusal}")
        for choice in self.choices:
            sure = "" if choice.certain else "a guess: "
            lines.append(
                f"{choice.quantity}: {', '.join(choice.columns)} in {choice.unit} ({sure}{choice.reason}); change it with {choice.option}"
            )
        for column in self.columns:
            values = "" if column.low is None else f", {column.low:.6g} to {column.high:.6g}"
            lines.append(f"column {column.number} ({column.name or 'no name'}): {column.holds}{values}")
        lines += [f"source: {source}" for source in self.sources]
        lines += [f"warning: {warning}" for warning in self.warnings]
        lines += [f"{'suits' if one.suits else 'does not suit'} {one.command}: {one.reason}" for one in self.commands]
        return "\n".join(lines)

    def __repr__(self) -> str:
        return self.summary()


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def inspect(
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    columns: Mapping[str, Any] | str | None = None,
    units: Mapping[str, Any] | str | None = None,
    rate: float | int | None = None,
    topics: Sequence[str] | str | None = None,
    raw: bool = False,
    data: str = "rate",
    missing: float | int | None = None,
) -> Inspection:
    r"""Show what is in a log, how and why `jaxcal.read` would read it, and which commands suit it.

    A log that cannot be read raises no error: `refusal` gives the reason, and the result still has the columns or topics.

    Parameters
    ----------
    path, format, columns, units, rate, topics, raw, data, missing : see `jaxcal.read`.

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
    if data not in ("rate", "phase"):
        raise DataError(f'data={data!r}: expected "rate" or "phase"')
    options = {"columns": parse_columns(columns), "units": parse_units(units), "rate": rate, "missing": missing}
    wanted = parse_topics(topics)
    held: list[Column] = []
    sources: tuple[str, ...] = ()
    origin: dict[str, Any] = {}
    choices: list[Choice] = []
    log, refusal = None, None
    try:
        with named(path), opened(path, format, options, wanted, raw) as (found, origin):
            if isinstance(found, Table):
                held = _columns(found)
            else:
                sources = tuple(found.sources)
            log = finished(found, origin, options, data == "phase", choices)
    except JaxcalError as error:
        refusal = str(error)
    known: dict[str, Any] = dict.fromkeys(("samples", "rate", "duration", "gaps", "missing"))
    if log is not None:
        lost = sum(gap.samples for gap in log.gaps)
        known = {"samples": len(log.time), "rate": log.rate, "duration": log.duration, "gaps": len(log.gaps), "missing": lost}
    return Inspection(
        file=shown(path), format=origin.get("format"), size=origin.get("size"), columns=tuple(held), sources=sources,
        choices=tuple(choices), refusal=refusal, notes=() if log is None else log.notes, warnings=() if log is None else log.warnings,
        commands=() if log is None else tuple(_suitable(log)), **known,
    )  # fmt: skip


def _columns(table: Table) -> list[Column]:
    found = []
    for number, (name, values) in enumerate(zip(table.names[:_MOST], table.columns, strict=False)):
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


def _suitable(log: Log) -> list[Suitability]:
    """Judge which commands suit a log, by its sensors, its length, and the share of it that is still."""
    inertial = [name for name in ("gyro", "accel") if getattr(log, name) is not None]
    still = _still(log)
    found = []
    if inertial or log.mag is not None:
        names = " and ".join(inertial) or "mag"
        rests = f"{100 * still:.0f} % of it is still" if still is not None else "whether it is still is not known"
        enough = log.duration >= 60 and (still is None or still > 0.9)
        found.append(
            Suitability(
                "jaxcal noise", enough, f"{names} for {log.duration:.4g} s, and {rests}; it needs a minute or more of a sensor at rest"
            )
        )
    if log.accel is not None and log.accel.shape[1] == 3:
        poses = _poses(log)
        found.append(Suitability("jaxcal imu", poses >= 9, f"{poses} different attitudes at rest; it needs nine or more"))
    if log.mag is not None and log.mag.shape[1] == 3:
        seen = log.mag[np.isfinite(log.mag).all(axis=1)]
        sizes = np.linalg.svd(seen - seen.mean(axis=0), compute_uv=False) / np.sqrt(max(len(seen), 1)) if len(seen) > 10 else np.zeros(3)
        turned = bool(sizes[-1] > 0.1 * np.median(np.linalg.norm(seen, axis=1))) if len(seen) > 10 else False
        reason = (
            "the field is seen from all sides" if turned else "the field is seen from few sides; it needs the sensor turned about all axes"
        )
        found.append(Suitability("jaxcal mag", turned, reason))
    if log.temperature is not None:
        span = float(np.nanmax(log.temperature) - np.nanmin(log.temperature))
        suits = span >= 5 and bool(inertial)
        found.append(Suitability("jaxcal temperature", suits, f"the temperature moves by {span:.3g} degC; it needs 5 degC or more"))
    return found


def _blocks(log: Log) -> tuple[np.ndarray, np.ndarray] | None:
    """Means of the accelerometer over one second each, and whether the sensor was still in it."""
    if log.accel is None or log.accel.shape[1] != 3:
        return None
    width = max(4, round(log.rate))
    count = len(log.accel) // width
    if count < 2:
        return None
    blocks = np.asarray(log.accel)[: count * width].reshape(count, width, 3)
    whole = np.isfinite(blocks).all(axis=(1, 2))
    if not whole.any():
        return None
    means, scatter = blocks[whole].mean(axis=1), np.linalg.norm(blocks[whole].std(axis=1), axis=1)
    quiet = scatter < max(3.0 * float(np.quantile(scatter, 0.1)), 0.05)
    steps = np.linalg.norm(np.diff(means, axis=0), axis=1)
    moved = np.concatenate([[False], steps > 0.3]) | np.concatenate([steps > 0.3, [False]])
    return means, quiet & ~moved


def _still(log: Log) -> float | None:
    blocks = _blocks(log)
    return None if blocks is None else float(np.mean(blocks[1]))


def _poses(log: Log) -> int:
    """Number of attitudes at rest that differ by 15 degrees or more."""
    blocks = _blocks(log)
    if blocks is None:
        return 0
    means, still = blocks
    found: list[np.ndarray] = []
    for mean in means[still][:20_000]:
        direction = mean / np.linalg.norm(mean)
        if len(found) < 50 and all(float(direction @ other) < np.cos(np.radians(15)) for other in found):
            found.append(direction)
    return len(found)
