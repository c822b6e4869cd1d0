"""The readings of a magnetometer on a sphere: data for the script that rotates it, and the same as static figures."""

import math
from typing import Any

import numpy as np

from .._units import shown_in
from ..magnetometer import MagFit, heading_uncertainty
from ..magnetometer._judge import attitude_in_words
from ..magnetometer._model import quantity_of
from ..plot._magnetometer import region_corners
from ._explore import short
from ._html import MOST, Markup, data, each, evenly, tag
from ._svg import ASPECT, Axis, Mark, figure, linear_axis

_STEPS = (0.5, 1.5, 3.5, 7.5)  # numbers of readings in a region above which its shade becomes darker


def sphere(found: MagFit, readings: np.ndarray | None) -> list[Markup]:
    """A sphere that the reader can rotate if scripts run, else static figures; the error of the heading; and a map of the directions.

    Parameters
    ----------
    found : a fit with a model.
    readings : (n, 3) the readings that were fitted, in the unit of the fit; None if they are not available.
    """
    unit, scale = shown_in(quantity_of(found.field))
    about: dict[str, Any] = {"unit": unit, "missing": _vectors(found.coverage.missing), "needed": _vectors(found.needed), "readings": []}  # type: ignore[union-attr]
    if readings is not None:
        pick = np.array(evenly(len(readings), MOST))
        fixed = np.asarray(found.model.correct(readings[pick]))  # type: ignore[union-attr]
        field = float(found.field)
        about |= {
            "field": float(f"{field / scale:.5g}"), "number": (pick + 1).tolist(),
            "outliers": np.isin(pick, found.outliers).astype(int).tolist(),
            "readings": _vectors(fixed / field), "measured": _vectors((readings[pick]) / field),
            "residual": short(np.asarray(found.residual)[pick] / scale, 3),
        }  # fmt: skip
    static = [] if readings is None else _planes(found, readings, scale, unit)
    turned = tag("div", data(about), tag("div", *static, class_="static"), class_="sphere")
    return [turned, *([_headings(found)] if np.isfinite(found.heading_error[0]) else []), _map(found)]


def _vectors(values: Any) -> list[list[float | None]]:
    return [short(row, 3) for row in np.asarray(values, dtype=float).reshape(-1, 3)]


def _planes(found: MagFit, readings: np.ndarray, scale: float, unit: str) -> list[Markup]:
    """Readings before and after correction, projected on two planes; and the residuals by direction."""
    pick = np.array(evenly(len(readings), MOST))
    before, after = readings[pick] / scale, np.asarray(found.model.correct(readings[pick])) / scale  # type: ignore[union-attr]
    circle = np.linspace(0, 2 * np.pi, 121)
    radius, reach = found.field / scale, 1.1 * max(np.abs(before).max(), np.abs(after).max())
    figures = []
    for i, j in ((0, 1), (0, 2)):
        x, y = (Axis(f"{'xyz'[k]} ({unit})", -reach * part, reach * part, False) for k, part in ((i, ASPECT), (j, 1.0)))
        marks = [Mark("dots", after[:, i], after[:, j], 0, look="small"), Mark("dots", before[:, i], before[:, j], 1, look="small")]
        marks.append(Mark("line", radius * np.cos(circle), radius * np.sin(circle), "ink", look="thin"))
        title = f"Readings, {'xyz'[i]} and {'xyz'[j]}"
        figures.append(figure(f"mag-{i}{j}", title, "Circle: the field.", x, y, marks, ("corrected", "as measured")))
    y = np.asarray(found.model.correct(readings[pick]))  # type: ignore[union-attr]
    longitude, height = np.rad2deg(np.arctan2(y[:, 1], y[:, 0])), y[:, 2] / np.linalg.norm(y, axis=1)
    off = np.asarray(found.residual)[pick] / scale
    marks = [Mark("dots", longitude[part], height[part], color, look="small") for part, color in ((off > 0, 1), (off <= 0, 0))]
    said = f"Distance of each reading to the ellipsoid; {np.sqrt(np.mean(off**2)):.2g} {unit} rms. Patches of one colour are not noise."
    figures.append(figure("mag-residual", "Residuals by direction", said, *_axes(), marks, ("below the field", "above the field")))
    return figures


def _axes() -> tuple[Axis, Axis]:
    return Axis("Longitude (°), 0 at x, 90 at y", -180.0, 180.0, False), Axis("Sine of latitude, z up", -1.0, 1.0, False)


def _map(found: MagFit) -> Markup:
    """Number of readings per region of equal area, and directions in which more would help."""
    marks = []
    for count, corners in zip(np.asarray(found.coverage.counts), region_corners(), strict=True):  # type: ignore[union-attr]
        (west, bottom), _, (east, top), _ = corners
        look = f"q{sum(count > step for step in _STEPS)}"
        marks.append(Mark("band", [west, east], [bottom, bottom], 0, [top, top], look=look))
    wanted = np.asarray(found.needed).reshape(-1, 3)
    marks.append(Mark("dots", np.rad2deg(np.arctan2(wanted[:, 1], wanted[:, 0])), wanted[:, 2], 1, look="large"))
    said = "Readings per region of equal area: the darker the more, none where it is blank. Dots: readings would help most here."
    drawn = figure("mag-coverage", "Directions of the corrected field", said, *_axes(), marks)
    words = each("li", (attitude_in_words(one, float(found.inclination), found.down) for one in wanted))
    return tag("div", drawn, tag("p", "Readings would help most in these attitudes, where x is the nose:"), tag("ul", words))


def _headings(found: MagFit) -> Markup:
    """Standard deviation of the heading as a function of heading."""
    headings = np.linspace(0, 2 * np.pi, 73)
    tilts = {"at level": 0.0, "at 20° of tilt": math.radians(20)}
    curves = [np.rad2deg(np.asarray(heading_uncertainty(found, headings, tilt=tilt))) for tilt in tilts.values()]
    y = linear_axis("Standard deviation (°)", [[0.0], *curves])._replace(low=0.0)
    marks = [Mark("line", np.rad2deg(headings), curve, i) for i, curve in enumerate(curves)]
    x = Axis("Heading (°)", 0.0, 360.0, False)
    return figure("mag-heading", "Heading error", "What the fit leaves, against heading.", x, y, marks, list(tilts))
