"""Thermal models as sections of a page, and as a JSON document."""

import importlib.metadata
from typing import Any

import numpy as np

from .._errors import DataError
from .._log import Log
from .._special import NORMAL95
from .._units import noise_factor, noise_units, si_unit
from ..plot._style import SENSORS, display_unit, number_label, unit_label
from ..temperature import TemperatureFit
from ._charts import Chart, Curve, charts
from ._html import Markup, definitions, join, numbers, recording, scroll, section, table, tag, warnings_of
from ._noise import about_log, by_channel, by_sensor, channels_of, number, sensor_of

_FINE = 160  # number of temperatures at which a curve is drawn
_MEANING = (
    ("rms", "What the model leaves of the means over 0.1 °C, over all temperatures. It is not a noise coefficient."),
    ("worst degree", "The same in the worst window of 1 °C. A model that misses a jump shows it here."),
    ("jump", "A step of the bias at a temperature. It is a property of the device; no polynomial follows it."),
    (
        "lag, play",
        "Heating and cooling give different biases: the sensor follows the thermometer late, or after a backlash.",
    ),
    (
        "interval",
        "It holds for the curve. The prediction holds for mean readings over 0.1 °C in the next cycle, in which the sensor wanders on.",
    ),
)


def document(results: dict[str, TemperatureFit], log: Log | None) -> dict[str, Any]:
    """Thermal models of every channel as a dictionary for JSON."""
    _check(results)
    head = {"schema": "jaxcal.temperature/1", "version": importlib.metadata.version("jaxcal"), **about_log(log)}
    return {**head, "channels": {name: _channel(fit, sensor_of(name)) for name, fit in results.items()}}


def _check(results: Any) -> None:
    """Raise a `DataError` unless there is at least one fit, each of a channel with a known sensor."""
    if not all(isinstance(fit, TemperatureFit) for fit in results.values()):
        raise DataError("expected the dictionary channel -> TemperatureFit that jaxcal.temperature.characterise returns")
    for name in results:
        sensor_of(name)


def _channel(fit: TemperatureFit, sensor: str) -> dict[str, Any]:
    t = np.linspace(float(fit.model.low), float(fit.model.high), 101)
    low, high = fit.interval_at(t)
    bottom, top = fit.prediction_at(t) if fit.next_error is not None else (low, high)
    fields = ("centre", "width", "height", "centre_error", "width_error", "height_error", "chance")
    listed = lambda values: None if values is None else [number(value) for value in values]  # noqa: E731
    return {
        "kind": fit.kind, "degree": None if fit.degree is None else int(fit.degree), "unit": si_unit(sensor),
        "minimum": number(fit.model.low), "maximum": number(fit.model.high), "lag": number(fit.model.lag), "play": number(fit.model.play),
        "rate": number(fit.model.rate), "rate_lag": number(fit.model.rate_lag),
        "parameters": {name: {"value": number(value), "error": number(error)} for name, (value, error) in fit.parameters.items()},
        "noise": None if fit.noise is None else {name: number(getattr(fit.noise, name)) for name in ("N", "B", "K")},
        "rms": number(fit.rms), "worst": number(fit.worst), "worst_at": number(fit.worst_at),
        "coefficients": listed(fit.coefficients), "coefficient_error": listed(fit.coefficient_error),
        "steps": [{name: number(getattr(step, name)) for name in fields} for step in fit.steps],
        "candidates": [{"name": one.name, "score": number(one.score), "chosen": bool(one.chosen)} for one in fit.candidates],
        "confidence": fit.confidence, "thermometer_noise": number(fit.thermometer),
        "curve": {"temperature": listed(t), "bias": listed(np.asarray(fit.model.curve.value(t))), "low": listed(low), "high": listed(high),
                  "prediction_low": listed(bottom), "prediction_high": listed(top)},
        "warnings": list(fit.warnings), "notes": list(fit.notes),
    }  # fmt: skip


def page(results: dict[str, TemperatureFit], log: Log | None, version: str) -> tuple[str, str, Markup]:
    """Subject, subtitle and sections of the page."""
    _check(results)
    sections = (
        _verdict(results), _figures(results), _choice(results), warnings_of(log, by_channel(results, "warnings")),
        section("What the words mean", "meaning", definitions(_MEANING)), recording(log),
    )  # fmt: skip
    return "Bias and temperature", channels_of(results), join(sections)


def summary(results: dict[str, TemperatureFit]) -> list[tuple[str, str, Any]]:
    """For every sensor, its name, the verdict in one word, and a sentence on the result."""
    rows = []
    for sensor, channels in by_sensor(results).items():
        scale, unit = display_unit("B", sensor)
        said = [
            f"{name.partition('_')[2]}: {_sentence(fit, scale, unit)}, rms {number_label(fit.rms / scale)} {unit}, worst degree "
            f"{number_label(fit.worst / scale)} {unit}"
            for name, fit in channels.items()
        ]
        warned = any(fit.warnings for fit in channels.values())
        rows.append((f"Temperature, {SENSORS[sensor].lower()}", "warnings" if warned else "fitted", f"{'. '.join(said)}."))
    return rows


