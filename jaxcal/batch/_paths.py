"""Find the logs of a run: files, folders and patterns, each log once, in natural order."""

import glob
import os
import pathlib
import re
from collections.abc import Iterable
from typing import Any

from .._errors import DataError

#: endings of the log files that are taken from a folder
SUFFIXES = (
    ".csv", ".txt", ".tsv", ".dat", ".log", ".gz", ".npy", ".npz", ".parquet", ".bag", ".db3", ".mcap",
    ".ulg", ".bin", ".mat", ".h5", ".hdf5", ".xlsx", ".xls", ".ods", ".tdms", ".lvm",
)  # fmt: skip
_MANIFEST = "manifest.json"
_MAGIC = re.compile(r"[*?\[]")


def find_logs(paths: Any, out: pathlib.Path | None = None) -> tuple[list[pathlib.Path], dict[pathlib.Path, str]]:
    """The logs at `paths`, each once and in natural order, and the folders that cannot be listed, with the reason.

    `paths` is one path or a list of files, folders with all logs in them (a folder with a metadata.yaml is a ROS 2 recording), and
    patterns. A file that does not exist is kept: the run reports it. Folders of results, such as `out`, are left out.
    """
    given = [paths] if isinstance(paths, str | os.PathLike) else list(paths) if isinstance(paths, Iterable) else [paths]
    if not all(isinstance(path, str | os.PathLike) for path in given):
        raise DataError(f"expected a path, or a list of paths, folders and patterns; got {paths!r}", code="paths")
    found: dict[str, pathlib.Path] = {}
    unreadable: dict[pathlib.Path, str] = {}
    own = None if out is None else os.path.abspath(out)
    for word in map(os.fspath, given):
        matches = sorted(glob.glob(word, recursive=True)) if _MAGIC.search(word) and not os.path.exists(word) else [word]
        for match in map(pathlib.Path, matches):
            for log in _in_folder(match, own, unreadable) if match.is_dir() else [match]:
                found.setdefault(os.path.realpath(log), log)
    return sorted(found.values(), key=natural), unreadable


def natural(path: pathlib.Path) -> list[Any]:
    """Sorting key that puts unit9 before unit10."""
    pieces = re.split(r"(\d+)", os.fspath(path))
    # numbers stand at odd positions, so that numbers are compared with numbers
    return [(int(piece), piece) if i % 2 else piece.casefold() for i, piece in enumerate(pieces)]


def _in_folder(folder: pathlib.Path, own: str | None, unreadable: dict[pathlib.Path, str]) -> list[pathlib.Path]:
    logs: list[pathlib.Path] = []

    def refused(error: OSError) -> None:
        unreadable[pathlib.Path(error.filename)] = (error.strerror or str(error)).lower()

    for here, folders, files in os.walk(folder, onerror=refused):
        if os.path.abspath(here) == own or _MANIFEST in files:
            folders.clear()
        elif "metadata.yaml" in files:
            folders.clear()
            logs.append(pathlib.Path(here))
        else:
            folders[:] = [name for name in folders if not name.startswith(".")]
            logs += [pathlib.Path(here, name) for name in files if name.lower().endswith(SUFFIXES) and not name.startswith(".")]
    return logs
