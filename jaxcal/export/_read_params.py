"""Readers of the parameters of flight controllers."""

import re
from typing import Any

import numpy as np
from numpy.polynomial import polynomial

from .._errors import DataError
from .._types import AnyArray
from ..calibration import Calibration, Thermal, polynomials
from ..imu import Triad
from ..magnetometer import MagModel
from ._ardupilot import names_of
from ._read_filters import inverse

_AXES = "XYZ"
_GAUSS, _MILLIGAUSS, _MILLIONTH = 1e-4, 1e-7, 1e-6
_REFERENCE = 35.0
_LARGEST = 1e15
Values = dict[str, float]


def px4(text: str, options: dict[str, Any]) -> Calibration:
    """One instance of each sensor; a thermal model that is switched off is left out, and its constant goes to the bias."""
    rows = [line.split("\t") for line in text.splitlines() if line.strip() and not line.startswith("#")]
    for row in rows:
        if len(row) != 5:
            raise DataError(
                f"the line {' '.join(row)!r:.80} has {len(row)} fields; expected vehicle, component, name, value and type by tabs"
            )
    values = {row[2].strip(): _number(row[2], row[3]) for row in rows}
    i = options["instance"]
    imu: dict[str, Triad] = {}
    ids: dict[str, int] = {}
    thermal: dict[str, Any] = {}
    for sensor, letter, start in (("accel", "A", f"CAL_ACC{i}"), ("gyro", "G", f"CAL_GYRO{i}")):
        model, constant = _px4_thermal(values, letter, i)
        if model is not None:
            thermal[sensor] = model
        if f"{start}_XOFF" in values:
            bias = _three(values, f"{start}_{{}}OFF") + constant
            scale = _three(values, f"{start}_{{}}SCALE") if sensor == "accel" else np.ones(3)
            imu[sensor] = _triad(scale, bias)
        _keep_id(ids, f"{sensor}_id", values.get(f"{start}_ID", values.get(f"TC_{letter}{i}_ID")))
    mag = None
    if f"CAL_MAG{i}_XOFF" in values:
        start = f"CAL_MAG{i}"
        correction = _symmetric(_three(values, f"{start}_{{}}SCALE"), _three(values, f"{start}_{{}}ODIAG"))
        mag = MagModel(inverse(correction), _three(values, f"{start}_{{}}OFF") * _GAUSS)
        _keep_id(ids, "mag_id", values.get(f"{start}_ID"))
    return _calibration(imu, mag, _joined(thermal), {"px4": ids}, f"instance {i} of any sensor")


def _px4_thermal(values: Values, letter: str, i: int) -> tuple[dict[str, Any] | None, AnyArray]:
    start = f"TC_{letter}{i}"
    if values.get(f"TC_{letter}_ENABLE", 0) != 1 or f"{start}_TREF" not in values:
        return None, np.zeros(3)
    powers = np.array([[values.get(f"{start}_X{power}_{axis}", 0.0) for power in range(4)] for axis in range(3)])
    limits = {name: _of(values, f"{start}_{key}") for name, key in (("reference", "TREF"), ("minimum", "TMIN"), ("maximum", "TMAX"))}
    return {"powers": powers[:, 1:], **limits}, powers[:, 0]


