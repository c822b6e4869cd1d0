"""Calibrations one after the other, and backwards."""

from typing import Any

import numpy as np

from .._errors import DataError
from .._types import AnyArray
from .._units import si_unit
from ..imu import Triad
from ..magnetometer import MagModel
from ._parts import Covariance, Imu, Part
from ._thermal import Thermal, polynomials

_IDENTITY = np.eye(3)
#: entries of the symmetric matrix of an ellipsoid in the order of the covariance
QUADRIC = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


def composed(new: Any, old: Any) -> dict[str, Any]:
    """Sections of the calibration that does at once what `old` and then `new` do: C_new C_old, the bias mapped back."""
    held = {**_parts(old), **_parts(new)}
    olds, news = ({sensor: _triad(one, sensor) for sensor in ("accel", "gyro")} for one in (old, new))
    parts: dict[str, Part[Triad]] = {}
    for sensor in held:
        if not _parts(old) or not _parts(new):  # the other changes nothing
            parts[sensor] = held[sensor]
            continue
        for one in (_parts(old), _parts(new)):
            _only_plain(one.get(sensor), f"imu.{sensor}", "a composition")
        o, n, a_new = olds[sensor], news[sensor], news["accel"]
        felt = o.matrix @ n.g_sensitivity + o.g_sensitivity @ a_new.matrix if sensor == "gyro" else np.zeros((3, 3))
        model = Triad(o.matrix @ n.matrix, o.bias + o.matrix @ n.bias + o.g_sensitivity @ a_new.bias, felt)
        parts[sensor] = Part(model, held[sensor].unit, covariance=_carried(new, old, sensor, o))
    first = new.imu or old.imu
    thermal = _thermal(new.temperature, old.temperature, olds)
    imu = None if first is None else Imu(parts.get("accel"), parts.get("gyro"), first.verdict, first.verdict_reason)
    return {
        "imu": imu, "magnetometer": _magnetometer(new.magnetometer, old.magnetometer), "temperature": thermal,
        "noise": new.noise or old.noise,
    }  # fmt: skip


def inverted(calibration: Any) -> dict[str, Any]:
    """Sections of the calibration that makes corrected readings raw again, at one temperature as at another."""
    held = _parts(calibration)
    for sensor, part in (*held.items(), ("mag", calibration.magnetometer)):
        _only_plain(part, sensor, "an inverse")
    accel, gyro = _triad(calibration, "accel"), _triad(calibration, "gyro")
    c, w = np.linalg.inv(accel.matrix), np.linalg.inv(gyro.matrix)
    felt = w @ gyro.g_sensitivity @ c
    models = {"accel": Triad(c, -c @ accel.bias), "gyro": Triad(w, -w @ gyro.bias + felt @ accel.bias, -felt)}
    mag, thermal = calibration.magnetometer, calibration.temperature
    if mag is not None:
        a = np.linalg.inv(mag.model.soft_iron)
        mag = Part(MagModel(a, -a @ mag.model.hard_iron), mag.unit, mag.field)
    if thermal is not None:
        powers = _powers_of(thermal, "its inverse")
        found = {}
        if "accel" in powers:
            found["accel"] = -c @ powers["accel"]
        if "gyro" in powers or ("accel" in powers and np.any(felt)):
            found["gyro"] = _sum(*[-w @ powers["gyro"]] * ("gyro" in powers), *[felt @ powers["accel"]] * ("accel" in powers))
        thermal = polynomials(thermal.reference, thermal.minimum, thermal.maximum, **found)
    of = {sensor: Part(models[sensor], part.unit) for sensor, part in held.items()}
    imu = Imu(of.get("accel"), of.get("gyro")) if of else None
    return {"imu": imu, "magnetometer": mag, "temperature": thermal, "noise": None}


def _parts(calibration: Any) -> dict[str, Part[Triad]]:
    return {} if calibration.imu is None else calibration.imu.parts


def _triad(calibration: Any, sensor: str) -> Triad:
    """A sensor's model; the identity where there is none."""
    part = _parts(calibration).get(sensor)
    return Triad(_IDENTITY, np.zeros(3)) if part is None else part.model


def _only_plain(part: Part[Any] | None, what: str, wish: str) -> None:
    """Raise a `DataError` for a model with fields of its own, of which nothing is known here."""
    if part is not None and type(part.model) is not part.base:
        raise DataError(
            f"the model {type(part.model).__name__} of {what} has {', '.join(part.further) or 'a formula of its own'}; {wish} is known of "
            f"{part.base.__name__} alone: correct the data in two steps"
        )


