"""The numbers behind a figure, in a table that opens."""

from collections.abc import Iterable, Sequence
from typing import Any

from ._html import Markup, each, tag


def numbers(title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> Markup:
    """A table that opens on demand; the first cell of a row is its name.

    Examples
    --------
    >>> from jaxcal.report._numbers import numbers
    >>> numbers("Numbers of x", ("τ (s)", "deviation"), [(1, 2.5)])[:40]
    '<details><summary>Numbers of x</summary>'
    """
    return tag("details", tag("summary", title), table_of(title, columns, rows))


def table_of(title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> Markup:
    """The table alone, in a region that scrolls."""
    head = tag("tr", *(tag("th", name, scope="col") for name in columns))
    body = [tag("tr", tag("th", first, scope="row"), each("td", cells)) for first, *cells in rows]
    table = tag("table", tag("caption", title), tag("thead", head), tag("tbody", *body))
    return scroll(table, title, "numbers")


def scroll(content: Markup, label: str, more: str = "") -> Markup:
    """What may be wider than a phone, in a region that scrolls by itself and takes the focus."""
    return tag("div", content, class_=f"scroll {more}".strip(), tabindex="0", role="region", aria_label=label)


def shown(count: int, most: int = 300) -> list[int]:
    """Indices of the rows that a table on a logarithmic scale lists: all, or so many evenly on that scale."""
    if count <= most:
        return list(range(count))
    return sorted({round(count ** (i / (most - 1))) - 1 for i in range(most)})
