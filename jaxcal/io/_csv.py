"""Text tables (CSV, TSV, blanks), plain or gzipped, through polars."""

import gzip
import io
import pathlib
import zlib
from typing import Any

import numpy as np

from .._errors import DataError
from ._sniff import MISSING, Layout, sniff, split
from ._table import Table

_HEAD = 1 << 18
#: part of the rows that may be damaged before the table is refused
_TOLERATED = 0.01


def is_gzip(path: pathlib.Path) -> bool:
    """Whether a file starts as gzip does."""
    with path.open("rb") as file:
        return file.read(2) == b"\x1f\x8b"


def read_csv(path: pathlib.Path) -> Table:
    """Columns of a text table.

    Rows with the wrong number of fields are left out, and text in a column of numbers is a missing value; both are counted, and
    more than 1 % of either is an error that shows the first.
    """
    try:
        import polars as pl
    except ImportError as error:
        raise DataError('reading tables needs polars: pip install "jaxcal[csv]"') from error

    head, whole = _head(path)
    encoding = _encoding(head)
    text = head.decode(encoding, errors="replace")
    if not whole:
        text = text[: text.rfind("\n") + 1] or text
    if not text.strip():
        raise DataError("the file is empty")
    layout = sniff(text)
    source: Any = path
    # polars reads UTF-8 and ends lines at \n
    if encoding.startswith("utf-16") or ("\n" not in text and "\r" in text):
        content = _content(path).decode(encoding, errors="replace")
        source = content.replace("\r\n", "\n").replace("\r", "\n").encode()

    warnings: list[str] = []
    frame = None
    if not layout.padded:
        try:
            frame = _parse(pl, source, layout, layout.skip)
        except (pl.exceptions.ComputeError, pl.exceptions.SchemaError):
            frame = None
    if frame is None or not _fits(pl, frame, layout):
        # something does not fit: look at the lines themselves (gzip then also checks its checksum)
        content = source if isinstance(source, bytes) else _content(path)
        frame = _repair(pl, content, layout, warnings)
    if frame.to_series(layout.width - 1).null_count():
        frame = frame.filter(~pl.all_horizontal(pl.all().is_null()))
    columns = [_dates(frame.to_series(j)) if kind == "date" else frame.to_series(j).to_numpy() for j, kind in enumerate(layout.kinds)]
    integer = {j for j, kind in enumerate(layout.kinds) if kind in ("int", "long")}
    return Table(columns, layout.names, integer, warnings=warnings)


def _head(path: pathlib.Path) -> tuple[bytes, bool]:
    """The first bytes of the text, and whether that is all of it."""
    with gzip.open(path) if is_gzip(path) else path.open("rb") as file:
        try:
            head = file.read(_HEAD)
            return head, not file.read(1)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise _damaged(error) from error


def _content(path: pathlib.Path) -> bytes:
    if not is_gzip(path):
        return path.read_bytes()
    try:
        with gzip.open(path) as file:
            return file.read()
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


def _schema(pl: Any, layout: Layout) -> dict[str, Any]:
    types = {"int": pl.Float64, "long": pl.Int64, "float": pl.Float64, "date": pl.String, "text": pl.String}
    schema = {f"c{j}": types[kind] for j, kind in enumerate(layout.kinds)}
    return schema | ({"end": pl.String} if layout.trailing else {})


def _parse(pl: Any, source: Any, layout: Layout, skip: int) -> Any:
    # the streaming engine reads twice as fast as read_csv, and holds neither the file nor a second copy
    return pl.scan_csv(
        io.BytesIO(source) if isinstance(source, bytes) else source,
        has_header=False,
        skip_lines=skip,
        separator=layout.delimiter,
        schema=_schema(pl, layout),
        null_values=list(MISSING),
        decimal_comma=layout.comma,
        comment_prefix=layout.comment,
        encoding="utf8-lossy",
        glob=False,
    ).collect(engine="streaming")


def _fits(pl: Any, frame: Any, layout: Layout) -> bool:
    """Whether no row looks cut short or overlong: a row cut short ends in nulls, as do a blank line and a missing last value."""
    if layout.trailing and frame["end"].drop_nulls().len():
        return False
    nulls = frame.to_series(layout.width - 1).null_count()
    return not nulls or nulls in (frame.height, frame.select(pl.all_horizontal(pl.all().is_null()).sum()).item())


