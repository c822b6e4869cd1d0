"""Figures of the alignment of a turntable: the azimuth on a compass and its distribution, and the readings with the fitted model."""

import math
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._special import NORMAL95
from .._units import factor, shown_in, unit_label
from ..alignment import AlignmentFit, Positions, Readings
from ._charts import Chart, Curve, charts
from ._html import Markup, numbers, section
from ._svg import ASPECT, Axis, Mark, figure

SUBJECT = "Alignment"
_, _DEG = shown_in("angle")
_SENSORS = (("accel", "Specific force of the accelerometer", ("m/s^2", "mg")), ("gyro", "Rate of the gyroscope", ("deg/h", "rad/s")))


def lead(result: AlignmentFit) -> str:
    """Number of positions, and time at them."""
    positions = result.readings.positions
    return f"{len(positions)} positions, {float(np.sum(positions.dwell)):g} s in all"


def figures(result: AlignmentFit, _: Any) -> tuple[list[Markup], list[Markup]]:
    """The azimuth on a compass and its distribution, if it was determined, and the readings over the table angle."""
    readings, psi = result.readings, result.estimate["psi"]
    known = psi.state == "estimated" and 0 < float(np.asarray(result.azimuth_std)) < math.inf
    drawn = charts(_readings(readings, result)[::-1])
    main = [_compass(psi), charts([_azimuth(result)])] if known else []
    return main, [section("Readings", "readings", drawn, _numbers(readings, result))]


def _compass(psi: Any) -> Markup:
    """The azimuth as a needle and its 95 % interval as a sector, on a compass with north at the top."""
    value, low, high = (float(one) / _DEG for one in (psi.value, psi.low, psi.high))
    side = 125.0

    def at(angle: Any, radius: float = side) -> Any:
        """Points across and up from the centre; one for each angle in degrees, clockwise from north."""
        return radius * np.sin(np.deg2rad(angle)), radius * np.cos(np.deg2rad(angle))

    turn, sector = np.linspace(0.0, 360.0, 121), np.linspace(low, min(high, low + 360.0), 2 + int(min(high - low, 360.0) / 3))
    (round_x, round_y), (sector_x, sector_y) = at(turn), at(sector)
    marks = [Mark("line", round_x, round_y, "frame"), Mark("band", np.append(sector_x, 0.0), np.append(sector_y, 0.0), 1)]
    marks.append(Mark("line", sector_x, sector_y, 1, look="wide"))
    for angle, start, end, color in (*((one, side - 8.0, side, "frame") for one in range(0, 360, 30)), (value, 0.0, side - 6.0, 0)):
        (x_from, y_from), (x_to, y_to) = at(angle, start), at(angle, end)
        marks.append(Mark("line", [x_from, x_to], [y_from, y_to], color))
    letters = []
    for word, angle in zip("NESW", range(0, 360, 90), strict=True):
        x_at, y_at = at(angle, side + 13.0)
        letters.append((word, x_at, y_at))
    about = f"Azimuth {value:.4g}°, from north towards east. Orange: 95 %, between {low:.4g}° and {high:.4g}°."
    x, y = (Axis("", -part * (side + 25.0), part * (side + 25.0), False) for part in (ASPECT, 1.0))
    return figure("north-compass", "Azimuth", about, x, y, marks, letters=letters)


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


def _azimuth(result: AlignmentFit) -> Chart:
    """Distribution of the azimuth."""
    psi, std = result.estimate["psi"], float(np.asarray(result.azimuth_std))
    low, high, freedom = psi.low, psi.high, float(result.estimate.select("psi").freedom[0])
    x = psi.value + (high - low) * np.linspace(-1.0, 1.0, 121)
    density = scipy.stats.t.pdf(x, freedom, psi.value, std) * _DEG
    curve = Curve("density", "line", x / _DEG, density, np.zeros(len(x)), density, label="density")
    return Chart("north-azimuth", "Distribution of the azimuth", "Dashed: the ends of the 95 % interval.", "Azimuth (deg)",
                 "Density (1/deg)", (("", 1.0),), [curve], [low / _DEG, high / _DEG])  # fmt: skip


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
