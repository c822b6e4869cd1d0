"""Parse the structure of a PX4 ULog: https://docs.px4.io/main/en/dev_log/ulog_file_format.html.

The parser walks over the messages once and records their offsets; the numbers are then read from the file as arrays. The time is
proportional to the length of the file, whatever its content: after damage the walk continues at the next synchronisation mark of the
logger, and no length stated in the file is trusted. (pyulog, which reads the same files, tries again at every byte.)
"""

import array
import dataclasses
import itertools
import mmap
import pathlib
import re
import struct
from typing import Any

import numpy as np

from ..._answer import Finding
from ..._errors import DataError
from .._findings import READ
from ._bounds import MOST, PIECE
from ._streams import gather

_MAGIC = b"ULog\x01\x12\x35"
_SYNC = b"\x2f\x73\x13\x20\x25\x0c\xbb\x12"
_KNOWN = frozenset(b"BFIMPQARDLCSO")
_TYPES = {
    "int8_t": "i1", "uint8_t": "u1", "int16_t": "<i2", "uint16_t": "<u2", "int32_t": "<i4", "uint32_t": "<u4", "int64_t": "<i8",
    "uint64_t": "<u8", "float": "<f4", "double": "<f8", "bool": "u1", "char": "S1",
}  # fmt: skip
_FIELD = re.compile(r"([A-Za-z_][\w-]*)(?:\[(\d{1,5})\])? ([A-Za-z_]\w*)")


