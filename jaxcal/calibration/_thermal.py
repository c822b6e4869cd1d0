"""The temperature section: thermal models of single channels, or polynomials of whole sensors, as they are stored."""

from typing import Any

import numpy as np
from numpy.polynomial import polynomial

from .._errors import DataError
from .._types import AnyArray
from .._units import si_unit
from ..temperature import Chebyshev, Piecewise, Steps, TemperatureFit, ThermalModel
from ._form import wrong

AXES = ("x", "y", "z")
_SENSORS = ("gyro", "accel", "mag")
_CHANNELS = tuple(f"{sensor}_{axis}" for sensor in _SENSORS for axis in AXES)
_NUMBERS = ("coefficients", "height", "centre", "width", "nodes")
_CHANNEL: dict[str, Any] = {
    "curve": str, "minimum": float, "maximum": float, "lag": float, "play": float,
    **{f"{name}?": (None,) for name in _NUMBERS}, "pieces?": (None, None),
}  # fmt: skip
_HOTTEST, _LONGEST, _LARGEST = 1e4, 1e6, 1e15  # degC, s, any unit: beyond them is damage
_MOST_POWERS, _MOST_NODES = 64, 4096
FORM: dict[str, Any] = {
    "unit": si_unit("temperature"),
    "reference": float,
    "minimum": float,
    "maximum": float,
    "accel?": (3, None),
    "gyro?": (3, None),
    "channels?": {f"{name}?": _CHANNEL for name in _CHANNELS},
}


def stored(section: Any) -> Any:
    """The stored form of fits (channel -> `TemperatureFit`); anything else as it is.

    The reference temperature is the middle of the range that all channels share.

    Raises
    ------
    DataError
        If a channel is unknown, is a scale factor, or the channels have no temperature in common.
    """
    if not (isinstance(section, dict) and section and all(isinstance(fit, TemperatureFit) for fit in section.values())):
        return section
    for name, fit in section.items():
        if name not in _CHANNELS:
            raise DataError(f"temperature holds a channel {name!r}; expected the channels of a log: {', '.join(_CHANNELS)}")
        if fit.model.scale:
            raise DataError(f"temperature.{name} is a scale factor; the calibration holds biases, keep scale factors beside it")
    low = max(float(fit.model.low) for fit in section.values())
    high = min(float(fit.model.high) for fit in section.values())
    if not low < high:
        raise DataError("the channels were fitted over different temperatures; fit those of one recording together")
    return {
        "unit": si_unit("temperature"), "reference": float(np.round((low + high) / 2, 2)), "minimum": low, "maximum": high,
        "channels": {name: _stored_model(fit.model) for name, fit in section.items()},
    }  # fmt: skip


def _stored_model(model: ThermalModel) -> dict[str, Any]:
    found: dict[str, Any] = {
        "minimum": float(model.low), "maximum": float(model.high), "lag": float(model.lag), "play": float(model.play)
    }  # fmt: skip
    curve = model.curve
    if isinstance(curve, Piecewise):
        return {"curve": "piecewise", **found, "nodes": curve.nodes, "pieces": curve.coefficients}
    if isinstance(curve, Steps):
        steps = {"height": curve.height, "centre": curve.centre, "width": curve.width}
        return {"curve": "steps", **found, "coefficients": curve.base.coefficients, **steps}
    assert isinstance(curve, Chebyshev)
    return {"curve": "chebyshev", **found, "coefficients": curve.coefficients}


def check(section: dict[str, Any]) -> dict[str, Any]:
    """A section whose channels are complete.

    Raises
    ------
    DataError
        If a channel lacks what its curve needs, or the range is empty.
    """
    for key in ("reference", "minimum", "maximum"):
        if not abs(section[key]) < _HOTTEST:
            raise wrong(section[key], "a temperature in degC", f"temperature.{key}")
    for sensor in _SENSORS[:2]:
        if sensor in section:
            _check_numbers(section[sensor], f"temperature.{sensor}", _MOST_POWERS)
    if not section["minimum"] < section["maximum"]:
        raise DataError(f"temperature.minimum is {section['minimum']:g} and maximum {section['maximum']:g}; expected the smaller first")
    needs = {"chebyshev": ("coefficients",), "steps": ("coefficients", "height", "centre", "width"), "piecewise": ("nodes", "pieces")}
    for name, channel in section.get("channels", {}).items():
        if channel["curve"] not in needs:
            raise DataError(f"temperature.channels.{name}.curve is {channel['curve']!r}; expected one of {', '.join(needs)}")
        for key in needs[channel["curve"]]:
            if key not in channel:
                raise DataError(f"temperature.channels.{name}.{key} is missing; curve {channel['curve']!r} needs it")
        _check_channel(channel, f"temperature.channels.{name}")
        if channel["curve"] == "piecewise" and len(channel["pieces"]) != len(channel["nodes"]) - 1:
            raise DataError(f"temperature.channels.{name}.pieces has {len(channel['pieces'])} rows for {len(channel['nodes'])} nodes")
    return section


