"""The page of any result: verdict, tables and findings from the result itself, then the figures of its kind, and where it comes from.

A module for a kind of result (`_MODULES`) has only what no other kind has: `SUBJECT` or `subject(result)`, `lead(result)`,
`figures(result, log)` (a list of sections), `known(result)` (facts for the provenance), and `meaning(result)` (terms and explanations).
Each but the subject may be missing.
"""

import importlib
from typing import Any

from .._answer import CAUTION, Reader
from .._answer._html import findings_html, grid_html
from .._answer._sections import Curve, Grid
from .._units import shown_in
from ._html import MOST, Markup, definitions, evenly, join, numbers, provenance, recording, scroll, section, tag
from ._timeline import timelines

_MODULES = {
    "NoiseFits": "_noise", "Deviations": "_curves", "Spectra": "_curves", "TemperatureFits": "_thermal", "ImuFit": "_imu",
    "MagFit": "_magnetometer", "DeviceFit": "_device", "AlignmentFit": "_north",
}  # fmt: skip


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
    head = tag("p", badge(result.verdict), " ", result.headline)
    urgent = [one for one in told if one.severity >= CAUTION]
    parts = [section("Verdict", "verdict", head, *tables)]
    none = "No warnings. Notes stand below the pictures." if len(told) > len(urgent) else "No warnings."
    parts.append(section("What to know", "findings", findings_html(urgent, reader) or tag("p", none)))
    parts += own("figures", [], log)
    parts += [section("Details", "details", *detail)] if detail else []
    notes = findings_html([one for one in told if one.severity < CAUTION], reader)
    parts += [section("Notes", "notes", notes)] if notes else []
    parts += [recording(log)] if described else []
    parts += [section("What was not the sensor", "evidence", seen)] if log is not None and (seen := timelines(log)) else []
    meaning = own("meaning", ())
    parts += [section("What it means", "meaning", definitions(meaning))] if meaning else []
    parts.append(provenance({"Made by": f"jaxcal {version}"} | own("known", {}), log))
    return own("subject", getattr(module, "SUBJECT", "Result")), own("lead", ""), join(parts)


def _curve(curve: Curve) -> Markup:
    """The numbers of a curve: all, or some that are evenly spread."""
    columns = {name: (shown_in(quantity), values) for name, (quantity, values) in curve.columns.items()}
    size = len(next(iter(columns.values()))[1])
    heads = [f"{name} ({unit})" if unit else name for name, ((unit, _), _) in columns.items()]
    rows = [[f"{float(values[i]) / factor:.4g}" for (_, factor), values in columns.values()] for i in evenly(size, MOST)]
    return numbers(f"Numbers of {curve.title}", heads, rows)
