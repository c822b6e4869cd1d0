"""`imu`: residuals of a multi-position calibration, pose by pose and turn by turn."""

from typing import TYPE_CHECKING, Any

import numpy as np

from .._errors import DataError
from .._types import Given
from ..imu import ImuFit
from ._style import INK, MUTED, SERIES, Drawing, cannot_draw, stacked, style_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def imu(result: Given, ax: Drawing | None = None) -> Any:
    """Draw the residuals of a multi-position calibration: magnitudes in the poses, angle errors after the turns, rates at rest.

    Hollow points are poses and turns to which the robust loss gives less weight. Bands show one standard deviation found by the fit.

    Parameters
    ----------
    result : an `ImuFit` that was not refused.
    ax : array of one Axes (accelerometer only), or of two or three with a gyroscope; None makes a figure 1000 pixels wide.

    Returns
    -------
    Array of Axes.

    Raises
    ------
    DataError
        If the result is not an `ImuFit`, was refused, or the number of axes is wrong.

    Examples
    --------
    For an accelerometer alone:

    >>> import jaxcal
    >>> log = jaxcal.imu.simulate(poses=18, seed=0)
    >>> found = jaxcal.imu.multi_position(jaxcal.Log(None, accel=log.accel, rate=log.rate), gravity=9.81)
    >>> [ax.get_ylabel() for ax in jaxcal.plot.imu(found)]
    ['Norm less gravity (mm/s²)']
    """
    if not isinstance(result, ImuFit):
        raise cannot_draw(result, "an ImuFit, as jaxcal.imu.multi_position returns it")
    if result.accel is None:
        raise DataError(f"there is nothing to draw: the calibration was refused. {result.reason}", code="refused")
    shown = [("Pose", "Norm less gravity (mm/s²)", -1e3 * np.asarray(result.residual_norm), 1e3 * float(result.sigma[0]))]
    if result.gyro is not None:
        shown.append(("Turn", "Angle after the turn (deg)", np.rad2deg(result.residual_turn), np.rad2deg(np.sqrt(2) * result.sigma[1])))
    panels = len(shown) + (result.gyro is not None and len(result.residual_rest) > 0)
    axes = stacked(ax, panels, 2.4 * panels + 0.4, "for the poses and, with a gyroscope, for the turns and the still rates")
    for panel, (what, label, values, band), low, color in zip(axes, shown, result.down_weighted, SERIES, strict=False):
        _points(panel, what, label, values, color, low, band)
    if len(shown) > 1:
        axes[1].set_ylim(bottom=0)
    if panels > 2:
        for column, color, axis in zip(np.rad2deg(result.residual_rest).T * 3600, SERIES, "xyz", strict=False):
            _points(axes[2], "Pose", "Still rate less model (deg/h)", column, color, name=axis)
        axes[2].legend(frameon=False, ncols=3, fontsize=9, loc="best", handletextpad=0.1)
    axes[0].set_title(f"{len(result.residual_norm)} poses: {result.verdict}", loc="left", color=INK, fontsize=11, fontweight="bold")
    return axes


def _points(
    ax: "Axes", what: str, label: str, values: np.ndarray, color: str, low: Any = (), band: float = 0.0, name: str | None = None
) -> None:
    from matplotlib.ticker import MaxNLocator

    number = np.arange(1, len(values) + 1)
    hollow = np.isin(number - 1, np.asarray(low, dtype=int))
    if band > 0:
        ax.axhspan(-band, band, color=color, alpha=0.08, linewidth=0)
    ax.axhline(0, color=MUTED, linewidth=0.8)
    ax.scatter(number[~hollow], values[~hollow], s=18, color=color, label=name, zorder=3)
    ax.scatter(number[hollow], values[hollow], s=24, facecolors="none", edgecolors=color, zorder=3)
    style_axes(ax, what, label)
    ax.set_xlim(0.3, len(values) + 0.7)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