def _verdict(results: dict[str, TemperatureFit]) -> Markup:
    parts = []
    for sensor, channels in by_sensor(results).items():
        scale, unit = display_unit("B", sensor)
        rows = []
        for name, fit in channels.items():
            worst = f"{number_label(fit.worst / scale)} at {fit.worst_at:.1f} °C"
            span = f"{float(fit.model.low):.1f} to {float(fit.model.high):.1f} °C"
            rows.append((name.partition("_")[2], _sentence(fit, scale, unit), number_label(fit.rms / scale), worst, span))
        found = table(("Axis", "Model", f"rms ({unit})", f"Worst degree ({unit})", "Range"), rows)
        parts += [tag("h3", SENSORS[sensor]), scroll(found, SENSORS[sensor])]
    return section("Verdict", "verdict", *parts)


def _sentence(fit: TemperatureFit, scale: float, unit: str) -> str:
    words = [fit.kind if fit.degree is None or fit.steps else f"{fit.kind} of degree {fit.degree}"]
    words += [
        f"jump of {number_label(abs(s.height) / scale)} {unit} {'up' if s.height > 0 else 'down'} at {s.centre:.2f} ± "
        f"{NORMAL95 * s.centre_error:.2g} °C" for s in fit.steps
    ]  # fmt: skip
    if fit.model.lag > 0:
        words.append(f"lag {float(fit.model.lag):.0f} s")
    if fit.model.play > 0:
        words.append(f"play {float(fit.model.play):.2f} °C")
    if fit.model.rate != 0:
        words.append(f"{number_label(float(fit.model.rate) / scale / 60)} {unit} per °C/min")
    return "; ".join(words)


def _figures(results: dict[str, TemperatureFit]) -> Markup:
    parts = []
    for sensor, channels in by_sensor(results).items():
        parts.append(charts([_chart(sensor, channels)]))
        parts += [_numbers(name, fit, sensor) for name, fit in channels.items()]
    return section("Bias and temperature", "plots", *parts)


def _chart(sensor: str, channels: dict[str, TemperatureFit]) -> Chart:
    """Means and curves of every axis, each relative to its value in the middle of its range."""
    curves = []
    for i, (name, fit) in enumerate(channels.items()):
        model, axis = fit.model, name.partition("_")[2]
        middle = float(np.asarray(model.curve.value(np.asarray((model.low + model.high) / 2))))
        t = _temperatures(fit)
        line, (low, high) = np.asarray(model.curve.value(t)), fit.interval_at(t)
        means = np.asarray(fit.bins.b) - middle
        curves.append(Curve(axis, "dots", np.asarray(fit.bins.t), means, color=i, label=f"{axis}, mean"))
        curves.append(Curve(axis, "line", t, line - middle, low - middle, high - middle, color=i, label=f"{axis}, model"))
    scaled = any(fit.model.scale for fit in channels.values())
    units = (("", 1.0),) if scaled else tuple((unit_label(unit), noise_factor("B", sensor, unit)) for unit in noise_units("B", sensor))
    title = f"{SENSORS[sensor]}: change of {'scale factor' if scaled else 'bias'} with temperature"
    about = "Dots: means over 0.1 °C. Lines: fitted curves with their intervals. Dashed: jumps."
    jumps = [step.centre for fit in channels.values() for step in fit.steps]
    return Chart(f"thermal-{sensor}", title, about, "Temperature (°C)", "Change", units, curves, jumps)


def _temperatures(fit: TemperatureFit) -> np.ndarray:
    """Temperatures at which a curve is drawn: evenly spaced, with more points around each narrow jump."""
    low, high = float(fit.model.low), float(fit.model.high)
    parts = [np.linspace(low, high, _FINE)]
    parts += [step.centre + step.width * np.linspace(-8.0, 8.0, 33) for step in fit.steps]
    found = np.unique(np.concatenate(parts))
    return found[(found >= low) & (found <= high)]


def _numbers(name: str, fit: TemperatureFit, sensor: str) -> Markup:
    scale, unit = display_unit("B", sensor)
    t = np.asarray(fit.bins.t)
    model, (low, high) = np.asarray(fit.model.curve.value(t)), fit.interval_at(t)
    level = f"{100 * fit.confidence:g} %"
    columns = ("temperature (°C)", f"mean ({unit})", f"model ({unit})", f"{level} low", f"{level} high", "samples")
    values = (np.asarray(fit.bins.b), model, low, high)
    rows = [(f"{t[i]:.2f}", *(number_label(float(v[i]) / scale, 5) for v in values), f"{fit.bins.count[i]:.0f}") for i in range(len(t))]
    return numbers(f"Numbers of {name}: bias as read, not shifted to the middle of the range", columns, rows)


def _choice(results: dict[str, TemperatureFit]) -> Markup:
    chosen = {name: fit for name, fit in results.items() if fit.candidates}
    if not chosen:
        return Markup("")
    tables = []
    for name, fit in chosen.items():
        rows = [(one.name, number_label(one.score, 3), "chosen" if one.chosen else "") for one in fit.candidates]
        compared = table(("Beside the curve", "-2 ln likelihood above the best, with the price of parameters", ""), rows)
        tables.append(tag("details", tag("summary", name), scroll(compared, name)))
    return section("How the model was chosen", "choice", *tables)
