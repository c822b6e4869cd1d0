"""A calibration as a table: one row for every number."""

from collections.abc import Iterator

import numpy as np

from .._errors import ExportError
from .._results import NORMAL95
from .._units import noise_units, si_unit
from ..calibration import Calibration, Covariance, DeviceNoise
from ._options import UNITS, Options, Product
from ._text import number

HEADER = "quantity,axis,value,low,high,unit,kind"
#: term of the noise -> its kind
TERMS = {"Q": "quantisation", "N": "density", "B": "bias_instability", "K": "random_walk", "R": "ramp"}
AXES = "xyz"
Row = tuple[str, str, float, float, float, str, str]


def table(calibration: Calibration, options: Options) -> Product:
    """Forward models, as in the JSON file; low and high are limits of the confidence interval where one is known."""
    rows = [*_noise(calibration.noise), *_imu(calibration), *_mag(calibration), *_temperature(calibration)]
    if not rows:
        raise ExportError("the calibration holds no numbers")
    warnings = []
    if calibration.temperature is not None and "channels" in calibration.temperature.to_document():
        warnings.append("thermal models with jumps, splines or hysteresis have no place in a table; the JSON file holds them")
    if calibration.device:
        warnings.append("the name and ids of the device are not in the table")
    lines = [HEADER]
    for quantity, axis, value, low, high, unit, kind in rows:
        limits = ",".join("" if np.isnan(limit) else number(limit) for limit in (low, high))
        lines.append(f"{quantity},{axis},{number(value)},{limits},{unit},{kind}")
    return Product("\n".join(lines) + "\n", tuple(warnings))


def _noise(noise: DeviceNoise | None) -> Iterator[Row]:
    if noise is None:
        return
    yield ("noise", "", noise.rate, np.nan, np.nan, "Hz", "rate")
    for sensor in ("gyro", "accel", "mag"):
        held = getattr(noise, sensor)
        if held is None:
            continue
        for term, kind in TERMS.items():
            values = getattr(held, term)
            low, high = ((limits or {}).get(term, np.full(3, np.nan)) for limits in (held.low, held.high))
            unit = UNITS.get(kind, {}).get(sensor, noise_units(term, sensor)[-1])
            for i, axis in enumerate(AXES):
                if values is not None and np.isfinite(values[i]):
                    least, most = (float(limit) if np.isfinite(limit) else np.nan for limit in (low[i], high[i]))
                    yield (sensor, axis, float(values[i]), least, most, unit, kind)


def _imu(calibration: Calibration) -> Iterator[Row]:
    for sensor, part in ({} if calibration.imu is None else calibration.imu.parts).items():
        spread, model = _errors(part.covariance), part.model
        unit = si_unit(sensor)
        for i, j in np.ndindex(3, 3):
            yield _row(sensor, AXES[i] + AXES[j], model.matrix[i, j], spread.get(f"matrix[{i},{j}]"), "1", "matrix")
        for i in range(3):
            yield _row(sensor, AXES[i], model.bias[i], spread.get(f"bias[{i}]"), unit, "bias")
        if sensor == "gyro":
            for i, j in np.ndindex(3, 3):
                value = model.g_sensitivity[i, j]
                yield _row(sensor, AXES[i] + AXES[j], value, spread.get(f"g_sensitivity[{i},{j}]"), "(rad/s)/(m/s^2)", "g_sensitivity")


def _mag(calibration: Calibration) -> Iterator[Row]:
    mag = calibration.magnetometer
    if mag is None:
        return
    spread = _errors(mag.covariance)
    for i, j in np.ndindex(3, 3):
        yield _row("mag", AXES[i] + AXES[j], mag.model.soft_iron[i, j], None, "1", "matrix")
    for i in range(3):
        yield _row("mag", AXES[i], mag.model.hard_iron[i], spread.get(f"b_{AXES[i]}"), "T", "bias")
    if mag.field is not None and np.isfinite(mag.field):
        yield _row("mag", "", mag.field, None, "T", "field")


def _temperature(calibration: Calibration) -> Iterator[Row]:
    section = calibration.temperature
    if section is None:
        return
    for key in ("reference", "minimum", "maximum"):
        yield _row("temperature", "", getattr(section, key), None, "degC", key)
    for sensor in ("accel", "gyro"):
        for i, row in enumerate(() if (rows := section.powers(sensor)) is None else rows):
            for power, value in enumerate(row, 1):
                yield _row(sensor, AXES[i], value, None, f"{si_unit(sensor)}/degC^{power}", f"bias_temperature_{power}")


def _row(quantity: str, axis: str, value: float, error: float | None, unit: str, kind: str) -> Row:
    half = np.nan if error is None or not np.isfinite(error) or error == 0 else NORMAL95 * error
    return (quantity, axis, float(value), float(value - half), float(value + half), unit, kind)


def _errors(covariance: Covariance | None) -> dict[str, float]:
    if covariance is None:
        return {}
    return dict(zip(covariance.parameters, np.sqrt(np.maximum(np.diag(covariance.values), 0.0)).tolist(), strict=True))
