"""Pictures of an error budget: errors over time, all and by cause."""

from typing import Any

from .._units import shown_in
from ..budget import Budget
from ..budget._result import GROUPS
from ._charts import Chart, Curve, charts

SUBJECT = "Error budget"


def lead(found: Budget) -> str:
    """The motion."""
    return f"{found.motion}, {found.time[-1]:g} s"


def figures(found: Budget, _: Any) -> tuple[list[Any], list[Any]]:
    """A chart of each error with its largest causes."""
    drawn = []
    sections: list[Any] = found.sections()
    for group, _, curves in sections[-len(found.groups) :]:
        _, quantity, label = GROUPS[group]
        names = ["all", *(cause for cause, _ in found.largest(group, found.time[-1]))]
        lines = [Curve(name, "line", found.time, curves[name][1], color=i, label=name) for i, name in enumerate(names)]
        drawn.append(Chart(group, label[0].upper() + label[1:], "Standard deviation.", "Time (s)", label, [shown_in(quantity)], lines))
    return [charts(drawn[:2])], [charts(drawn[2:])] if drawn[2:] else []
