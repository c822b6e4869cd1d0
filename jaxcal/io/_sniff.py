"""The layout of a text table, told from its beginning: delimiter, header, comments, kinds of columns."""

import csv
import dataclasses
import re

from .._errors import DataError
from ._columns import parse_name, unit_of
from ._options import SENSORS

MISSING = ("", "NA", "N/A", "n/a", "null", "NULL", "None", "none", "-", "--", "NAN", "nan", "NaN", "Nan")
COMMENTS = ("#", "%", "//")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:inf(?:inity)?)", re.IGNORECASE)
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_DATE = re.compile(r"\d{4}[-/]\d\d[-/]\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d+)?\s*(?:Z|UTC|[+-]\d\d:?\d\d)?")
_LOOK = 500


@dataclasses.dataclass(frozen=True)
class Layout:
    """How to read a text table.

    `skip` lines precede the first row; `delimiter` " " stands for any white space; `width` columns carry data, and rows may end
    with one delimiter more (`trailing`); `kinds` are "int", "long" (more than 15 digits), "float", "date" or "text"; `padded` rows
    have blanks to remove first.
    """

    skip: int
    delimiter: str
    names: list[str]
    kinds: list[str]
    comma: bool
    comment: str | None
    trailing: bool
    padded: bool

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.kinds)


def sniff(text: str) -> Layout:
    r"""Layout of a table from its first lines.

    Raises
    ------
    DataError
        If there is no row of numbers in it.

    Examples
    --------
    >>> from jaxcal.io._sniff import sniff
    >>> layout = sniff("time [s];gyro_x\n0,00;1,5\n0,01;2,5\n")
    >>> layout.delimiter, layout.names, layout.comma, layout.skip
    (';', ['time [s]', 'gyro_x'], True, 1)
    """
    lines = text.splitlines()[:_LOOK]
    best = None
    for delimiter in (";", "\t", ",", " "):
        rows = [None if _is_comment(line) or not line.strip() else split(line, delimiter) for line in lines]
        widths = [_effective(row) for row in rows if row is not None and _is_data(row)]
        if not widths:
            continue
        width = max(set(widths), key=widths.count)
        agreement = widths.count(width) / max(1, sum(row is not None for row in rows))
        if width > 1 and agreement > 0.5:
            best = (delimiter, rows, width)
            break
        if best is None or (width > 1, agreement) > (best[2] > 1, 0.0):
            best = (delimiter, rows, width)
    if best is None:
        shown = next((line.strip() for line in lines if line.strip()), "")
        raise DataError(f"there are no rows of numbers; the first line is {shown[:80]!r}")
    delimiter, rows, width = best
    first = next(i for i, row in enumerate(rows) if row is not None and _is_data(row) and _effective(row) == width)
    data = [row for row in rows[first:] if row is not None and _is_data(row) and _effective(row) == width]
    comments = [line.strip() for line in lines[first:] if _is_comment(line)]
    marks = [mark for mark in COMMENTS if any(line.startswith(mark) for line in comments)]
    blanks = delimiter == " " and any(line != line.strip() or re.search(r"[ \t]{2,}|\t", line) for line in lines[first:])
    return Layout(
        skip=first,
        delimiter=delimiter,
        names=_names([line for line in lines[:first] if line.strip(" \t#%/")], delimiter, width),
        kinds=[_kind([row[j].strip() for row in data]) for j in range(width)],
        comma=delimiter in ";\t" and any(_COMMA_NUMBER.fullmatch(field.strip()) for row in data for field in row),
        comment=marks[0] if marks else "#",
        trailing=any(len(row) > width for row in data),
        padded=blanks or (delimiter != " " and any(field != field.rstrip() for row in data for field in row[-1:])),
    )


def split(line: str, delimiter: str) -> list[str]:
    """Fields of a line; " " splits at any white space; quoted fields are kept whole."""
    if delimiter == " ":
        return [field.strip('"') for field in line.split()]
    if '"' not in line:
        return line.split(delimiter)
    return next(csv.reader([line], delimiter=delimiter), [])


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENTS)


def _effective(row: list[str]) -> int:
    """Number of fields, a trailing delimiter left out."""
    return len(row) - (len(row) > 1 and not row[-1].strip())


def _is_number(field: str) -> bool:
    return bool(_NUMBER.fullmatch(field) or _COMMA_NUMBER.fullmatch(field) or _DATE.fullmatch(field))


def _is_data(row: list[str]) -> bool:
    filled = [field.strip() for field in row if field.strip() not in MISSING]
    numbers = sum(map(_is_number, filled))
    return numbers >= max(1, len(filled) / 2)


def _kind(fields: list[str]) -> str:
    filled = [field for field in fields if field not in MISSING]
    if not filled:
        return "float"
    if sum(map(bool, map(_DATE.fullmatch, filled))) > len(filled) / 2:
        return "date"
    if sum(map(_is_number, filled)) <= len(filled) / 2:
        return "text"
    if not all(re.fullmatch(r"[+-]?\d+", field) for field in filled if _is_number(field)):
        return "float"
    # float64 holds whole numbers up to 2^53; nanoseconds since 1970 are longer
    return "long" if max(len(field) for field in filled) > 15 else "int"


def _names(head: list[str], delimiter: str, width: int) -> list[str]:
    """Column names: the line of text before the data that has as many fields; a line of units below it is joined on."""
    nameless = [""] * width
    if not head:
        return nameless
    names = _fields(head[-1], delimiter, width)
    units = names and len(head) > 1 and all(map(_is_unit, names)) and any(names)
    if names and units and (above := _fields(head[-2], delimiter, width)) and any(map(parse_name, above)):
        return [f"{name} [{unit.strip('[]()')}]" if unit.strip("[]()- ") else name for name, unit in zip(above, names, strict=True)]
    # a comment may happen to have as many words as there are columns
    if not names or (_is_comment(head[-1]) and not any(map(parse_name, names))):
        return nameless
    return names


def _fields(line: str, delimiter: str, width: int) -> list[str] | None:
    """The `width` words of a line above the data, or None; a comment may use another delimiter than the data."""
    comment = _is_comment(line)
    bare = line.strip().lstrip("#%/").strip() if comment else line
    for mark in dict.fromkeys((delimiter, ",", ";", "\t", " ") if comment else (delimiter,)):
        row = split(bare, mark)
        if _effective(row) == width and not _is_data(row):
            return [field.strip().strip('"') for field in row[:width]]
    return None


def _is_unit(field: str) -> bool:
    text = field.strip("[]() ")
    return not text or text == "-" or any(unit_of(text, quantity) for quantity in ("time", *SENSORS, "temperature"))
