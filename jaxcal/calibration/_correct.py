"""Correct a log with a calibration: first temperature, then bias, scale factor and misalignment."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np

from .._answer import Finding
from .._errors import DataError
from .._log import Log
from .._types import AnyArray
from ..temperature import Steps, ThermalModel, thermometer
from ._findings import CORRECTED
from ._parts import Part
from ._thermal import AXES, SENSORS, Thermal


def corrected(calibration: Any, log: Log, currents: dict[str, Any] | None) -> Log:
    """The log with every correction that the calibration has for its sensors."""
    said: list[Finding] = []
    fields = _fields_of(calibration.magnetometer, log, currents or {}, said)
    known = (calibration.provenance or {}).get("sha256")
    if calibration.temperature is not None and known is not None and known == log.provenance.get("sha256"):
        said.append(CORRECTED("same_recording"))
    parts = {**({} if calibration.imu is None else calibration.imu.parts), "mag": calibration.magnetometer}
    values: dict[str, Any] = {name: np.array(getattr(log, name)) for name in SENSORS if getattr(log, name) is not None}
    done = []
    for sensor in values:
        offset = _thermal(calibration.temperature, log, sensor, values[sensor], sensor in parts, said)
        if offset is not None:
            values[sensor] = values[sensor] - offset
            done.append(sensor)
    for sensor in ("accel", "gyro", "mag"):  # in this order, because the gyroscope's model uses the corrected accelerometer
        part = parts.get(sensor)
        if part is None or sensor not in values:
            continue
        if values[sensor].shape[1:] != (3,):
            said.append(CORRECTED("not_three_axes", sensor))
        else:
            if sensor == "mag" and fields is not None:
                values[sensor] = values[sensor] - fields
            values[sensor] = _modelled(part, sensor, log, values, said)
            done.append(sensor)
    if not done:
        raise DataError("the calibration has nothing for this log; see its imu, magnetometer and temperature", code="nothing")
    said.append(CORRECTED("corrected", dict.fromkeys(done)))
    name = (calibration.device or {}).get("name")
    new = [*values.values(), (*log.findings, *said), {**log.provenance, "corrected_with": name or "calibration"}]
    found: Any = eqx.tree_at(lambda one: [*(getattr(one, sensor) for sensor in values), one.findings, one.provenance], log, new)
    return found


def _fields_of(part: Part[Any] | None, log: Log, given: dict[str, Any], said: list[Finding]) -> AnyArray | None:
    """Fields (n, 3) of the given currents, by the magnetometer's terms."""
    terms = {} if part is None or log.mag is None else part.currents or {}
    if unknown := [name for name in given if name not in terms]:
        known = f"it has {', '.join(terms)}" if terms else "it has none"
        raise DataError(f"the calibration has no field of the current {unknown[0]!r}; {known}", code="current")
    if left := [name for name in terms if name not in given]:
        said.append(CORRECTED("currents_missing", "mag", names=", ".join(left)))
    total = np.zeros((len(log.time), 3))
    for name, values in given.items():
        current = np.asarray(values, dtype=float)
        if current.shape != (len(total),):
            raise DataError(f"the current {name!r} has shape {current.shape}; give one number a sample, {len(total)}", code="current")
        total += np.outer(current, terms[name])
    if given:
        said.append(CORRECTED("currents_taken", "mag", names=", ".join(given)))
    return total if given else None


def _modelled(part: Part[Any], sensor: str, log: Log, values: dict[str, Any], said: list[Finding]) -> AnyArray:
    """Readings corrected by the model of their sensor, with the further inputs that it needs: temperature, specific force, time."""
    conditions: dict[str, Callable[[], Any]] = {"temperature": lambda: thermometer(log), "time": lambda: log.time}
    if sensor == "gyro" and np.any(part.model.g_sensitivity):
        if "accel" in values and values["accel"].shape[1:] == (3,):
            conditions["accel"] = lambda: values["accel"]
        else:
            said.append(CORRECTED("g_sensitivity", "gyro"))
            part = eqx.tree_at(lambda one: one.model.g_sensitivity, part, np.zeros((3, 3)))
    return part.correct(values[sensor], conditions, sensor)


def _thermal(thermal: Thermal | None, log: Log, sensor: str, y: AnyArray, has_bias: bool, said: list[Finding]) -> AnyArray | None:
    """Change of a sensor with temperature, (n, axes); None if the calibration has no thermal model for it."""
    axes = AXES[: y.reshape(len(y), -1).shape[1]]
    models = {} if thermal is None else {axis: model for axis, model in thermal.of(sensor).items() if axis in axes}
    if thermal is None or not models:
        return None
    t, kept = thermometer(log), False
    offset = np.zeros((len(t), len(axes)))
    for i, axis in enumerate(axes):
        name = f"{sensor}_{axis}"
        if axis not in models:
            said.append(CORRECTED("no_thermal_model", name))
            continue
        model, constant = models[axis], thermal.constant(name)
        felt, change = model.effective(t, rate=log.rate)
        _outside(name, felt, float(model.low), float(model.high), said)
        offset[:, i] = np.asarray(model.curve.value(np.clip(felt, model.low, model.high))) + change
        if constant == 0 or has_bias or sensor != "gyro":
            offset[:, i] -= constant
            kept = True
        _passages(name, model, felt, said)
    if kept:
        said.append(CORRECTED("constant_kept", sensor, reference=thermal.reference))
    return offset.reshape(y.shape)


def _outside(name: str, t: AnyArray, low: float, high: float, said: list[Finding]) -> None:
    share = np.mean((t < low) | (t > high))
    if t.min() < low - 0.1 or t.max() > high + 0.1:
        said.append(CORRECTED("outside", name, percent=100 * float(share), least=float(t.min()), most=float(t.max()), low=low, high=high))


def _passages(name: str, model: ThermalModel, t: AnyArray, said: list[Finding]) -> None:
    curve = model.curve
    for centre, width in zip(curve.centre, curve.width, strict=True) if isinstance(curve, Steps) else ():
        if t.min() < centre + 3 * width and t.max() > centre - 3 * width:
            said.append(CORRECTED("jump", name, centre=float(centre)))
