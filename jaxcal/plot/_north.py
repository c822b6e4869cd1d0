"""`north`: readings on the turntable with the fitted sinusoid, and the uncertainty of the azimuth."""

from typing import TYPE_CHECKING, Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._special import NORMAL95
from .._types import Given
from .._units import factor, shown_in
from ..alignment import AlignmentFit, Positions, Readings
from ._style import INK, MUTED, SERIES, SHADE, Drawing, cannot_draw, stacked, style_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_, _DEG = shown_in("angle")
_SENSORS = (("accel", "Specific force (m/s²)", "m/s^2"), ("gyro", "Rate (deg/h)", "deg/h"))


def north(readings: Given, result: Given, ax: Drawing | None = None) -> Any:
    """Draw readings against the table angle with the fitted model, and the azimuth's distribution.

    A line shows the prediction of the fitted parameters at every table angle for mounting "x" or "y". A sensor
    fixed on the z axis reads the same at every angle and is left out. The last panel shows the distribution of the azimuth, with 95 % of
    it shaded: normal if the noise was given, Student's t if it comes from the residuals.

    Parameters
    ----------
    readings : `jaxcal.alignment.Readings` that were fitted.
    result : the `AlignmentFit` of these readings.
    ax : array of Axes to draw on, one per sensor and one for the azimuth; None makes a figure 1000 pixels wide.

    Returns
    -------
    (k,) array of the Axes.

    Raises
    ------
    DataError
        If the arguments are not readings and their fit, or the fit did not converge.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from jaxcal.alignment import Sensor, simulate
    >>> gyro, accel = Sensor(white=3e-6), Sensor(white=5e-4)
    >>> readings = simulate(np.deg2rad([0.0, 90.0, 180.0, 270.0]), np.deg2rad([2.0, -1.0, 40.0]), 0.6, accel=accel, gyro=gyro)
    >>> axes = jaxcal.plot.north(readings, jaxcal.alignment.fit(readings, 0.6))
    >>> axes[-1].get_xlabel()
    'Azimuth (deg)'
    """
    if not isinstance(readings, Readings) or not isinstance(result, AlignmentFit):
        raise cannot_draw((readings, result), "Readings and the AlignmentFit that jaxcal.alignment.fit made of them")
    if not np.isfinite(result.estimate.values).all():
        raise DataError("there is nothing to draw: the fit did not converge", code="nothing")
    sensors = [entry for entry in _SENSORS if getattr(readings, entry[0]) is not None]
    axes = stacked(ax, len(sensors) + 1, 2.6 * (len(sensors) + 1), "per sensor and one for the azimuth")
    rate, width = (float(np.mean(getattr(readings.positions, name))) for name in ("rate", "width"))
    turning = np.linspace(0, 2 * np.pi, 181)
    curves = {}
    for word in ("x", "y"):
        if word in readings.positions.mounting:
            moving = Positions(turning, word, start=0.0, rate=rate, width=width)  # a single instant, so that there is no drift
            curves[word] = Readings(moving, *result.model.measure(moving, lever_arm=readings.lever_arm))
    for panel, (name, label, unit) in zip(axes, sensors, strict=False):
        _readings(panel, readings, name, label, 1 / factor(unit, name), curves)
    _azimuth(axes[-1], result)
    return axes


def _readings(ax: "Axes", readings: Readings, name: str, label: str, scale: float, curves: dict[str, Readings]) -> None:
    positions = readings.positions
    values, variance = np.asarray(getattr(readings, name)) * scale, readings.variance(name)
    bars = None if variance is None else NORMAL95 * scale * np.sqrt(variance)
    angle = np.mod(positions.angle / _DEG, 360.0)
    words, there = np.array(positions.mounting), np.isfinite(values)
    for i, word in enumerate(dict.fromkeys(words)):
        here, said = (words == word) & there, "" if len(set(words)) == 1 else f" {word}"
        if word == "fixed z" or not here.any():
            continue
        color = SERIES[i % len(SERIES)]
        if word in curves:
            model = curves[word]
            ax.plot(model.positions.angle / _DEG, getattr(model, name) * scale, color=color, linewidth=1.2, label=f"fitted model{said}")
        label_of = f"reading{said}" + (", 95 %" if bars is not None else "")
        yerr = None if bars is None else bars[here]
        ax.errorbar(angle[here], values[here], yerr=yerr, label=label_of, color=color, ecolor=color, fmt="o", markersize=5, capsize=3)
    style_axes(ax, "Table angle (deg)", label)
    ax.set(xlim=(-8, 368), xticks=np.arange(0, 361, 45))
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=4, frameon=False, fontsize=9, labelcolor=INK, borderaxespad=0.2)


def _azimuth(ax: "Axes", result: AlignmentFit) -> None:
    std = float(np.asarray(result.azimuth_std))
    style_axes(ax, "Azimuth (deg)", "Density (1/deg)")
    psi = result.estimate["psi"]
    if psi.state != "estimated" or not 0 < std < np.inf:
        ax.text(0.5, 0.5, "The readings give no azimuth.", transform=ax.transAxes, ha="center", va="center", color=MUTED)
        ax.set(xticks=[], yticks=[])
        return
    centre, sigma = psi.value / _DEG, std / _DEG
    half, freedom = psi.half / _DEG, float(result.estimate.select("psi").freedom[0])
    x = centre + 2 * half * np.linspace(-1, 1, 201)
    density = scipy.stats.t.pdf(x, freedom, centre, sigma)
    inner = np.abs(x - centre) <= half
    ax.fill_between(x[inner], density[inner], color=SHADE)
    ax.plot(x, density, color=SERIES[0], linewidth=1.2)
    ax.axvline(centre, color=MUTED, linewidth=0.8)
    ax.set_ylim(0, None)
    digits = max(0, int(np.ceil(1 - np.log10(half / 2))))
    ax.set_title(f"azimuth {centre:.{digits}f} ± {half:.{digits}f} degrees (95 %)", loc="left", fontsize=10, color=INK)
