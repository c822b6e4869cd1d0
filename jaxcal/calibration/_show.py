"""The numbers of a calibration as tables, from which text and HTML are rendered."""

from typing import Any

import numpy as np

from .._answer import Grid, Number, Section, by_axis
from ._noise import TERMS, SensorNoise
from ._parts import Part, quantities_of
from ._thermal import AXES, SENSORS, Thermal

_TITLES = {"gyro": "gyroscope", "accel": "accelerometer", "mag": "magnetometer"}


def sections_of(calibration: Any) -> list[Section]:
    """One table for each sensor of each section of a calibration; a new field of a model appears by itself."""
    parts = {} if calibration.imu is None else dict(calibration.imu.parts)
    parts |= {} if calibration.magnetometer is None else {"mag": calibration.magnetometer}
    found: list[Section] = [by_axis(sensor, _TITLES[sensor], numbers_of(sensor, part)) for sensor, part in parts.items()]
    for sensor in SENSORS:
        held = None if calibration.noise is None else getattr(calibration.noise, sensor)
        found += [_noise(sensor, held)] if held is not None else []
    return found + ([] if calibration.temperature is None else _thermal(calibration.temperature))


def numbers_of(sensor: str, part: Part[Any]) -> list[Number]:
    """Parameters of a part with their 95 % intervals, where it has them."""
    values, known = part.parameters, part.estimate
    values = {name: value for name, value in values.items() if sensor != "accel" or value or not name.startswith("g_sensitivity")}
    halves = {} if known is None else dict(zip(known.names, np.diff(known.intervals(), axis=1)[:, 0] / 2, strict=True))
    if part.field is not None:
        values["field"] = float(part.field)
    found = []
    for (name, value), quantity in zip(values.items(), quantities_of(sensor, part, values), strict=True):
        half = float(halves.get(name, np.nan))
        found.append(Number(f"{sensor}.{name}", value, value - half, value + half, quantity))
    return found


def _noise(sensor: str, held: SensorNoise) -> Grid:
    def cell(term: str, i: int) -> Number | None:
        values, name, quantity = getattr(held, term), f"noise.{sensor}_{AXES[i]}.{term}", f"{term}.{sensor}"
        if values is None or not np.isfinite(values[i]):
            return None
        if held.verdict is not None and held.upper_limit is not None and held.verdict[term][i] == "not detected":
            return Number(name, np.nan, high=float(held.upper_limit[term][i]), quantity=quantity, state="limit")
        limits = (np.nan, np.nan) if held.low is None or held.high is None else (held.low[term][i], held.high[term][i])
        return Number(name, float(values[i]), float(limits[0]), float(limits[1]), quantity)

    rows = tuple((term, tuple(cell(term, i) for i in range(3))) for term in TERMS if getattr(held, term) is not None)
    return Grid(f"noise {sensor}", f"noise of the {_TITLES[sensor]}", AXES, rows)


def _thermal(held: Thermal) -> list[Section]:
    found: list[Section] = []
    for sensor in SENSORS:
        models = held.of(sensor)
        cells: dict[str, list[Number | str | None]] = {"change over the range": [], "lag": [], "jumps": []}
        for axis, model in models.items():
            curve = np.asarray(model.curve.value(np.linspace(float(model.low), float(model.high), 201)))
            name = f"temperature.{sensor}_{axis}"
            cells["change over the range"].append(Number(f"{name}.change", float(np.ptp(curve)), quantity=f"B.{sensor}"))
            cells["lag"].append(Number(f"{name}.lag", float(model.lag), quantity="time") if model.lag else None)
            count = len(getattr(model.curve, "centre", ()))
            cells["jumps"].append(f"{count}" if count else None)
        rows = tuple((label, tuple(row)) for label, row in cells.items() if any(one is not None for one in row))
        note = f"{held.minimum:g} to {held.maximum:g} degC; corrected to {held.reference:g} degC."
        found += [Grid(f"temperature {sensor}", f"{_TITLES[sensor]} over temperature", tuple(models), rows, note=note)] if models else []
    return found
