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

_LIGHT = """
  color-scheme: light;
  --ink: #1b1f24; --muted: #5d6570; --paper: #ffffff; --grid: #e4e7eb; --shade: #f1f3f5; --line: #d4d9df;
  --series-0: #0072b2; --series-1: #d55e00; --series-2: #009e73; --series-3: #c4609a; --series-4: #b97f00; --series-5: #2f8fc4;
  --good: #00694c; --good-back: #e2f3ec; --fair: #7a5200; --fair-back: #fdf0d2; --none-back: #eceff2;
"""
_DARK = """
  color-scheme: dark;
  --ink: #e8eaed; --muted: #a2abb6; --paper: #14171b; --grid: #2b3138; --shade: #1d2126; --line: #3a424b;
  --series-0: #56a8e0; --series-1: #f08a4b; --series-2: #3cc79c; --series-3: #e29ac4; --series-4: #f0b83c; --series-5: #8cd0f5;
  --good: #7fdcbb; --good-back: #143a2e; --fair: #f3c969; --fair-back: #41310c; --none-back: #282e35;
"""
_STYLE = (
    f":root {{{_LIGHT}}}\n@media screen and (prefers-color-scheme: dark) {{ :root {{{_DARK}}} }}"
    """
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink); font: 1rem/1.5 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; }
header, main, footer, body > .facts { max-width: 72rem; width: 100%; margin: 0 auto; padding: 0 1rem; }
p, li, dd, figcaption { max-width: 48rem; }
nav { display: none; }
@media (min-width: 86rem) {
  body { display: grid; grid-template-columns: 12rem minmax(0, 72rem); justify-content: center; }
  header, main, footer, body > .facts { grid-column: 2; }
  nav { display: block; grid-column: 1; grid-row: 1 / span 4; font-size: .875rem; }
  nav ul { position: sticky; top: 2rem; list-style: none; margin: 2rem 0; padding: 0 1rem; }
}
.main { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 26rem), 1fr)); gap: 0 2rem; }
.first > *, .main > *, .static > figure { min-width: 0; }
.first .matrix :is(th, td) { padding: .2rem .6rem .2rem 0; font-size: .875rem; }
.first .number { white-space: normal; } .first .numbers { max-height: 36rem; } .drawn .wide { stroke-width: 6; }
.first .charts, .first figure { margin: 0 0 .5rem; }
section:has(> .limits:not([open])) .exact { display: none; }
.limits, .tools { border: 0; margin: 0; padding: 0; color: var(--muted); font-size: .875rem; }
@media screen and (min-width: 66rem) {
  .first { display: grid; grid-template-columns: minmax(0, 28rem) minmax(0, 1fr); grid-template-rows: repeat(3, auto) 1fr; gap: 0 2rem; }
  .first > * { grid-column: 1; }
  .beside { grid-column: 2; grid-row: 1 / span 4; }
  .beside > :first-child h2 { margin-top: 0; border: 0; padding: 0; }
}
h1, h2, p, li, dd, dt, summary { overflow-wrap: anywhere; }
header { padding-top: 1.5rem; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0; }
h2 { font-size: 1.2rem; line-height: 1.3; margin: 1.5rem 0 .5rem; padding-top: .5rem; border-top: 1px solid var(--line); }
.fold > summary h2 { display: inline; margin: 0; padding: 0; border: 0; font-size: 1rem; }
article > h2 { font-size: 1.45rem; margin-top: 3.5rem; border-top: 2px solid var(--ink); }
article h3 { font-size: 1.15rem; padding-top: .5rem; border-top: 1px solid var(--line); }
article h4 { font-size: 1rem; margin: 1.5rem 0 .5rem; }
h3 { font-size: 1.05rem; margin: 1.75rem 0 .5rem; }
p, ul, dl { margin: .5rem 0; }
ul { padding-left: 1.25rem; }
li { margin: .25rem 0; }
a { color: var(--series-0); }
.lead { color: var(--muted); margin: .25rem 0; }
.said { font-size: 1.2rem; }
.grid { margin-bottom: 1.25rem; }
.small, caption, figcaption { color: var(--muted); font-size: .875rem; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
caption { text-align: left; padding: .25rem 0; caption-side: bottom; max-width: calc(100vw - 2rem); }
th, td { text-align: left; vertical-align: top; padding: .5rem .6rem; border-bottom: 1px solid var(--line); font-weight: normal; }
thead th { border-bottom: 2px solid var(--line); font-weight: 600; }
.badge { width: fit-content; padding: 0 .4rem; border-radius: 1rem; font-size: .75rem; white-space: nowrap; }
.badge { background: var(--none-back); color: var(--ink); }
.present { background: var(--good-back); color: var(--good); }
.hint { background: var(--fair-back); color: var(--fair); }
.verdicts :is(th, td) { overflow-wrap: anywhere; }
figure { margin: 1rem 0; }
.scroll { overflow-x: auto; }
.scroll svg { display: block; fill: var(--ink); width: 100%; min-width: 34rem; height: auto; }
.scroll .exact { display: block; white-space: nowrap; }
.number { white-space: nowrap; }
.numbers { max-height: 26rem; overflow: auto; }
.numbers table { font-size: .85rem; white-space: nowrap; }
.numbers td, .numbers th { padding: .2rem .8rem .2rem 0; }
.numbers td, .numbers thead th + th { text-align: right; }
.numbers thead th { position: sticky; top: 0; background: var(--paper); }
details { border: 1px solid var(--line); border-radius: .4rem; margin: .5rem 0; padding: 0 .8rem; }
summary { cursor: pointer; padding: .5rem 0; }
pre { overflow-x: auto; background: var(--shade); padding: .75rem; border-radius: .4rem; font-size: .85rem; }
dt { font-weight: 600; margin-top: .75rem; }
dd { margin: 0; }
.facts { display: flex; flex-wrap: wrap; gap: 0 .5rem; font-size: .875rem; }
.facts dd + dt { margin-left: 1rem; }
.facts dt, .facts dd { margin: 0; overflow-wrap: anywhere; min-width: 0; }
.facts dt { color: var(--muted); font-weight: normal; }
.pairs { display: grid; grid-template-columns: minmax(5rem, max-content) 1fr; gap: .1rem .8rem; font-size: .875rem; }
.pairs dt, .pairs dd { margin: 0; min-width: 0; overflow-wrap: anywhere; }
.c0 { --c: var(--series-0); } .c1 { --c: var(--series-1); } .c2 { --c: var(--series-2); }
.c3 { --c: var(--series-3); } .c4 { --c: var(--series-4); } .c5 { --c: var(--series-5); }
.ink { --c: var(--ink); } .shade { --c: var(--shade); }
.drawn path { fill: none; stroke: var(--c); stroke-linejoin: round; stroke-width: 2; }
.drawn text { font-size: 12px; }
.scroll svg.strip { width: 6.5rem; min-width: 6.5rem; height: 1rem; margin: .15rem 0; }
.drawn .scroll svg { min-width: 0; max-width: 42rem; }
.drawn .grid { stroke: var(--grid); stroke-width: 1; } .drawn .frame { stroke: var(--muted); stroke-width: 1; }
.drawn a path { pointer-events: stroke; } .drawn .chosen path { stroke: var(--series-2); stroke-width: 4; }
.drawn .dots { stroke-width: 5.5; stroke-linecap: round; } .drawn .faint { stroke-opacity: .45; }
.drawn .small { stroke-width: 3; } .drawn .large { stroke-width: 11; }
.drawn .thin { stroke-width: 1; } .drawn .dashed { stroke-dasharray: 5 4; stroke-width: 1.3; }
.drawn .band { fill: var(--c); fill-opacity: .2; stroke: none; } .drawn .band.shade { fill-opacity: 1; }
.drawn .q0 { fill-opacity: 0; } .drawn .q1 { fill-opacity: .12; } .drawn .q2 { fill-opacity: .3; } .drawn .q3 { fill-opacity: .55; }
.drawn .q4 { fill-opacity: .85; }
.key span { white-space: nowrap; }
.key i { display: inline-block; width: .7rem; height: .7rem; border-radius: 50%; background: var(--c); margin-left: .6rem; }
footer { color: var(--muted); font-size: .875rem; padding-bottom: 2rem; }
#reason::first-letter { text-transform: uppercase; }
:focus-visible { outline: 2px solid var(--series-0); outline-offset: 2px; }
@media (max-width: 36rem) {
  body { display: flex; flex-direction: column; }
  body > .facts { order: 1; } footer { order: 2; }
  header { padding-top: .6rem; } h1 { font-size: 1.2rem; } .lead { font-size: .875rem; margin: 0; }
  .said { font-size: 1rem; margin: .25rem 0; }
  h2 { font-size: 1.1rem; margin-top: .75rem; padding-top: .25rem; }
  .scroll svg { min-width: 0; } .drawn text { font-size: 13px; }
  .first > :first-child figcaption { display: -webkit-box; -webkit-box-orient: vertical; -webkit-line-clamp: 2; overflow: hidden; }
  .first > :first-child:is(:hover, :focus-within) figcaption { -webkit-line-clamp: none; }
  th, td { padding: .4rem .3rem; font-size: .875rem; }
  .matrix, .matrix :is(thead, tbody) { display: block; }
  .matrix thead th + th { display: none; }
  .matrix tr { display: flex; flex-wrap: wrap; gap: 0 .5rem; padding: .2rem 0; border-bottom: 1px solid var(--line); }
  .matrix :is(th, td), .first .matrix :is(th, td) { border: 0; padding: 0; font-size: .8125rem; flex: 1 0 30%; }
  .matrix tbody th { flex: 0 1 auto; }
  .matrix td.small { flex: 1 0 50%; font-size: .75rem; }
  .matrix td:has(> .number:empty) { display: none; }
  .matrix tr:not(:has(td:nth-of-type(3) > .number:not(:empty))) td { flex: 0 1 auto; }
  .matrix tr:not(:has(td:nth-of-type(3) > .number:not(:empty))) td::before { content: none; }
  .matrix td::before { content: attr(data-axis); color: var(--muted); margin-right: .3rem; white-space: nowrap; }
  .scroll .exact { white-space: normal; } .first .number { white-space: nowrap; }
  .numbers table { font-size: .8rem; }
}
@media print {
  @page { margin: 12mm; }
  body { font-size: 9pt; line-height: 1.35; print-color-adjust: exact; }
  header, main, footer, body > .facts { max-width: none; padding: 0; }
  figure, tr, li, dd { break-inside: avoid; }
  nav, .sphere.replay, .numbers, .tools, #brush { display: none; }
  details:has(> .numbers, > pre, > summary > #meaning, > summary > #details) { display: none; }
  section > .numbers, .first .numbers { display: block; max-height: none; overflow: visible; }
  section > .numbers table { font-size: 7pt; }
  section > .numbers .strip { width: 6rem; min-width: 6rem; height: .75rem; margin: 0; }
  ul:has(+ .every), .exact, .limits { display: none !important; }
  .first > .sphere, .first > .sphere > .static { display: contents; }
  .beside { grid-column: 1 / -1; order: 1; } .first > :nth-child(n + 4) { order: 2; }
  .explore:not(:has(.static > *)), section:has(> .explore):not(:has(.static > *)) { display: none; }
  .fold:has(> .pairs) { break-inside: avoid; }
  .small, figcaption, .pairs, footer { font-size: 8pt; } .pairs dt { margin: 0; } h2 { margin-top: .6rem; }
  .every { border: 0; padding: 0; } .every > summary { display: none; } p, ul, dl { margin: .3rem 0; }
  :is(ul, p) + .main { break-before: avoid; } .first > div:has(> figure + p) { grid-column: 1 / -1; columns: 2; }
  .pairs { columns: 3; display: block; } .pairs :is(dt, dd) { display: inline; } .pairs dd::before { content: " "; }
  .pairs dd::after { content: "\\A"; white-space: pre; } .first .matrix :is(th, td) { padding: .1rem .4rem .1rem 0; font-size: 8pt; }
  .main, .first, .live > .static { display: grid; grid-template-columns: 1fr 1fr; gap: 0 1rem; }
  .first > .charts > .static { display: block; }
  figure { margin: .5rem 0; }
  th, td { padding: .15rem .4rem; }
  h2, h3 { break-after: avoid; }
  .scroll svg { min-width: 0; }
  .live-part { display: none; }
  details::details-content { content-visibility: visible; height: auto; }
  pre { white-space: pre-wrap; overflow-wrap: anywhere; }
}
"""
)


def page(title: str, lead: str, body: Markup, footer: str, facts: Iterable[tuple[str, str]] = ()) -> str:
    """Make a whole document; the facts appear below its title."""
    style = _STYLE
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
