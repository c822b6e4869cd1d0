"""Zip files: NumPy arrays, workbooks, and packed logs."""

import contextlib
import pathlib
import re
import shutil
import tempfile
import zipfile
from collections.abc import Iterator

from .._errors import DataError
from .._files import clear_hidden, hidden_name
from ._readers._bounds import BLOCK, FREE_TEXT, MOST, allowed, check_declared


def zip_kind(path: pathlib.Path) -> str:
    """Return the format npz or xlsx, or zip for packed logs."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, NotImplementedError, OSError, UnicodeError, ValueError):
        return "npz"  # a damaged file, which its reader will report
    if {"xl/workbook.xml", "xl/workbook.bin"} & set(names) or {"content.xml", "mimetype"} <= set(names):
        return "xlsx"
    return "npz" if not names or all(name.endswith(".npy") for name in names) or path.suffix.lower() == ".npz" else "zip"


@contextlib.contextmanager
def unpacked(path: pathlib.Path) -> Iterator[pathlib.Path]:
    """Unpack the logs of a zip file into a temporary folder, with a limit on the total size."""
    size = path.stat().st_size
    with zipfile.ZipFile(path) as archive, _room() as folder:
        members = [one for one in archive.infolist() if not one.is_dir() and _wanted(one.filename)]
        if len(members) > MOST:
            raise DataError(f"the zip file holds {len(members)} files, as no log does; unpack it and give one log", code="not_a_log")
        if any(one.flag_bits & 1 for one in members):
            raise DataError("the zip file is encrypted; unpack it with its password and give the log in it", code="not_a_log")
        check_declared(sum(one.file_size for one in members), size, "the zip file", FREE_TEXT)
        room = allowed(size, FREE_TEXT)
        for member in members:
            place = folder / (re.sub(r"[^\w.() +-]", "_", pathlib.PurePosixPath(member.filename).name)[-120:] or "log")
            if place.exists():
                place = place.with_name(f"{members.index(member)}_{place.name}")
            with archive.open(member) as source, place.open("wb") as target:
                while piece := source.read(BLOCK):
                    room -= len(piece)
                    check_declared(0 if room >= 0 else allowed(size) + 1, size, "the zip file", FREE_TEXT)
                    target.write(piece)
        if not members:
            raise DataError("the zip file holds no file; unpack it, and look", code="not_a_log")
        yield folder


@contextlib.contextmanager
def _room() -> Iterator[pathlib.Path]:
    """Make a temporary folder, after removing the folders of killed runs."""
    above = pathlib.Path(tempfile.gettempdir())
    clear_hidden(above)
    room = above / hidden_name()
    room.mkdir(0o700)
    try:
        yield room
    finally:
        shutil.rmtree(room, ignore_errors=True)


def _wanted(name: str) -> bool:
    return not pathlib.PurePosixPath(name).name.startswith(".") and "__MACOSX/" not in name
