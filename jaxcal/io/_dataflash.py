"""The structure of an ArduPilot DataFlash log, which describes itself: FMT records give the layout of all others.

Records are found in whole arrays: every place where the two bytes stand that begin a record is a candidate, and one is real where
the record before it ends. Only where that chain breaks (the same two bytes within a record, or damage) is it followed by hand.
"""

import dataclasses
import mmap
import pathlib

import numpy as np

from .._errors import DataError
from ._rows import gather

_HEAD = b"\xa3\x95"
_FMT, _FMT_LENGTH = 128, 89
_LETTERS = {
    "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8", "f": "<f4", "d": "<f8", "g": "<f2",
    "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4", "M": "u1", "n": "S4", "N": "S16", "Z": "S64", "a": ("<i2", (32,)),
}  # fmt: skip
#: letters whose value is stored times 100
HUNDREDTHS = "cCeE"
#: bytes looked at in one go
_BLOCK = 1 << 24


@dataclasses.dataclass
class Format:
    """Layout of one type of record: its number, `letters` of its fields, and where its records begin."""

    number: int
    name: str
    letters: dict[str, str]
    dtype: np.dtype
    offsets: np.ndarray


@dataclasses.dataclass
class DataFlash:
    """Types of records by name; `skipped` bytes belong to no record."""

    content: np.ndarray
    formats: dict[str, Format]
    skipped: int

    def rows(self, name: str) -> np.ndarray:
        """Records of one type as a structured array with the log's field names; values as stored."""
        form = self.formats[name]
        return gather(self.content, form.offsets, form.dtype)

    def count(self, name: str) -> int:
        """How many records of a type there are."""
        return len(self.formats[name].offsets) if name in self.formats else 0


def open_dataflash(path: pathlib.Path) -> DataFlash:
    """Find the records of a DataFlash log.

    Raises
    ------
    DataError
        If no record is described.
    """
    with path.open("rb") as file:
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    found = _formats(data)
    if not found:
        raise DataError("the log describes no records (no FMT); it is damaged, or not a DataFlash log: copy it again")
    lengths = np.zeros(256, np.int64)
    lengths[_FMT] = _FMT_LENGTH
    for form in found.values():
        lengths[form.number] = form.dtype.itemsize + 3
    content = np.frombuffer(data, np.uint8)
    places, kinds, skipped = _walk(content, lengths)
    for form in found.values():
        form.offsets = places[kinds == form.number] + 3
    return DataFlash(content, {form.name: form for form in found.values()}, skipped)


def _formats(data: mmap.mmap) -> dict[str, Format]:
    """Types of records, by the FMT records wherever they stand; the first of a number or a name holds."""
    found: dict[str, Format] = {}
    numbers = {_FMT}
    at = data.find(_HEAD + bytes([_FMT]))
    while 0 <= at <= len(data) - _FMT_LENGTH:
        body = data[at + 3 : at + _FMT_LENGTH]
        name, letters, labels = (part.rstrip(b"\0").decode("latin-1") for part in (body[2:6], body[6:22], body[22:86]))
        names = labels.split(",") if labels else []
        step = 1
        if len(names) == len(letters) == len(set(names)) and all(letter in _LETTERS for letter in letters) and all(names) and letters:
            dtype = np.dtype([(label, *_kind(letter)) for label, letter in zip(names, letters, strict=True)])
            if dtype.itemsize + 3 == body[1]:
                step = _FMT_LENGTH
                if body[0] not in numbers and name not in found and name.isalnum():
                    numbers.add(body[0])
                    found[name] = Format(body[0], name, dict(zip(names, letters, strict=True)), dtype, np.empty(0, np.int64))
        at = data.find(_HEAD + bytes([_FMT]), at + step)
    return found


def _kind(letter: str) -> tuple:
    kind = _LETTERS[letter]
    return kind if isinstance(kind, tuple) else (kind,)


def _walk(content: np.ndarray, lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Where records begin, their types, and how many bytes belong to none."""
    places, kinds = [np.empty(0, np.int64)], [np.empty(0, np.uint8)]
    due = taken = 0
    for begin in range(0, len(content), _BLOCK):
        block = content[begin : begin + _BLOCK + 2]
        at = np.flatnonzero((block[:-2] == _HEAD[0]) & (block[1:-1] == _HEAD[1]))
        kind = block[at + 2] if len(at) else np.empty(0, np.uint8)
        at = at + begin
        length = lengths[kind]
        known = (length > 0) & (at + length <= len(content)) & (at >= due)
        at, kind, length = at[known], kind[known], length[known]
        real, due = _chain(at, at + length, due)
        places.append(at[real])
        kinds.append(kind[real])
        taken += int(length[real].sum())
    return np.concatenate(places), np.concatenate(kinds), len(content) - taken


def _chain(at: np.ndarray, end: np.ndarray, due: int) -> tuple[np.ndarray, int]:
    """Which candidates begin a record: each begins where, or after, the one before it ends."""
    real = np.zeros(len(at), bool)
    breaks = [*np.flatnonzero(end[:-1] != at[1:]).tolist(), len(at) - 1]
    i = 0
    for stop in breaks:
        if stop < i:
            continue
        real[i : stop + 1] = True
        due = int(end[stop])
        i = int(np.searchsorted(at, due))
        if i >= len(at):
            break
    return real, due
