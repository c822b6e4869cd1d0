"""Results as text, for the terminal and for `print`: one number a row and axis, and at most three things to know."""

import math
import textwrap
from collections.abc import Iterable, Sequence

from .._message import Reader
from .._units import number, shown_in
from ._findings import Finding, joined, merged
from ._sections import Grid, Number, Section

_WIDTH = 80  # characters of a line of a terminal
#: findings shown without `-v`: a reader acts on three at most
_FEW = 3
_EXACT = 1e-10  # relative half-width below which an interval is rounding, and the value exact


def cell_text(cell: Number | str | None, wanted: Sequence[str] = (), digits: int = 2) -> str:
    """One number with half of its 95 % interval to some digits, in the unit of the reader.

    Examples
    --------
    >>> from jaxcal._answer import Number, cell_text
    >>> cell_text(Number("b", 5e-6, 4e-6, 6e-6, "mag")), cell_text(Number("K", 0.0, high=2e-6, quantity="mag", state="limit"))
    ('5.0 ± 1.0', '< 2.0')
    >>> cell_text(Number("m", 1.0, state="held")), cell_text(Number("d", float("nan"), state="open"))
    ('1 held', 'open')
    """
    if cell is None or isinstance(cell, str):
        return cell or ""
    size = shown_in(cell.quantity, wanted)[1]
    value, half = float(cell.value) / size, float(cell.half) / size
    if cell.state == "open" or (cell.state == "limit" and not math.isfinite(cell.high)):
        said = "open"
    elif cell.state == "limit":
        said = f"< {number(float(cell.high) / size, float(cell.high) / size / 2)}"
    elif cell.state == "held":
        said = f"{value:.6g} held"
    elif math.isfinite(half) and half > _EXACT * abs(value):
        shown = half * 10 ** (2 - digits)
        said, apart = number(value, shown), number(half, shown)
        # both in one notation, so that a reader can add them
        said += f" ± {half:.{len(said.partition('.')[2])}f}" if "e" in apart and "e" not in said else f" ± {apart}"
    else:
        said = f"{value:.4g}"
    return f"{said} {cell.remark}".strip()


def row_unit(cells: Iterable[Number | str | None], wanted: Sequence[str] = ()) -> str:
    """Unit of a row, which its first number gives."""
    return next((shown_in(cell.quantity, wanted)[0] for cell in cells if isinstance(cell, Number)), "")


def grid_lines(grid: Grid, wanted: Sequence[str] = (), width: int = _WIDTH) -> list[str]:
    r"""A table as lines: its title above the labels, a column for the unit, and one column for each axis.

    A table that is too wide gets narrower gaps, then one digit less; then a label such as "N  angle random walk" loses its words.

    Examples
    --------
    >>> from jaxcal._answer import Number, by_axis, grid_lines
    >>> bias = [Number(f"gyro.bias[{i}]", x, x - 1e-4, x + 1e-4, "gyro") for i, x in enumerate((0.0, -1e-3, 2e-3))]
    >>> print("\n".join(grid_lines(by_axis("gyro", "gyroscope", bias))))
    gyroscope           x                 y                  z
    bias        deg/s   0.0000 ± 0.0057   -0.0573 ± 0.0057   0.1146 ± 0.0057
    """
    lines: list[str] = []
    for gap, digits, words in ((3, 2, True), (2, 2, True), (2, 1, True), (2, 2, False), (2, 1, False), (1, 1, False)):
        labels = [grid.title, *(label if words else label.strip().partition("  ")[0] for label, _ in grid.rows)]
        units = ["", *(row_unit(cells, wanted) for _, cells in grid.rows)]
        columns = [
            [name, *_aligned([cell_text(cells[i], wanted, digits) for _, cells in grid.rows])] for i, name in enumerate(grid.columns)
        ]
        # a title may be wider than all labels; without headings of columns it runs on above them
        first = max(map(len, labels if any(grid.columns) else labels[1:]), default=0)
        widths = [first, *(max(map(len, column)) for column in (units, *columns))]
        rows = zip(labels, units, *columns, strict=True)
        space = " " * gap
        lines = [space.join(cell.ljust(size) for cell, size in zip(row, widths, strict=True) if size).rstrip() for row in rows]
        if max(map(len, lines)) <= width:
            break
    return lines


def _aligned(cells: Sequence[str]) -> list[str]:
    """Cells of a column with the signs ± below one another, and values that are held in line with them."""
    signs = [next((sign for sign in (" ± ", " held") if sign in cell), "") for cell in cells]
    split = [cell.partition(sign) if sign else (cell, "", "") for cell, sign in zip(cells, signs, strict=True)]
    size = max((len(value) for value, sign, _ in split if sign), default=0)
    return [f"{value.rjust(size)}{sign}{half}" if sign else value for value, sign, half in split]


def aligned(rows: Sequence[Sequence[str]], gap: int = 3) -> list[str]:
    """Rows of cells as lines, with the cells of a column below one another."""
    widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)]
    return [(" " * gap).join(cell.ljust(size) for cell, size in zip(row, widths, strict=True)).rstrip() for row in rows]


def titled(title: str, lines: Sequence[str]) -> list[str]:
    """Lines below a title; nothing without lines."""
    return ["", title, *lines] if lines else []


def bullets(sentences: Iterable[str], width: int = _WIDTH) -> list[str]:
    """A wrapped bullet for each sentence."""
    return [line for said in sentences for line in textwrap.wrap(said, width, initial_indent=" - ", subsequent_indent="   ",
                                                                break_long_words=False, break_on_hyphens=False)]  # fmt: skip


def tables(
    verdict: str, headline: str, sections: Iterable[Section], findings: Iterable[Finding], *, reader: Reader = "python",
    wanted: Sequence[str] = (), verbose: bool = False, width: int = _WIDTH,
) -> list[str]:  # fmt: skip
    """The first part of an answer: guesses that matter, the verdict with its one number, and the tables.

    Parameters
    ----------
    verdict, headline : of the result; a verdict of "" is left out.
    sections, findings : of the result, and of its recording.
    reader, wanted : who reads it, and the units wanted.
    verbose : show tables of detail too.
    width : characters a line.
    """
    guesses = [one.spelt(reader, wanted) for one in joined(findings) if one.kind.guess and not verbose]
    head = f"{verdict}: {headline}" if verdict and headline else verdict or headline
    lines = bullets(guesses, width) + textwrap.wrap(head, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
    for grid in sections:
        if isinstance(grid, Grid) and grid.rows and (verbose or not grid.detail):
            lines += ["", *grid_lines(grid, wanted, width)]
            lines += textwrap.wrap(grid.note, width, initial_indent="  ", subsequent_indent="  ")
    return lines


def things_to_know(
    findings: Iterable[Finding], *, reader: Reader = "python", wanted: Sequence[str] = (), verbose: bool = False, width: int = _WIDTH,
    more: str = "",
) -> list[str]:  # fmt: skip
    """The second part of an answer: the three findings that matter most, the worst first; all of them if `verbose`.

    more : where the findings that are left out stand, such as "-v, or the report"; "" to say nothing of them.
    """
    told = merged(findings) if verbose else [one for one in joined(findings) if not one.kind.guess]
    shown = told if verbose else told[:_FEW]
    lines = bullets(dict.fromkeys(one.spelt(reader, wanted) for one in shown), width)
    if more and len(told) > len(shown):
        lines.append(f"   {len(told) - len(shown)} more: {more}")
    return ["", *lines] if lines else []
