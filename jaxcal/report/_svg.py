"""A figure as SVG inside a page, in the colours of the page."""

import io
import re
from typing import Any

from ..plot._style import GRID, INK, MUTED, SERIES, SHADE
from ._html import Markup, tag

#: colour that the figure is drawn in -> the page's own
_COLORS = {INK: "ink", MUTED: "muted", GRID: "grid", SHADE: "shade", **{color: f"series-{i}" for i, color in enumerate(SERIES)}}
#: frames, ticks and the walls of a space where nothing else is said; black letters are left to the style of the page
_COLORS |= {"#ffffff": "paper", "#000000": "ink", "#b0b0b0": "grid", **dict.fromkeys(("#f2f2f2", "#e6e6e6", "#ececec"), "shade")}


def inline(axes: Any, prefix: str, title: str, description: str) -> Markup:
    """SVG of the figure of `axes`: colours are variables of the page, and ids begin with `prefix`."""
    import matplotlib

    buffer = io.BytesIO()
    # matplotlib takes the kind of text and of ids from its settings alone; they are put back at once
    with matplotlib.rc_context({"svg.hashsalt": prefix, "svg.fonttype": "path"}):
        axes.figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue().decode("utf-8")
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", text, flags=re.DOTALL)
    body = text[text.index(">") + 1 : text.rindex("</svg>")]
    for color, name in _COLORS.items():
        body = re.sub(color, f"var(--{name})", body, flags=re.IGNORECASE)
    body = re.sub(r'(\bid="|xlink:href="#|url\(#)', lambda found: f"{found[1]}{prefix}-", body).replace("xlink:href", "href")
    body = re.sub(r"\s*\n\s*", " ", body)
    view = re.search(r'viewBox="([^"]+)"', text)
    assert view is not None
    named = tag("title", title, id=f"{prefix}-title") + tag("desc", description, id=f"{prefix}-desc")
    labels = f'role="img" aria-labelledby="{prefix}-title" aria-describedby="{prefix}-desc"'
    return Markup(f'<svg viewBox="{view[1]}" {labels}>{named}{body}</svg>')
