"""`write_fleet`: write the overview of many logs as one page."""

import importlib.metadata
import math
import os
from typing import Any

import numpy as np

from .._files import write_atomically
from ..plot._style import MUTED, SERIES, new_figure, number_label, style_axes, unit_label
from ._html import Markup, definitions, each, join, scroll, section, table, tag
from ._page import page, picture
from ._population import populations

_ROWS = 36  # largest number of coefficients in the figure
_PANELS = 8  # largest number of trends that are drawn
_LISTED = 50  # largest number of logs, sentences or outliers in a list
_MEANING = (
    (
        "robust standard deviation",
        "1.4826 times the median distance from the median: what the standard deviation would be without the logs that stand out.",
    ),
    (
        "own error",
        "Median of the standard errors of the single logs. Where the spread is not larger than it, the logs differ by chance alone, "
        "and say nothing of a difference between the sensors.",
    ),
    (
        "outlier",
        "A log so far from the median that in 19 of 20 fleets without one no log and no coefficient would be. The limit grows with "
        "the number of logs and coefficients, and where there are few logs.",
    ),
    ("trend", "A coefficient that goes up or down with the order or the date of the logs (Kendall's tau), by the same rule."),
)


def write_fleet(fleet: dict[str, Any], path: str | os.PathLike[str]) -> None:
    """Write the overview of many logs: the spread of every coefficient, outliers, trends, and failed logs.

    Parameters
    ----------
    fleet : `task` (name, options, reading, jaxcal), `logs` (number of logs), `names` and `dates` of the logs with a result, `failed`
        (pairs of name and reason), `warnings` (pairs of sentence and names), `spread` (name -> the fields of `jaxcal.batch.Spread`), and
        `populations` (name -> `jaxcal.batch.Population`) if the logs were pooled.
    path : file to write; an existing file is replaced atomically.

    Raises
    ------
    ExportError
        If the file cannot be written.
    """
    version = importlib.metadata.version("jaxcal")
    done, task = len(fleet["names"]), str(fleet["task"]["name"])
    lead = f"{fleet['logs']} log{'s' * (fleet['logs'] != 1)}, {done} answered, {len(fleet['failed'])} not"
    failed = table(("Log", "Reason"), fleet["failed"]) if fleet["failed"] else tag("p", "None.")
    body = (
        _verdict(fleet), populations(fleet.get("populations", {})), _spread(fleet), _outliers(fleet), _trends(fleet),
        section("Logs without an answer", "failed", failed),
        _warnings(fleet), section("What the words mean", "meaning", definitions(_MEANING)),
        section("Provenance", "provenance", definitions((key, str(value)) for key, value in fleet["task"].items() if value)),
    )  # fmt: skip
    write_atomically(path, page(f"Fleet: {task}", lead, join(body), f"Written by jaxcal {version}"))


def _verdict(fleet: dict[str, Any]) -> Markup:
    spread = {name: one for name, one in fleet["spread"].items() if one["count"]}
    odd = {outlier["path"]: outlier["name"] for one in spread.values() for outlier in one["outliers"]}
    lines = []
    if not spread:
        lines.append("No log was answered: see below for the reasons." if fleet["failed"] else "The logs have no coefficients to compare.")
    elif all(math.isinf(one["limit"]) for one in spread.values()):
        lines.append("Fewer than five logs have a coefficient in common: none is called an outlier.")
    elif odd:
        shown = ", ".join(list(odd.values())[:10]) + (f" and {len(odd) - 10} more" if len(odd) > 10 else "")
        lines.append(f"{len(odd)} of {len(fleet['names'])} logs stand out: {shown}.")
    else:
        lines.append("No log stands out.")
    trends = [trend["reason"] for one in spread.values() for trend in one["trends"]]
    if trends:
        lines.append(f"{len(trends)} trend{'s' * (len(trends) != 1)}; the first: {trends[0]}.")
    elif spread:
        lines.append("No coefficient goes with the order or the date of the logs, as far as can be told.")
    if fleet["failed"]:
        lines.append(f"{len(fleet['failed'])} log{'s' * (len(fleet['failed']) != 1)} could not be answered; the reasons are below.")
    return section("Verdict", "verdict", tag("ul", each("li", lines)))


def _spread(fleet: dict[str, Any]) -> Markup:
    shown = {name: one for name, one in fleet["spread"].items() if one["count"]}
    if not shown:
        return Markup("")
    drawn = dict(sorted(shown.items(), key=lambda item: -len(item[1]["outliers"]))[:_ROWS])  # prefer those with outliers
    drawn = {name: one for name, one in shown.items() if name in drawn}
    title = "Distance of every log from the median"
    caption = "Each point is a log, in robust standard deviations of its coefficient; orange: outliers. Linear up to 5, then logarithmic."
    if len(drawn) < len(shown):
        caption += f" {len(drawn)} of {len(shown)} coefficients; the table has all."
    figure = picture(_spread_figure(drawn), "fleet-spread", title, caption, caption)
    columns = ("Coefficient", "Unit", "Logs", "Median", "5 %", "95 %", "Robust s.d.", "Own error", "Outliers")
    rows = [
        (name, unit_label(one["unit"]), one["count"], *(_shown(one[key]) for key in ("median", "low", "high", "sigma", "own")),
         len(one["outliers"])) for name, one in shown.items()
    ]  # fmt: skip
    return section("Spread", "spread", figure, scroll(table(columns, rows), "Spread of every coefficient", "numbers"))


