"""HTML, written so that no text can become markup."""

import html
import re
from typing import Any

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
    element = re.sub(r'(?<= aria-labelledby=")[^"]*|(?<= aria-describedby=")[^"]*', lambda found: _each_with(prefix, found[0]), element)
    return re.sub(r"^(</?)h([2-5])(?=[ >])", lambda found: f"{found[1]}h{int(found[2]) + 1}", element)


def _each_with(prefix: str, names: str) -> str:
    return " ".join(prefix + name for name in names.split())
