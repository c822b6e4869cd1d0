"""Correct a log with a calibration: first temperature, then bias, scale factor and misalignment."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np

from .._errors import DataError
from .._log import Log
from .._types import AnyArray
from ..temperature import Steps, ThermalModel, thermometer
from ._parts import Part
from ._thermal import AXES, SENSORS, Thermal


def corrected(calibration: Any, log: Log, currents: dict[str, Any] | None) -> Log:
    """The log with every correction that the calibration has for its sensors."""
    notes, warnings = [], []
    fields = _fields_of(calibration.magnetometer, log, currents or {}, notes, warnings)
    _same_recording(calibration, log, warnings)
    parts = {**({} if calibration.imu is None else calibration.imu.parts), "mag": calibration.magnetometer}
    values: dict[str, Any] = {name: np.array(getattr(log, name)) for name in SENSORS if getattr(log, name) is not None}
    done = []
    for sensor in values:
        offset = _thermal(calibration.temperature, log, sensor, values[sensor], sensor in parts, notes, warnings)
        if offset is not None:
            values[sensor] = values[sensor] - offset
            done.append(sensor)
    for sensor in ("accel", "gyro", "mag"):  # in this order, because the gyroscope's model uses the corrected accelerometer
        part = parts.get(sensor)
        if part is None or sensor not in values:
            continue
        if values[sensor].shape[1:] != (3,):
            warnings.append(f"{sensor} has no three axes in the log; its matrix and bias are not corrected")
        else:
            if sensor == "mag" and fields is not None:
                values[sensor] = values[sensor] - fields
            values[sensor] = _modelled(part, sensor, log, values, warnings)
            done.append(sensor)
    if not done:
        raise DataError("the calibration holds nothing that this log could be corrected with; see its imu, magnetometer and temperature")
    notes.append(f"corrected: {', '.join(dict.fromkeys(done))}")
    name = (calibration.device or {}).get("name")
    found: Any = eqx.tree_at(
        lambda one: [*(getattr(one, sensor) for sensor in values), one.notes, one.warnings, one.provenance],
        log,
        [*values.values(), (*log.notes, *notes), (*log.warnings, *warnings), {**log.provenance, "corrected_with": name or "calibration"}],
    )
    return found


def _fields_of(part: Part[Any] | None, log: Log, given: dict[str, Any], notes: list[str], warnings: list[str]) -> AnyArray | None:
    """Fields (n, 3) of the given currents, by the magnetometer's terms."""
    terms = {} if part is None or log.mag is None else part.currents or {}
    if unknown := [name for name in given if name not in terms]:
        known = f"it has {', '.join(terms)}" if terms else "it has none"
        raise DataError(f"the calibration has no field of the current {unknown[0]!r}; {known}")
    if left := [name for name in terms if name not in given]:
        warnings.append(
            f"mag: the calibration has the field of the currents {', '.join(left)}, which were not given: it is still in the readings. "
            "Name their columns with --currents, or give them as `currents`"
        )
    total = np.zeros((len(log.time), 3))
    for name, values in given.items():
        current = np.asarray(values, dtype=float)
        if current.shape != (len(total),):
            raise DataError(f"the current {name!r} has shape {current.shape}; give one number for each of the {len(total)} samples")
        total += np.outer(current, terms[name])
    if given:
        notes.append(f"mag: the fields of the currents {', '.join(given)} are taken off")
    return total if given else None


def _modelled(part: Part[Any], sensor: str, log: Log, values: dict[str, Any], warnings: list[str]) -> AnyArray:
    """Readings corrected by the model of their sensor, with the further inputs that it needs: temperature, specific force, time."""
    conditions: dict[str, Callable[[], Any]] = {"temperature": lambda: thermometer(log), "time": lambda: log.time}
    if sensor == "gyro" and np.any(part.model.g_sensitivity):
        if "accel" in values and values["accel"].shape[1:] == (3,):
            conditions["accel"] = lambda: values["accel"]
        else:
            warnings.append("the gyroscope's g-sensitivity is not corrected, for the log has no accelerometer with three axes")
            part = eqx.tree_at(lambda one: one.model.g_sensitivity, part, np.zeros((3, 3)))
    return part.correct(values[sensor], conditions, sensor)


def _thermal(
    thermal: Thermal | None, log: Log, sensor: str, y: AnyArray, has_bias: bool, notes: list[str], warnings: list[str]
) -> AnyArray | None:
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
            warnings.append(f"{name} is not corrected for temperature; the calibration does not have it")
            continue
        model, constant = models[axis], thermal.constant(name)
        felt, change, _ = model.effective(t, rate=log.rate)
        _outside(name, felt, float(model.low), float(model.high), warnings)
        offset[:, i] = np.asarray(model.curve.value(np.clip(felt, model.low, model.high))) + change
        if constant == 0 or has_bias or sensor != "gyro":
            offset[:, i] -= constant
            kept = True
        _passages(name, model, felt, warnings)
    if kept:
        notes.append(f"{sensor}: brought to {thermal.reference:g} degC; its constant part is kept")
    return offset.reshape(y.shape)


def _outside(name: str, t: AnyArray, low: float, high: float, warnings: list[str]) -> None:
    share = np.mean((t < low) | (t > high))
    if t.min() < low - 0.1 or t.max() > high + 0.1:
        warnings.append(
            f"{name}: {100 * share:.3g} % of the temperatures ({t.min():.2f} to {t.max():.2f} degC) are outside the range of the model, "
            f"{low:.2f} to {high:.2f} degC; the value at its end is used. Calibrate over a wider range"
        )


def _passages(name: str, model: ThermalModel, t: AnyArray, warnings: list[str]) -> None:
    curve = model.curve
    for centre, width in zip(curve.centre, curve.width, strict=True) if isinstance(curve, Steps) else ():
        if t.min() < centre + 3 * width and t.max() > centre - 3 * width:
            warnings.append(
                f"{name}: the temperature passes a jump of the bias at {centre:.2f} degC in this record; what the correction leaves of it "
                "looks like a rate random walk at every cluster time"
            )


def _same_recording(calibration: Any, log: Log, warnings: list[str]) -> None:
    known = (calibration.provenance or {}).get("sha256")
    if calibration.temperature is not None and known is not None and known == log.provenance.get("sha256"):
        warnings.append(
            "the thermal model was fitted to this very recording and takes slow noise with it: K comes out too small (5 to 13 % where a "
            "ramp alone is taken), and holds only for this model; correct another recording, at a steady temperature"
        )
