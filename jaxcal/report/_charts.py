"""Interactive charts of a few curves: data for `charts.js`, and the same curves as static figures."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ._explore import short
from ._html import Markup, data, tag
from ._svg import Mark, figure, linear_axis, log_axis


class Curve(NamedTuple):
    """Dots with intervals, or a line with the band of its interval.

    `name` is the text of the switch, `label` the text beside a value; `hollow` are the indices of dots with less weight.
    """

    name: str
    kind: str
    x: Any
    y: Any
    low: Any = None
    high: Any = None
    color: int = 0
    label: str = ""
    hollow: Sequence[int] = ()


class Chart(NamedTuple):
    """Curves over one abscissa; `units` are (label, size) to choose from, the default first; `marks` are abscissas of vertical lines.

    `log` makes both axes logarithmic.
    """

    prefix: str
    title: str
    about: str
    x: str
    y: str
    units: Sequence[tuple[str, float]]
    curves: Sequence[Curve]
    marks: Sequence[float] = ()
    log: bool = False


def charts(found: Sequence[Chart]) -> Markup:
    """The charts if scripts run, else static figures."""
    return tag("div", data([_data(one) for one in found]), tag("div", *map(_static, found), class_="static"), class_="charts")


def _data(chart: Chart) -> dict[str, Any]:
    curves = []
    for one in chart.curves:
        held: dict[str, Any] = {"name": one.name, "label": one.label, "kind": one.kind, "color": one.color, "x": short(one.x, 6)}
        held |= {"y": short(one.y, 6), "hollow": [int(i) for i in one.hollow]}
        held |= {name: None if values is None else short(values, 5) for name, values in (("low", one.low), ("high", one.high))}
        curves.append(held)
    return {"title": chart.title, "about": chart.about, "x": chart.x, "y": chart.y, "units": [list(unit) for unit in chart.units],
            "curves": curves, "marks": short(chart.marks, 6), "log": chart.log}  # fmt: skip


def _static(chart: Chart) -> Markup:
    unit, size = chart.units[0]
    marks: list[Mark] = []
    values = [np.asarray(part, dtype=float) / size for one in chart.curves for part in (one.y, one.low, one.high) if part is not None]
    axis, pad = (log_axis, 1.1) if chart.log else (linear_axis, 0.02)
    x = axis(chart.x, [one.x for one in chart.curves], pad)
    y = axis(f"{chart.y} ({unit})" if unit else chart.y, values)
    for place in chart.marks:
        marks.append(Mark("line", [place, place], [y.low, y.high], "ink", look="thin dashed"))
    for one in chart.curves:
        across, up = np.asarray(one.x, dtype=float), np.asarray(one.y, dtype=float) / size
        ends = None if one.low is None else [np.asarray(end, dtype=float) / size for end in (one.low, one.high)]
        if one.kind == "line":
            marks += [] if ends is None else [Mark("band", across, ends[0], one.color, ends[1])]
            marks.append(Mark("line", across, up, one.color))
            continue
        if ends is not None:
            apart = np.full(len(across), np.nan)
            bars = np.stack([across, across, apart], axis=1).ravel(), np.stack([*ends, apart], axis=1).ravel()
            marks.append(Mark("line", *bars, one.color, look="thin"))
        hollow = np.isin(np.arange(len(across)), np.asarray(one.hollow, dtype=int))
        for there, look in ((~hollow, "small" if len(across) > 60 else ""), (hollow, "faint")):
            if there.any():
                marks.append(Mark("dots", across[there], up[there], one.color, look=look))
    colors = {one.color: one.name for one in chart.curves}
    names = [colors.get(i, "") for i in range(max(colors) + 1)] if len(set(colors.values())) > 1 else []
    return figure(chart.prefix, chart.title, chart.about, x, y, marks, names)
