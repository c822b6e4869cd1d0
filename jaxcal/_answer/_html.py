"""Results as HTML, for notebooks and reports; and how to write HTML so that no text can become markup."""

import html
import math
import re
from collections.abc import Iterable
from typing import Any

from .._message import Reader
from .._units import number, shown_in, unit_label
from ._findings import NOTE, Finding, merged
from ._sections import Grid, Number, Section
from ._text import cell_text, row_unit

_VOID = ("meta", "br", "hr", "col")


class Markup(str):
    """Text that is already HTML."""

    __slots__ = ()


def tag(name: str, /, *content: Any, **attributes: Any) -> Markup:
    """Make an element; every attribute is escaped, and so is content that is not `Markup`.

    In attribute names a trailing underscore is dropped, and other underscores become hyphens; a value of None omits the attribute.

    Examples
    --------
    >>> from jaxcal._answer._html import tag
    >>> tag("p", "a < b", tag("b", "c"), class_="lead")
    '<p class="lead">a &lt; b<b>c</b></p>'
    """
    pairs = ((key.rstrip("_").replace("_", "-"), value) for key, value in attributes.items() if value is not None)
    start = name + "".join(f' {key}="{html.escape(str(value))}"' for key, value in pairs)
    if name in _VOID:
        return Markup(f"<{start}>")
    return Markup(f"<{start}>{join(content)}</{name}>")


def join(content: Any) -> Markup:
    """Concatenate pieces."""
    return Markup("".join(piece if isinstance(piece, Markup) else html.escape(str(piece)) for piece in content))


def each(name: str, items: Any) -> Markup:
    """Make an element for every item."""
    return join(tag(name, item) for item in items)


def grid_html(grid: Grid) -> Markup:
    """A table of numbers: the value with half of its 95 % interval, and the interval itself below."""
    head = tag("thead", tag("tr", *(tag("th", name, scope="col") for name in (grid.title, "", *grid.columns))))
    names = (*grid.columns, "")

    def cell(i: int, one: Number | str | None) -> Markup:
        named = one.name if isinstance(one, Number) else None
        return tag("td", _cell(one), data_axis=names[i], data_number=named)

    rows = (
        tag(
            "tr",
            tag("th", label, scope="row"),
            tag("td", unit_label(row_unit(cells)), class_="small"),
            *(cell(i, one) for i, one in enumerate(cells)),
        )
        for label, cells in grid.rows
    )
    table = tag("table", head, tag("tbody", *rows), class_="grid matrix")
    return join((table, tag("p", grid.note, class_="small"))) if grid.note else table


def _cell(cell: Number | str | None) -> Markup:
    remark = cell.remark if isinstance(cell, Number) else ""
    said = tag("span", cell_text(cell._replace(remark="") if isinstance(cell, Number) else cell), class_="number")
    said = join((said, " ", tag("span", remark, class_="small"))) if remark else said
    if not isinstance(cell, Number) or cell.state != "estimated" or not math.isfinite(cell.half) or not cell.half > 0:
        return said
    size = shown_in(cell.quantity)[1]
    # a digit more than the value has, so that the limits of a narrow interval differ
    limits = " to ".join(number(float(limit) / size, cell.half / size / 10) for limit in (cell.low, cell.high))
    return join((said, tag("span", limits, class_="small exact")))


def findings_html(findings: Iterable[Finding], reader: Reader = "python") -> Markup:
    """Findings as a list, the worst first; those that ask for action are marked, and options are spelt for the reader."""
    items = [
        tag("li", *_unbroken(one.spelt(reader)), class_="caution" if one.severity > NOTE else "note", data_code=one.code)
        for one in merged(findings)
    ]
    return tag("ul", *items, class_="findings") if items else Markup("")


def _unbroken(text: str) -> Iterable[str]:
    """A sentence in which no line ends within the name of an option."""
    pieces = re.split(r"(--[a-z][\w-]*)", text)
    return (tag("span", piece, class_="option") if piece.startswith("--") else piece for piece in pieces)


def answer_html(verdict: str, headline: str, sections: Iterable[Section], findings: Iterable[Finding]) -> Markup:
    """The verdict, the tables and all findings of a result."""
    tables = [grid_html(one) for one in sections if isinstance(one, Grid) and one.rows]
    return join((tag("p", tag("b", verdict), f" {headline}"), *tables, findings_html(findings)))
