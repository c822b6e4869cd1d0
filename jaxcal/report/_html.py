"""Write HTML so that no text can become markup; common parts of all pages."""

import json
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from .._answer import plain
from .._answer._html import Markup, each, join as join, tag
from ..calibration._provenance import date_of

#: how much a page shows: points of a curve and rows of its numbers, points of a smooth line, entries of a list, and panels
MOST, FINE, LISTED, PANELS = 300, 100, 50, 8


def inside(prefix: str, content: Markup) -> Markup:
    """Make a page's content a part of another page: add `prefix` to its ids and references, and lower its headings by one level.

    Examples
    --------
    >>> from jaxcal.report._html import inside, tag
    >>> inside("a-", tag("h2", 'url(#x) id="x"', id="x"))
    '<h3 id="a-x">url(#x) id=&quot;x&quot;</h3>'
    """
    # < and > are escaped in text and attributes, so this pattern finds only elements
    return Markup(re.sub("<[^>]*>", lambda found: _moved(prefix, found[0]), content))


def _moved(prefix: str, element: str) -> str:
    element = re.sub(r'( id="| href="#|url\(#)', lambda found: f"{found[1]}{prefix}", element)
    names = r'(?<= aria-labelledby=")[^"]*|(?<= aria-describedby=")[^"]*'
    element = re.sub(names, lambda found: " ".join(prefix + name for name in found[0].split()), element)
    return re.sub(r"^(</?)h([2-5])(?=[ >])", lambda found: f"{found[1]}h{int(found[2]) + 1}", element)


def section(title: str, name: str, *content: Any) -> Markup:
    """A section of a page with a heading, whose id is the target of links."""
    return tag("section", tag("h2", title, id=name), *content, aria_labelledby=name)


def fold(title: str, name: str, *content: Any) -> Markup:
    """A section that opens on demand."""
    return tag("details", tag("summary", tag("h2", title, id=name)), *content, class_="fold")


def definitions(pairs: Iterable[tuple[Any, Any]], class_: str | None = None) -> Markup:
    """A list of terms with their definitions or values."""
    return tag("dl", *(piece for word, text in pairs for piece in (tag("dt", word), tag("dd", text))), class_=class_)


def table(columns: Sequence[str], rows: Iterable[Sequence[Any]], caption: str | None = None, class_: str | None = None) -> Markup:
    """A table; the first cell of a row is its name."""
    head = tag("thead", tag("tr", *(tag("th", name, scope="col") for name in columns)))
    body = tag("tbody", *(tag("tr", tag("th", first, scope="row"), each("td", cells)) for first, *cells in rows))
    return tag("table", *(() if caption is None else (tag("caption", caption),)), head, body, class_=class_)


def scroll(content: Markup, label: str, class_: str = "scroll") -> Markup:
    """Put content that may be wider than a phone into a region that scrolls separately and takes the focus."""
    return tag("div", content, class_=class_, tabindex="0", role="region", aria_label=label)


def numbers(title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> Markup:
    """The numbers of a figure, in a table that opens on demand."""
    return tag("details", tag("summary", title), scroll(table(columns, rows, title), title, "scroll numbers"))


def data(value: Any) -> Markup:
    """The data of a script: JSON in which nothing can end the element."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return tag("script", Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")), type="application/json")


def evenly(count: int, most: int) -> list[int]:
    """Indices of at most so many of `count` values, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(int)).tolist()


def recording(log: Any) -> Markup:
    """Summary of the log; what was inferred to read it stands among the findings."""
    if log is None:
        return Markup("")
    summary = tag("pre", log.summary(), tabindex="0", role="region", aria_label="Summary of the recording")
    return fold("Recording", "recording", summary)


def provenance(known: dict[str, Any], log: Any) -> Markup:
    """The origin of the numbers: first `known`, then the provenance of the log, in words."""
    for key, value in plain(log.provenance if log is not None else {}).items():
        if key == "epoch_ns":
            if (when := recorded(log)) is not None:
                known["First sample"] = when
        elif (text := _words(value)) != "":
            known[str(_LABELS.get(key, key.replace("_", " ").capitalize()))] = text
    return fold("Provenance", "provenance", definitions(known.items(), "pairs"))


_LABELS = {"sha256": "SHA-256", "size": "Size in bytes", "rate": "Sampling rate"}


def recorded(log: Any) -> str | None:
    """Start of a recording as text, or None if the clock of the log does not know it."""
    known = None if log is None else date_of(log.provenance)
    return None if known is None else f"{known:%Y-%m-%d %H:%M:%S} UTC"


def _words(value: Any) -> str:
    """Format a value for readers; empty for a value that was not given."""
    if isinstance(value, dict):
        return "; ".join(f"{key} {text}".strip() for key, item in value.items() if (text := _words(item)) != "")
    if isinstance(value, list):
        return ", ".join(_words(item) for item in value)
    if value is None or value is False:
        return ""
    return "yes" if value is True else f"{value:.9g}" if isinstance(value, float) else str(value)
