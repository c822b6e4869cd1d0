"""A block of a text table in which something does not fit: line by line, and what is wrong is counted."""

import dataclasses
from typing import Any

from .._errors import DataError
from ._sniff import MISSING, Layout, split

#: part of the rows that may be damaged before the table is refused
_TOLERATED = 0.01


@dataclasses.dataclass
class Seen:
    """Something that was found `count` times, first in line `number`, which reads `shown`."""

    count: int
    number: int
    shown: str

    def joined(self, other: "Seen", lines: int) -> "Seen":
        """With what a later block holds, of which `lines` stand before it."""
        return Seen(self.count + other.count, *((self.number, self.shown) if self.count else (other.number + lines, other.shown)))


@dataclasses.dataclass
class Faults:
    """What was found in the lines of a block, or of a table."""

    rows: int = 0
    wrong: Seen = dataclasses.field(default_factory=lambda: Seen(0, 0, ""))
    text: dict[int, Seen] = dataclasses.field(default_factory=dict)

    @property
    def any(self) -> bool:
        """Whether there is something wrong."""
        return bool(self.wrong.count or self.text)

    def joined(self, other: "Faults", lines: int) -> "Faults":
        """With those of a later block, of which `lines` stand before it."""
        nothing = Seen(0, 0, "")
        text = {j: self.text.get(j, nothing) for j in {**self.text, **other.text}}
        text = {j: seen.joined(other.text[j], lines) if j in other.text else seen for j, seen in text.items()}
        return Faults(self.rows + other.rows, self.wrong.joined(other.wrong, lines), text)

    def judged(self, layout: Layout) -> list[str]:
        """A sentence on each.

        Raises
        ------
        DataError
            If more than 1 % of the rows are wrong.
        """
        said = []
        if self.wrong.count:
            sentence = (
                f"{self.wrong.count} of {self.rows} rows do not have {layout.width} fields; the first is line {self.wrong.number}: "
                f"{self.wrong.shown[:80]!r}"
            )
            if self.wrong.count > max(1, _TOLERATED * self.rows):
                raise DataError(f"{sentence}; mend the file, or remove these lines")
            said.append(f"{sentence}; they are left out")
        rows = self.rows - self.wrong.count
        for j, seen in sorted(self.text.items()):
            name = f"column {j}" + (f" ({layout.names[j]})" if layout.names[j] else "")
            sentence = (
                f"{name} holds text instead of a number in {seen.count} of {rows} rows; the first is {seen.shown!r} in line {seen.number}"
            )
            if seen.count > max(1, _TOLERATED * rows):
                raise DataError(f"{sentence}; mend the file, or leave the column out with columns= (--columns)")
            said.append(f"{sentence}; they are treated as missing")
        return said


def mend(pl: Any, content: bytes, layout: Layout) -> tuple[Any, Faults]:
    """The rows of a block as a frame, and what is wrong: rows of the wrong width are left out, text among numbers is blanked out."""
    lines = pl.read_csv(
        content, has_header=False, separator="\x1f", quote_char=None, schema={"line": pl.String}, encoding="utf8-lossy",
        truncate_ragged_lines=True, raise_if_empty=False,
    ).with_row_index("number", offset=1)  # fmt: skip
    line = pl.col("line")
    lines = lines.with_columns(line.str.strip_chars(" \t\r" if layout.delimiter != "\t" else " \r")).drop_nulls("line")
    lines = lines.filter((line != "") & ~line.str.contains(r"^(#|%|//)"))
    separator = layout.delimiter
    if separator == " ":
        lines = lines.with_columns(line.str.replace_all(r"\s+", " "))
    if lines.select(line.str.contains('"', literal=True).any()).item():
        # delimiters inside quotes are no delimiters
        plain = [separator.join(field.replace(separator, " ") for field in split(text, separator)) for text in lines["line"]]
        lines = lines.with_columns(pl.Series("line", plain, pl.String))
    fields = line.str.count_matches(separator, literal=True) + 1
    right = (fields == layout.width) | ((fields == layout.width + 1) & line.str.ends_with(separator))
    faults = Faults(lines.height)
    wrong = lines.filter(~right)
    if wrong.height:
        faults.wrong = Seen(wrong.height, *wrong.row(0))
        lines = lines.filter(right)
    lines = lines.with_columns(pl.when(fields > layout.width).then(line.str.strip_suffix(separator)).otherwise(line).alias("line"))
    text = "\n".join(lines["line"].to_list()).encode()
    strings = {f"c{j}": pl.String for j in range(layout.width)}
    frame = pl.read_csv(
        text, has_header=False, separator=separator, schema=strings, null_values=list(MISSING), quote_char=None, raise_if_empty=False
    )
    return frame.select(_cast(pl, frame, j, layout, lines["number"], faults) for j in range(layout.width)), faults


def _cast(pl: Any, frame: Any, j: int, layout: Layout, numbers: Any, faults: Faults) -> Any:
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
        faults.text[j] = Seen(len(bad), numbers[int(bad[0])], column[int(bad[0])])
    return values