def _repair(pl: Any, content: bytes, layout: Layout, warnings: list[str]) -> Any:
    """Parse line by line in whole columns: drop rows of the wrong width, blank out text among numbers, and count both."""
    lines = pl.read_csv(
        content, has_header=False, separator="\x1f", quote_char=None, schema={"line": pl.String}, skip_lines=layout.skip,
        encoding="utf8-lossy", truncate_ragged_lines=True,
    ).with_row_index("number", offset=layout.skip + 1)  # fmt: skip
    line = pl.col("line")
    lines = lines.with_columns(line.str.strip_chars(" \t\r" if layout.delimiter != "\t" else " \r")).drop_nulls("line")
    lines = lines.filter((line != "") & ~line.str.contains(r"^(#|%|//)"))
    separator = layout.delimiter
    if separator == " ":
        lines = lines.with_columns(line.str.replace_all(r"\s+", " "))
    if lines.select(line.str.contains('"', literal=True).any()).item():
        # delimiters inside quotes are no delimiters
        plain = [separator.join(field.replace(separator, " ") for field in split(text, separator)) for text in lines["line"]]
        lines = lines.with_columns(pl.Series("line", plain))
    fields = line.str.count_matches(separator, literal=True) + 1
    right = (fields == layout.width) | ((fields == layout.width + 1) & line.str.ends_with(separator))
    wrong = lines.filter(~right)
    if wrong.height:
        number, shown = wrong.row(0)
        sentence = f"{wrong.height} of {lines.height} rows do not have {layout.width} fields; the first is line {number}: {shown[:80]!r}"
        if wrong.height > max(1, _TOLERATED * lines.height):
            raise DataError(f"{sentence}; mend the file, or remove these lines")
        warnings.append(f"{sentence}; they are left out")
        lines = lines.filter(right)
    lines = lines.with_columns(pl.when(fields > layout.width).then(line.str.strip_suffix(separator)).otherwise(line).alias("line"))
    text = "\n".join(lines["line"].to_list()).encode()
    strings = {f"c{j}": pl.String for j in range(layout.width)}
    frame = pl.read_csv(text, has_header=False, separator=separator, schema=strings, null_values=list(MISSING), quote_char=None)
    return frame.select(_cast(pl, frame, j, layout, lines["number"], warnings) for j in range(layout.width))


def _cast(pl: Any, frame: Any, j: int, layout: Layout, numbers: Any, warnings: list[str]) -> Any:
    column = frame.to_series(j).str.strip_chars()
    column = column.set(column.is_in(list(MISSING)).fill_null(False), None)
    kind = layout.kinds[j]
    if kind in ("text", "date"):
        return column
    if layout.comma:
        column = column.str.replace(",", ".", literal=True)
    values = column.cast(pl.Float64, strict=False)
    if kind == "long" and (whole := column.cast(pl.Int64, strict=False)).null_count() == values.null_count():
        values = whole
    bad = (values.is_null() & column.is_not_null()).arg_true()
    if len(bad):
        first = int(bad[0])
        name = f"column {j}" + (f" ({layout.names[j]})" if layout.names[j] else "")
        sentence = (
            f"{name} holds text instead of a number in {len(bad)} of {len(column)} rows; the first is {column[first]!r} in line "
            f"{numbers[first]}"
        )
        if len(bad) > max(1, _TOLERATED * len(column)):
            raise DataError(f"{sentence}; mend the file, or leave the column out with columns= (--columns)")
        warnings.append(f"{sentence}; they are treated as missing")
    return values


def _dates(column: Any) -> np.ndarray:
    """ISO 8601 dates as datetime64[ns], in UTC where they carry a zone."""
    text = column.str.replace_all("/", "-", literal=True).str.replace(",", ".", literal=True).str.replace(" ", "T", literal=True)
    clock = text.str.extract(r"^(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(?:\.\d{1,9})?)")
    values = clock.str.to_datetime("%Y-%m-%dT%H:%M:%S%.f", time_unit="ns", strict=False).to_numpy().astype("datetime64[ns]")
    zones = text.str.extract(r"T.*([+-]\d\d:?\d\d)$").to_numpy()
    for zone in {zone for zone in zones if zone}:
        minutes = int(zone[1:3]) * 60 + int(zone[-2:])
        values[zones == zone] -= np.timedelta64(minutes if zone[0] == "+" else -minutes, "m")
    return values
