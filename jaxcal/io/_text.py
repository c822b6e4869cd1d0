"""The bytes of a text table: plain, gzipped or in another encoding, in blocks of whole lines."""

import dataclasses
import functools
import gzip
import io
import itertools
import pathlib
import zlib
from collections.abc import Callable, Iterator

from .._errors import DataError

_HEAD = 1 << 18
#: two threads with blocks of 4 MiB read as fast as they parse, and hold little
_BLOCK = 1 << 22


@dataclasses.dataclass(frozen=True)
class Text:
    """A text table: `head` is its beginning as text; `content` is all of it in UTF-8 with line feeds, where the file has it otherwise."""

    path: pathlib.Path
    head: str
    first: bytes  # the head as it stands in the blocks
    content: bytes | None
    packed: bool

    def start(self, lines: int) -> int:
        """Where the line after the first `lines` begins."""
        at = 0
        for _ in range(lines):
            at = self.first.find(b"\n", at) + 1
        return at

    def edges(self, start: int) -> list[int]:
        """Where blocks of whole lines begin, from `start` on, and where the last one ends."""
        with self._open() as file:
            size = file.seek(0, io.SEEK_END)
            found = [start]
            while found[-1] < size:
                file.seek(min(found[-1] + _BLOCK, size))
                file.readline()
                found.append(file.tell())
        return found

    def part(self, start: int, stop: int) -> bytes:
        """The bytes between two places."""
        with self._open() as file:
            file.seek(start)
            return file.read(stop - start)

    def blocks(self, start: int) -> Iterator[Callable[[], bytes]]:
        """What reads one block each; they may be called in any thread."""
        if self.packed and self.content is None:
            yield from (functools.partial(bytes, block) for block in _unpacked(self.path, start))
            return
        edges = self.edges(start)
        for at, end in itertools.pairwise(edges):
            yield functools.partial(self.part, at, end)

    @property
    def size(self) -> int | None:
        """Bytes in all, None where that is known at the end only."""
        if self.content is not None:
            return len(self.content)
        return None if self.packed else self.path.stat().st_size

    def _open(self) -> io.BufferedIOBase:
        return self.path.open("rb") if self.content is None else io.BytesIO(self.content)


def open_text(path: pathlib.Path) -> Text:
    """Look at the beginning of a text file.

    Raises
    ------
    DataError
        If it is not text, is empty, or is a damaged gzip file.
    """
    packed = _is_gzip(path)
    first, whole = _head(path, packed=packed)
    encoding = _encoding(first)
    text = first.decode(encoding, errors="replace")
    if not whole:
        text = text[: text.rfind("\n") + 1] or text
    if not text.strip():
        raise DataError("the file is empty")
    content = None
    # polars reads UTF-8 and ends lines at \n
    if encoding.startswith("utf-16") or ("\n" not in text and "\r" in text):
        everything = b"".join(_unpacked(path, 0)) if packed else path.read_bytes()
        content = everything.decode(encoding, errors="replace").replace("\r\n", "\n").replace("\r", "\n").encode()
        first = content[:_HEAD]
    return Text(path, text, first, content, packed)


def _is_gzip(path: pathlib.Path) -> bool:
    with path.open("rb") as file:
        return file.read(2) == b"\x1f\x8b"


def _head(path: pathlib.Path, *, packed: bool) -> tuple[bytes, bool]:
    """The first bytes of the text, and whether that is all of it."""
    with gzip.open(path) if packed else path.open("rb") as file:
        try:
            head = file.read(_HEAD)
            return head, not file.read(1)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise _damaged(error) from error


def _unpacked(path: pathlib.Path, start: int) -> Iterator[bytes]:
    """Blocks of whole lines of a gzip file, whose checksum is looked at on the way."""
    try:
        with gzip.open(path) as file:
            file.read(start)
            while block := file.read(_BLOCK):
                yield block + file.readline()
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise _damaged(error) from error


def _damaged(error: Exception) -> DataError:
    return DataError(f"the gzip file is damaged or cut off ({error}); copy it again, or save what `zcat` still gives as a plain file")


def _encoding(head: bytes) -> str:
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    control = sum(byte < 9 or 13 < byte < 32 for byte in head[:4096])
    if b"\0" in head or control > 0.01 * len(head[:4096]):
        raise DataError("this is neither text nor a format that is known by its first bytes; convert it to CSV or NPZ")
    try:
        head.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if error.start < len(head) - 4:
            return "latin-1"
    return "utf-8-sig"
