"""Read the rows of a text table in blocks, parsed by parallel threads, without keeping the text or a frame of all rows in memory.

A block with faulty rows is parsed again line by line, and the faults are counted.
"""

import collections
import dataclasses
import os
import pathlib
import re
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from ..._answer import Finding
from ..._errors import DataError
from ..._message import Message, joined_messages
from .._columns import wrong
from .._findings import READ
from .._table import Table
from .._triples import file_kind
from ._bounds import MOST, allowed, check_declared, require
from ._sandbox import sandbox
from ._text import HEAD, MISSING, MONTHS, STAMPS, Layout, Text, open_text, sniff, split

_PLAIN: dict[str, Any] = {"has_header": False, "encoding": "utf8-lossy", "raise_if_empty": False}  # options of polars
#: largest share of damaged rows; a table with more is refused
_TOLERATED = 0.01
_DESCRIBES = 0.05  # share of the rows of the longest sheet below which a sheet describes the recording


def read_csv(path: pathlib.Path) -> Table:
    """Read the columns of a text table (CSV, TSV, blanks), plain or gzipped.

    Rows with a wrong number of fields are left out, and text in a column of numbers is a missing value. Both are counted; more than 1 %
    of either is an error, which shows the first case.
    """
    require("polars", "reading tables", "csv")
    return read_text(open_text(path), path.name.removesuffix(".gz").rpartition(".")[0] or path.name)


def read_text(text: Text, stem: str) -> Table:
    """Read the columns of an opened text table."""
    layout = sniff(text.head)
    found = [READ("holes")] if text.holes else []
    columns = gather(text, layout, found)
    if _cut_last(text, layout, columns):
        columns = [column[:-1] for column in columns]
        found.append(READ("last_row"))
    of = {kind: {j for j, each in enumerate(layout.kinds) if each == kind} for kind in ("clock", "day")}
    integer = {j for j, kind in enumerate(layout.kinds) if kind in ("int", "long")}
    return Table(columns, layout.names, integer, findings=found, clocks=of["clock"], days=of["day"], preamble=layout.preamble, stem=stem)


def read_workbook(path: pathlib.Path, topics: list[str] | None) -> dict[str, Table]:
    """Read the sheets of a workbook (XLSX, XLS, ODS) that hold a table of numbers, or those of them in `topics`."""
    for library, extra in (("python_calamine", "xlsx"), ("polars", "csv")):
        require(library, "reading workbooks", extra)
    size = path.stat().st_size
    about, sheets = sandbox.read("xlsx", str(path), allowed=allowed(size), most=MOST)
    check_declared(about.get("declared", 0), size, "the workbook")
    found: dict[str, Table] = {}
    faults: list[Any] = []
    for name, content in zip(about["names"], map(bytes, sheets), strict=True):
        try:
            head = content[:HEAD].decode("utf-8", errors="replace")
            found[name] = read_text(Text(path, head, content[:HEAD], content, packed=False), name)
        except DataError as error:
            faults.append(Message("{name}: {error}", name=name, error=error))
    if topics and (unknown := [name for name in topics if name not in found]):
        raise wrong("topics", f"no sheet {', '.join(unknown)} with a table of numbers among {', '.join(about['names'])}")
    most = max((len(table.columns[0]) for table in found.values()), default=0)
    found = {name: table for name, table in found.items() if (name in topics if topics else len(table.columns[0]) > _DESCRIBES * most)}
    kinds = [file_kind(name) for name in found]
    if len(found) > 1 and (None in kinds or len(set(kinds)) < len(kinds)):
        said = "the workbook holds {count} sheets with numbers: name one, as in {option.topics:{first}}: {names}"
        raise DataError(Message(said, count=len(found), first=next(iter(found)), names=", ".join(found)), code="several")
    if not found:
        raise DataError(joined_messages(["no sheet holds a table of numbers", *faults]), code="no_rows")
    return found


def _cut_last(text: Text, layout: Layout, columns: list[np.ndarray]) -> bool:
    """Whether the last row may be cut off within a number: no line end, and a shorter last field than other rows."""
    tail = text.tail()
    if tail is None or tail.endswith(("\n", "\r")) or not len(columns[0]) or layout.kinds[-1] not in ("int", "long", "float"):
        return False
    rows = [line for line in tail.splitlines()[1 if len(tail) > 60_000 else 0 :] if line.strip()]
    if len(rows) < 3 or len(split(rows[-1], layout.delimiter)) != layout.width:
        return False  # a row with too few fields is left out in any case
    fields = [split(row, layout.delimiter)[-1].strip() for row in rows[-1000:]]
    others = [len(field) for field in fields[:-1] if re.fullmatch(r"[+-]?[\d.,]+(?:[eE][+-]?\d+)?", field)]  # the header may be among them
    return fields[-1] not in MISSING and len(fields[-1]) < min(others, default=0)