def _carried(new: Any, old: Any, sensor: str, o: Triad) -> Covariance | None:
    """Covariance of the product: the old numbers are what was applied, and exact; the new fit knows all that is uncertain."""
    if sensor not in _parts(new):
        return _parts(old)[sensor].covariance
    covariance = _parts(new)[sensor].covariance
    size = 21 if sensor == "gyro" else 12
    if covariance is None or covariance.values.shape != (size, size):
        return None
    slope = np.zeros((size, size))
    slope[:9, :9] = np.kron(o.matrix, _IDENTITY)
    slope[9:12, 9:12] = o.matrix
    slope[12:, 12:] = np.kron(o.matrix, _IDENTITY)[: size - 12, : size - 12]
    values = slope @ covariance.values @ slope.T
    accel = _parts(new).get("accel")
    if sensor == "gyro" and np.any(o.g_sensitivity) and accel is not None and accel.covariance is not None:
        extra = np.zeros((21, 12))
        extra[9:12, 9:12] = o.g_sensitivity
        extra[12:, :9] = np.kron(o.g_sensitivity, _IDENTITY)
        values = values + extra @ accel.covariance.values @ extra.T
    return Covariance(covariance.parameters, values)


def _magnetometer(new: Part[MagModel] | None, old: Part[MagModel] | None) -> Part[MagModel] | None:
    if new is None or old is None:
        return new if old is None else old
    for part in (old, new):
        _only_plain(part, "the magnetometer", "a composition")
    s, covariance = old.model.soft_iron, new.covariance
    if covariance is not None and covariance.parameters[6:] == ("b_x", "b_y", "b_z"):
        # A_raw = S^-T A S^-1 and b_raw = S b + h, A as its six entries xx, xy, yy, xz, yz, zz
        c = np.linalg.inv(s)
        slope = np.zeros((9, 9))
        slope[6:, 6:] = s
        for k, (i, j) in enumerate(QUADRIC):
            unit = np.zeros((3, 3))
            unit[i, j] = unit[j, i] = 1.0
            turned = c.T @ unit @ c
            slope[:6, k] = [turned[p, q] for p, q in QUADRIC]
        covariance = Covariance(covariance.parameters, slope @ covariance.values @ slope.T)
    else:
        covariance = None
    model = MagModel(s @ new.model.soft_iron, old.model.hard_iron + s @ new.model.hard_iron)
    return Part(model, si_unit("mag"), new.field, covariance, None, new.verdict, new.verdict_reason)


def _thermal(new: Thermal | None, old: Thermal | None, o: dict[str, Triad]) -> Thermal | None:
    if new is None:
        return old
    plain = all(np.array_equal(part.matrix, _IDENTITY) for part in o.values()) and not np.any(o["gyro"].g_sensitivity)
    if old is None and plain:
        return new  # the same before the old correction as after it
    older = {} if old is None else _powers_of(old, "a composition")
    newer = _powers_of(new, "a composition")
    sections = [one for one in (old, new) if one is not None]
    reference = sections[0].reference
    if new.reference != reference:
        raise DataError(
            f"the thermal models are about {reference:g} and {new.reference:g} degC, and do not add up; correct the data in two steps"
        )
    low, high = max(one.minimum for one in sections), min(one.maximum for one in sections)
    if not low < high:
        raise DataError("the thermal models have no temperature in common")
    found = {}
    for sensor in ("accel", "gyro"):
        parts = [older[sensor]] if sensor in older else []
        parts += [o[sensor].matrix @ newer[sensor]] if sensor in newer else []
        if sensor == "gyro" and np.any(o["gyro"].g_sensitivity) and "accel" in newer:
            parts.append(o["gyro"].g_sensitivity @ newer["accel"])
        if parts:
            found[sensor] = _sum(*parts)
    return polynomials(reference, low, high, **found)


def _powers_of(thermal: Thermal, what: str) -> dict[str, AnyArray]:
    found = {sensor: rows for sensor in ("accel", "gyro") if (rows := thermal.powers(sensor)) is not None}
    if len(thermal.channels) > 3 * len(found):
        raise DataError(f"thermal models with jumps, splines or hysteresis are of single axes, and {what} mixes axes; correct in two steps")
    return found


def _sum(*powers: AnyArray) -> AnyArray:
    """Coefficients of a sum of polynomials."""
    width = max(part.shape[1] for part in powers)
    return np.sum([np.pad(part, ((0, 0), (0, width - part.shape[1]))) for part in powers], axis=0)
