"""The rows of a text table, block by block: threads parse side by side, and neither the text nor a frame of all rows is held."""

import collections
import dataclasses
import functools
import itertools
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from .._errors import DataError
from ._mend import Faults, mend
from ._sniff import MISSING, Layout
from ._text import Text


@dataclasses.dataclass
class Block:
    """Columns of one block, of how many rows and bytes, and what was wrong with it."""

    columns: list[np.ndarray]
    rows: int
    size: int
    faults: Faults


def polars() -> Any:
    """The library that parses."""
    try:
        import polars
    except ImportError as error:
        raise DataError('reading tables needs polars: pip install "jaxcal[csv]"') from error
    return polars


def blocks(text: Text, layout: Layout) -> Iterator[Block]:
    """The blocks of a table, in order; some are parsed ahead."""
    return _parsed_ahead(layout, text.blocks(text.start(layout.skip)))


def stretch(text: Text, layout: Layout, edges: list[int]) -> Iterator[Block]:
    """The blocks between successive places in the text."""
    return _parsed_ahead(layout, (functools.partial(text.part, at, end) for at, end in itertools.pairwise(edges)))


def row_edges(text: Text, layout: Layout) -> tuple[list[int], np.ndarray]:
    """Where blocks begin in a text that is not packed, and how many rows stand before each, ends included.

    Raises
    ------
    DataError
        If a row does not fit: read in chunks there is nobody to be told.
    """
    edges = text.edges(text.start(layout.skip))
    counts, lines = [0], _Lines(text, layout)
    for index, block in enumerate(stretch(text, layout, edges)):
        counts.append(block.rows)
        if block.faults.any:
            said = Faults().joined(block.faults, lines.before(index)).judged(layout)
            raise DataError(f"{said[0].rpartition(';')[0]}; convert it once with `jaxcal convert LOG LOG.npz`, which mends it and says so")
    return edges, np.cumsum(counts)


def _parsed_ahead(layout: Layout, reads: Iterator[Callable[[], bytes]]) -> Iterator[Block]:
    pl, threads = polars(), os.cpu_count() or 1
    with ThreadPoolExecutor(threads) as pool:
        ahead = collections.deque()
        try:
            for read in reads:
                ahead.append(pool.submit(parse, pl, read, layout))
                if len(ahead) > threads + 1:
                    yield ahead.popleft().result()
            while ahead:
                yield ahead.popleft().result()
        finally:
            for future in ahead:
                future.cancel()


def parse(pl: Any, read: Callable[[], bytes], layout: Layout) -> Block:
    """The rows of one block."""
    text = read()
    frame, faults = (None if layout.padded else _parsed(pl, text, layout)), None
    if frame is None or not _fits(pl, frame, layout, text):
        frame, faults = mend(pl, text, layout)
    if frame.to_series(layout.width - 1).null_count():
        frame = frame.filter(~pl.all_horizontal(pl.all().is_null()))
    columns = [dates(frame.to_series(j)) if kind == "date" else frame.to_series(j).to_numpy() for j, kind in enumerate(layout.kinds)]
    return Block(columns, frame.height, len(text), faults or Faults(frame.height))


def _parsed(pl: Any, text: bytes, layout: Layout) -> Any:
    """The rows as a frame, or None where they do not fit."""
    plain = not (b'"' in text or (layout.comment or "#").encode() in text or {"date", "text"} & set(layout.kinds))
    # to look for quotes, comments and words that stand for a missing value takes as long as the numbers
    for quick in (True, False) if plain else (False,):
        more = {"quote_char": None} if quick else {"null_values": list(MISSING), "comment_prefix": layout.comment}
        try:
            return pl.read_csv(
                text, has_header=False, separator=layout.delimiter, schema=_schema(pl, layout), decimal_comma=layout.comma,
                encoding="utf8-lossy", raise_if_empty=False, **more,
            )  # fmt: skip
        except (pl.exceptions.ComputeError, pl.exceptions.SchemaError):
            continue
    return None


