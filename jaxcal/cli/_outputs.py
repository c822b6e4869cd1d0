"""Output files of a command: their makers, checks before the work starts, and writing of all files or none."""

import contextlib
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import jaxcal

from .._answer import NOTE, Kind, table
from .._files import check_replaceable, clear_hidden, hidden_name
from ._options import CallError, folder

FINDINGS = table(
    read_so=Kind(NOTE, "{said}"),
    no_times=Kind(NOTE, "{said}"),
    not_written=Kind(NOTE, "{file} is not written: {reason}"),
)
#: (place to write to, results, log) -> sentences to print, if any
Maker = Callable[[Path, Any, Any], Sequence[Any] | None]
#: option and name in the output folder ("" for none), and the maker of the file
File = tuple[str, str, Maker]
#: target -> its maker, and the folder to create if it is missing
Outputs = tuple[dict[Path, Maker], Path | None]


def outputs(
    writing: Any, files: Sequence[File], default: str = "", *, formats: Mapping[str, str] | None = None,
    export: Callable[..., Sequence[str] | None] | None = None,
) -> Outputs:  # fmt: skip
    """The files to write: the requested ones, or all in one folder.

    Parameters
    ----------
    writing : options of the command: those named in `files`, and --out and --export if the command has them.
    files : all files that the command can write. A file without a name in the folder is written only on request, in addition to others.
    default : name of the folder if --out is not given; "" for no folder.
    formats, export : format of --export -> name of its file, and the maker, which also gets format=.
    """
    out = getattr(writing, "out", None)
    given = [(getattr(writing, option, None), name, make) for option, name, make in files if option]
    asked = [(target, make) for target, name, make in given if target is not None and name]
    beside = [(target, make) for target, name, make in given if target is not None and not name]
    for word in getattr(writing, "export", None) or ():
        format, _, file = word.partition("=")
        if formats is None or export is None or format not in formats:
            raise CallError(f"--export {word}: unknown format {format!r}; expected one of {', '.join(formats or ())}", "export")
        asked.append((Path(file) if file else (out or Path()) / formats[format], partial(export, format=format)))
    if not asked and (out or default):
        out = out or Path(default)
        asked = [(out / name, make) for _, name, make in files if name]
    wanted = [*asked, *beside]
    if len({target.resolve() for target, _ in wanted}) < len(wanted):
        raise CallError("two outputs have the same file name; give each a name of its own", "same_file")
    return dict(wanted), out


def standard(
    writing: Any, name: str, log: Path, *further: File, part: str = "", device: Any = None, default: str | None = None,
    formats: Mapping[str, str] | None = None, export: Callable[..., Any] | None = None, readings: Callable[[Any, Any], Any] | None = None,
) -> Outputs:  # fmt: skip
    """The `outputs` of every fit: its picture, report and JSON, and `further` files; for a `part` of a calibration this, and its exports.

    name : of the command, for its files and its folder beside `log`.
    readings : (results, log) -> readings that the picture needs beside the results.
    """
    files = [("plot", "", figure(readings)), ("report", "report.html", save_report), ("json", f"{name.replace('-', '_')}.json", save_json)]
    if part:
        files.append(("calibration", "calibration.json", partial(save_calibration, part=part, device=device)))
        export = partial(save_export, part=part, device=device)
    default = (folder(log, name) if hasattr(writing, "out") else "") if default is None else default
    return outputs(writing, [*files, *further], default, formats=formats, export=export)


def tried(make: Maker, error: type[jaxcal.JaxcalError] = jaxcal.DataError) -> Maker:
    """Wrap a maker, so that `error` gives a sentence on the missing file instead of a failure of the command."""

    def attempt(place: Path, results: Any, log: Any) -> Sequence[Any] | None:
        try:
            return make(place, results, log)
        except error as reason:
            return (FINDINGS("not_written", file=place.name, reason=reason.spelt("terminal")),)

    return attempt


def figure(readings: Callable[[Any, Any], Any] | None = None) -> Maker:
    """Maker of the picture of the results, which may need readings. If it cannot be drawn, the reason is printed."""

    def make(place: Path, results: Any, log: Any) -> None:
        jaxcal.plot.save(results.plot(*([] if readings is None else [readings(results, log)])), place)

    return tried(make)