class Seen(NamedTuple):
    """A fault that was found `count` times, first in line `number` with the content `shown`."""

    count: int
    number: int
    shown: str


@dataclasses.dataclass
class Faults:
    """Faults in the lines of a block or of a table, by column; rows with a wrong number of fields in the place of one column more."""

    rows: int = 0
    found: dict[int, Seen] = dataclasses.field(default_factory=dict)

    def add(self, other: "Faults", lines: int) -> None:
        """Add the faults of a later block, which begins after `lines` lines."""
        self.rows += other.rows
        for j, seen in other.found.items():
            first = self.found.get(j, Seen(0, seen.number + lines, seen.shown))
            self.found[j] = first._replace(count=first.count + seen.count)

    def judged(self, layout: Layout) -> list[Finding]:
        """One finding for each fault; an error if it affects more than 1 % of the rows."""
        said, rows = [], self.rows
        for j, (count, number, shown) in sorted(self.found.items(), key=lambda one: (one[0] != layout.width, one[0])):
            facts = {"count": count, "rows": rows, "line": number, "shown": shown[:60]}
            if j == layout.width:
                one = READ("rows_left_out", width=layout.width, **facts)
                mend = "remove these lines"
            else:
                one = READ("text_missing", column=f"column {j}" + (f" ({layout.names[j]})" if layout.names[j] else ""), **facts)
                mend = Message("leave the column out with {option.columns}")
            if count > max(1, _TOLERATED * rows):
                raise DataError(Message("too many faults. {found} Mend the file, or {mend}", found=one, mend=mend), code=one.code)
            said.append(one)
            rows -= count if j == layout.width else 0
        return said


@dataclasses.dataclass
class Block:
    """Columns of one block, its numbers of rows and lines, and its faults."""

    columns: collections.deque[np.ndarray]
    rows: int
    lines: int
    faults: Faults


def _parsed_ahead(layout: Layout, reads: Iterator[Callable[[], bytes]]) -> Iterator[Block]:
    """Parse the blocks from `reads` in order; some are parsed ahead."""
    import polars as pl

    threads, ahead = os.cpu_count() or 1, collections.deque()
    with ThreadPoolExecutor(threads) as pool:
        for read in reads:
            ahead.append(pool.submit(_parse, pl, read, layout))
            if len(ahead) > threads + 1:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()


def _parse(pl: Any, read: Callable[[], bytes], layout: Layout) -> Block:
    """Parse the rows of one block."""
    text = read()
    frame, faults = (None if layout.padded else _parsed(pl, text, layout)), None
    if frame is None or not _fits(pl, frame, layout, text):
        frame, faults = _repair(pl, text, layout)
    if frame.to_series(layout.width - 1).null_count():
        frame = frame.filter(~pl.all_horizontal(pl.all().is_null()))
    columns = (_STAMPS.get(kind, lambda one: one.to_numpy())(frame.to_series(j)) for j, kind in enumerate(layout.kinds))
    return Block(collections.deque(columns), frame.height, text.count(b"\n"), faults or Faults(frame.height))


def _parsed(pl: Any, text: bytes, layout: Layout) -> Any:
    """Parse the rows to a frame; None if they do not fit the layout."""
    if re.search(rb'[\n%s]"\s*$' % re.escape(layout.delimiter.encode()), text[-4:]):
        return None  # polars breaks down at a last field of one quote, and shows how on the terminal
    types = {"int": pl.Float64, "long": pl.Int64, "float": pl.Float64, **dict.fromkeys((*STAMPS, "text"), pl.String)}
    schema = {f"c{j}": types[kind] for j, kind in enumerate(layout.kinds)} | ({"end": pl.String} if layout.trailing else {})
    plain = not (b'"' in text or (layout.comment or "#").encode() in text or {*STAMPS, "text"} & set(layout.kinds))
    # try a quick way first: handling of quotes, comments and words for missing values doubles the time
    for quick in (True, False) if plain else (False,):
        more = {"quote_char": None} if quick else {"null_values": list(MISSING), "comment_prefix": layout.comment}
        try:
            return pl.read_csv(text, separator=layout.delimiter, schema=schema, decimal_comma=layout.comma, **_PLAIN, **more)
        except (pl.exceptions.ComputeError, pl.exceptions.SchemaError):
            continue
    return None


