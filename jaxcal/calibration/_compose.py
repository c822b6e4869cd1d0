"""Calibrations one after the other, and backwards."""

from typing import Any

import numpy as np

from .._errors import DataError
from .._types import AnyArray

#: model of one sensor: y = matrix x + bias + g_sensitivity a + thermal powers
_IDENTITY = np.eye(3)
_ZERO = np.zeros((3, 3))


def composed(new: Any, old: Any) -> dict[str, Any]:
    """Sections of the calibration that does at once what `old` and then `new` do: C_new C_old, the bias mapped back."""
    imu: dict[str, Any] = {}
    a_old, a_new = _triad(old, "accel"), _triad(new, "accel")
    for sensor in ("accel", "gyro"):
        if not (_has(old, sensor) or _has(new, sensor)):
            continue
        o, n = _triad(old, sensor), _triad(new, sensor)
        part: dict[str, Any] = {
            "unit": {"accel": "m/s^2", "gyro": "rad/s"}[sensor], "matrix": o["matrix"] @ n["matrix"],
            "bias": o["bias"] + o["matrix"] @ n["bias"] + o["g_sensitivity"] @ a_new["bias"],
            "covariance": _carried(o, n, a_new if sensor == "gyro" else None, new, old, sensor),
        }  # fmt: skip
        if sensor == "gyro":
            part["g_sensitivity"] = o["matrix"] @ n["g_sensitivity"] + o["g_sensitivity"] @ a_new["matrix"]
        imu[sensor] = part
    thermal = _thermal(new, old, {"accel": a_old, "gyro": _triad(old, "gyro")}, a_new)
    return {
        "imu": imu | _verdict(new.imu or old.imu) if imu else None, "magnetometer": _magnetometer(new.magnetometer, old.magnetometer),
        "temperature": thermal, "noise": new.noise or old.noise,
    }  # fmt: skip


def inverted(calibration: Any) -> dict[str, Any]:
    """Sections of the calibration that makes corrected readings raw again, at one temperature as at another."""
    accel, gyro = _triad(calibration, "accel"), _triad(calibration, "gyro")
    c, w = np.linalg.inv(accel["matrix"]), np.linalg.inv(gyro["matrix"])
    felt = w @ gyro["g_sensitivity"] @ c
    imu: dict[str, Any] = {}
    if _has(calibration, "accel"):
        imu["accel"] = {"unit": "m/s^2", "matrix": c, "bias": -c @ accel["bias"], "covariance": None}
    if _has(calibration, "gyro"):
        bias = -w @ gyro["bias"] + felt @ accel["bias"]
        imu["gyro"] = {"unit": "rad/s", "matrix": w, "bias": bias, "g_sensitivity": -felt, "covariance": None}
    mag = calibration.magnetometer
    if mag is not None:
        a = np.linalg.inv(mag["soft_iron"])
        mag = {"unit": "T", "soft_iron": a, "hard_iron": -a @ mag["hard_iron"], "field": mag["field"], "covariance": None}
    thermal = calibration.temperature
    if thermal is not None:
        powers = _powers_of(thermal, "its inverse")
        found = {}
        if "accel" in powers:
            found["accel"] = -c @ powers["accel"]
        if "gyro" in powers or ("accel" in powers and np.any(felt)):
            own, other = _padded(powers.get("gyro"), powers.get("accel"))
            found["gyro"] = -w @ own + felt @ other
        thermal = {key: thermal[key] for key in ("unit", "reference", "minimum", "maximum")} | found
    return {"imu": imu or None, "magnetometer": mag, "temperature": thermal, "noise": None}


def _has(calibration: Any, sensor: str) -> bool:
    return sensor in (calibration.imu or {})


def _triad(calibration: Any, sensor: str) -> dict[str, Any]:
    """A sensor's model; the identity where there is none."""
    part = (calibration.imu or {}).get(sensor, {"matrix": _IDENTITY, "bias": np.zeros(3), "covariance": None})
    return {"g_sensitivity": _ZERO} | part


def _verdict(imu: dict[str, Any]) -> dict[str, str]:
    return {key: imu[key] for key in ("verdict", "verdict_reason") if key in imu}


