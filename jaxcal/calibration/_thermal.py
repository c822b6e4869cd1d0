"""Thermal models of a device, one for every channel, and their stored form."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import numpy as np
from numpy.polynomial import polynomial

from .._errors import DataError
from .._types import AnyArray
from .._units import si_unit
from ..temperature import AbstractCurve, Chebyshev, Piecewise, Steps, TemperatureFit, ThermalModel
from ._codec import check_finite, checked_unit, document_of, numbers, required, structured, wrong

AXES = ("x", "y", "z")
SENSORS = ("gyro", "accel", "mag")
CHANNELS = tuple(f"{sensor}_{axis}" for sensor in SENSORS for axis in AXES)


class Powers(AbstractCurve):
    r"""Change of a bias since a reference temperature, as a polynomial.

    .. math:: b(T) = \sum_{i \ge 1} c_i (T - T_r)^i

    Attributes
    ----------
    reference : T_r, degC.
    coefficients : (degree,) c, in the unit of the bias per degC, degC^2, ...

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.calibration._thermal import Powers
    >>> print(Powers(25.0, np.array([2.0, 0.5])).value(np.array([25.0, 27.0])))
    [0. 6.]
    """

    reference: Any
    coefficients: Any

    def value(self, t: Any) -> AnyArray:
        """Value of the polynomial at the temperatures `t`, degC."""
        return np.asarray(polynomial.polyval(np.asarray(t) - self.reference, np.concatenate([[0.0], self.coefficients])))


class Thermal(eqx.Module):
    """Thermal models of the channels of a device.

    Attributes
    ----------
    reference : temperature to which readings are corrected, degC.
    minimum, maximum : range that all channels share, degC.
    channels : "gyro_x" .. "mag_z" -> `ThermalModel`.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> made = jaxcal.temperature.simulate(jump=0.0)
    >>> log = jaxcal.Log(made.time, gyro=made.bias, temperature=made.temperature)
    >>> fits = jaxcal.temperature.characterise(log, model="polynomial", degree=3)
    >>> device = jaxcal.Calibration(temperature=fits)
    >>> list(device.temperature.channels), round(device.temperature.reference)
    (['gyro_x'], 32)
    """

    reference: float
    minimum: float
    maximum: float
    channels: dict[str, ThermalModel]

    def of(self, sensor: str) -> dict[str, ThermalModel]:
        """Axis -> model, for one sensor."""
        return {axis: self.channels[f"{sensor}_{axis}"] for axis in AXES if f"{sensor}_{axis}" in self.channels}

    def constant(self, name: str) -> float:
        """Bias of a channel at the reference temperature; zero for `Powers`, which model changes only."""
        model = self.channels[name]
        if isinstance(model.curve, Powers):
            return 0.0
        return float(np.asarray(model.curve.value(np.clip(self.reference, model.low, model.high))))

    def powers(self, sensor: str) -> AnyArray | None:
        """Coefficients (3, degree) of a sensor if all its axes are plain polynomials over the whole range; otherwise None."""
        limits = (self.reference, self.minimum, self.maximum, 0, 0, 0)
        plain: list[Any] = [one for one in self.of(sensor).values() if isinstance(one.curve, Powers)]
        plain = [one for one in plain if (one.curve.reference, one.low, one.high, one.lag, one.play, one.rate) == limits]
        rows = [np.asarray(one.curve.coefficients) for one in plain]
        return np.stack(rows) if len(rows) == len(AXES) and len({len(row) for row in rows}) == 1 else None

    def to_document(self) -> dict[str, Any]:
        """The stored form, in which the plain polynomials of a sensor are the rows of a matrix."""
        found: dict[str, Any] = {"unit": si_unit("temperature"), **{key: getattr(self, key) for key in ("reference", "minimum", "maximum")}}
        found |= {sensor: rows for sensor in ("accel", "gyro") if (rows := self.powers(sensor)) is not None}
        single = {name: model for name, model in self.channels.items() if name.partition("_")[0] not in found}
        channels = {name: _document(model, f"temperature.channels.{name}") for name, model in single.items()}
        return found | ({"channels": channels} if channels else {})


def polynomials(reference: float, minimum: float, maximum: float, **sensors: AnyArray) -> Thermal:
    """Thermal models of whole sensors, as polynomials of the temperature above a reference.

    Parameters
    ----------
    reference, minimum, maximum : temperature to which readings are corrected, and range of the models, degC.
    sensors : (3, degree) coefficients of the powers 1, 2, ... for "accel" and "gyro", SI per degC, degC^2, ...

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.calibration import polynomials
    >>> model = polynomials(25.0, 0.0, 50.0, gyro=np.array([[1e-3], [0.0], [0.0]])).channels["gyro_x"]
    >>> round(float(model.bias_at(np.array(35.0))), 6)
    0.01
    """
    rows = {f"{sensor}_{axis}": row for sensor, held in sensors.items() for axis, row in zip(AXES, held, strict=True)}
    models = {name: ThermalModel(Powers(reference, np.asarray(row)), minimum, maximum) for name, row in rows.items()}
    return Thermal(reference, minimum, maximum, models)


#: built-in curves by their name in a file -> the keys of their numbers
_CURVES = {
    "chebyshev": ("coefficients",), "steps": ("coefficients", "height", "centre", "width"), "piecewise": ("nodes", "pieces"),
    "powers": ("coefficients",),
}  # fmt: skip
_RANGE = ("minimum", "maximum", "lag", "play")
_RATE = ("rate", "rate_lag")  # stored only if the rate is not zero


def thermal_of(value: Any) -> Thermal | None:
    """The thermal part of a calibration, checked: fits (channel -> `TemperatureFit`), the stored form, or a `Thermal`.

    For fits, the reference temperature is the middle of the range that all channels share.
    """
    if value is None:
        return None
    if isinstance(value, Mapping) and value and all(isinstance(fit, TemperatureFit) for fit in value.values()):
        low = max(float(fit.model.low) for fit in value.values())
        high = min(float(fit.model.high) for fit in value.values())
        if not low < high:
            raise DataError("the channels were fitted over different temperatures; fit those of one recording", code="range")
        value = Thermal(float(np.round((low + high) / 2, 2)), low, high, {name: fit.model for name, fit in value.items()})
    found = value if isinstance(value, Thermal) else _from_document(value)
    _check_range(found, "temperature")
    for name, model in found.channels.items():
        if name not in CHANNELS:
            raise DataError(f"temperature holds a channel {name!r}; expected those of a log: {', '.join(CHANNELS)}", code="channel")
        if type(model) is not ThermalModel:
            raise wrong(type(model).__name__, "a ThermalModel of the bias", f"temperature.{name}")
        _check_model(model, f"temperature.channels.{name}")
    return found


def _from_document(value: Any) -> Thermal:
    checked_unit(value, si_unit("temperature"), "temperature")
    needed = ("reference", "minimum", "maximum")
    reference, low, high = (structured(required(value, key, "temperature", needed), float, f"temperature.{key}") for key in needed)
    held = [name for name in ("accel", "gyro") if value.get(name) is not None]
    channels = polynomials(reference, low, high, **{name: numbers(value[name], (3, None), f"temperature.{name}") for name in held}).channels
    stored = structured(value.get("channels"), dict[str, dict[str, Any] | None] | None, "temperature.channels") or {}
    models = {
        name: _model(value["channels"][name], reference, f"temperature.channels.{name}")
        for name in CHANNELS
        if stored.get(name) is not None
    }
    return Thermal(reference, low, high, channels | models)


def _model(value: Any, reference: float, path: str) -> ThermalModel:
    """A channel from its stored form, whose curve is a built-in one or a user's class."""
    if not isinstance(value, dict):
        raise wrong(value, f"a dictionary with curve, {', '.join(_RANGE)}", path)
    name = structured(required(value, "curve", path, ("curve", *_RANGE)), str, f"{path}.curve")
    low, high, *filters = (structured(required(value, key, path, ("curve", *_RANGE)), float, f"{path}.{key}") for key in _RANGE)
    filters += [structured(value.get(key, 0.0), float, f"{path}.{key}") for key in _RATE]
    if name not in _CURVES:
        own = {key: stored for key, stored in value.items() if key not in _RATE}
        return ThermalModel(structured({**own, "class": name}, AbstractCurve, path), low, high, *filters)
    held = {}
    for key in _CURVES[name]:
        held[key] = numbers(required(value, key, path, _CURVES[name]), (None, None) if key == "pieces" else (None,), f"{path}.{key}")
    if name == "piecewise":
        return ThermalModel(Piecewise(held["nodes"], held["pieces"]), low, high, *filters)
    curve: Any = Powers(reference, held["coefficients"]) if name == "powers" else Chebyshev(held.pop("coefficients"), low, high)
    return ThermalModel(Steps(curve, **held) if name == "steps" else curve, low, high, *filters)