def _fits(pl: Any, frame: Any, layout: Layout, text: bytes) -> bool:
    """Whether no row seems too short or too long; a short row ends in nulls, as do a blank line and a missing last value."""
    if layout.trailing and frame["end"].drop_nulls().len():
        return False
    nulls = frame.to_series(layout.width - 1).null_count()
    if not nulls or nulls == frame.select(pl.all_horizontal(pl.all().is_null()).sum()).item():
        return True
    # accept a last column without any value
    fields = text.count(layout.delimiter.encode()) == (layout.width - 1 + layout.trailing) * frame.height
    return nulls == frame.height and fields and b'"' not in text


def gather(text: Text, layout: Layout, found: list[Finding]) -> list[np.ndarray]:
    """Read all rows into columns; the columns of numbers are the rows of one array."""
    blocks: list[Block] = []
    faults, lines = Faults(), layout.skip
    for block in _parsed_ahead(layout, text.blocks(text.start(layout.skip))):
        faults.add(block.faults, lines)
        lines += block.lines
        blocks.append(block)
    found.extend(faults.judged(layout))
    numeric = [kind in ("int", "float") for kind in layout.kinds]
    numbers = iter(np.empty((sum(numeric), sum(block.rows for block in blocks))))
    # a column of the blocks goes before the next is copied, so that a table is not held twice
    return [
        np.concatenate([block.columns.popleft() for block in blocks] or [[]], out=next(numbers) if number else None) for number in numeric
    ]


def _dates(column: Any) -> np.ndarray:
    """Convert dates with times to datetime64[ns], to UTC if they have a time zone."""
    text = column.str.strip_chars(" \t[]").str.replace(
        r"^[A-Z][a-z]{2} ([A-Z][a-z]{2}) +(\d\d?) ([\d:.,]+) (\d{4})$", "${2}-${1}-${4} ${3}"
    )
    text = _months(text).str.replace(r"^(\d{4})(\d\d)(\d\d)[T_](\d\d)(\d\d)(\d\d)", "${1}-${2}-${3}T${4}:${5}:${6}")
    text = text.str.replace(r"([T_ ])(\d\d?)-(\d\d)-(\d\d)(?:[.,_:-](\d+))?", "${1}${2}:${3}:${4}.${5}")
    parts = text.str.extract_groups(r"^([\d./-]+)(?:[T_]|,? +)([\d.,:]+\s*(?:[AaPp][Mm])?)").struct.unnest()
    day, clock = _days(parts.to_series(0)), _clocks(parts.to_series(1))
    whole = np.isfinite(clock)
    values = day + np.where(whole, np.round(np.where(whole, clock, 0.0) * 1e9), 0).astype(np.int64).astype("timedelta64[ns]")
    values[~whole] = np.datetime64("NaT")
    zones = text.str.extract(r":.*([+-]\d\d:?\d\d)$").to_numpy()
    for zone in {zone for zone in zones if zone}:
        minutes = int(zone[1:3]) * 60 + int(zone[-2:])
        values[zones == zone] -= np.timedelta64(minutes if zone[0] == "+" else -minutes, "m")
    return values


def _months(text: Any) -> Any:
    """Replace the names of months in dates by digits."""
    if text.head(1000).str.contains(r"^\d\d?[- ][A-Za-z]{3}").any():
        for number, month in enumerate(MONTHS, 1):
            text = text.str.replace(rf"(?i)^(\d\d?)[- ]{month}[a-z]*[- ]", f"${{1}}-{number:02d}-")
    return text


def _days(column: Any) -> np.ndarray:
    """Convert dates to datetime64[ns]: year first, or day first, or month first."""
    text = _months(column.str.strip_chars()).str.replace_all(r"[./]", "-")
    text = text.str.replace(r"^(\d\d?-\d\d?)-(\d\d)$", "$1-20$2")
    year_first = text.str.to_datetime("%Y-%m-%d", time_unit="ns", strict=False)
    orders = [text.str.to_datetime(form, time_unit="ns", strict=False) for form in ("%d-%m-%Y", "%m-%d-%Y")]
    # with slashes the month is often first; if both orders give dates, choose the one with fewer distinct dates
    found = min((year_first.fill_null(order) for order in orders), key=lambda one: (one.null_count(), one.n_unique()))
    return found.to_numpy().astype("datetime64[ns]")


