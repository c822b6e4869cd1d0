"""HTML, written so that no text can become markup, and the pieces that all pages are made of."""

import datetime
import html
import re
from collections.abc import Iterable, Sequence
from typing import Any

from .._results import plain

_VOID = ("meta", "br", "hr", "col")


class Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


def tag(name: str, /, *content: Any, **attributes: Any) -> Markup:
    """An element; content that is not `Markup` is escaped, and so is every attribute.

    A trailing underscore of an attribute is dropped, another becomes a hyphen; None leaves the attribute out.

    Examples
    --------
    >>> from jaxcal.report._html import tag
    >>> tag("p", "a < b", tag("b", "c"), class_="lead")
    '<p class="lead">a &lt; b<b>c</b></p>'
    """
    pairs = ((key.rstrip("_").replace("_", "-"), value) for key, value in attributes.items() if value is not None)
    start = name + "".join(f' {key}="{html.escape(str(value))}"' for key, value in pairs)
    if name in _VOID:
        return Markup(f"<{start}>")
    return Markup(f"<{start}>{join(content)}</{name}>")


def join(content: Any) -> Markup:
    """Pieces one after the other."""
    return Markup("".join(piece if isinstance(piece, Markup) else html.escape(str(piece)) for piece in content))


def each(name: str, items: Any) -> Markup:
    """An element for every item."""
    return join(tag(name, item) for item in items)


def inside(prefix: str, content: Markup) -> Markup:
    """A page's content as a part of another: its ids and what refers to them begin with `prefix`, its headings are one level lower.

    Examples
    --------
    >>> from jaxcal.report._html import inside, tag
    >>> inside("a-", tag("h2", 'url(#x) id="x"', id="x"))
    '<h3 id="a-x">url(#x) id=&quot;x&quot;</h3>'
    """
    # in text and in attributes < and > are escaped, so that this finds elements and nothing else
    return Markup(re.sub("<[^>]*>", lambda found: _moved(prefix, found[0]), content))


def _moved(prefix: str, element: str) -> str:
    element = re.sub(r'( id="| href="#|url\(#)', lambda found: f"{found[1]}{prefix}", element)
    names = r'(?<= aria-labelledby=")[^"]*|(?<= aria-describedby=")[^"]*'
    element = re.sub(names, lambda found: " ".join(prefix + name for name in found[0].split()), element)
    return re.sub(r"^(</?)h([2-5])(?=[ >])", lambda found: f"{found[1]}h{int(found[2]) + 1}", element)


def section(title: str, name: str, *content: Any) -> Markup:
    """A part of a page below a heading, by which links find it."""
    return tag("section", tag("h2", title, id=name), *content, aria_labelledby=name)


def definitions(pairs: Iterable[tuple[Any, Any]]) -> Markup:
    """Words, and what each of them means or holds."""
    return tag("dl", *(piece for word, text in pairs for piece in (tag("dt", word), tag("dd", text))))


def table(columns: Sequence[str], rows: Iterable[Sequence[Any]], caption: str | None = None, class_: str | None = None) -> Markup:
    """A table; the first cell of a row is its name."""
    head = tag("thead", tag("tr", *(tag("th", name, scope="col") for name in columns)))
    named = [*columns, ""] if class_ in ("terms", "matrix") else [None]  # a phone shows the name of the column in the cell

    def cell(i: int, content: Any) -> Markup:
        return tag("td", content, data_axis=named[min(i, len(named) - 1)])

    body = tag(
        "tbody", *(tag("tr", tag("th", first, scope="row"), *(cell(i, one) for i, one in enumerate(cells, 1))) for first, *cells in rows)
    )
    return tag("table", *(() if caption is None else (tag("caption", caption),)), head, body, class_=class_)


def scroll(content: Markup, label: str, class_: str = "scroll") -> Markup:
    """What may be wider than a phone, in a region that scrolls by itself and takes the focus."""
    return tag("div", content, class_=class_, tabindex="0", role="region", aria_label=label)


def numbers(title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> Markup:
    """The numbers behind a figure, in a table that opens on demand."""
    return tag("details", tag("summary", title), numbers_table(title, columns, rows))


def numbers_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> Markup:
    """The table alone, in a region that scrolls."""
    return scroll(table(columns, rows, title), title, "scroll numbers")


def warnings_of(log: Any, said: Iterable[str]) -> Markup:
    """Warnings of the log, then those of the result."""
    lines = [*(() if log is None else log.warnings), *said]
    return section("Warnings", "warnings", tag("ul", each("li", lines or ["None."])))


def recording(log: Any) -> Markup:
    """What the log is, and what was guessed to read it."""
    if log is None:
        return Markup("")
    notes = [tag("h3", "How it was read"), tag("ul", each("li", log.notes))] if log.notes else []
    summary = tag("pre", log.summary(), tabindex="0", role="region", aria_label="Summary of the recording")
    return section("Recording", "recording", summary, *notes)


def provenance(known: dict[str, Any], log: Any) -> Markup:
    """Where the numbers come from: what is `known`, then what the log says, in words."""
    for key, value in plain(log.provenance if log is not None else {}).items():
        if key == "epoch_ns":
            if (when := recorded(log)) is not None:
                known["First sample"] = when
        elif (text := _words(value)) != "":
            known[str(_LABELS.get(key, key.replace("_", " ").capitalize()))] = text
    return section("Provenance", "provenance", definitions(known.items()))


_LABELS = {"sha256": "SHA-256", "size": "Size in bytes", "rate": "Sampling rate"}
_YEAR_2000 = 946_684_800  # s; a log whose clock says less does not know its date


def recorded(log: Any) -> str | None:
    """When a recording began, where it knows."""
    seconds = int(getattr(log, "provenance", {}).get("epoch_ns", 0)) // 1_000_000_000
    if seconds < _YEAR_2000:
        return None
    return f"{datetime.datetime.fromtimestamp(seconds, datetime.UTC):%Y-%m-%d %H:%M:%S} UTC"


def _words(value: Any) -> str:
    """A value as people write it; nothing for what was not given."""
    if isinstance(value, dict):
        return "; ".join(f"{key} {text}".strip() for key, item in value.items() if (text := _words(item)) != "")
    if isinstance(value, list):
        return ", ".join(_words(item) for item in value)
    if value is None or value is False:
        return ""
    return "yes" if value is True else f"{value:.9g}" if isinstance(value, float) else str(value)
