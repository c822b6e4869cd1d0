"""The frame of a page: head, style and script, without external resources.

A page with interactive curves includes uPlot, and `explore.js` or `charts.js`. A content security policy lists the hashes of the scripts,
so that no other script can run, and nothing can be loaded or sent.
"""

import base64
import hashlib
import pathlib
import re
from collections.abc import Iterable
from typing import Any

from ._html import Markup, data, definitions, join, tag

_ASSETS = pathlib.Path(__file__).parent / "_assets"
_LIBRARY = "uPlot 1.6.32 (MIT License, Copyright (c) 2022 Leon Sorokin)"


def page(title: str, lead: str, body: Markup, footer: str, facts: Iterable[tuple[str, str]] = ()) -> str:
    """Make a whole document; the facts appear below its title."""
    style = _asset("page.css")
    used = (('class="sphere', "sphere"), ('id="live"', "live"), ('id="brush"', "fleet"))
    scripts = [_asset(f"{name}.js") for mark, name in used if mark in body]
    if drawn := [f"{name}.js" for name in ("explore", "charts") if f'class="{name}"' in body]:
        style = _asset("uPlot.min.css") + style
        library = f"/*\n{_asset('uPlot.LICENSE')}\n*/\n{_asset('uPlot.iife.min.js')}"
        scripts += [library, _asset("tools.js"), *map(_asset, drawn)]
        footer = f"{footer}. Charts: {_LIBRARY}."
    if scripts:
        style = _asset("explore.css") + style
    allowed = " ".join(f"'{_hash(script)}'" for script in scripts) or "'none'"
    policy = f"default-src 'none'; script-src {allowed}; style-src '{_hash(style)}'; img-src data:; base-uri 'none'; form-action 'none'"
    policy += "; connect-src 'self'" if 'id="live"' in body else ""
    head = join(
        (
            tag("meta", charset="utf-8"),
            tag("meta", http_equiv="Content-Security-Policy", content=policy),
            tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
            tag("meta", name="color-scheme", content="light dark"),
            tag("title", title),
            tag("style", Markup(style)),
        )
    )
    header = join((tag("header", tag("h1", title), tag("p", lead, class_="lead")), definitions(facts, "facts")))
    behind = [tag("script", Markup(script)) for script in scripts]
    parts = re.findall(r'<h2 id="([^"]+)">(.*?)</h2>', body)
    contents = tag("nav", tag("ul", *(tag("li", tag("a", Markup(name), href=f"#{place}")) for place, name in parts)), aria_label="Contents")
    content = join((contents, header, tag("main", body), tag("footer", footer), *behind))
    return "<!DOCTYPE html>\n" + tag("html", tag("head", head), "\n", tag("body", content), lang="en") + "\n"


def live_page() -> str:
    """The page of a magnetometer that is being recorded; its script fetches "state" and posts "stop" beside it."""
    nothing: dict[str, Any] = {name: [] for name in ("readings", "residual", "number", "outliers", "missing", "needed")}
    facts = tag("dl", *(part for name, place in (("Readings", "count"), ("Heading error to expect", "error"))
                        for part in (tag("dt", name), tag("dd", "", id=place))), class_="facts")  # fmt: skip
    body = tag(
        "div", tag("p", "Turn the sensor so that the next reading falls on the cross.", id="turn"), tag("p", "", id="reason"), facts,
        tag("p", tag("button", "Stop", type="button", id="stop"), class_="bar still"),
        tag("div", data(nothing | {"unit": "", "field": 1}), tag("div", class_="static"), class_="sphere"), id="live",
    )  # fmt: skip
    return page("Magnetometer", "Recording", body, "Served by this machine, for this machine alone")


def _asset(name: str) -> str:
    """Read a file that is included in the page, without its indentation."""
    return re.sub(r"(?m)^[ ]+", "", (_ASSETS / name).read_text(encoding="utf-8")).strip()


def _hash(text: str) -> str:
    """Source expression of an inline script or style for the policy."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
