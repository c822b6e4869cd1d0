"""Figures of a magnetometer calibration: sphere, coverage, heading error."""

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from .._errors import DataError
from .._types import Checked, Samples
from .._units import shown_in
from ..magnetometer import MagFit, heading_uncertainty
from ..magnetometer._model import quantity_of
from ._style import INK, MOST, SERIES, SHADE, cannot_draw, new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_AFTER, _BEFORE, *_ = SERIES


def sphere(m: Samples, found: Checked[MagFit], axes: Checked[list[Any] | np.ndarray] | None = None) -> Any:
    """Draw readings before and after the calibration, in the three planes and in space, with the circle that they should fill.

    Parameters
    ----------
    m : (n, 3) the readings, in tesla or any other unit.
    found : the fit of these readings.
    axes : four matplotlib Axes, the last one three-dimensional; None makes a figure.

    Returns
    -------
    Array of the four Axes.

    Raises
    ------
    DataError
        If the fit has no model, or the readings are not (n, 3).

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from jaxcal.magnetometer import body_field, scenario
    >>> m = body_field(scenario("all"), 50e-6) + [2e-5, -1e-5, 0]
    >>> jaxcal.plot.sphere(m, jaxcal.magnetometer.fit(m)).shape
    (4,)
    """
    model = _checked(found)
    m = np.asarray(m, dtype=float)
    if m.ndim != 2 or m.shape[1] != 3:
        raise DataError(f"the readings have shape {m.shape}; expected (n, 3)", code="shape")
    m = m[np.isfinite(m).all(axis=1)]
    m = m[:: max(len(m) // MOST, 1)]
    unit, scale = shown_in(quantity_of(found.field))
    before, after, radius = m / scale, np.asarray(model.correct(m)) / scale, found.field / scale
    if axes is None:
        figure = new_figure(10.0)
        places = [figure.add_subplot(2, 2, i + 1) for i in range(3)]
        axes = np.array([*places, figure.add_subplot(2, 2, 4, projection="3d")], dtype=object)
    circle = np.linspace(0, 2 * np.pi, 181)
    for ax, (i, j) in zip(axes[:3], itertools.combinations(range(3), 2), strict=True):
        ax.plot(before[:, i], before[:, j], ".", color=_BEFORE, markersize=2, alpha=0.5, label="as measured")
        ax.plot(after[:, i], after[:, j], ".", color=_AFTER, markersize=2, alpha=0.5, label="corrected")
        ax.plot(radius * np.cos(circle), radius * np.sin(circle), color=INK, linewidth=0.8, label="field")
        style_axes(ax, f"{'xyz'[i]} ({unit})", f"{'xyz'[j]} ({unit})")
        ax.set_aspect("equal")
    axes[0].legend(loc="upper right", fontsize=8, markerscale=4, frameon=True, framealpha=0.85, edgecolor="none")
    axes[3].scatter(*before.T, color=_BEFORE, s=2, alpha=0.4)
    axes[3].scatter(*after.T, color=_AFTER, s=2, alpha=0.4)
    axes[3].set_aspect("equal")
    for axis, name in zip((axes[3].xaxis, axes[3].yaxis, axes[3].zaxis), "xyz", strict=True):
        axis.set_label_text(name, color=INK)
        axis.set_tick_params(labelsize=7, labelcolor=INK)
    return axes


def coverage(found: Checked[MagFit], ax: Checked["Axes"] | None = None) -> Any:
    """Draw an equal-area map of the corrected field's directions: readings per region, and the missing regions.

    Longitude runs from x (0) to y (90 degrees), latitude from -z to +z. Crosses show where further readings would help most.

    Parameters
    ----------
    found : a fit with a model.
    ax : matplotlib Axes; None makes a figure.

    Returns
    -------
    The Axes.

    Raises
    ------
    DataError
        If the fit has no model.

    Examples
    --------
    >>> import jaxcal
    >>> from jaxcal.magnetometer import body_field, scenario
    >>> jaxcal.plot.coverage(jaxcal.magnetometer.fit(body_field(scenario("three_turns"), 50e-6), model="sphere")).get_xlabel()
    'longitude (°), 0 at x, 90 at y'
    """
    from matplotlib.collections import PolyCollection

    _checked(found)
    ax = new_figure().subplots() if ax is None else ax
    counts = np.asarray(found.coverage.counts, dtype=float)  # type: ignore[union-attr]
    cells = PolyCollection(region_corners(), array=np.ma.masked_equal(counts, 0), cmap="viridis", edgecolors="white", linewidths=0.4)
    cells.set_facecolor(SHADE)
    ax.set_facecolor(SHADE)
    ax.add_collection(cells)
    ax.figure.colorbar(cells, ax=ax, pad=0.02).set_label("readings per region", color=INK)
    wanted = np.asarray(found.needed)
    if len(wanted):
        longitude = np.rad2deg(np.arctan2(wanted[:, 1], wanted[:, 0]))
        ax.plot(longitude, wanted[:, 2], "x", color=SERIES[1], markersize=10, markeredgewidth=2.5, label="readings would help most here")
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False, fontsize=9, labelcolor=INK)
    _map(ax)
    ax.grid(False)
    return ax


def heading_error(found: Checked[MagFit], ax: Checked["Axes"] | None = None) -> Any:
    """Draw the standard deviation of the heading after the fit, against heading, at level and at 20 degrees of tilt.

    Parameters
    ----------
    found : a fit with a model.
    ax : matplotlib Axes; None makes a figure.

    Returns
    -------
    The Axes.

    Raises
    ------
    DataError
        If the fit has no model, or its readings do not determine the heading.

    Examples
    --------
    >>> import jaxcal
    >>> from jaxcal.magnetometer import body_field, scenario
    >>> m = body_field(scenario("all"), 50e-6)
    >>> jaxcal.plot.heading_error(jaxcal.magnetometer.fit(m)).get_xlabel()
    'heading (°)'
    """
    _checked(found)
    if not np.isfinite(found.heading_error[0]):
        raise DataError("there is nothing to draw: the readings leave the heading open", code="nothing")
    ax = new_figure().subplots() if ax is None else ax
    headings = np.linspace(0, 2 * np.pi, 145)
    tilts = ((0.0, "level"), (np.deg2rad(20), "20° of tilt"))
    for (tilt, name), color in zip(tilts, SERIES, strict=False):
        ax.plot(np.rad2deg(headings), np.rad2deg(heading_uncertainty(found, headings, tilt=tilt)), color=color, label=name)
    style_axes(ax, "heading (°)", "standard deviation (°)")
    ax.set(xlim=(0, 360), xticks=range(0, 361, 45))
    ax.set_ylim(bottom=0)
    ax.legend(frameon=False, fontsize=9, labelcolor=INK)
    return ax


def _map(ax: "Axes") -> None:
    """Set up axes of longitude and of the sine of latitude, which form an equal-area map."""
    style_axes(ax, "longitude (°), 0 at x, 90 at y", "latitude (°), z up")
    ax.set(xlim=(-180, 180), ylim=(-1, 1), xticks=range(-180, 181, 45))
    latitudes = np.array([-90, -45, -30, -15, 0, 15, 30, 45, 90])
    ax.set_yticks(np.sin(np.deg2rad(latitudes)), [str(latitude) for latitude in latitudes])


def _checked(found: Any) -> Any:
    if not isinstance(found, MagFit):
        raise cannot_draw(found, "a MagFit, as jaxcal.magnetometer.fit returns it")
    if found.model is None:
        raise DataError(f"there is nothing to draw: the fit has no model. {found.reason}", code="nothing")
    return found.model


def region_corners() -> list[np.ndarray]:
    """Corners of the 100 regions of equal area, in longitude (degrees) and sine of latitude."""
    edges = np.sin([1.37046, 0.74776, 0.0, -0.74776, -1.37046])
    rows = [(1, 1.0, edges[0])] + [(n, edges[k], edges[k + 1]) for k, n in enumerate((15, 34, 34, 15))] + [(1, edges[-1], -1.0)]
    # region j of a zone begins j sectors after -x, where the longitude is -180 degrees
    return [
        np.array([(west, bottom), (west + 360 / count, bottom), (west + 360 / count, top), (west, top)])
        for count, top, bottom in rows
        for west in -180 + 360 * np.arange(count) / count
    ]
