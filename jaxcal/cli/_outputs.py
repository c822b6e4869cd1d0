"""Output files of a command: checked before the work, and there all together or not at all."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from .._files import json_text, write_atomically
from ._options import CallError, distinct

#: (place to write to, results, log) -> sentences to tell
Maker = Callable[[Path, Any, Any], Sequence[str]]
#: target -> what makes it, and the folder that may have to be made
Outputs = tuple[dict[Path, Maker], Path | None]
PICTURES = (".png", ".svg", ".pdf")


def outputs(
    asked: Iterable[tuple[Path | None, Maker]], names: dict[str, Maker] | None = None, *, out: Path | None = None, default: str = ""
) -> Outputs:
    """What was asked for; where nothing was, all `names` in the folder `out`, or `default`."""
    wanted = [(target, make) for target, make in asked if target is not None]
    if wanted or names is None:
        return distinct(wanted), out
    folder = out or Path(default)
    return {folder / name: make for name, make in names.items()}, folder


def exports(
    words: Iterable[str] | None, known: dict[str, str], make: Callable[..., Sequence[str]], out: Path | None
) -> list[tuple[Path, Maker]]:
    """Targets of --export FORMAT or FORMAT=FILE; `known` has the name of the file where none is given."""
    asked = []
    for word in words or ():
        format, _, file = word.partition("=")
        if format not in known:
            raise CallError(f"--export {word}: unknown format {format!r}; expected one of {', '.join(known)}")
        asked.append((Path(file) if file else (out or Path()) / known[format], partial(make, format=format)))
    return asked


def check_picture(option: str, target: Path | None) -> None:
    """Raise a `CallError` unless the name of a figure has a known ending."""
    if target is not None and target.suffix.lower() not in PICTURES:
        raise CallError(f"{option} {target}: expected a name that ends in {', '.join(PICTURES)}")


def save_picture(place: Path, results: Any, log: Any, *, draw: str) -> Sequence[str]:
    """The figure of `jaxcal.plot` named `draw`; what forbids drawing it is told."""
    import jaxcal

    try:
        axes = getattr(jaxcal.plot, draw)(results)
    except jaxcal.DataError as error:
        return (f"{place.name} is not written: {error}",)
    jaxcal.plot.save(axes, place)
    return ()


def save_report(place: Path, results: Any, log: Any) -> Sequence[str]:
    """The HTML page."""
    import jaxcal

    jaxcal.report.write(results, place, log=log)
    return ()


def save_json(place: Path, results: Any, log: Any) -> Sequence[str]:
    """The JSON document."""
    import jaxcal

    write_atomically(place, json_text(jaxcal.report.document(results, log)))
    return ()


@contextlib.contextmanager
def staged(targets: Iterable[Path], *, inputs: Iterable[Path] = (), folder: Path | None = None) -> Iterator[dict[Path, Path]]:
    """Give a place to write to for every target; what was written there takes the target's name when the block ends well.

    The place is a hidden folder next to the target, so that entering the block proves that the folder can be written, and
    a failure, or an interruption, removes every trace. A target that was not written is left out.

    Parameters
    ----------
    targets : files to write, each once.
    inputs : files that must not be overwritten.
    folder : a folder to create if it is missing; other folders must exist.

    Raises
    ------
    CallError
        If a target is a folder or an input, or its folder is missing or cannot be written.
    """
    targets = list(targets)
    _check(targets, inputs)
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


def _check(targets: list[Path], inputs: Iterable[Path]) -> None:
    read = {path.resolve() for path in inputs}
    for target in targets:
        final = target.resolve()
        if final in read:
            raise CallError(f"{target} is the log that is read; it would be overwritten. Give another name for the output")
        if target.is_dir():
            raise CallError(f"{target} is a folder; give the name of a file in it")


def _create(folder: Path, cleanup: contextlib.ExitStack) -> None:
    """Make `folder` and its parents; those made here vanish again if they stay empty."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    for path in reversed(missing):
        try:
            path.mkdir()
        except OSError as error:
            raise CallError(f"cannot make the folder {path}: {_reason(error)}; give another with --out") from error
        cleanup.callback(_remove_if_empty, path)


def _room(parent: Path, cleanup: contextlib.ExitStack) -> Path:
    try:
        room = tempfile.mkdtemp(prefix=".jaxcal-", dir=parent)
    except OSError as error:
        raise CallError(f"cannot write into {parent}: {_reason(error)}; give a path in another folder") from error
    cleanup.callback(shutil.rmtree, room, ignore_errors=True)
    return Path(room)


def _remove_if_empty(folder: Path) -> None:
    with contextlib.suppress(OSError):
        folder.rmdir()


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
