"""The folder of a run: a lock, one result file per log, and what is already there."""

import contextlib
import hashlib
import json
import os
import pathlib
import re
import threading
from collections.abc import Iterator
from typing import Any

from .._errors import DataError, ExportError
from ._answer import SCHEMA

_HELD: set[str] = set()  # folders that this process writes to: a lock of the system does not tell its threads apart everywhere
_GUARD = threading.Lock()


class Store:
    """Result files in `folder`/results, each whole or not there."""

    def __init__(self, folder: pathlib.Path) -> None:
        self.folder = folder
        self.results = folder / "results"

    def file_of(self, log: str | os.PathLike[str]) -> pathlib.Path:
        """The result file of a log: its name without anything that a file system could take amiss, and a part of its path's hash.

        Two logs of one name in different folders have a file each.
        """
        path = os.path.abspath(log)
        name = re.sub(r"[^A-Za-z0-9_-]+", "_", os.path.basename(path).rsplit(".", 1)[0]).strip("_")[:80] or "log"
        return self.results / f"{name}-{hashlib.sha256(os.fsencode(path)).hexdigest()[:10]}.json"

    def load(self, log: str | os.PathLike[str]) -> dict[str, Any] | None:
        """The result of a log; None where there is none, or the file is not one of ours."""
        try:
            document = json.loads(self.file_of(log).read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return None
        if not isinstance(document, dict) or document.get("schema") != SCHEMA or document.get("status") not in ("done", "failed"):
            return None
        return document

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Make the folders, and keep other runs out until the block ends. The lock goes with the process, however that ends.

        Raises
        ------
        DataError
            If another run writes here.
        ExportError
            If the folder cannot be made or written to.
        """
        try:
            self.results.mkdir(parents=True, exist_ok=True)
            handle = os.open(self.folder / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise ExportError(
                f"cannot write into {self.folder}: {reason}; make it writable, or give another folder for the results"
            ) from error
        key = os.path.realpath(self.folder)
        with _GUARD:
            taken = key in _HELD or not _locked(handle)
            if not taken:
                _HELD.add(key)
        if taken:
            os.close(handle)
            raise DataError(f"another run is writing into {self.folder}; wait until it ends, or give another folder for the results")
        try:
            for left in self.results.glob(".*.part"):  # of a run that was killed while it wrote
                with contextlib.suppress(OSError):
                    left.unlink()
            yield
        finally:
            with _GUARD:
                _HELD.discard(key)
            os.close(handle)


def _locked(handle: int) -> bool:
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        try:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # pyright: ignore[reportAttributeAccessIssue]
        except OSError:
            return False
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
