"""The signal of each sensor, with what in it is not the sensor under test marked."""

from typing import Any

import numpy as np

from .._log import Log
from .._units import BEYOND, shown_in
from ..evidence import Stretch
from ..evidence._findings import timeline
from ..plot._style import SENSORS
from ._html import FINE, Markup, join, tag
from ._svg import Mark, figure, linear_axis

#: kinds by colour, and the words of the key
_COLUMNS = 2 * FINE
_COLOURS = {"moving": 1, "knock": 1, "step": 3, "gap": 4, "held": 5, "stuck": 5, "zeroed": 5, "clipped": 5, "warm_up": 2}


def timelines(log: Any) -> Markup:
    """The lines of `jaxcal info`, and the signal of each sensor."""
    if not isinstance(log, Log):  # a table of readings has no signal
        return Markup("")
    raw, lines = log.recorded, timeline(log.evidence)
    figures = [_figure(raw, name, log.evidence) for name in SENSORS if getattr(raw, name, None) is not None]
    said = tag("ul", *(tag("li", line) for line in lines)) if lines else tag("p", "Nothing was set aside.")
    return join((said, tag("div", *figures, class_="main"))) if figures else Markup("")


def _figure(log: Log, sensor: str, evidence: tuple[Stretch, ...]) -> Markup:
    found = [one for one in evidence if one.sensor in ("", sensor) and one.kind in _COLOURS]
    readings = np.asarray(getattr(log, sensor)).reshape(len(log.time), -1)
    unit, size = shown_in(sensor if np.nanmedian(np.abs(readings)) < BEYOND[sensor] else "counts")
    long, scale = ("h", 3600.0) if log.duration > 7200 else ("min", 60.0) if log.duration > 300 else ("s", 1.0)
    values = (readings - np.nanmedian(readings, axis=0)) / size
    edges = np.unique(np.linspace(0, len(values), _COLUMNS + 1).astype(int))[:-1]
    low, high = (extreme.reduceat(values, edges, axis=0) for extreme in (np.fmin, np.fmax))
    x, y = linear_axis(f"Time ({long})", [[0.0, log.duration / scale]], 0.0), linear_axis(f"{SENSORS[sensor]} ({unit})", [low, high])
    marks = []
    for one in found:
        times = np.array([one.start, max(one.stop, one.start + 2 * log.duration / _COLUMNS)]) / scale
        marks.append(Mark("band", times, np.full(2, y.low), _COLOURS[one.kind], np.full(2, y.high)))
        marks.append(Mark("line", times, np.full(2, y.low), _COLOURS[one.kind], look="large"))
    times = log.time[edges] / scale
    known = np.isfinite(values)
    with np.errstate(invalid="ignore"):
        mean = np.add.reduceat(np.where(known, values, 0.0), edges, axis=0) / np.add.reduceat(known, edges, axis=0, dtype=float)
    for axis in range(values.shape[1]):
        marks += [Mark("band", times, low[:, axis], "ink", high[:, axis], "thin"), Mark("line", times, mean[:, axis], axis, look="thin")]
    kinds = "; ".join(dict.fromkeys(one.kind.replace("_", "-") for one in found))
    about = "Mean, least and largest reading of each axis, less its median." + f" Marked: {kinds}." * bool(kinds)
    return figure(f"timeline-{sensor}", SENSORS[sensor], about, x, y, marks)