def save_report(place: Path, results: Any, log: Any) -> None:
    """Write the HTML page, which spells options as the command line does."""
    jaxcal.report.write(results, place, log=log, reader="terminal")


def save_json(place: Path, results: Any, log: Any) -> None:
    """Write the JSON document."""
    results.save(place, log)


def save_calibration(place: Path, results: Any, log: Any, *, part: str, device: Any = None) -> None:
    """Write the results as the `part` of a calibration."""
    jaxcal.Calibration(**{part: results}, device=device, provenance=log.provenance).save(place)


def save_export(place: Path, results: Any, log: Any, format: str, *, part: str, device: Any = None) -> list[Any]:
    """Write the results as the `part` of a calibration, in the format of another tool."""
    made = jaxcal.Calibration(**{part: results}, device=device, provenance=log.provenance)
    return [one.of(place.name, *one.subject) for one in jaxcal.export.write(made, place, format=format, force=True)]


@contextlib.contextmanager
def staged(
    targets: Iterable[Path], *, inputs: Iterable[Path] = (), folder: Path | None = None, force: bool = False
) -> Iterator[dict[Path, Path]]:
    """Yield a temporary path for every target; after the block, the files written there are renamed to the targets.

    The paths are in a hidden folder next to the target. Entering the block therefore proves that the folder can be written, and after a
    failure or an interruption nothing remains. Targets that were not written are ignored.

    Parameters
    ----------
    targets : files to write, each once.
    inputs : files that must not be overwritten.
    folder : a folder to create if it is missing; other folders must exist.
    force : replace files that jaxcal did not write.

    Raises
    ------
    CallError
        If a target is a folder, an input, or a file that jaxcal did not write, or its folder is missing or cannot be written.
    """
    targets = list(targets)
    _check(targets, inputs)
    replaceable(targets, force=force)
    with contextlib.ExitStack() as cleanup:
        if folder is not None:
            _create(folder, cleanup)
        rooms: dict[Path, Path] = {}
        places = {}
        for target in targets:
            if target.exists() and not target.is_file():  # a device or a pipe, such as /dev/stdout
                places[target] = target
                continue
            parent = target.resolve().parent
            if parent not in rooms:
                rooms[parent] = _room(parent, cleanup)
            places[target] = rooms[parent] / target.name
        yield places
        for target, place in places.items():
            if place != target and place.exists():
                os.replace(place, target.resolve())


def replaceable(targets: Iterable[Path], digest: str = "", *, force: bool = False) -> None:
    """Raise a `CallError` for a file that jaxcal did not write, or wrote for a log with another SHA-256, unless `force`."""
    for target in targets:
        try:
            check_replaceable(target, digest, force=force)
        except jaxcal.ExportError as error:
            raise CallError(error.args[0], error.code) from None


def _check(targets: list[Path], inputs: Iterable[Path]) -> None:
    read = {path.resolve() for path in inputs}
    for target in targets:
        final = target.resolve()
        if final in read:
            raise CallError(f"{target} is the log that is read; it would be overwritten. Give another name for the output", "is_input")
        if target.is_dir():
            raise CallError(f"{target} is a folder; give the name of a file in it", "is_folder")


def _create(folder: Path, cleanup: contextlib.ExitStack) -> None:
    """Create `folder` and its parents; afterwards, remove those created here if they are still empty."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    for path in reversed(missing):
        try:
            path.mkdir()
        except OSError as error:
            raise CallError(f"cannot make the folder {path}: {_reason(error)}; give another with --out", "no_folder") from error
        cleanup.callback(_remove_if_empty, path)


def _room(parent: Path, cleanup: contextlib.ExitStack) -> Path:
    clear_hidden(parent)
    room = parent / hidden_name()
    try:
        room.mkdir(0o700)
    except OSError as error:
        raise CallError(f"cannot write into {parent}: {_reason(error)}; give a path in another folder", "not_writable") from error
    cleanup.callback(shutil.rmtree, room, ignore_errors=True)
    return room


def _remove_if_empty(folder: Path) -> None:
    with contextlib.suppress(OSError):
        folder.rmdir()


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