def _shown(value: float) -> str:
    if not math.isfinite(value):
        return "\u2013"
    return f"\u2212{number_label(-value)}" if value < 0 else number_label(value)


def _outliers(fleet: dict[str, Any]) -> Markup:
    by_log: dict[str, list[dict[str, Any]]] = {}
    for one in fleet["spread"].values():
        for outlier in one["outliers"]:
            by_log.setdefault(outlier["path"], []).append(outlier)
    worst = sorted(by_log.values(), key=lambda found: -max(abs(outlier["score"]) for outlier in found))
    items = [
        tag("li", tag("b", found[0]["name"]), tag("ul", each("li", (o["reason"] for o in sorted(found, key=lambda o: -abs(o["score"]))))))
        for found in worst[:_LISTED]
    ]  # fmt: skip
    if len(worst) > _LISTED:
        items.append(tag("li", f"and {len(worst) - _LISTED} more"))
    return section("Outliers", "outliers", tag("ul", *items) if items else tag("p", "None."))


def _trends(fleet: dict[str, Any]) -> Markup:
    found = [(name, one, trend) for name, one in fleet["spread"].items() for trend in one["trends"]]
    if not found:
        return section("Trends", "trends", tag("p", "None."))
    found.sort(key=lambda item: item[2]["p"])
    title = "Coefficients that go with the order or the date of the logs"
    about = "Value of the coefficient of every log, orange where it is an outlier."
    figure = picture(_trend_figure(found[:_PANELS]), "fleet-trends", title, about)
    return section("Trends", "trends", tag("ul", each("li", (trend["reason"] for _, _, trend in found[:_LISTED]))), figure)


def _warnings(fleet: dict[str, Any]) -> Markup:
    items = []
    for sentence, names in fleet["warnings"][:_LISTED]:
        shown = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
        items.append(tag("li", f"{len(names)} log{'s' * (len(names) != 1)} ({shown}): {sentence}"))
    if len(fleet["warnings"]) > _LISTED:
        items.append(tag("li", f"and {len(fleet['warnings']) - _LISTED} more; the result files have all"))
    return section("Warnings", "warnings", tag("ul", *items) if items else tag("p", "None."))


def _spread_figure(spread: dict[str, dict[str, Any]]) -> Any:
    """A row of points for each coefficient."""
    ax = new_figure(0.27 * len(spread) + 0.9).subplots()
    rng = np.random.default_rng(0)  # small random heights, so that the points of a row do not overlap
    for row, one in enumerate(spread.values()):
        score = np.array(one["scores"], dtype=float)
        odd = np.abs(score) > one["limit"]
        height = row + 0.28 * rng.uniform(-1.0, 1.0, len(score))
        ax.plot(score[~odd], height[~odd], "o", markersize=3.0, color=SERIES[0], alpha=0.45, markeredgewidth=0)
        ax.plot(score[odd], height[odd], "o", markersize=4.5, color=SERIES[1], markeredgewidth=0)
    scores = np.abs([s for one in spread.values() for s in one["scores"]])
    reach = max(6.0, 1.3 * float(np.nanmax(scores, initial=0.0)))
    ax.set_xscale("symlog", linthresh=5.0, linscale=1.0)
    ax.set_xlim(-reach, reach)
    ticks = [t for t in (1, 2, 3, 4, 5, *(d * 10.0**p for p in range(1, 18) for d in ((1, 2, 5) if reach < 300 else (1,)))) if t <= reach]
    ax.set_xticks([-t for t in reversed(ticks)] + [0.0, *ticks], minor=False)
    ax.set_xticks([], minor=True)
    ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "\u2212"))
    ax.set_yticks(range(len(spread)), [name.replace("$", r"\$") for name in spread])
    ax.set_ylim(len(spread) - 0.5, -0.5)
    ax.axvline(0.0, color=MUTED, linewidth=0.8, zorder=0)
    style_axes(ax, "Distance from the median (robust standard deviations)", "", 9.0)
    return ax


def _trend_figure(found: list[tuple[str, dict[str, Any], dict[str, Any]]]) -> Any:
    """A panel for each trend, over the order or the date of the logs."""
    panels = new_figure(1.7 * len(found) + 0.4).subplots(len(found), 1, squeeze=False)[:, 0]
    for ax, (name, one, trend) in zip(panels, found, strict=True):
        values = np.array(one["values"], dtype=float)
        odd = np.abs(np.array(one["scores"], dtype=float)) > one["limit"]
        at = np.array(trend["at"], dtype=float)
        ax.plot(at[~odd], values[~odd], "o", markersize=3.5, color=SERIES[0], alpha=0.7, markeredgewidth=0)
        ax.plot(at[odd], values[odd], "o", markersize=4.5, color=SERIES[1], markeredgewidth=0)
        label = f"{name}\n{unit_label(one['unit'])}".replace("$", r"\$").strip()
        style_axes(ax, f"{trend['along']}{' (days after the first)' if trend['along'] == 'date' else ''}", label, 9.0)
        ax.ticklabel_format(axis="y", style="sci", scilimits=(-3, 4), useMathText=True)
    return panels[0]