def _schema(pl: Any, layout: Layout) -> dict[str, Any]:
    types = {"int": pl.Float64, "long": pl.Int64, "float": pl.Float64, "date": pl.String, "text": pl.String}
    schema = {f"c{j}": types[kind] for j, kind in enumerate(layout.kinds)}
    return schema | ({"end": pl.String} if layout.trailing else {})


def _fits(pl: Any, frame: Any, layout: Layout, text: bytes) -> bool:
    """Whether no row looks cut short or overlong: a row cut short ends in nulls, as do a blank line and a missing last value."""
    if layout.trailing and frame["end"].drop_nulls().len():
        return False
    nulls = frame.to_series(layout.width - 1).null_count()
    if not nulls or nulls == frame.select(pl.all_horizontal(pl.all().is_null()).sum()).item():
        return True
    # a last column without any value
    fields = text.count(layout.delimiter.encode()) == (layout.width - 1 + layout.trailing) * frame.height
    return nulls == frame.height and fields and b'"' not in text


def gather(text: Text, layout: Layout, warnings: list[str]) -> list[np.ndarray]:
    """All rows, column by column; those of numbers are the rows of one array.

    Raises
    ------
    DataError
        If more than 1 % of the rows do not fit.
    """
    places = {j: i for i, j in enumerate(j for j, kind in enumerate(layout.kinds) if kind in ("int", "float"))}
    others: dict[int, list[np.ndarray]] = {j: [] for j in range(layout.width) if j not in places}
    numbers = np.empty((len(places), 0))
    rows, faults, lines = 0, Faults(), _Lines(text, layout)
    for index, block in enumerate(blocks(text, layout)):
        end = rows + block.rows
        if end > numbers.shape[1]:
            numbers = _longer(numbers, rows, _expected(text, block, end))
        for j, column in enumerate(block.columns):
            if j in places:
                numbers[places[j], rows:end] = column
            else:
                others[j].append(column)
        faults, rows = faults.joined(block.faults, lines.before(index) if block.faults.any else 0), end
    warnings.extend(faults.judged(layout))
    return [numbers[places[j], :rows] if j in places else _whole(others[j]) for j in range(layout.width)]


class _Lines:
    """How many lines stand before a block, counted when something is wrong in it."""

    def __init__(self, text: Text, layout: Layout) -> None:
        self._reads, self._at, self._lines = text.blocks(text.start(layout.skip)), 0, layout.skip

    def before(self, index: int) -> int:
        while self._at < index:
            self._lines += next(self._reads)().count(b"\n")
            self._at += 1
        return self._lines


def _expected(text: Text, block: Block, rows: int) -> int:
    """Rows to make room for; what is not needed costs no memory, as it is never touched."""
    if text.size is None or not block.size:
        return 2 * rows
    return max(int(1.05 * block.rows * text.size / block.size), rows + rows // 4)


def _longer(numbers: np.ndarray, rows: int, size: int) -> np.ndarray:
    longer = np.empty((len(numbers), size))
    longer[:, :rows] = numbers[:, :rows]
    return longer


def _whole(parts: list[np.ndarray]) -> np.ndarray:
    return np.concatenate(parts) if parts else np.empty(0)


def dates(column: Any) -> np.ndarray:
    """ISO 8601 dates as datetime64[ns], in UTC where they carry a zone."""
    text = column.str.replace_all("/", "-", literal=True).str.replace(",", ".", literal=True).str.replace(" ", "T", literal=True)
    clock = text.str.extract(r"^(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(?:\.\d{1,9})?)")
    values = clock.str.to_datetime("%Y-%m-%dT%H:%M:%S%.f", time_unit="ns", strict=False).to_numpy().astype("datetime64[ns]")
    zones = text.str.extract(r"T.*([+-]\d\d:?\d\d)$").to_numpy()
    for zone in {zone for zone in zones if zone}:
        minutes = int(zone[1:3]) * 60 + int(zone[-2:])
        values[zones == zone] -= np.timedelta64(minutes if zone[0] == "+" else -minutes, "m")
    return values
