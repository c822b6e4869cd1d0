"""Access to the bytes of a text table (plain, gzipped or in another encoding), and detection of its layout from its beginning."""

import collections
import contextlib
import csv
import dataclasses
import functools
import gzip
import io
import itertools
import pathlib
import re
import zlib
from collections.abc import Callable, Iterator

from ..._errors import DataError
from .._columns import SENSORS
from .._names import OTHER_SCRIPTS, parse_name, unit_of
from ._bounds import BLOCK, FREE_TEXT, MOST, check_declared
from ._labelled import refuse_kinds, relabelled
from ._programs import of_program

#: bytes at the beginning that tell the layout; a line as long as this is none of a log
HEAD = 1 << 18
MISSING = ("", "NA", "N/A", "n/a", "null", "NULL", "None", "none", "-", "--", "NAN", "nan", "NaN", "Nan")
COMMENTS = ("#", "%", "//")
_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:inf(?:inity)?)", re.IGNORECASE)
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_DAY = (
    r"(?:\d{4}[-/.]\d\d?[-/.]\d\d?|\d\d?[-/.]\d\d?[-/.](?:\d{4}|\d\d(?!\d))|"
    rf"\d\d?[- ](?i:{'|'.join(MONTHS)})[a-z]{{0,6}}[- ]\d{{4}})"
)
#: also minutes and seconds without hours, as spreadsheets save times
_TIME_OF_DAY = r"(?:\d\d?:\d\d?:\d\d?(?:[.,:]\d+)?(?:\s*[AaPp][Mm])?|\d\d?:\d\d[.,]\d+)"
#: as ctime of C writes it
_CTIME = rf"[A-Z][a-z]{{2}} (?i:{'|'.join(MONTHS)}) {{1,2}}\d\d? {_TIME_OF_DAY} \d{{4}}"
_DATE = re.compile(
    rf"\[?(?:{_DAY}(?:[T_]|,? +)(?:{_TIME_OF_DAY}|\d\d?-\d\d-\d\d(?:[.,_:-]\d+)?)|{_CTIME}|\d{{8}}[T_]\d{{6}}(?:[.,]\d+)?)"
    r"\s*(?:Z|UTC|[+-]\d\d:?\d\d)?\]?"
)
_DAY_ALONE, _CLOCK = re.compile(_DAY), re.compile(rf"\[?{_TIME_OF_DAY}\]?")
_ANY = re.compile("|".join(f"(?:{form.pattern})" for form in (_NUMBER, _COMMA_NUMBER, _DATE, _DAY_ALONE, _CLOCK)), re.IGNORECASE)
_WORDS = re.compile(r"(?!nan|null|none|n/a)[A-Za-z][\w #-]*:?$", re.IGNORECASE)
#: lines of numbers that are not read as such, and what to do with them
_UNREAD = {
    r"^[^a-zA-Z]*(?:[,;\s]*-?0x[\da-fA-F]+)+[,;\s]*$": "; numbers such as 0x1F are hexadecimal: write signed decimal ones",
    r"\d [^\d\s,;]+ *[,;\t]": "; a unit beside each number: remove it, as with `sed 's/\\([0-9]\\) [^,;]*/\\1/g' LOG > log.csv`",
}
#: kinds of text columns that are converted to time stamps
STAMPS = ("date", "day", "clock")
_LOOK = 500
#: blocks of zero bytes, which a memory card leaves where nothing was written before the power went
_HOLE = re.compile(rb"\0{8,}")
_CONTROL = bytes([*range(9), *range(14, 32)])


@dataclasses.dataclass(frozen=True)
class Text:
    """A text table: `head` is its beginning; `content` is the whole text converted to UTF-8 with line feeds, if the file needs it."""

    path: pathlib.Path
    head: str
    first: bytes  # the bytes of the head, as in the blocks
    content: bytes | None
    packed: bool
    holes: bool = False  # whether blocks of zero bytes were removed

    def start(self, lines: int) -> int:
        """Byte offset of the line after the first `lines` lines."""
        at = 0
        for _ in range(lines):
            at = self.first.find(b"\n", at) + 1
        return at

    def part(self, start: int, stop: int) -> bytes:
        """The bytes between two offsets."""
        with self._open() as file:
            file.seek(start)
            return file.read(stop - start)

    def blocks(self, start: int) -> Iterator[Callable[[], bytes]]:
        """Functions that read one block each, and may be called in any thread."""
        if self.packed and self.content is None:
            yield from (functools.partial(bytes, block) for block in _unpacked(self.path, start))
            return
        with self._open() as file:
            size = file.seek(0, io.SEEK_END)
            while start < size:
                file.seek(min(start + BLOCK, size))
                file.readline()
                yield functools.partial(self.part, start, file.tell())
                start = file.tell()

    def tail(self) -> str | None:
        """The end of the text; None for a packed file."""
        if self.packed and self.content is None:
            return None
        with self._open() as file:
            file.seek(max(0, file.seek(0, io.SEEK_END) - (1 << 16)))
            return file.read().decode("utf-8", errors="replace")

    def _open(self) -> io.BufferedIOBase:
        return self.path.open("rb") if self.content is None else io.BytesIO(self.content)


