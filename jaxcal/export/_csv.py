"""Write a calibration as a table with one row per number."""

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from .._errors import ExportError
from .._special import NORMAL95
from .._types import AnyArray
from .._units import noise_units, si_unit
from ..calibration import Calibration, DeviceNoise, Thermal
from ..fitting import Estimate
from ._findings import FINDINGS
from ._options import UNITS, Product, number

_HEADER = "quantity,axis,value,low,high,unit,kind"
#: noise term -> its name in the column `kind`
_TERMS = {"Q": "quantisation", "N": "density", "B": "bias_instability", "K": "random_walk", "R": "ramp"}
_AXES = "xyz"
_RANGE = ("reference", "minimum", "maximum")
#: quantity, axis, value, low, high, unit, kind
Row = tuple[str, str, float, float, float, str, str]
#: (quantity, kind) -> axis -> value, low, high
Cells = dict[tuple[str, str], dict[str, AnyArray]]


def write_csv(calibration: Calibration, options: Any) -> Product:
    """Write the forward models, as in the JSON file; low and high are the limits of the confidence interval if it is known."""
    rows = [*_noise(calibration.noise), *_models(calibration), *_temperature(calibration.temperature)]
    if not rows:
        raise ExportError("the calibration holds no numbers", code="no_part")
    only_json = calibration.temperature is not None and "channels" in calibration.temperature.to_document()
    lines = [_HEADER]
    for quantity, axis, value, low, high, unit, kind in rows:
        limits = ",".join("" if np.isnan(limit) else number(limit) for limit in (low, high))
        lines.append(f"{quantity},{axis},{number(value)},{limits},{unit},{kind}")
    return Product("\n".join(lines) + "\n", [FINDINGS("models_left_out")] if only_json else [])


def _noise(noise: DeviceNoise | None) -> Iterator[Row]:
    if noise is None:
        return
    yield ("noise", "", noise.rate, np.nan, np.nan, "Hz", "rate")
    for sensor, (term, kind) in itertools.product(("gyro", "accel", "mag"), _TERMS.items()):
        held = getattr(noise, sensor)
        values = getattr(held, term, None)
        if values is None:
            continue
        low, high = ((limits or {}).get(term, np.full(3, np.nan)) for limits in (held.low, held.high))
        unit = UNITS.get(term, {}).get(sensor, noise_units(term, sensor)[-1])
        for i in np.flatnonzero(np.isfinite(values)):
            least, most = (float(limit) if np.isfinite(limit) else np.nan for limit in (low[i], high[i]))
            yield (sensor, _AXES[i], float(values[i]), least, most, unit, kind)


def _models(calibration: Calibration) -> Iterator[Row]:
    for sensor, part in ({} if calibration.imu is None else calibration.imu.parts).items():
        errors, model = _errors(part.estimate), part.model
        yield from _rows(sensor, "matrix", "1", model.matrix, errors)
        yield from _rows(sensor, "bias", si_unit(sensor), model.bias, errors)
        if sensor == "gyro":
            yield from _rows(sensor, "g_sensitivity", "(rad/s)/(m/s^2)", model.g_sensitivity, errors)
    mag = calibration.magnetometer
    if mag is not None:
        errors = _errors(mag.estimate)
        own = {name.replace("soft_iron", "matrix").replace("hard_iron", "bias"): error for name, error in errors.items()}
        yield from _rows("mag", "matrix", "1", mag.model.soft_iron, own)
        yield from _rows("mag", "bias", mag.unit, mag.model.hard_iron, own)
        if mag.field is not None and np.isfinite(mag.field):
            yield from _rows("mag", "field", mag.unit, mag.field)


def _temperature(section: Thermal | None) -> Iterator[Row]:
    if section is None:
        return
    for key in _RANGE:
        yield from _rows("temperature", key, "degC", getattr(section, key))
    for sensor in ("accel", "gyro"):
        powers = section.powers(sensor)
        for (i, k), value in () if powers is None else np.ndenumerate(powers):
            yield (sensor, _AXES[i], float(value), np.nan, np.nan, f"{si_unit(sensor)}/degC^{k + 1}", f"bias_temperature_{k + 1}")


def _rows(quantity: str, kind: str, unit: str, values: Any, errors: dict[str, float] | None = None) -> Iterator[Row]:
    """Rows of a number, a vector or a matrix; `errors` maps names such as "bias[2]" to standard errors."""
    values = np.asarray(values, dtype=float)
    for index in np.ndindex(values.shape):
        error = (errors or {}).get(f"{kind}[{','.join(map(str, index))}]", 0.0)
        half = NORMAL95 * error if 0 < error < np.inf else np.nan
        value = float(values[index])
        yield (quantity, "".join(_AXES[i] for i in index), value, value - half, value + half, unit, kind)


def _errors(known: Estimate | None) -> dict[str, float]:
    return {} if known is None else dict(zip(known.names, known.error.tolist(), strict=True))
