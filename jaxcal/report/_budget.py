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
    drawn, color = [], {"all": 0}  # a cause has one colour in all charts
    sections: list[Any] = found.sections()
    for group, _, curves in sections[-len(found.groups) :]:
        _, quantity, label = GROUPS[group]
        # the largest cause of every time in the table, and the largest at the end
        causes = [found.largest(group, found.time[place])[: None if place == found.shown[-1] else 1] for place in found.shown[::-1]]
        names = ["all", *dict.fromkeys(cause for each in causes for cause, _ in each)]
        lines = [Curve(name, "line", found.time, curves[name][1], color=color.setdefault(name, len(color)), label=name) for name in names]
        title = label[0].upper() + label[1:]
        drawn.append(Chart(group, title, "Standard deviation.", "Time (s)", label, [shown_in(quantity)], lines, log=True))
    return [charts([one]) for one in drawn[:2]], [charts(drawn[2:])] if drawn[2:] else []