def open_text(path: pathlib.Path) -> Text:
    """Open a text file and examine its beginning."""
    with path.open("rb") as file:
        packed = file.read(2) == b"\x1f\x8b"
    with _gzip_faults(), gzip.open(path) if packed else path.open("rb") as file:
        first = file.read(HEAD)
        whole = not file.read(1)
    holes = _HOLE.search(first) is not None and b"\0" not in _HOLE.sub(b"", first)
    encoding = _encoding(_HOLE.sub(b"\n", first) if holes else first)
    text = first.decode(encoding, errors="replace")
    if not whole:
        _refuse_wide(text.split("\n"))
        text = text[: text.rfind("\n") + 1] or text
    if not text.strip():
        raise DataError("the file is empty", code="empty")
    table, content = None if holes else of_program(text) or relabelled(text), None
    # polars needs UTF-8 and lines that end with \n
    if holes or table is not None or encoding not in ("utf-8-sig", "latin-1") or ("\n" not in text and "\r" in text):
        everything = b"".join(_unpacked(path, 0)) if packed else path.read_bytes()
        text = (_HOLE.sub(b"\n", everything) if holes else everything).decode(encoding, errors="replace")
        text = text.replace("\r\n", "\n").replace("\r", "\n")
        content = (text if table is None else table(text)).encode()
        first = content[:HEAD]
        text = first.decode("utf-8", errors="replace")
    return Text(path, text, first, content, packed, holes)


def _unpacked(path: pathlib.Path, start: int) -> Iterator[bytes]:
    """Blocks of whole lines of a gzip file, whose checksum is verified at the end."""
    size = path.stat().st_size
    with _gzip_faults(), gzip.open(path) as file:
        file.read(start)
        while block := file.read(BLOCK):
            check_declared(file.tell(), size, "the packed text", FREE_TEXT)
            yield block + file.readline(BLOCK)


@contextlib.contextmanager
def _gzip_faults() -> Iterator[None]:
    try:
        yield
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        said = f"the gzip file is damaged or cut off ({error}); copy it again, or save what `zcat` still gives as a plain file"
        raise DataError(said, code="damaged") from error


def _encoding(head: bytes) -> str:
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    control = len(head[:4096]) - len(head[:4096].translate(None, _CONTROL))
    if b"\0" in head or control > 0.01 * len(head[:4096]):
        raise DataError("this is neither text nor a format that is known by its first bytes; convert it to CSV or NPZ", code="not_a_log")
    try:
        head.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if error.start < len(head) - 4:
            return _older(head)
    return "utf-8-sig"


def _older(head: bytes) -> str:
    """Latin-1, or the encoding of Chinese systems if it gives known words."""
    line = b"\n".join(head.split(b"\n", 5)[:5])
    try:
        text = line.decode("gb18030")
    except UnicodeDecodeError:
        return "latin-1"
    return "gb18030" if any(word in text for word in OTHER_SCRIPTS) else "latin-1"


@dataclasses.dataclass(frozen=True)
class Layout:
    """Layout of a text table.

    `skip` lines precede the first row; `delimiter` " " means any white space; there are `width` columns of data, and rows may end with
    one more delimiter (`trailing`); `kinds` are "int", "long" (more than 15 digits), "float", "date", "day", "clock" (a time of day) or
    "text"; `padded` rows have blanks that must be removed first; `preamble` is the text above the rows.
    """

    skip: int
    delimiter: str
    names: list[str]
    kinds: list[str]
    comma: bool
    comment: str | None
    trailing: bool
    padded: bool
    preamble: str = ""

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.kinds)