def _clocks(column: Any) -> np.ndarray:
    """Convert times of day to s."""
    # minutes and seconds without hours get hour 0
    text = column.str.strip_chars(" \t[]").str.replace(r"^(\d\d?:\d\d[.,])", "0:$1")
    fields = text.str.extract_groups(r"^(\d\d?):(\d\d?):(\d\d?)(?:[.,:](\d+))?\s*([AaPp])?").struct.unnest()
    hours, minutes, seconds, fraction = (fields.to_series(k).cast(float, strict=False).to_numpy() for k in range(4))
    digits = _digits(fields.to_series(3))
    half = fields.to_series(4).str.to_lowercase().fill_null("").to_numpy()
    hours = np.where(half == "", hours, hours % 12 + 12.0 * (half == "p"))
    return hours * 3600 + minutes * 60 + seconds + np.where(digits > 0, np.nan_to_num(fraction) / 10.0**digits, 0.0)


def _digits(fraction: Any) -> np.ndarray:
    """Number of digits of the fractions of a second, or that of the unit if they are counts of ms or us without leading zeros.

    Of decimals, every tenth begins with a zero; if trailing zeros are left out, none ends with one.
    """
    digits = fraction.str.len_chars().fill_null(0).to_numpy()
    most = int(digits.max(initial=0))
    counts = most and digits[digits > 0].min() < most and not fraction.str.contains(r"^0\d").any() and fraction.str.contains(r"\d0$").any()
    if counts and most not in (3, 6, 9):
        said = "the fractions of a second are counts without leading zeros, of an unclear unit; write all digits, as in 12:00:00.010"
        raise DataError(said, code="fractions")
    return np.where(digits > 0, most, 0) if counts else digits


_STAMPS = {"date": _dates, "day": _days, "clock": _clocks}


def _repair(pl: Any, content: bytes, layout: Layout) -> tuple[Any, Faults]:
    """Parse a block line by line; rows with a wrong number of fields are left out, text among numbers becomes missing; count both."""
    lines = pl.read_csv(content, separator="\x1f", quote_char=None, schema={"line": pl.String}, truncate_ragged_lines=True, **_PLAIN)
    lines = lines.with_row_index("number", offset=1)
    line = pl.col("line")
    lines = lines.with_columns(line.str.strip_chars(" \t\r" if layout.delimiter != "\t" else " \r")).drop_nulls("line")
    if layout.delimiter in ",":
        lines = lines.with_columns(line.str.strip_suffix(";"))
    lines = lines.filter((line != "") & ~line.str.contains(r"^(#|%|//)"))
    separator = layout.delimiter
    if separator == " ":
        lines = lines.with_columns(line.str.replace_all(r"\s+", " "))
    if lines.select(line.str.contains('"', literal=True).any()).item():
        # replace delimiters inside quotes, which do not separate fields
        instead = "." if layout.comma and separator == "," else " "
        plain = [separator.join(field.replace(separator, instead) for field in split(text, separator)) for text in lines["line"]]
        lines = lines.with_columns(pl.Series("line", plain, pl.String))
    fields = line.str.count_matches(separator, literal=True) + 1
    right = (fields == layout.width) | ((fields == layout.width + 1) & line.str.ends_with(separator))
    faults = Faults(lines.height)
    wrong = lines.filter(~right)
    if wrong.height:
        faults.found[layout.width] = Seen(wrong.height, *wrong.row(0))
        lines = lines.filter(right)
    lines = lines.with_columns(pl.when(fields > layout.width).then(line.str.strip_suffix(separator)).otherwise(line).alias("line"))
    text = "\n".join(lines["line"].to_list()).encode()
    strings = {f"c{j}": pl.String for j in range(layout.width)}
    frame = pl.read_csv(text, separator=separator, quote_char=None, schema=strings, null_values=list(MISSING), **_PLAIN)
    return frame.select(_cast(pl, frame, j, layout, lines["number"], faults) for j in range(layout.width)), faults


def _cast(pl: Any, frame: Any, j: int, layout: Layout, numbers: Any, faults: Faults) -> Any:
    column = frame.to_series(j).str.strip_chars()
    column = column.set(column.is_in(list(MISSING)).fill_null(False), None)
    kind = layout.kinds[j]
    if kind in ("text", *STAMPS):
        return column
    if layout.comma:
        column = column.str.replace(",", ".", literal=True)
    values = column.cast(pl.Float64, strict=False)
    if kind == "long" and (whole := column.cast(pl.Int64, strict=False)).null_count() == values.null_count():
        values = whole
    bad = (values.is_null() & column.is_not_null()).arg_true()
    if len(bad):
        faults.found[j] = Seen(len(bad), numbers[int(bad[0])], column[int(bad[0])])
    return values
