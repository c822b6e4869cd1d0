"""A log without the errors that a calibration knows: temperature first, then bias, scale factor and misalignment."""

from typing import Any

import equinox as eqx
import numpy as np
from numpy.polynomial import polynomial

from .._errors import DataError
from .._log import Log
from .._types import AnyArray
from ..temperature import thermometer
from ._thermal import AXES, at_reference, model_of

_SENSORS = ("gyro", "accel", "mag")


def corrected(calibration: Any, log: Log) -> Log:
    """The log with every correction that the calibration has for its sensors."""
    notes, warnings = [], []
    _same_recording(calibration, log, warnings)
    imu, section = calibration.imu or {}, calibration.temperature
    values: dict[str, Any] = {name: np.array(getattr(log, name)) for name in _SENSORS if getattr(log, name) is not None}
    done = []
    for sensor in values:
        offset = None if section is None else _thermal(section, log, sensor, values[sensor], sensor in imu, notes, warnings)
        if offset is not None:
            values[sensor] = values[sensor] - offset
            done.append(sensor)
    accel = imu.get("accel")
    if accel is not None and _whole(values, "accel", warnings):
        values["accel"] = _solved(accel["matrix"], values["accel"] - accel["bias"])
        done.append("accel")
    gyro = imu.get("gyro")
    if gyro is not None and _whole(values, "gyro", warnings):
        felt = np.zeros(3)
        if np.any(gyro["g_sensitivity"]):
            if "accel" in values and values["accel"].shape[1:] == (3,):
                felt = values["accel"] @ gyro["g_sensitivity"].T
            else:
                warnings.append("the gyroscope's g-sensitivity is not corrected, for the log has no accelerometer with three axes")
        values["gyro"] = _solved(gyro["matrix"], values["gyro"] - gyro["bias"] - felt)
        done.append("gyro")
    mag = calibration.magnetometer
    if mag is not None and _whole(values, "mag", warnings):
        values["mag"] = _solved(mag["soft_iron"], values["mag"] - mag["hard_iron"])
        done.append("mag")
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


def _solved(matrix: AnyArray, y: AnyArray) -> AnyArray:
    return y @ np.linalg.inv(matrix).T


def _whole(values: dict[str, Any], sensor: str, warnings: list[str]) -> bool:
    if sensor not in values:
        return False
    if values[sensor].shape[1:] != (3,):
        warnings.append(f"{sensor} has no three axes in the log; its matrix and bias are not corrected")
        return False
    return True


def _thermal(
    section: dict[str, Any], log: Log, sensor: str, y: AnyArray, has_bias: bool, notes: list[str], warnings: list[str]
) -> AnyArray | None:
    """What the temperature adds to a sensor, (n, axes); None where the calibration does not say."""
    channels = section.get("channels", {})
    names = [f"{sensor}_{axis}" for axis in AXES[: y.reshape(len(y), -1).shape[1]]]
    powers = section.get(sensor)
    if powers is None and not any(name in channels for name in names):
        return None
    t = thermometer(log)
    offset = np.zeros((len(t), len(names)))
    kept = False
    for i, name in enumerate(names):
        if name in channels:
            model = model_of(channels[name])
            felt = np.asarray(model.effective(t, rate=log.rate)[0])
            _outside(name, felt, float(model.low), float(model.high), warnings)
            offset[:, i] = np.asarray(model.curve.value(np.clip(felt, model.low, model.high)))
            if has_bias or sensor != "gyro":
                offset[:, i] -= at_reference(section, name)
                kept = True
            _passages(name, channels[name], felt, warnings)
        elif powers is not None:
            _outside(name, t, section["minimum"], section["maximum"], warnings)
            d = np.clip(t, section["minimum"], section["maximum"]) - section["reference"]
            offset[:, i] = polynomial.polyval(d, np.concatenate([[0.0], powers[i]]))
            kept = True
        else:
            warnings.append(f"{name} is not corrected for temperature; the calibration does not have it")
    if kept:
        notes.append(f"{sensor}: brought to {section['reference']:g} degC; its constant part is kept")
    return offset.reshape(y.shape)


def _outside(name: str, t: AnyArray, low: float, high: float, warnings: list[str]) -> None:
    share = np.mean((t < low) | (t > high))
    if t.min() < low - 0.1 or t.max() > high + 0.1:
        warnings.append(
            f"{name}: {100 * share:.3g} % of the temperatures ({t.min():.2f} to {t.max():.2f} degC) are outside the range of the model, "
            f"{low:.2f} to {high:.2f} degC; the value at its end is used. Calibrate over a wider range"
        )


def _passages(name: str, channel: dict[str, Any], t: AnyArray, warnings: list[str]) -> None:
    for centre, width in zip(channel.get("centre", ()), channel.get("width", ()), strict=True):
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
