"""HTML, written so that no text can become markup."""

import html
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
