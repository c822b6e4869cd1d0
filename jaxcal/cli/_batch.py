"""`jaxcal batch`: run one task on many logs."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

import jaxcal

from .._answer._text import aligned, bullets, titled
from ._cache import keep_compiled
from ._options import RUNNING, CallError, Config, Part, Quiet, checked
from ._screen import Screen, progress, show_written

Task = Literal["noise", "mag", "imu", "temperature", "allan"]
_ROWS = 40  # largest number of rows of a printed table; the files have all rows


def _positive(name: str, help: str) -> Parameter:
    """Parameter of a number above zero."""
    return checked(f"--{name}", lambda value: value > 0, "a number above 0", help)


@Parameter(name="*", group=RUNNING)
@dataclass(frozen=True, kw_only=True)
class FleetRunning:
    """How the command runs."""

    workers: Annotated[int | None, _positive("workers", "Processes; by default one for each core.")] = None
    timeout: Annotated[float | None, _positive("timeout", "Seconds after which a log is given up; by default 900, and 10 a MB.")] = None
    memory: Annotated[float | None, _positive("memory", "GB beyond which a log is given up; by default equal shares.")] = None
    each: Annotated[
        bool, Parameter(help="A result for every IMU of a log that holds several (ULog, DataFlash, bags, HDF5), not only for the first.")
    ] = False
    reports: Annotated[bool, Parameter(help="Write a page for each log beside its result file.")] = False
    again: Annotated[bool, Parameter(help="Compute every log anew, also those that are done.")] = False
    quiet: Quiet = False
    config: Config = None


def batch(
    *paths: Annotated[Path, Parameter(help='Logs, folders of logs, and patterns such as "logs/*.csv".')],
    task: Annotated[Task, Parameter(help="What to do with each: noise, mag, imu, temperature or allan.")] = "noise",
    out: Annotated[Path, Parameter(help="Folder for the results, made if it is missing.")],
    option: Annotated[
        tuple[str, ...] | None,
        Parameter(name="--set", help="Option of the task, NAME=VALUE, as terms=QNBKR, gravity=9.8123 or kind=mdev. Repeatable."),
    ] = None,
    reading: Part = Part(),
    running: FleetRunning = FleetRunning(),
) -> None:
    """Run one task on many logs in parallel; after an interruption, rerun to resume.

    A log that fails is reported and does not stop the others. The folder --out
    gets a result file for each log, manifest.json, summary.csv (and .parquet),
    and overview.html with the spread of every coefficient, outliers and trends.
    The status is 1 only if no log gave a result.
    """
    from jaxcal.batch._paths import find_logs
    from jaxcal.batch._tasks import check_task, reading_options

    if not paths:
        raise CallError("batch needs logs, such as a folder: jaxcal batch logs/ --task noise --out fleet")
    if out.resolve() in [path.resolve() for path in paths]:
        raise CallError(f"--out {out} is the folder of the logs; the results need one of their own: --out fleet")
    if out.exists() and not out.is_dir():
        raise CallError(f"--out {out}: this is a file; give a folder")
    above = next((folder for folder in (out.absolute(), *out.absolute().parents) if folder.exists()), out)
    if not os.access(above, os.W_OK | os.X_OK) or not above.is_dir():
        raise CallError(f"--out {out}: cannot write into {above}; give another folder")
    options, known = _options(option), {name: _joined(value) for name, value in reading.asked().items()}
    try:
        check_task(task, options)
        reading_options(known)
    except jaxcal.DataError as error:  # nothing was read yet
        raise CallError(error.args[0], error.code) from error
    logs, unreadable = find_logs(list(paths), out)
    if not any(os.path.lexists(path) for path in [*logs, *unreadable]):
        raise CallError(f"there are no logs at {', '.join(map(str, paths))}")
    screen = Screen(running.quiet)
    keep_compiled()
    with progress(f"{task} of", running.quiet) as move:
        fleet = jaxcal.batch.run(
            list(paths), task, out=out, resume=not running.again, workers=running.workers, options=options, reading=known,
            timeout=running.timeout, memory=None if running.memory is None else 1e9 * running.memory, progress=move, each=running.each,
            reports=running.reports,
        )  # fmt: skip
    _show(screen, fleet, running.reports)
    if not fleet.done:
        raise jaxcal.DataError(
            f"none of {_logs(len(fleet))} could be answered; the first: {fleet.failed[0].typed or fleet.failed[0].reason}"
        )


def _options(words: tuple[str, ...] | None) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for word in words or ():
        name, equals, text = word.partition("=")
        if not equals or not name:
            raise CallError(f"--set {word}: expected NAME=VALUE, such as confidence=0.9")
        try:
            found[name] = json.loads(text)
        except ValueError:
            found[name] = text  # a word
    return found


def _joined(value: Any) -> Any:
    return ",".join(value) if isinstance(value, tuple) else value


def _show(screen: Screen, fleet: Any, reports: bool) -> None:
    """Print the table of the fleet, outliers and trends, and failures."""
    kept = sum(entry.kept for entry in fleet)
    there = f"; {kept} of them were there already" if kept else ""
    screen.line(f"{_logs(len(fleet))}: {len(fleet.done)} answered, {len(fleet.failed)} not{there}")
    rows: list[tuple[str, ...]] = [("", "unit", "logs", "median", "95 %")]
    rows += [(name, unit, str(count), f"{median:.3g}", f"{high:.3g}") for name, unit, count, median, high in fleet.for_filters]
    screen.lines(titled("for a filter (SI), the worst axis of each log", aligned(rows)) if rows[1:] else [])
    shown = {name: one for name, one in fleet.spread.items() if one.count >= min(2, len(fleet.done))}
    rows = [("", "unit", "logs", "median", "5 %", "95 %", "out")] if shown else []
    for name, one in list(shown.items())[:_ROWS]:
        values = (f"{value:.4g}" for value in (one.median, one.low, one.high))
        rows.append((name, one.unit, str(one.count), *values, str(len(one.outliers) or "")))
    left = f"; {_ROWS} of {len(shown)} coefficients" if len(shown) > _ROWS else ""
    screen.lines(titled(f"spread over the logs{left}", aligned(rows)))
    outliers = sorted((outlier for one in shown.values() for outlier in one.outliers), key=lambda found: -abs(found.score))
    for title, said in (
        ("Outliers", [f"{found.name}: {found.reason}" for found in outliers]),
        ("Trends", [trend.reason for one in shown.values() for trend in one.trends]),
        ("Not answered", [entry.typed or entry.reason for entry in fleet.failed]),
    ):
        screen.lines(titled(title, bullets(_first(list(dict.fromkeys(said))))))
    written = [fleet.out / name for name in ("overview.html", "summary.csv", "summary.parquet", "manifest.json")]
    show_written(screen, [path for path in written if path.exists()])
    what = "a result file and a page" if reports else "a result file"
    screen.lines([f"and {what} for each log in {fleet.out / 'results'}"])


def _logs(number: int) -> str:
    return f"{number} log{'s' * (number != 1)}"


def _first(sentences: list[str], most: int = 12) -> list[str]:
    return sentences[:most] + ([f"and {len(sentences) - most} more, in the overview"] if len(sentences) > most else [])
