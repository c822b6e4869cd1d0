"""The populations of a fleet, as a section of its page."""

from typing import Any

import numpy as np

from ..plot._style import MUTED, SERIES, new_figure, number_label, style_axes
from ._html import Markup, each, scroll, section, table, tag
from ._page import picture

_DRAWN = 60  # largest number of recordings in a panel
_LISTED = 200  # largest number of rows in the table of recordings
_PANELS = 6


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
    unit = "standard deviation of the logarithm: 0.2 is 20 %" if found.logarithm else "standard deviation"
    rows = []
    for i, term in enumerate(found.terms):
        rows.append((term, "middle device", *map(_shown, (found.median[i], *found.median_interval[i]))))
        for level, value, limits in zip(found.levels, found.components[:, i], found.components_interval[:, i], strict=True):
            rows.append((term, f"between, level {level}", *map(_shown, (value, *limits))))
        for label, value, limits in zip(found.covariates, found.effect[:, i], found.effect_interval[:, i], strict=True):
            rows.append((term, f"effect of {label}", *map(_shown, (value, *limits))))
    columns = ("Parameter", f"What ({unit})", "Value", "Low", "High")
    odd = [f"{device} in {term}: a usual device is as far from the middle in {100 * _chance(found, device, term):.2g} % of cases"
           for device, term in found.outliers]  # fmt: skip
    head = f"{100 * found.false_alarm:g} % of usual devices are named in each parameter."
    return tag(
        "div", tag("h3", name), scroll(table(columns, rows), f"Population of {name}", "numbers"),
        tag("h4", "Odd units"), tag("p", head), tag("ul", each("li", odd)) if odd else tag("p", "None."),
        picture(_figure(found), f"population-{name}", f"Raw and pooled values of {name}", "Each log alone in grey, pooled in blue."),
        _recordings(name, found),
    )  # fmt: skip


def _chance(found: Any, device: Any, term: str) -> float:
    return float(found.chance[found.devices.index(device), found.terms.index(term)])


def _recordings(name: str, found: Any) -> Markup:
    rows = []
    for i, device in enumerate(found.recordings):
        for j, term in enumerate(found.terms):
            cells = (found.raw[i, j], *found.raw_interval[i, j], found.pooled[i, j], *found.pooled_interval[i, j])
            rows.append((str(device), term, *map(_shown, cells)))
    columns = ("Device", "Parameter", "Raw", "Low", "High", "Pooled", "Low", "High")
    more = () if len(rows) <= _LISTED else (tag("p", f"and {len(rows) - _LISTED} more, in population.json"),)
    return tag(
        "details", tag("summary", "Raw and pooled values"), scroll(table(columns, rows[:_LISTED]), f"Values of {name}", "numbers"), *more
    )


def _shown(value: float) -> str:
    return f"\u2212{number_label(-value)}" if value < 0 else number_label(value)


def _figure(found: Any) -> Any:
    """A panel for each parameter: the value of each log beside its pooled value."""
    terms = found.terms[:_PANELS]
    panels = new_figure(1.8 * len(terms) + 0.4).subplots(len(terms), 1, squeeze=False)[:, 0]
    count = min(len(found.recordings), _DRAWN)
    at = np.arange(count)
    for j, (ax, term) in enumerate(zip(panels, terms, strict=True)):
        for shift, color, value, limits in (
            (-0.15, MUTED, found.raw, found.raw_interval),
            (0.15, SERIES[0], found.pooled, found.pooled_interval),
        ):
            low, high = np.where(np.isfinite(limits[:count, j]), limits[:count, j], np.nan).T
            ax.vlines(at + shift, low, high, color=color, linewidth=1.0)
            ax.plot(at + shift, value[:count, j], "o", markersize=3.0, color=color, markeredgewidth=0)
        odd = [i for i in at if (found.recordings[i], term) in found.outliers]
        ax.plot(np.array(odd) + 0.15, found.pooled[odd, j], "o", markersize=4.5, color=SERIES[1], markeredgewidth=0)
        ax.axhline(found.median[j], color=MUTED, linewidth=0.8, zorder=0)
        style_axes(ax, "log", term, 9.0)
    return panels[0]
