"""`Fleet`: what a run found out about its logs."""

import dataclasses
import json
import pathlib
from collections.abc import Iterator
from typing import Any

from ._coefficients import Coefficient


@dataclasses.dataclass(frozen=True)
class Entry:
    """One log of a run.

    Attributes
    ----------
    path : the log.
    status : "done" or "failed".
    reason : of a failure, a sentence; otherwise None.
    again : whether the reason may be gone the next time.
    coefficients : name -> `Coefficient`.
    warnings : sentences.
    sha256 : of the log; None where it could not be read.
    date : when it was recorded (ISO 8601), by its stamps, or by the time of its file; None where it could not be read.
    seconds : of computation; None where there was none.
    kept : whether the result was there already.
    file : result file; None without a folder.
    """

    path: pathlib.Path
    status: str
    reason: str | None
    again: bool
    coefficients: dict[str, Coefficient]
    warnings: tuple[str, ...]
    sha256: str | None
    date: str | None
    seconds: float | None
    file: pathlib.Path | None
    kept: bool = False
    _text: str | None = dataclasses.field(default=None, repr=False)

    @property
    def document(self) -> dict[str, Any]:
        """The whole result, as its file has it: `result` holds what the task found."""
        text = self._text if self.file is None else self.file.read_text(encoding="utf-8")
        assert text is not None  # without a file the text is kept
        return json.loads(text)


@dataclasses.dataclass(frozen=True)
class Fleet:
    """The logs of a run, in natural order of their names.

    Attributes
    ----------
    entries : one `Entry` for each log.
    spread : name of a coefficient -> `Spread` over the logs.
    out : folder of the results, or None.
    """

    entries: tuple[Entry, ...]
    spread: dict[str, Any]
    out: pathlib.Path | None

    def __len__(self) -> int:
        return len(self.entries)

    def __iter__(self) -> Iterator[Entry]:
        return iter(self.entries)

    @property
    def done(self) -> tuple[Entry, ...]:
        """The logs that were answered."""
        return tuple(entry for entry in self.entries if entry.status == "done")

    @property
    def failed(self) -> tuple[Entry, ...]:
        """The logs that were not, each with its reason."""
        return tuple(entry for entry in self.entries if entry.status == "failed")
