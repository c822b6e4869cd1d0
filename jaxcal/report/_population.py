"""The populations of a fleet, as a section of its page."""

from typing import Any

import numpy as np

from .._answer._html import findings_html, grid_html
from ..plot._style import number_label
from ._charts import Chart, Curve, charts
from ._html import LISTED, MOST, PANELS, Markup, scroll, section, table, tag


def populations(found: dict[str, Any]) -> Markup:
    """Middle, variance components and odd units of each population, and the value of each recording beside its pooled value."""
    if not found:
        return Markup("")
    lead = tag(
        "p", "All logs together describe the type: its middle device, and how much devices differ. A pooled value combines a log with the "
        "type. Its interval includes the uncertainty of the type.",
    )  # fmt: skip
    return section("Population", "population", lead, *(_one(name, one) for name, one in found.items()))


def _one(name: str, found: Any) -> Markup:
    head = f"{100 * found.false_alarm:g} % of usual devices are named in each parameter."
    return tag(
        "div", tag("h3", name), *(scroll(grid_html(one), f"Population of {name}") for one in found.sections()),
        tag("h4", "Odd units"), tag("p", head), findings_html(found.findings) or tag("p", "None."),
        _figure(name, found), _recordings(name, found),
    )  # fmt: skip


def _recordings(name: str, found: Any) -> Markup:
    rows = []
    for i, device in enumerate(found.recordings):
        for j, term in enumerate(found.terms):
            cells = (found.raw[i, j], *found.raw_interval[i, j], found.pooled[i, j], *found.pooled_interval[i, j])
            rows.append((str(device), term, *map(_shown, cells)))
    columns = ("Device", "Parameter", "Raw", "Low", "High", "Pooled", "Low", "High")
    more = () if len(rows) <= MOST else (tag("p", f"and {len(rows) - MOST} more, in population.json"),)
    return tag(
        "details", tag("summary", "Raw and pooled values"), scroll(table(columns, rows[:MOST]), f"Values of {name}", "numbers"), *more
    )


def _shown(value: float) -> str:
    return f"\u2212{number_label(-value)}" if value < 0 else number_label(value)


def _figure(name: str, found: Any) -> Markup:
    """A chart for each parameter: the value of each log alone, and its pooled value."""
    count = min(len(found.recordings), LISTED)
    at, made = np.arange(count), []
    for j, term in enumerate(found.terms[:PANELS]):
        words = [f"{device}{' (odd)' * ((device, term) in found.outliers)}" for device in found.recordings[:count]]
        curves = [
            Curve(what, "dots", at + shift, value[:count, j], *limits[:count, j].T, color=color, label=what, words=words)
            for what, shift, color, value, limits in (
                ("alone", -0.15, 1, found.raw, found.raw_interval), ("pooled", 0.15, 0, found.pooled, found.pooled_interval)
            )
        ]  # fmt: skip
        middle = Curve("middle device", "line", [-0.5, count - 0.5], [found.median[j]] * 2, color=2, label="middle")
        about = "The value of each log alone, and pooled with all others, with intervals."
        made.append(Chart(f"population-{name}-{j}", f"{term} of each log", about, "log", term, [("", 1.0)], [*curves, middle]))
    return charts(made)