def _carried(o: dict, n: dict, a_new: dict | None, new: Any, old: Any, sensor: str) -> dict[str, Any] | None:
    """Covariance of the product: the old numbers are what was applied, and exact; the new fit knows all that is uncertain."""
    covariance = n["covariance"] if _has(new, sensor) else o["covariance"]
    size = 21 if a_new is not None else 12
    if covariance is None or covariance["values"].shape != (size, size) or not _has(new, sensor):
        return covariance if not _has(new, sensor) else None
    m = o["matrix"]
    slope = np.zeros((size, size))
    slope[:9, :9] = np.kron(m, _IDENTITY)
    slope[9:12, 9:12] = m
    values = covariance["values"]
    if size == 21:
        slope[12:, 12:] = np.kron(m, _IDENTITY)
    values = slope @ values @ slope.T
    if a_new is not None and np.any(o["g_sensitivity"]) and a_new["covariance"] is not None:
        extra = np.zeros((21, 12))
        extra[9:12, 9:12] = o["g_sensitivity"]
        extra[12:, :9] = np.kron(o["g_sensitivity"], _IDENTITY)
        values = values + extra @ a_new["covariance"]["values"] @ extra.T
    return {"parameters": covariance["parameters"], "values": values}


def _magnetometer(new: dict[str, Any] | None, old: dict[str, Any] | None) -> dict[str, Any] | None:
    if new is None or old is None:
        return new if old is None else old
    s = old["soft_iron"]
    found = {
        "unit": "T", "soft_iron": s @ new["soft_iron"], "hard_iron": old["hard_iron"] + s @ new["hard_iron"], "field": new["field"],
        "covariance": None,
    }  # fmt: skip
    covariance = new["covariance"]
    if covariance is not None and covariance["parameters"][6:] == ("b_x", "b_y", "b_z"):
        # A_raw = S^-T A S^-1 and b_raw = S b + h, A as its six entries xx, xy, yy, xz, yz, zz
        c = np.linalg.inv(s)
        slope = np.zeros((9, 9))
        slope[6:, 6:] = s
        for k, (i, j) in enumerate(QUADRIC):
            unit = np.zeros((3, 3))
            unit[i, j] = unit[j, i] = 1.0
            turned = c.T @ unit @ c
            slope[:6, k] = [turned[p, q] for p, q in QUADRIC]
        found["covariance"] = {"parameters": covariance["parameters"], "values": slope @ covariance["values"] @ slope.T}
    return found | _verdict(new)


#: entries of the symmetric matrix of an ellipsoid in the order of the covariance
QUADRIC = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


def _thermal(new: Any, old: Any, o: dict[str, dict], a_new: dict) -> dict[str, Any] | None:
    if new.temperature is None and old.temperature is None:
        return None
    if new.temperature is None:
        return old.temperature
    if old.temperature is None and _is_plain(new.temperature, o):
        return new.temperature
    sections = [section for section in (old.temperature, new.temperature) if section is not None]
    reference = sections[0]["reference"]
    older = {} if old.temperature is None else _powers_of(old.temperature, "a composition")
    newer = _powers_of(new.temperature, "a composition")
    if new.temperature["reference"] != reference:
        raise DataError(
            f"the thermal models are about {reference:g} and {new.temperature['reference']:g} degC, and do not add up; correct the data in "
            "two steps"
        )
    low, high = max(section["minimum"] for section in sections), min(section["maximum"] for section in sections)
    if not low < high:
        raise DataError("the thermal models have no temperature in common")
    found: dict[str, Any] = {"unit": "degC", "reference": reference, "minimum": low, "maximum": high}
    for sensor in ("accel", "gyro"):
        parts = [] if sensor not in older else [older[sensor]]
        parts += [o[sensor]["matrix"] @ newer[sensor]] if sensor in newer else []
        if sensor == "gyro" and np.any(o["gyro"]["g_sensitivity"]) and "accel" in newer:
            parts.append(o["gyro"]["g_sensitivity"] @ newer["accel"])
        if parts:
            width = max(part.shape[1] for part in parts)
            found[sensor] = sum(np.pad(part, ((0, 0), (0, width - part.shape[1]))) for part in parts)
    return found


def _is_plain(section: dict[str, Any], o: dict[str, dict]) -> bool:
    """Whether a new thermal model is the same before an old correction as after it."""
    same = all(np.array_equal(part["matrix"], _IDENTITY) for part in o.values())
    return same and not np.any(o["gyro"]["g_sensitivity"])


def _powers_of(section: dict[str, Any], what: str) -> dict[str, AnyArray]:
    if section.get("channels"):
        raise DataError(f"thermal models with jumps, splines or hysteresis are of single axes, and {what} mixes axes; correct in two steps")
    return {sensor: section[sensor] for sensor in ("accel", "gyro") if sensor in section}


def _padded(a: AnyArray | None, b: AnyArray | None) -> tuple[AnyArray, AnyArray]:
    width = max(0 if part is None else part.shape[1] for part in (a, b))
    found = [np.zeros((3, width)) if part is None else np.pad(part, ((0, 0), (0, width - part.shape[1]))) for part in (a, b)]
    return found[0], found[1]
