"""The page of any result. Its first screen has the verdict, the main picture and the tables beside it; the rest follows in folds.

A module for a kind of result (`_MODULES`) has only what no other kind has: `SUBJECT` or `subject(result)`, `lead(result)`,
`figures(result, log)` (the main pictures, the first of which a phone shows above the numbers, and a list of further sections), `PART`
(the part of a calibration that it becomes), `known(result)` (facts for the provenance), and `meaning(result)` (terms and explanations).
Each but the subject may be missing.
"""

import importlib
from typing import Any

from .._answer import CAUTION, Finding, Reader, joined, merged
from .._answer._html import findings_html, grid_html
from .._answer._sections import Curve, Grid
from .._errors import JaxcalError
from .._units import shown_in
from ..calibration import Calibration
from ..export._formats import FORMATS, checked_options
from ..export._write import rendered
from ._html import FINE, Markup, definitions, evenly, fold, join, numbers, provenance, recording, scroll, section, tag
from ._timeline import timelines

_MODULES = {
    "NoiseFits": "_noise", "Deviations": "_curves", "Spectra": "_curves", "TemperatureFits": "_thermal", "ImuFit": "_imu",
    "MagFit": "_magnetometer", "DeviceFit": "_device", "AlignmentFit": "_north", "Budget": "_budget",
}  # fmt: skip
_FIRST = 3  # warnings that stand on the first screen, as many as the terminal prints


def module_of(result: Any) -> Any:
    """The module with the figures of this kind of result; None for a kind without figures."""
    names = (_MODULES.get(one.__name__) for one in type(result).__mro__)
    name = next((name for name in names if name), None)
    return None if name is None else importlib.import_module(f".{name}", __package__)


def badge(verdict: str) -> Markup:
    """The verdict as a coloured word."""
    return tag("span", verdict, class_="badge present" if verdict == "good" else "badge hint")


def answer_page(result: Any, log: Any, version: str, reader: Reader, described: bool = True) -> tuple[str, str, Markup]:
    """Subject, subtitle and sections of the page of a result; `described`: with the summary of the recording."""
    module, sections = module_of(result), result.sections()
    told = [*(() if log is None else log.findings), *result.findings]

    def own(name: str, default: Any, *arguments: Any) -> Any:
        return getattr(module, name)(result, *arguments) if hasattr(module, name) else default

    tables = [scroll(grid_html(one), one.title) for one in sections if isinstance(one, Grid) and one.rows and not one.detail]
    detail = [scroll(grid_html(one), one.title) for one in sections if isinstance(one, Grid) and one.rows and one.detail]
    detail += [_curve(one) for one in sections if isinstance(one, Curve)]
    main, further = own("figures", ([], []), log)
    urgent = [one for one in told if one.severity >= CAUTION]
    count = len(merged(urgent))
    link = [" ", tag("a", f"{count} warning{'s' * (count != 1)}", href="#findings", class_="small")] if count else []
    none = "No warnings. Notes stand below the pictures." if len(told) > len(urgent) else "No warnings."
    limits = [tag("details", tag("summary", "With the limits of the intervals"), class_="limits")] if tables else []
    copies = _copies(result, getattr(module, "PART", None), log)
    tools = [tag("details", tag("summary", "For a filter or another tool: choose, and copy"), *copies, class_="tools")] if copies else []
    beside = tag(
        "div",
        section("Numbers", "numbers", *tools, *tables, *limits),
        section("What to know", "findings", *_few_first(urgent, reader) or [tag("p", none)]),
        class_="beside",
    )
    head = tag("p", badge(result.verdict), " ", result.headline, *link, class_="said")
    first = tag("div", *main[:1], beside, *main[1:], class_="first") if main else beside
    parts = [tag("section", head, aria_label="Verdict"), first, *further]
    parts += [section("The signal, and what was set aside", "evidence", seen)] if (seen := timelines(log)) else []
    parts += [fold("Details", "details", *detail)] if detail else []
    notes = findings_html([one for one in told if one.severity < CAUTION], reader)
    parts += [fold("Notes", "notes", notes)] if notes else []
    parts += [recording(log)] if described else []
    meaning = own("meaning", ())
    parts += [fold("What it means", "meaning", definitions(meaning))] if meaning else []
    parts.append(provenance({"Made by": f"jaxcal {version}"} | own("known", {}), log))
    return own("subject", getattr(module, "SUBJECT", "Result")), own("lead", ""), join(parts)


def _few_first(findings: list[Finding], reader: Reader) -> list[Markup]:
    """The worst findings, one of a kind, and all of them on demand; nothing where there is none."""
    every, first = findings_html(findings, reader), findings_html(joined(findings)[:_FIRST], reader)
    if len(merged(findings)) <= _FIRST:
        return [every] if findings else []
    return [first, tag("details", tag("summary", f"All {len(merged(findings))} warnings"), every, class_="every")]


def _copies(result: Any, part: str | None, log: Any) -> list[Markup]:
    """The numbers as each tool that takes them reads them."""
    if part is None:
        return []
    found = []
    for name, kind in FORMATS.items():
        try:
            device = [Calibration(**{part: result}, provenance=None if log is None else log.provenance)]
            content, _ = rendered(device, name, checked_options(name, {}), force=True, provenance=bool(kind.mark))
        except JaxcalError:  # a calibration needs intervals, and not every tool takes every part of it
            continue
        if isinstance(content, str) and part in kind.sections:
            found.append(tag("details", tag("summary", f"{name}: {kind.file}"), tag("pre", content, tabindex="0")))
    return found


def _curve(curve: Curve) -> Markup:
    """The numbers of a curve: all, or some that are evenly spread."""
    columns = {name: (shown_in(quantity), values) for name, (quantity, values) in curve.columns.items()}
    size = len(next(iter(columns.values()))[1])
    heads = [f"{name} ({unit})" if unit else name for name, ((unit, _), _) in columns.items()]
    rows = [[f"{float(values[i]) / factor:.4g}" for (_, factor), values in columns.values()] for i in evenly(size, FINE)]
    return numbers(f"Numbers of {curve.title}", heads, rows)