def ardupilot(text: str, options: dict[str, Any]) -> Calibration:
    """One instance of each sensor; the bias of the compass is minus its offset, and thermal models hold at CALTEMP."""
    values: Values = {}
    for line in text.splitlines():
        if line.strip() and not line.startswith("#"):
            parts = [part for part in re.split(r"[ ,\t]+", line.strip()) if part]
            if len(parts) != 2:
                raise DataError(f"the line {line!r:.80} has {len(parts)} items; expected a name and a value")
            values[parts[0]] = _number(parts[0], parts[1])
    names = names_of(options["instance"] + 1)
    imu: dict[str, Triad] = {}
    ids: dict[str, int] = {}
    for sensor in ("accel", "gyro"):
        if names[f"{sensor}_offset"].format("X") in values:
            scale = _three(values, names["accel_scale"]) if sensor == "accel" else np.ones(3)
            imu[sensor] = _triad(scale, _three(values, names[f"{sensor}_offset"]))
    _keep_id(ids, "accel_id", values.get(names["accel_id"]))
    mag = None
    if names["compass_offset"].format("X") in values:
        # a scale of 0 is ignored by the firmware
        scale = values.get(names["compass_scale"], 1.0) or 1.0
        correction = scale * _symmetric(_three(values, names["compass_diagonal"]), _three(values, names["compass_rest"]))
        mag = MagModel(inverse(correction), -_three(values, names["compass_offset"]) * _MILLIGAUSS)
        _keep_id(ids, "compass_id", values.get(names["compass_id"]))
    return _calibration(imu, mag, _ardupilot_thermal(values, names), {"ardupilot": ids}, f"instance {options['instance']} of any sensor")


def _ardupilot_thermal(values: Values, names: dict[str, str]) -> Thermal | None:
    start = names["thermal"]
    if values.get(f"{start}ENABLE", 0) != 1:
        return None
    low, high = _of(values, f"{start}TMIN"), _of(values, f"{start}TMAX")
    holds = min(max(values.get(names["accel_temperature"], low), low), high)
    sensors = {}
    for sensor, letter in (("accel", "ACC"), ("gyro", "GYR")):
        powers = np.array([[values.get(f"{start}{letter}{power}_{axis}", 0.0) for power in (1, 2, 3)] for axis in _AXES])
        if np.any(powers):
            sensors[sensor] = _about(powers * _MILLIONTH, _REFERENCE, holds)
    return polynomials(holds, low, high, **sensors)


def _joined(thermal: dict[str, Any]) -> Thermal | None:
    """One section of the models of two sensors: the reference of the first, and the range that both share."""
    if not thermal:
        return None
    models = thermal.values()
    reference = next(iter(models))["reference"]
    sensors = {sensor: _about(model["powers"], model["reference"], reference) for sensor, model in thermal.items()}
    return polynomials(reference, max(model["minimum"] for model in models), min(model["maximum"] for model in models), **sensors)


def _about(powers: AnyArray, old: float, new: float) -> AnyArray:
    """Coefficients of the powers from 1 of T - new, from those of T - old; the constant stays with the bias."""
    if old == new:
        return powers
    shift = polynomial.Polynomial([new - old, 1.0])
    found = [polynomial.Polynomial([0.0, *row])(shift).coef for row in powers]
    return np.stack([np.pad(row, (0, powers.shape[1] + 1 - len(row)))[1:] for row in found])


def _triad(scale: AnyArray, bias: AnyArray) -> Triad:
    if not np.all(scale):
        raise DataError("a scale factor of the accelerometer is 0")
    return Triad(np.diag(1 / scale), bias)


def _calibration(imu: dict, mag: MagModel | None, thermal: Thermal | None, device: dict[str, Any], what: str) -> Calibration:
    if not imu and mag is None and thermal is None:
        raise DataError(f"the file has no calibration of {what}")
    return Calibration(
        imu=imu or None, magnetometer=mag, temperature=thermal, device={name: ids for name, ids in device.items() if ids} or None
    )


def _symmetric(diagonal: AnyArray, rest: AnyArray) -> AnyArray:
    x, y, z = rest
    return np.array([[diagonal[0], x, y], [x, diagonal[1], z], [y, z, diagonal[2]]])


def _keep_id(ids: dict[str, int], name: str, value: float | None) -> None:
    if value is not None and value == int(value) and value > 0:
        ids[name] = int(value)


def _three(values: Values, pattern: str) -> AnyArray:
    return np.array([_of(values, pattern.format(axis)) for axis in _AXES])


def _of(values: Values, name: str) -> float:
    if name not in values:
        raise DataError(f"{name} is missing, though others of its group are there")
    return values[name]


def _number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not abs(value) < _LARGEST:
        raise DataError(f"{name} is {text!r:.80}; expected a number")
    return value
