"""Write HTML so that no text can become markup; common parts of all pages."""

import datetime
import math
import re
from collections.abc import Iterable, Sequence
from typing import Any

from .._answer import plain
from .._answer._html import Markup, join, tag


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


def definitions(pairs: Iterable[tuple[Any, Any]]) -> Markup:
    """A list of terms with their definitions or values."""
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
    """Put content that may be wider than a phone into a region that scrolls separately and takes the focus."""
    return tag("div", content, class_=class_, tabindex="0", role="region", aria_label=label)


def estimate(value: float, low: float, high: float, fixed: str = "fixed") -> Markup:
    """A value and its interval, rounded to the second digit of the half width; `fixed` is the word for an interval of no width.

    Examples
    --------
    >>> import re
    >>> from jaxcal.report._html import estimate
    >>> re.sub("<[^>]*>", "", estimate(1.0123456, 1.01111, 1.01358))
    '1.0123 1.0111 to 1.0136'
    """
    if not math.isfinite(high - low):
        return tag("span", "not determined", class_="small")
    if not high > low:
        return join((tag("span", f"{value:g}", class_="number"), " ", tag("span", f"({fixed})", class_="small")))
    digits = 1 - math.floor(math.log10((high - low) / 2))
    if digits > 7:
        top = math.floor(math.log10(max(abs(value), abs(low), abs(high))))
        shown = [f"{one:.{max(digits + top, 1)}e}" for one in (value, low, high)]
    else:
        shown = [f"{one:.{max(digits, 0)}f}" for one in (value, low, high)]
    middle, first, last = (tag("span", one.replace("-", "\u2212"), class_="number") for one in shown)
    return join((middle, " ", tag("span", first, " to ", last, class_="small exact")))


def numbers(title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> Markup:
    """The numbers of a figure, in a table that opens on demand."""
    return tag("details", tag("summary", title), numbers_table(title, columns, rows))


def numbers_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> Markup:
    """The table without the control to open it, in a region that scrolls."""
    return scroll(table(columns, rows, title), title, "scroll numbers")


def recording(log: Any) -> Markup:
    """Summary of the log; what was inferred to read it stands among the findings."""
    if log is None:
        return Markup("")
    summary = tag("pre", log.summary(), tabindex="0", role="region", aria_label="Summary of the recording")
    return section("Recording", "recording", summary)


def provenance(known: dict[str, Any], log: Any) -> Markup:
    """The origin of the numbers: first `known`, then the provenance of the log, in words."""
    for key, value in plain(log.provenance if log is not None else {}).items():
        if key == "epoch_ns":
            if (when := recorded(log)) is not None:
                known["First sample"] = when
        elif (text := _words(value)) != "":
            known[str(_LABELS.get(key, key.replace("_", " ").capitalize()))] = text
    return section("Provenance", "provenance", definitions(known.items()))


_LABELS = {"sha256": "SHA-256", "size": "Size in bytes", "rate": "Sampling rate"}
_YEAR_2000 = 946_684_800  # s; an earlier time means that the clock of the log does not know the date


def recorded(log: Any) -> str | None:
    """Start of a recording as text, or None if the log does not know it."""
    seconds = int(getattr(log, "provenance", {}).get("epoch_ns", 0)) // 1_000_000_000
    if seconds < _YEAR_2000:
        return None
    return f"{datetime.datetime.fromtimestamp(seconds, datetime.UTC):%Y-%m-%d %H:%M:%S} UTC"


def _words(value: Any) -> str:
    """Format a value for readers; empty for a value that was not given."""
    if isinstance(value, dict):
        return "; ".join(f"{key} {text}".strip() for key, item in value.items() if (text := _words(item)) != "")
    if isinstance(value, list):
        return ", ".join(_words(item) for item in value)
    if value is None or value is False:
        return ""
    return "yes" if value is True else f"{value:.9g}" if isinstance(value, float) else str(value)
