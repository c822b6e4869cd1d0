"""The alignment of a turntable as sections of a page, and as a JSON document."""

import importlib.metadata
import math
from typing import Any

import numpy as np

from .._errors import DataError
from .._special import NORMAL95
from .._units import STANDARD_GRAVITY
from ..alignment import UNITS, AlignmentFit, Positions, Readings, verdict_name
from ..plot._north import student_density
from ._charts import Chart, Curve, charts
from ._html import Markup, each, join, numbers, scroll, section, table, tag
from ._noise import number

_DEG = math.pi / 180
_SENSORS = (
    ("accel", "Specific force of the accelerometer", (("m/s²", 1.0), ("mg", STANDARD_GRAVITY * 1e-3))),
    ("gyro", "Rate of the gyroscope", (("deg/h", _DEG / 3600), ("rad/s", 1.0))),
)
_MEANING = {
    "phi": "roll of the table", "theta": "pitch of the table", "psi": "azimuth of the table's x axis, from north towards east",
    "b_a": "bias of the accelerometer", "s_a": "scale error of the accelerometer", "b_g": "bias of the gyro",
    "s_g": "scale error of the gyro",
    "ma_a_xy": "misalignment of the accelerometer, first cross axis", "ma_a_xz": "misalignment of the accelerometer, second cross axis",
    "ma_g_xy": "misalignment of the gyro, first cross axis", "ma_g_xz": "misalignment of the gyro, second cross axis",
    "b_a_rate": "drift of the accelerometer", "b_g_rate": "drift of the gyro", "latitude": "latitude, north positive",
}  # fmt: skip


def document(result: AlignmentFit, readings: Any) -> dict[str, Any]:
    """An alignment as a dictionary for JSON."""
    parameters, interval, freedom = {}, result.interval, dict(zip(result.names, np.asarray(result.freedom), strict=True))
    for name, value in result.parameters.items():
        low, high = interval.get(name, (math.inf, math.inf))
        parameters[name] = {
            "value": None if value is None else number(value), "std": number(result.std[name]), "low": number(low), "high": number(high),
            "degrees_of_freedom": number(freedom[name]), "unit": UNITS.get(name, ""),
        }  # fmt: skip
    return {
        "schema": "jaxcal.north/1", "version": importlib.metadata.version("jaxcal"), "verdict": verdict_name(result.verdict),
        "reason": result.reason, "parameters": parameters, "rank": int(result.rank), "unobservable": list(result.unobservable),
        "undetermined": list(result.undetermined), "chi_square": number(result.chi_square),
        "degrees_of_freedom": int(result.degrees_of_freedom), "p_value": result.p_value, "notes": list(result.notes),
    }  # fmt: skip


def summary(result: AlignmentFit) -> list[tuple[str, str, Any]]:
    """Subject, verdict in one word, and the reason for the verdict."""
    return [("Alignment", verdict_name(result.verdict), result.reason)]


def page(result: AlignmentFit, readings: Any, version: str) -> tuple[str, str, Markup]:
    """Subject, subtitle and sections of the page."""
    if not isinstance(readings, Readings):
        raise DataError(
            f"log is {type(readings).__name__}; the page of an alignment shows what was read: give the Readings that were fitted"
        )
    lead = f"{len(readings.positions)} positions, {float(np.sum(readings.positions.dwell)):g} s in all"
    figure = charts([*_readings(readings, result), *_azimuth(result)])
    said = [result.observability]
    if result.p_value is not None:
        said.append(
            f"Chi-square {float(result.chi_square):.3g} with {int(result.degrees_of_freedom)} degrees of freedom: p = {result.p_value:.2g}."
        )
    notes = section("Notes", "notes", tag("ul", each("li", [*said, *result.notes])))
    return "Alignment", lead, join((_found(result), section("Readings", "readings", figure, _numbers(readings, result)), notes))


def _readings(readings: Readings, result: AlignmentFit) -> list[Chart]:
    """Readings over the table angle, with the model at every angle."""
    positions, turning, shown = readings.positions, np.linspace(0.0, 2.0 * np.pi, 121), []
    mean = {name: float(np.mean(getattr(positions, name))) for name in ("rate", "width")}
    words, models = np.array(positions.mounting), {}
    for word in ("x", "y"):
        if word in positions.mounting:
            moving = Positions(turning, word, start=0.0, **mean)  # all at one time, so without drift
            models[word] = dict(zip(("accel", "gyro"), result.model.measure(moving, lever_arm=readings.lever_arm), strict=True))
    for name, title, units in _SENSORS:
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
    std = float(np.asarray(result.azimuth_std))
    if result.psi is None or not 0 < std < math.inf:
        return []
    low, high = result.interval["psi"]
    x = result.psi + (high - low) * np.linspace(-1.0, 1.0, 121)
    density = student_density((x - result.psi) / std, float(result.freedom[2])) / std * _DEG
    about = f"Azimuth {result.psi / _DEG:.4g}°, 95 % between {low / _DEG:.4g}° and {high / _DEG:.4g}° (dashed)."
    curve = Curve("density", "line", x / _DEG, density, np.zeros(len(x)), density, label="density")
    return [Chart("north-azimuth", "Distribution of the azimuth", about, "Azimuth (deg)", "Density (1/deg)", (("", 1.0),), [curve],
                  [low / _DEG, high / _DEG])]  # fmt: skip


def _shown(name: str) -> tuple[float, str]:
    """Size and name of the unit in which a parameter is displayed."""
    if name not in UNITS or name in ("phi", "theta", "psi", "latitude"):
        return (_DEG, "deg") if name in UNITS else (1.0, "SI")
    return {
        "rad": (_DEG / 3600, "arcsec"), "": (1e-6, "ppm"), "m/s^2": (9.80665e-6, "µg"), "rad/s": (_DEG / 3600, "deg/h"),
        "m/s^3": (9.80665e-6 / 3600, "µg/h"), "rad/s^2": (_DEG / 3600**2, "deg/h²"),
    }[UNITS[name]]  # fmt: skip


def _found(result: AlignmentFit) -> Markup:
    rows, interval = [], result.interval
    for name, value in result.parameters.items():
        size, unit = _shown(name)
        low, high = interval.get(name, (-math.inf, math.inf))
        half = (high - low) / 2 / size
        if value is None or not math.isfinite(half):
            cells = ("not determined", "")
        else:
            digits = max(0, 1 - math.floor(math.log10(half))) if half > 0 else 6
            shown = value / size
            texts = (f"{shown:.{digits}f} {unit}", f"{shown - half:.{digits}f} to {shown + half:.{digits}f}")
            cells = tuple(text.replace("-", "\u2212") for text in texts)  # unlike a hyphen, this minus stays on the line of its number
        badge = tag("span", "prior", class_="badge hint") if bool(np.asarray(result.prior_only)[result.names.index(name)]) else Markup("")
        rows.append((join((tag("b", name), " ", badge, tag("span", _MEANING.get(name, ""), class_="small"))), *cells))
    found = table(("", "value", "95 % interval"), rows, class_="terms")
    return section("What was found", "found", tag("p", result.reason), scroll(found, "What was found"))


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
