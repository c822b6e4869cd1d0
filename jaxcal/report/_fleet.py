"""`write_fleet`: write the overview of many logs as one page."""

import math
import os
from typing import Any

import numpy as np

from .._answer._html import each
from .._files import version_of, write_atomically
from .._units import unit_label
from ..plot._style import number_label
from ._html import LISTED, MOST, PANELS, Markup, definitions, join, scroll, section, table, tag
from ._page import page
from ._svg import Mark, figure, linear_axis, log_axis

_LINEAR, _HALF = 5.0, 80.0  # distance up to which a row of points is linear, and half its width
_MEANING = (
    ("robust standard deviation", "1.4826 times the median distance from the median, which single logs that stand out do not widen."),
    ("own error", "Median standard error of the logs. A spread that is not larger is chance, and no difference between sensors."),
    ("outlier", "A log so far from the median that 19 of 20 fleets of equal sensors have none, over all logs and coefficients."),
    ("trend", "A coefficient that goes up or down with the order or the date of the logs (Kendall's tau), by the same rule."),
)


def write_fleet(fleet: dict[str, Any], path: str | os.PathLike[str]) -> None:
    """Write the overview of many logs: the spread of every coefficient, outliers, trends, and failed logs.

    Parameters
    ----------
    fleet : `task` (name, options, reading, jaxcal), `logs` (number of logs), `names` and `dates` of the logs with a result, `failed`
        (pairs of name and reason), `files` (addresses of the results), `curves` (channel -> number of the log -> times and deviations),
        `warnings` (pairs of sentence and names), `filters` (`jaxcal.batch.Fleet.for_filters`), and `spread` (name -> the fields of
        `jaxcal.batch.Spread`).
    path : file to write; an existing file is replaced atomically.

    Raises
    ------
    ExportError
        If the file cannot be written.
    """
    version = version_of("jaxcal")
    done, task = len(fleet["names"]), str(fleet["task"]["name"])
    lead = f"{fleet['logs']} log{'s' * (fleet['logs'] != 1)}, {done} answered, {len(fleet['failed'])} not"
    failed = table(("Log", "Reason"), fleet["failed"]) if fleet["failed"] else tag("p", "None.")
    drawn = _curves(fleet)
    logs = zip(fleet["names"], fleet["files"], strict=True)
    choice = tag(
        "select", tag("option", "none", value=""), *(tag("option", name, value=name, data_page=file) for name, file in logs), id="log"
    )
    brush = tag("p", tag("label", "Log ", choice), " ", tag("a", "its result", id="result", hidden=""), id="brush")
    body = (
        _verdict(fleet), brush, tag("div", *drawn[:1], _spread(fleet), *drawn[1:], class_="first") if drawn else _spread(fleet),
        _outliers(fleet), _trends(fleet),
        section("Logs without an answer", "failed", failed),
        _warnings(fleet), section("What the words mean", "meaning", definitions(_MEANING)),
        section("Provenance", "provenance", definitions(((key, str(value)) for key, value in fleet["task"].items() if value), "pairs")),
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
        lines.append("No coefficient shows a trend with the order or the date of the logs.")
    if fleet["failed"]:
        lines.append(f"{len(fleet['failed'])} log{'s' * (len(fleet['failed']) != 1)} could not be answered; the reasons are below.")
    return section("Verdict", "verdict", tag("ul", each("li", lines)))


def _curves(fleet: dict[str, Any]) -> list[Markup]:
    """The curves of all logs over one another; the one that is chosen, or under the pointer, stands out and leads to its result."""
    if not fleet["curves"]:
        return []
    odd = {outlier["name"] for one in fleet["spread"].values() for outlier in one["outliers"]}
    figures = []
    for channel, curves in list(fleet["curves"].items())[:PANELS]:
        units = [one["unit"] for name, one in fleet["spread"].items() if name.startswith(f"{channel}.") and "dev" in name]
        x, y = (
            log_axis(label, [one[i] for one in curves.values()])
            for i, label in enumerate(("Cluster time τ (s)", f"Deviation ({unit_label(units[0])})" if units else "Deviation"))
        )
        lines = [
            Mark("line", tau, deviation, int(fleet["names"][i] in odd), look="thin", log=fleet["names"][i], link=fleet["files"][i])
            for i, (tau, deviation) in curves.items()
        ]  # fmt: skip
        about = f"{len(lines)} logs; those in orange have an outlier."
        figures.append(figure(f"curves-{channel}", channel, about, x, y, lines))
    return figures


def _spread(fleet: dict[str, Any]) -> Markup:
    shown = {name: one for name, one in fleet["spread"].items() if one["count"] >= min(2, len(fleet["names"]))}
    if not shown:
        return Markup("")
    drawn = set(sorted(shown, key=lambda name: -len(shown[name]["outliers"]))[:LISTED])  # prefer those with outliers
    scores = np.abs([score for name in drawn for score in shown[name]["scores"]])
    reach = max(_LINEAR + 1.0, 1.3 * float(np.max(scores, initial=0.0, where=np.isfinite(scores))))
    caption = (
        f"Each point is a log: its distance from the median, in robust standard deviations, linear up to {_LINEAR:g} and then logarithmic "
        f"up to {reach:.3g} at the ends. Orange points are outliers, beyond the dashed limit."
    )
    if len(drawn) < len(shown):
        caption += f" {len(drawn)} of {len(shown)} coefficients have points."
    columns = ("Coefficient", "Median", "Unit", "Robust s.d.", "Own error", "Each log", "Outliers", "Logs", "5 %", "95 %")
    rows = [
        (name, _shown(one["median"]), unit_label(one["unit"]), _shown(one["sigma"]), _shown(one["own"]),
         _strip(one, reach) if name in drawn else "", len(one["outliers"]), one["count"], _shown(one["low"]), _shown(one["high"]))
        for name, one in shown.items()
    ]  # fmt: skip
    listed = scroll(table(columns, rows), "Spread of every coefficient", "scroll numbers")
    return tag("div", _filters(fleet), section("Spread", "spread", listed, tag("p", caption, class_="small")), class_="beside")


def _filters(fleet: dict[str, Any]) -> Markup:
    """What a filter for any of the devices needs; nothing for a task that does not say it."""
    found = fleet.get("filters") or []
    rows = [(name, unit_label(unit), f"{high:.3g}", f"{median:.3g}", count) for name, unit, count, median, high in found]
    listed = table(("Worst axis", "SI unit", "95 %", "Median", "Logs"), rows)
    about = "Of each log; 95 % of the logs are below the first number. A log in which a term is not present counts with its upper limit."
    return (
        section("For a filter", "filter", scroll(listed, "For a filter", "scroll numbers"), tag("p", about, class_="small"))
        if rows
        else Markup("")
    )


def _shown(value: float) -> str:
    if not math.isfinite(value):
        return "\u2013"
    return f"\u2212{number_label(-value)}" if value < 0 else number_label(value)


def _outliers(fleet: dict[str, Any]) -> Markup:
    files = dict(zip(fleet["names"], fleet["files"], strict=True))
    by_log: dict[str, list[dict[str, Any]]] = {}
    for one in fleet["spread"].values():
        for outlier in one["outliers"]:
            by_log.setdefault(outlier["path"], []).append(outlier)
    worst = sorted(by_log.values(), key=lambda found: -max(abs(outlier["score"]) for outlier in found))
    items = []
    for found in worst[:LISTED]:
        reasons = each("li", (o["reason"] for o in sorted(found, key=lambda o: -abs(o["score"]))))
        items.append(tag("li", tag("a", found[0]["name"], href=files[found[0]["name"]]), tag("ul", reasons)))
    if len(worst) > LISTED:
        items.append(tag("li", f"and {len(worst) - LISTED} more"))
    return section("Outliers", "outliers", tag("ul", *items) if items else tag("p", "None."))


def _trends(fleet: dict[str, Any]) -> Markup:
    found = [(name, one, trend) for name, one in fleet["spread"].items() for trend in one["trends"]]
    if not found:
        return section("Trends", "trends", tag("p", "None."))
    found.sort(key=lambda item: item[2]["p"])
    drawn = [_trend_figure(f"fleet-trend-{number}", *item) for number, item in enumerate(found[: PANELS // 2])]
    return section(
        "Trends", "trends", tag("ul", each("li", (trend["reason"] for _, _, trend in found[:PANELS]))), tag("div", *drawn, class_="main")
    )


def _warnings(fleet: dict[str, Any]) -> Markup:
    items = []
    for sentence, names in fleet["warnings"][:LISTED]:
        shown = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
        items.append(tag("li", f"{len(names)} log{'s' * (len(names) != 1)} ({shown}): {sentence}"))
    if len(fleet["warnings"]) > LISTED:
        items.append(tag("li", f"and {len(fleet['warnings']) - LISTED} more; the result files have all"))
    return section("Warnings", "warnings", tag("ul", *items) if items else tag("p", "None."))


def _strip(one: dict[str, Any], reach: float) -> Markup:
    """A row of points, one for each log, in a cell of the table: linear up to `_LINEAR`, then logarithmic up to `reach`."""
    score = np.array(one["scores"], dtype=float)
    odd, known = np.abs(score) > one["limit"], np.isfinite(score)

    def across(values: Any) -> np.ndarray:
        size = np.abs(values) / _LINEAR
        return _HALF * (1.0 + 0.98 * np.sign(values) * _bent(size) / _bent(reach / _LINEAR))

    height = np.random.default_rng(0).uniform(3.0, 15.0, len(score))  # so that the points do not overlap
    limits = [limit for limit in (-one["limit"], 0.0, one["limit"]) if abs(limit) <= reach]
    lines = [tag("path", d=f"M{at:.1f} 0V18", class_="grid" if at == _HALF else "grid thin dashed") for at in across(np.array(limits))]
    size = "small " if len(score) > MOST // 4 else ""  # few points are large enough to be seen one by one
    for there, look in ((known & ~odd, f"dots {size}faint c0"), (known & odd, "dots c1")):
        points = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in zip(across(score[there]), height[there], strict=True))
        lines.append(tag("path", d=points, class_=look))
    label = f"{int(known.sum())} logs, {int(odd.sum())} outliers"
    return tag("svg", *lines, viewBox=f"0 0 {2 * _HALF} 18", role="img", aria_label=label, class_="strip drawn")


def _bent(size: Any) -> Any:
    """The size up to one, then one more than its logarithm."""
    return np.where(size <= 1.0, size, 1.0 + np.log10(np.maximum(size, 1.0)))


def _trend_figure(prefix: str, name: str, one: dict[str, Any], trend: dict[str, Any]) -> Markup:
    """The values of a coefficient over the order or the date of the logs; outliers are orange."""
    values, at = np.array(one["values"], dtype=float), np.array(trend["at"], dtype=float)
    odd = np.abs(np.array(one["scores"], dtype=float)) > one["limit"]
    along = f"{trend['along']}{' (days after the first)' if trend['along'] == 'date' else ''}"
    power = 10.0 ** math.floor(math.log10(np.nanmax(np.abs(values))))  # of ten, in the label in place of the ticks
    x, y = linear_axis(along, [at]), linear_axis(f"{name} ({number_label(power, 1)} {unit_label(one['unit'])})", [values / power])
    marks = [Mark("dots", at[there], values[there] / power, color) for color, there in enumerate((~odd, odd))]
    return figure(prefix, name, f"{trend['reason']}.", x, y, marks)
