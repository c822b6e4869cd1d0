"""Figures of thermal models for a page."""

import numpy as np

from .._answer import joined_names
from .._units import noise_factor, noise_units, unit_label
from ..plot._style import SENSORS
from ..temperature import TemperatureFit, TemperatureFits
from ._charts import Chart, Curve, charts
from ._html import MOST, Markup

SUBJECT, PART = "Bias and temperature", "temperature"
_MEANING = (
    ("rms left", "What the model leaves of the means over 0.1 °C, over all temperatures. It is not a noise coefficient."),
    ("worst degree", "The same in the worst window of 1 °C. A model that misses a jump shows it here."),
    ("jump", "A step of the bias at a temperature. It is a property of the device; no polynomial follows it."),
    ("lag, play", "Heating and cooling give different biases: the sensor follows the thermometer late, or after a backlash."),
    ("interval", "That of the curve. The prediction is for means over 0.1 °C in the next cycle, in which the sensor wanders on."),
)


def lead(result: TemperatureFits) -> str:
    """The channels."""
    return joined_names(result)


def meaning(_: TemperatureFits) -> tuple[tuple[str, str], ...]:
    """Terms and their explanations."""
    return _MEANING


def figures(result: TemperatureFits, _: object) -> tuple[list[Markup], list[Markup]]:
    """For each sensor its bias over temperature, and what the curve leaves."""
    return [charts([one]) for sensor, axes in result.by_sensor().items() for one in _charts(sensor, axes)], []


def _charts(sensor: str, channels: dict[str, TemperatureFit]) -> list[Chart]:
    """Means and curves of every axis, each relative to its value in the middle of its range; and their difference."""
    curves, left = [], []
    for i, (axis, fit) in enumerate(channels.items()):
        model = fit.model
        middle = float(np.asarray(model.curve.value(np.asarray((model.low + model.high) / 2))))
        t = _temperatures(fit)
        line, (low, high) = np.asarray(model.curve.value(t)), fit.interval_at(t)
        means = np.asarray(fit.bins.b) - middle
        curves.append(Curve(axis, "dots", np.asarray(fit.bins.t), means, color=i, label=f"{axis}, mean"))
        apart = np.asarray(fit.bins.b) - np.asarray(model.curve.value(np.asarray(fit.bins.t)))
        left.append(Curve(axis, "dots", np.asarray(fit.bins.t), apart, color=i))
        curves.append(Curve(axis, "line", t, line - middle, low - middle, high - middle, color=i, label=f"{axis}, model"))
    known = sensor in SENSORS
    units = tuple((unit_label(unit), noise_factor("B", sensor, unit)) for unit in noise_units("B", sensor)) if known else (("", 1.0),)
    name, x = SENSORS.get(sensor, sensor), "Temperature (°C)"
    about = "Dots: means over 0.1 °C. Lines: fitted curves with their intervals. Dashed: jumps."
    jumps = [step.centre for fit in channels.values() for step in fit.steps]
    residual = "Means over 0.1 °C less the curve. A pattern is what the model lacks."
    return [
        Chart(f"thermal-{sensor}", f"{name}: change of bias with temperature", about, x, "Change", units, curves, jumps),
        Chart(f"thermal-left-{sensor}", f"{name}: what the curve leaves", residual, x, "Residual", units, left, jumps),
    ]


def _temperatures(fit: TemperatureFit) -> np.ndarray:
    """Temperatures at which a curve is drawn: evenly spaced, with more points around each narrow jump."""
    low, high = float(fit.model.low), float(fit.model.high)
    parts = [np.linspace(low, high, MOST)]
    parts += [step.centre + step.width * np.linspace(-8.0, 8.0, 33) for step in fit.steps]
    found = np.unique(np.concatenate(parts))
    return found[(found >= low) & (found <= high)]