def _document(model: ThermalModel, path: str) -> dict[str, Any]:
    fields = document_of(model.curve, AbstractCurve, path)
    name = fields.pop("class")
    if name.lower() in _CURVES:
        name, fields = name.lower(), fields | fields.get("base", {})
        fields |= {"pieces": fields["coefficients"]} if name == "piecewise" else {}
        fields = {key: fields[key] for key in _CURVES[name]}
    limits = zip(_RANGE, (model.low, model.high, model.lag, model.play), strict=True)
    rate = {key: float(getattr(model, key)) for key in _RATE if model.rate != 0}
    return {"curve": name, **{key: float(number) for key, number in limits}, **rate, **fields}


def _check_model(model: ThermalModel, path: str) -> None:
    curve: Any = model.curve
    _check_range(Thermal(0.0, float(model.low), float(model.high), {}), path)
    if not np.isfinite(model.rate):
        raise wrong(model.rate, "a finite number", f"{path}.rate")
    for key in ("lag", "play", "rate_lag"):
        if not 0 <= getattr(model, key) < np.inf:
            raise wrong(getattr(model, key), "a number from 0", f"{path}.{key}")
    held = _document(model, path)
    for key, value in held.items():
        if isinstance(value, list):
            check_finite(np.array(value), f"{path}.{key}")
    if isinstance(curve, Steps):
        if len({len(held[key]) for key in ("height", "centre", "width")}) > 1:
            raise wrong(held["height"], "as many heights as centres and widths", f"{path}.height")
        if not np.all(np.asarray(curve.width) > 0):
            raise wrong(held["width"], "widths above 0 in degC", f"{path}.width")
    if isinstance(curve, Piecewise):
        if len(held["nodes"]) < 2 or not np.all(np.diff(held["nodes"]) > 0):
            raise wrong(held["nodes"], "two rising temperatures or more", f"{path}.nodes")
        if len(held["pieces"]) != len(held["nodes"]) - 1:
            raise wrong(held["pieces"], f"{len(held['nodes']) - 1} rows for {len(held['nodes'])} nodes", f"{path}.pieces")