def sniff(text: str) -> Layout:
    """Detect the layout of a table from its first lines."""
    lines = text.split("\n", _LOOK)[:_LOOK]
    lines = [part for line in lines for part in line.rstrip("\r").split("\r")][:_LOOK]
    _refuse_wide(lines)
    refuse_kinds(lines)
    best: tuple[str, int, dict[int, list[str]]] | None = None
    ended = [line.rstrip() for line in lines if line.strip()]
    ended = len(ended) > 2 and sum(line.endswith(";") and line.count(";") == 1 and "," in line for line in ended) > 0.9 * len(ended)
    for mark in (",",) if ended else (";", "\t", "|", ",", " "):
        known = {i: line.rstrip("; ") if ended else line for i, line in enumerate(lines) if line.strip() and not _is_comment(line)}
        rows = {i: split(line, mark) for i, line in known.items()}
        rows_of_numbers = {i: row for i, row in rows.items() if _is_data(row)}
        width_of = _width_of(list(rows_of_numbers.values()))
        widths = [width_of(row) for row in rows_of_numbers.values()]
        if not widths:
            continue
        width = max(set(widths), key=widths.count)
        if best is None or width > 1 or best[1] == 1:
            best = mark, width, {i: row for i, row in rows_of_numbers.items() if width_of(row) == width}
        if width > 1 and widths.count(width) > 0.5 * len(rows):
            break
    if best is None:
        shown = next((line.strip() for line in lines if line.strip()), "")
        short = [line.strip() for line in lines[:100] if len(line) < HEAD >> 9]
        hint = next((hint for form, hint in _UNREAD.items() if sum(bool(re.search(form, one)) for one in short) > len(short) / 2), "")
        raise DataError(f"there are no rows of numbers; the first line is {shown[:80]!r}{hint}", code="no_rows")
    delimiter, width, found = best
    numbers = [j for j in range(width) if _kind([row[j].strip() for row in found.values()]) in ("int", "long", "float")]
    # a line above the rows may have as many fields as they have, such as "Tau: 1.0", or stand alone above other words
    after = dict(itertools.pairwise(known))
    while len(found) > 2 and (any(_WORDS.match(found[min(found)][j].strip()) for j in numbers) or after[min(found)] not in found):
        del found[min(found)]
    first, data = min(found), list(found.values())
    stated = ""
    heads = [{*map(str.strip, row)} for row in data[:2]]
    if len(data) > 3 and len(heads[0]) == len(heads[1]) == 1 and re.fullmatch(r" *1\d{9}(?:\.\d+)?", data[0][0]):
        # Empatica writes a start in s since 1970 and a rate above every column
        stated, first, data = f"\nsampling rate: {data[1][0].strip()} Hz", sorted(found)[2], data[2:]
    trailing = any(len(row) > width for row in data)
    comments = [line.strip() for line in lines[first:] if _is_comment(line)]
    head = [one for one in lines[:first] if one.strip(" \t#%/")]
    marks = [mark for mark in COMMENTS if any(line.startswith(mark) for line in comments)]
    comma = delimiter != " " and any(_COMMA_NUMBER.fullmatch(field.strip()) for row in data for field in row)
    blanks = delimiter == " " and any(line != line.strip() or re.search(r"[ \t]{2,}|\t", line) for line in lines[first:])
    padded = ended or blanks or (comma and delimiter == ",") or (delimiter != " " and any(row[-1] != row[-1].rstrip() for row in data))
    names = (not stated and (_names(head, delimiter, width, trailing) or _uneven(head, delimiter, data, width))) or [""] * width
    kinds = [_kind([row[j].strip() for row in data]) for j in range(width)]
    preamble = "\n".join(lines[:first])[:20_000] + stated
    return Layout(first, delimiter, names, kinds, comma, marks[0] if marks else "#", trailing, padded, preamble)


def _refuse_wide(lines: list[str]) -> None:
    """Refuse a line that is longer or has more fields than any log, before splitting it."""
    for number, line in enumerate(lines, 1):
        fields = max(line.count(mark) for mark in ",;\t ") + 1 if len(line) > MOST else 0
        if fields > MOST or len(line) >= HEAD:
            what = f"{fields} fields" if fields > MOST else f"{len(line)} characters"
            said = f"line {number} has {what}, as no log has: write one sample a line (transpose the table), or save the arrays as .npz"
            raise DataError(said, code="too_wide")


def split(line: str, delimiter: str) -> list[str]:
    """Split a line into fields; " " splits at any white space; quoted fields are not split."""
    if delimiter == " ":
        return [field.strip('"') for field in line.split()]
    return next(csv.reader([line], delimiter=delimiter), []) if '"' in line else line.split(delimiter)


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENTS)


def _width_of(rows: list[list[str]]) -> Callable[[list[str]], int]:
    """Function that counts the fields of a row. The last one counts although it is empty, if other rows of the usual length fill it."""
    usual = collections.Counter(map(len, rows)).most_common(1)[0][0] if rows else 0
    filled = any(row[-1].strip() for row in rows if len(row) == usual)
    return lambda row: usual if filled and len(row) == usual else _effective(row)


def _effective(row: list[str]) -> int:
    """Number of fields, without the empty field after a trailing delimiter."""
    return len(row) - (len(row) > 1 and not row[-1].strip())


