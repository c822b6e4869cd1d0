"""Figures of the alignment of a turntable: the readings with the fitted model, and the distribution of the azimuth."""

import math
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._special import NORMAL95
from .._units import factor, shown_in
from ..alignment import AlignmentFit, Positions, Readings
from ..plot._style import unit_label
from ._charts import Chart, Curve, charts
from ._html import Markup, numbers, section

SUBJECT = "Alignment"
_, _DEG = shown_in("angle")
_SENSORS = (("accel", "Specific force of the accelerometer", ("m/s^2", "mg")), ("gyro", "Rate of the gyroscope", ("deg/h", "rad/s")))


def lead(result: AlignmentFit) -> str:
    """Number of positions, and time at them."""
    positions = result.readings.positions
    return f"{len(positions)} positions, {float(np.sum(positions.dwell)):g} s in all"


def figures(result: AlignmentFit, _: Any) -> tuple[list[Markup], list[Markup]]:
    """The distribution of the azimuth, and the readings over the table angle."""
    readings, azimuth = result.readings, _azimuth(result)
    shown = [*azimuth, *_readings(readings, result)[::-1]]
    more = [charts(shown[2:])] if shown[2:] else []
    return [charts([one]) for one in shown[:2]], [section("Readings", "readings", *more, _numbers(readings, result))]


def _readings(readings: Readings, result: AlignmentFit) -> list[Chart]:
    """Readings over the table angle, with the model at every angle."""
    positions, turning, shown = readings.positions, np.linspace(0.0, 2.0 * np.pi, 121), []
    mean = {name: float(np.mean(getattr(positions, name))) for name in ("rate", "width")}
    words, models = np.array(positions.mounting), {}
    for word in ("x", "y"):
        if word in positions.mounting:
            moving = Positions(turning, word, start=0.0, **mean)  # all at one time, so without drift
            models[word] = dict(zip(("accel", "gyro"), result.model.measure(moving, lever_arm=readings.lever_arm), strict=True))
    for name, title, named in _SENSORS:
        units = [(unit_label(unit), factor(unit, name)) for unit in named]
        if getattr(readings, name) is None:
            continue
        values, variance = np.asarray(getattr(readings, name)), readings.variance(name)
        angle, curves = np.mod(positions.angle / _DEG, 360.0), []
        half = None if variance is None else NORMAL95 * np.sqrt(np.asarray(variance))
        for color, word in enumerate(dict.fromkeys(words)):
            here = (words == word) & np.isfinite(values)
            if here.any() and word != "fixed z":
                ends = (None, None) if half is None else (values[here] - half[here], values[here] + half[here])
                curves.append(Curve(f"mounting {word}", "dots", angle[here], values[here], *ends, color=color, label=f"{word}, read"))
            if word in models:
                model = np.asarray(models[word][name])
                curves.append(Curve(f"mounting {word}", "line", turning / _DEG, model, color=color, label=f"{word}, model"))
        about = "Dots: readings" + (" with their 95 % intervals." if half is not None else ".") + " Lines: fitted model."
        shown.append(Chart(f"north-{name}", title, about, "Table angle (deg)", title.partition(" of")[0], units, curves))
    return shown


def _azimuth(result: AlignmentFit) -> list[Chart]:
    """Distribution of the azimuth, if it was determined."""
    psi = result.estimate["psi"]
    std = float(np.asarray(result.azimuth_std))
    if psi.state != "estimated" or not 0 < std < math.inf:
        return []
    low, high, freedom = psi.low, psi.high, float(result.estimate.select("psi").freedom[0])
    x = psi.value + (high - low) * np.linspace(-1.0, 1.0, 121)
    density = scipy.stats.t.pdf(x, freedom, psi.value, std) * _DEG
    about = f"Azimuth {psi.value / _DEG:.4g}°, 95 % between {low / _DEG:.4g}° and {high / _DEG:.4g}° (dashed)."
    curve = Curve("density", "line", x / _DEG, density, np.zeros(len(x)), density, label="density")
    return [Chart("north-azimuth", "Distribution of the azimuth", about, "Azimuth (deg)", "Density (1/deg)", (("", 1.0),), [curve],
                  [low / _DEG, high / _DEG])]  # fmt: skip


def _numbers(readings: Readings, result: AlignmentFit) -> Markup:
    positions = readings.positions
    columns = ("angle (deg)", "mounting", "dwell (s)", "accelerometer (m/s²)", "residual in std", "gyro (deg/h)", "residual in std")
    rows = []
    for i in range(len(positions)):
        cells = [f"{positions.angle[i] / _DEG:.4f}", positions.mounting[i], f"{positions.dwell[i]:g}"]
        for values, residual, size in ((readings.accel, result.accel_residual, 1.0), (readings.gyro, result.gyro_residual, _DEG / 3600)):
            value = np.nan if values is None else values[i]
            cells += [f"{value / size:.6f}", f"{-residual[i]:+.2f}"] if np.isfinite(value) else ["", ""]
        rows.append(cells)
    return numbers("Every reading", columns, rows)