def _check_range(thermal: Thermal, path: str) -> None:
    for key in ("reference", "minimum", "maximum"):
        check_finite(getattr(thermal, key), f"{path}.{key}")
    if not thermal.minimum < thermal.maximum:
        raise wrong(thermal.minimum, f"a temperature below the maximum, {thermal.maximum:g}", f"{path}.minimum")


def cubic(thermal: Thermal, sensor: str, degree: int, reference: float) -> tuple[AnyArray, AnyArray, AnyArray] | None:
    """A sensor's thermal models as polynomials about a temperature, for programs that need these; None if there are none.

    Returns
    -------
    (3, degree) coefficients of the powers 1, 2, ... of T - reference; (3,) change of the bias from the stored reference to this one;
    (3,) largest difference from the model over its range.
    """
    models = thermal.of(sensor)
    if not models:
        return None
    t = np.linspace(thermal.minimum, thermal.maximum, 501)
    found, lost = np.zeros((3, degree + 1)), np.zeros(3)
    for i, axis in enumerate(AXES):
        if axis not in models:
            continue
        model = models[axis]
        curve: Any = model.curve
        if isinstance(curve, Powers) and len(curve.coefficients) <= degree:
            exact = polynomial.Polynomial(np.concatenate([[0.0], curve.coefficients]))
            about = exact(polynomial.Polynomial([reference - curve.reference, 1.0])).coef
        else:
            value = np.asarray(model.curve.value(np.clip(t, model.low, model.high))) - thermal.constant(f"{sensor}_{axis}")
            fitted = polynomial.Polynomial.fit(t, value, degree, domain=[thermal.minimum, thermal.maximum])
            about = fitted.convert()(polynomial.Polynomial([reference, 1.0])).coef
            departure = float(np.max(np.abs(fitted(t) - value)))
            lost[i] = departure if departure > 1e-9 * np.max(np.abs(value)) else 0.0  # a smaller difference is rounding
        found[i, : len(about)] = about
    return found[:, 1:], found[:, 0], lost