def _is_data(row: list[str]) -> bool:
    filled = [field.strip() for field in row if field.strip() not in MISSING]
    return sum(map(bool, map(_ANY.fullmatch, filled))) >= max(1, len(filled) / 2)


def _kind(fields: list[str]) -> str:
    filled = [field for field in fields if field not in MISSING]
    if not filled:
        return "float"
    for kind, form in (("date", _DATE), ("day", _DAY_ALONE), ("clock", _CLOCK)):
        if sum(map(bool, map(form.fullmatch, filled))) > len(filled) / 2:
            return kind
    if sum(map(bool, map(_ANY.fullmatch, filled))) <= len(filled) / 2:
        return "text"
    if not all(re.fullmatch(r"[+-]?\d+", field) for field in filled if _ANY.fullmatch(field)):
        return "float"
    # float64 represents whole numbers exactly up to 2^53; nanoseconds since 1970 are larger
    return "long" if max(len(field) for field in filled) > 15 else "int"


def _names(head: list[str], delimiter: str, width: int, trailing: bool) -> list[str] | None:
    """Column names: of the last lines above the data with its number of fields, the one with most known names, or groups above axes.

    Others are lines of units, which are added to the names, of types, or of how a value was made.
    """
    rows = []
    for line in head[:-5:-1]:
        row = _fields(line, delimiter, width) or (_fields(line, delimiter, width + 1) if trailing else None)
        # a comment can have as many words as there are columns by chance
        if row and (_known(row[:width]) or not _is_comment(line)):
            rows.append(row[:width])  # the name of a field that is empty in all rows goes
        elif line is head[-1]:
            rows.append([])
    units = next((row for row in rows if _are_units(row)), [])
    named = [row for row in rows if row is not units] or rows
    forms = named + [_grouped(*pair) for pair in itertools.pairwise(named)]
    names = max(forms, key=_known, default=[])
    names = names if _known(names) > 1 else named[0] if named else []
    if not units or names is units:
        return names or None
    return [f"{name} [{_bare(unit)}]" if _bare(unit).strip("- ") else name for name, unit in zip(names, units, strict=False)] or None


def _known(names: list[str]) -> int:
    return sum(parse_name(name) is not None for name in names)


def _grouped(axes: list[str], above: list[str]) -> list[str]:
    """Axes with their groups before them, each of which is named once or above every axis, as pandas and workbooks write them."""
    filled, group = [], ""
    for word in above:
        group = word if word and not word.startswith("Unnamed") else group
        filled.append(group)
    return [f"{one}_{name}" if one and name else one or name for one, name in zip(filled, axes, strict=False)]


def _uneven(head: list[str], delimiter: str, data: list[list[str]], width: int) -> list[str] | None:
    """Column names where rows have a field more than the header, such as a number of the row or a checksum, or one less."""
    names = head and (_fields(head[-1], delimiter, width - 1) or _fields(head[-1], delimiter, width + 1))
    if not names or not any(map(parse_name, names)):
        return None
    if len(names) > width:
        return names[:width] if parse_name(names[-1]) is None else None
    first, last = ([row[j].strip(' "') for row in data if len(row) > j] for j in (0, width - 1))
    if all(one.isdecimal() for one in first) and all(int(b) - int(a) == 1 for a, b in itertools.pairwise(first)):
        return ["", *names]
    return [*names, ""] if not any("." in one for one in last) else None


def _fields(line: str, delimiter: str, width: int) -> list[str] | None:
    """The `width` fields of a line above the data, or None; a comment may use another delimiter than the data."""
    comment = _is_comment(line)
    bare = line.strip().lstrip("#%/").strip() if comment else line
    for mark in dict.fromkeys((delimiter, ",", ";", "\t", " ") if comment else (delimiter,)):
        row = split(bare, mark)
        if width in (len(row), _effective(row)) and not _is_data(row):
            return [field.strip().strip('"') for field in row[:width]]
    return None


def _are_units(fields: list[str]) -> bool:
    """Whether a line has units: all known, or most of them known and some repeated."""
    filled = [field for field in fields if field.strip()]
    known = sum(map(_is_unit, filled))
    # a line of units may include unknown units
    return bool(filled) and (known == len(filled) or (known >= max(2, len(filled) / 2) and len(set(filled)) < len(filled)))


def _is_unit(field: str) -> bool:
    text = _bare(field)
    return not text or text == "-" or any(unit_of(text, quantity) for quantity in ("time", *SENSORS, "temperature"))


def _bare(field: str) -> str:
    """Remove the brackets around a field."""
    text = field.strip()
    return text[1:-1].strip() if text[:1] in ("[", "(") and text[-1:] in ("]", ")") else text
