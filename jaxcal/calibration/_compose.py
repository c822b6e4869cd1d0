"""Combine two calibrations that are applied one after the other, and invert one.

Accelerometer and gyroscope form one affine model with six axes, y = M x + b, in which the g-sensitivity is a block of M.
"""

import dataclasses
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._types import AnyArray
from ..fitting import Estimate
from ..imu import Triad
from ..magnetometer import MagModel
from ..magnetometer._model import HARD, SOFT
from ._parts import Imu, Part
from ._thermal import Thermal


def composed(new: Any, old: Any) -> dict[str, Any]:
    """Sections of the calibration that combines `old` and then `new`: M_old M_new, with the bias transformed back."""
    (m, b), (n, c) = _affine(old), _affine(new)
    parts = {**_parts(old), **_parts(new)}
    if _parts(old) and _parts(new):
        for sensor, part in (*_parts(old).items(), *_parts(new).items()):
            _only_plain(part, f"imu.{sensor}")
        models = _triads(m @ n, b + m @ c)
        parts = {sensor: Part(models[sensor], part.unit) for sensor, part in parts.items()}
        known = {sensor: _carried(new, old, sensor, m, part.parameters) for sensor, part in parts.items()}
        parts = {sensor: dataclasses.replace(part, estimate=known[sensor]) for sensor, part in parts.items()}
    first = new.imu or old.imu
    imu = None if first is None else Imu(parts.get("accel"), parts.get("gyro"), first.verdict, first.verdict_reason)
    magnetometer, thermal = _magnetometer(new.magnetometer, old.magnetometer), _thermal(new.temperature, old.temperature, m)
    return {"imu": imu, "magnetometer": magnetometer, "temperature": thermal, "noise": new.noise or old.noise}


def _parts(calibration: Any) -> dict[str, Part[Triad]]:
    return {} if calibration.imu is None else calibration.imu.parts


def _affine(calibration: Any) -> tuple[AnyArray, AnyArray]:
    """M (6, 6) and b (6,) of accelerometer and gyroscope; the identity for a missing sensor."""
    nothing = Triad(np.eye(3), np.zeros(3))
    accel, gyro = (nothing if (part := _parts(calibration).get(sensor)) is None else part.model for sensor in ("accel", "gyro"))
    matrix = np.block([[accel.matrix, np.zeros((3, 3))], [gyro.g_sensitivity, gyro.matrix]])
    return matrix, np.concatenate([accel.bias, gyro.bias])


def _triads(matrix: AnyArray, bias: AnyArray) -> dict[str, Triad]:
    return {"accel": Triad(matrix[:3, :3], bias[:3]), "gyro": Triad(matrix[3:, 3:], bias[3:], matrix[3:, :3])}


def _only_plain(part: Part[Any] | None, what: str) -> None:
    """Raise a `DataError` for a model with fields of its own, whose composition and inverse are unknown here."""
    if part is not None and type(part.model) is not part.base:
        own = ", ".join(part.further) or "a formula of its own"
        said = f"{type(part.model).__name__} of {what} has {own}; composition is of {part.base.__name__} alone: correct in two steps"
        raise DataError(said, code="own_model")


def _carried(new: Any, old: Any, sensor: str, m: AnyArray, values: dict[str, float]) -> Estimate | None:
    """Estimate of the product, which has these values: the old numbers were applied and so are exact; all uncertainty is in the new fit."""
    if sensor not in _parts(new):
        return _parts(old)[sensor].estimate
    names = [name for name in _parts(new)[sensor].parameters if sensor == "gyro" or "g_sens" not in name]
    known, size = _parts(new)[sensor].spread(names), len(names)
    if known is None:
        return None
    own, felt = (m[3:, 3:] if sensor == "gyro" else m[:3, :3]), m[3:, :3]
    slope = scipy.linalg.block_diag(np.kron(own, np.eye(3)), own, np.kron(own, np.eye(3)))[:size, :size]
    matrix = slope @ known @ slope.T
    accel = _parts(new).get("accel")
    if sensor == "gyro" and np.any(felt) and accel is not None and (by_accel := accel.spread(names[:12])) is not None:
        extra = np.zeros((21, 12))
        extra[9:12, 9:12] = felt
        extra[12:, :9] = np.kron(felt, np.eye(3))
        matrix = matrix + extra @ by_accel @ extra.T
    return Estimate(names, np.array([values[name] for name in names]), matrix)


def _magnetometer(new: Part[MagModel] | None, old: Part[MagModel] | None) -> Part[MagModel] | None:
    if new is None or old is None:
        return new if old is None else old
    for part in (old, new):
        _only_plain(part, "the magnetometer")
    s, known = old.model.soft_iron, None
    model = MagModel(s @ new.model.soft_iron, old.model.hard_iron + s @ new.model.hard_iron)
    names = (*HARD, *SOFT, "field")
    if (held := new.spread(names)) is not None:
        # C_raw = S C, by rows, and b_raw = S b + h
        slope = scipy.linalg.block_diag(s, np.kron(s, np.eye(3)), 1.0)
        known = Estimate(names, np.concatenate([model.hard_iron, model.soft_iron.ravel(), [new.field or np.nan]]), slope @ held @ slope.T)
    return Part(model, old.unit, new.field, known, new.verdict, new.verdict_reason, _currents(new, old, s))


def _currents(new: Part[MagModel], old: Part[MagModel], s: AnyArray) -> dict[str, AnyArray] | None:
    """Fields of currents in the raw readings: the old ones, plus the new ones of the corrected readings, mapped by the soft iron."""
    found = dict(old.currents or {})
    for name, field in (new.currents or {}).items():
        found[name] = found.get(name, np.zeros(3)) + s @ field
    return found or None


def _thermal(new: Thermal | None, old: Thermal | None, m: AnyArray) -> Thermal | None:
    """The thermal models of one of both; those of corrected readings are no models of the raw ones."""
    if new is not None and (old is not None or not np.array_equal(m, np.eye(6))):
        raise DataError("thermal models of corrected readings do not go into a composition; correct in two steps", code="thermal")
    return old if new is None else new