def _check_channel(channel: dict[str, Any], path: str) -> None:
    for key in ("minimum", "maximum"):
        if not abs(channel[key]) < _HOTTEST:
            raise wrong(channel[key], "a temperature in degC", f"{path}.{key}")
    if not channel["minimum"] < channel["maximum"]:
        raise DataError(f"{path}.minimum is {channel['minimum']:g} and maximum {channel['maximum']:g}; expected the smaller first")
    for key in ("lag", "play"):
        if not 0 <= channel[key] < _LONGEST:
            raise wrong(channel[key], "a number from 0", f"{path}.{key}")
    for key in (*_NUMBERS, "pieces"):
        if key in channel:
            _check_numbers(channel[key], f"{path}.{key}", _MOST_POWERS if key == "coefficients" else _MOST_NODES)
    if channel["curve"] == "steps":
        if len({len(channel[key]) for key in ("height", "centre", "width")}) > 1:
            raise DataError(f"{path}: height, centre and width have different lengths; expected one of each for every jump")
        if not np.all(channel["width"] > 0):
            raise wrong(channel["width"].tolist(), "widths above 0 in degC", f"{path}.width")
    if channel["curve"] == "piecewise" and (len(channel["nodes"]) < 2 or not np.all(np.diff(channel["nodes"]) > 0)):
        raise wrong(channel["nodes"].tolist(), "two rising temperatures or more", f"{path}.nodes")


def _check_numbers(values: AnyArray, path: str, most: int) -> None:
    if not np.all(np.abs(values) < _LARGEST):
        raise wrong(values.tolist(), f"finite numbers below {_LARGEST:g}", path)
    jumps = path.endswith((".height", ".centre", ".width"))
    if not (0 if jumps else 1) <= max(values.shape) <= most or (values.ndim == 2 and not 0 < values.shape[1] <= _MOST_POWERS):
        raise DataError(f"{path} has {values.shape} numbers; expected at least one and at most {most} in a row")


def model_of(channel: dict[str, Any]) -> ThermalModel:
    """The model of a stored channel."""
    low, high = channel["minimum"], channel["maximum"]
    if channel["curve"] == "piecewise":
        curve: Any = Piecewise(channel["nodes"], channel["pieces"])
    else:
        curve = Chebyshev(channel["coefficients"], low, high)
        if channel["curve"] == "steps":
            curve = Steps(curve, channel["height"], channel["centre"], channel["width"])
    return ThermalModel(curve, low, high, channel["lag"], channel["play"])


def at_reference(section: dict[str, Any], name: str) -> float:
    """Bias of a stored channel at the reference temperature."""
    model = model_of(section["channels"][name])
    return float(np.asarray(model.curve.value(np.clip(section["reference"], model.low, model.high))))


def powers(section: dict[str, Any], sensor: str, degree: int, reference: float) -> tuple[AnyArray, AnyArray, AnyArray] | None:
    """A sensor's thermal model as polynomials about a temperature, for tools that know nothing else; None where it has none.

    Returns
    -------
    (3, degree) coefficients of the powers 1, 2, ... of T - reference; (3,) change of the bias from the stored reference to this one;
    (3,) largest departure from the model over its range.
    """
    t = np.linspace(section["minimum"], section["maximum"], 501)
    rows, moved, lost = [], [], []
    channels = section.get("channels", {})
    polynomials = section.get(sensor)
    if polynomials is None and not any(f"{sensor}_{axis}" in channels for axis in AXES):
        return None
    half = (section["maximum"] - section["minimum"]) / 2
    middle = (section["maximum"] + section["minimum"]) / 2
    for i, axis in enumerate(AXES):
        if polynomials is not None:
            exact = np.concatenate([[0.0], polynomials[i]])
            about = polynomial.Polynomial(exact)(polynomial.Polynomial([reference - section["reference"], 1.0])).coef
            value = polynomial.polyval(t - section["reference"], exact)
            if len(exact) <= degree + 1:
                rows.append(np.pad(about[1 : degree + 1], (0, degree - len(about[1 : degree + 1]))))
                moved.append(about[0])
                lost.append(0.0)
                continue
        else:
            name = f"{sensor}_{axis}"
            if name not in channels:
                rows.append(np.zeros(degree))
                moved.append(0.0)
                lost.append(0.0)
                continue
            model = model_of(channels[name])
            value = np.asarray(model.curve.value(np.clip(t, model.low, model.high))) - at_reference(section, name)
        scaled = np.polynomial.Polynomial.fit(t, value, degree, domain=[middle - half, middle + half])
        about = scaled.convert()(polynomial.Polynomial([reference, 1.0])).coef
        about = np.pad(about, (0, degree + 1 - len(about)))
        rows.append(about[1:])
        moved.append(about[0])
        departure = float(np.max(np.abs(scaled(t) - value)))
        lost.append(departure if departure > 1e-9 * np.max(np.abs(value)) else 0.0)  # less is rounding
    return np.stack(rows), np.array(moved), np.array(lost)