@dataclasses.dataclass
class Topic:
    """One instance of a topic: layout and offsets of its rows."""

    name: str
    instance: int
    dtype: np.dtype
    offsets: np.ndarray

    @property
    def label(self) -> str:
        """Name, as in `topics=`."""
        return f"{self.name}:{self.instance}"

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the columns."""
        return self.dtype.names or ()


class ULog:
    """A parsed ULog.

    `topics` are the `wanted` topics that have rows, `others` the names of the other topics, `dropouts` the lengths in ms of the logger's
    dropouts.
    """

    def __init__(self, path: pathlib.Path, wanted: frozenset[str]):
        with path.open("rb") as file:
            data = self._data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        if len(data) < 16 or data[: len(_MAGIC)] != _MAGIC:
            raise DataError("the header of the ULog is cut off; copy the file again", code="damaged")
        self.others: set[str] = set()
        self.dropouts: list[int] = []
        self.findings: list[Finding] = []
        self._wanted, self._formats, self._stops = wanted, dict[str, str](), list[int]()
        # offsets of the rows by topic and instance; the same lists by subscription number
        self._rows: dict[tuple[str, int], array.array] = {}
        self._places: list[array.array | None] = [None] * 65536
        self._skipped = 0
        self._span(16, len(data), True)
        # data appended by a crash dump begin at listed offsets, and the message before such an offset may be cut off
        for begin, end in itertools.pairwise([*self._stops, len(data)]):
            self._span(begin, end, False)
        self._content = np.frombuffer(data, np.uint8)
        self.topics = [topic for key, place in sorted(self._rows.items()) if len((topic := self._topic(*key, place)).offsets)]
        if self._skipped:
            self.findings.append(READ("damaged", what=f"{self._skipped} bytes are no messages and are left out"))

    def rows(self, topic: Topic, fields: list[str]) -> dict[str, np.ndarray]:
        """Columns of a topic by name; missing columns are left out."""
        kept = [name for name in fields if name in topic.fields]
        rows = gather(self._content, topic.offsets, topic.dtype[kept])
        return {name: rows[name] for name in kept}

    def _topic(self, name: str, instance: int, place: array.array) -> Topic:
        dtype, padding = layout(name, self._formats)
        offsets = np.frombuffer(place, np.int64)  # without a copy: in a long log there is no memory for two
        whole = np.empty(len(offsets), bool)
        for start in range(0, len(offsets), PIECE):
            piece = offsets[start : start + PIECE]
            size = self._content[piece].astype(np.int64) + (self._content[piece + 1].astype(np.int64) << 8) - 2
            # the padding at the end of a row is optional
            whole[start : start + PIECE] = (size >= dtype.itemsize) & (size <= dtype.itemsize + padding)
        if not whole.all():
            what = f"{np.count_nonzero(~whole)} rows have the wrong length and are left out"
            self.findings.append(READ("damaged", f"{name}:{instance}", what=what))
            offsets = offsets[whole]
        offsets += 5
        return Topic(name, instance, dtype, offsets)

    def _span(self, i: int, end: int, first: bool) -> None:
        data, places = self._data, self._places
        while i + 3 <= end:
            size = data[i] | data[i + 1] << 8
            kind = data[i + 2]
            after = i + 3 + size
            if after > end or kind not in _KNOWN:
                if after > end and kind in _KNOWN and data.find(_SYNC, i, end) < 0:
                    break  # the last message is cut off, as after every power-off
                found = data.find(_SYNC, i + 1, end)
                self._skipped += (end if found < 0 else found) - i
                if found < 0:
                    break
                i = found + len(_SYNC)
                continue
            if kind == 68:  # D, data
                if size >= 2:
                    place = places[data[i + 3] | data[i + 4] << 8]
                    if place is not None:
                        place.append(i)
            else:
                self._other(kind, data[i + 3 : after])
                if first and self._stops:
                    end = self._stops[0]
                    first = False
            i = after

    def _other(self, kind: int, body: bytes) -> None:
        if kind == 70:  # F, format
            name, colon, fields = body.decode("latin-1").partition(":")
            if colon:
                self._formats.setdefault(name, fields)
        elif kind == 65 and len(body) >= 3:  # A, subscription
            name, number = body[3:].decode("latin-1"), body[1] | body[2] << 8
            self._places[number] = None
            if name in self._wanted:
                self._places[number] = self._rows.setdefault((name, body[0]), array.array("q"))
            else:
                self.others.add(name)
        elif kind == 82 and len(body) >= 2:  # R, end of a subscription
            self._places[body[0] | body[1] << 8] = None
        elif kind == 79 and len(body) == 2:  # O, dropout in ms
            self.dropouts.append(body[0] | body[1] << 8)
        elif kind == 66 and len(body) >= 40:  # B, flags
            if any(body[9:16]) or body[8] & ~1:
                raise DataError("this ULog uses features that are not known here; convert it with `ulog2csv` of pyulog", code="damaged")
            if body[8] & 1:
                self._stops = sorted({stop for stop in struct.unpack("<3Q", body[16:40]) if 16 < stop < len(self._data)})


def layout(name: str, formats: dict[str, str]) -> tuple[np.dtype, int]:
    """Layout of the rows of a topic, and the number of padding bytes that may follow; nested types are expanded."""
    fields: list[tuple[Any, ...]] = []
    visits = itertools.count()

    def add(name: str, prefix: str, depth: int) -> None:
        if name not in formats or depth > 8 or next(visits) > MOST:
            raise DataError(f"the ULog does not say what {name} holds; it is damaged: copy it again", code="damaged")
        for word in formats[name].split(";"):
            match = _FIELD.fullmatch(word.strip())
            if match is None:
                if word.strip():
                    raise DataError(f"the ULog's description of {name} is damaged ({word[:40]!r}): copy the file again", code="damaged")
                continue
            kind, count, field = match[1], int(match[2] or 0), prefix + match[3]
            if kind in _TYPES:
                fields.append((field, _TYPES[kind], (count,)) if count else (field, _TYPES[kind]))
            else:
                for k in range(max(count, 1)):
                    add(kind, f"{field}[{k}]." if count else f"{field}.", depth + 1)
            if len(fields) > MOST:
                raise DataError(f"the ULog gives {name} more than {MOST} fields; it is damaged: copy it again", code="damaged")

    add(name, "", 0)
    names = [field[0] for field in fields]
    if len(set(names)) < len(names) or not fields:
        raise DataError(f"the ULog's description of {name} is damaged (fields {', '.join(names[:8])}): copy the file again", code="damaged")
    sizes = [np.dtype(field[1]).itemsize * (field[2][0] if len(field) > 2 else 1) for field in fields]
    padding = 0
    while len(fields) > 1 and fields[-1][0].startswith("_padding"):
        fields.pop()
        padding += sizes.pop()
    return np.dtype(fields), padding
