"""Matrices as flight controllers hold them: diagonal, symmetric, or not at all; with what is lost."""

import numpy as np
from scipy.linalg import polar

from .._types import AnyArray
from .._units import STANDARD_GRAVITY
from ..calibration import Calibration


def diagonal(calibration: Calibration, warnings: list[str]) -> AnyArray:
    """Scale factors of the accelerometer's correction, (3,)."""
    imu = calibration.imu or {}
    correction = np.linalg.inv(imu["accel"]["matrix"])
    scale = np.diag(correction)
    lost = np.linalg.norm(correction - np.diag(scale), 2)
    if lost > 0:
        warnings.append(
            f"accelerometer: misalignment not written, for it has no place: {lost:.4g} ({lost * STANDARD_GRAVITY:.4g} m/s^2 at 1 g)"
        )
    return scale


def symmetric(calibration: Calibration, mounting: str, warnings: list[str]) -> AnyArray:
    """Correction of the magnetometer as a symmetric matrix, (3, 3): A = U P gives P, and U is lost."""
    mag = calibration.magnetometer or {}
    turn, shape = polar(np.linalg.inv(mag["soft_iron"]))
    angle = np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
    if angle > 1e-3:
        warnings.append(f"magnetometer: a rotation of {angle:.3g} degrees not written; {mounting} could hold it")
    if mag["field"] is None or not np.isfinite(mag["field"]):
        warnings.append("magnetometer: the field's strength was not known, so that the overall scale is arbitrary")
    return np.asarray(shape)


def dropped_of_gyro(calibration: Calibration) -> list[str]:
    """What a gyroscope loses where only its bias is written."""
    gyro = (calibration.imu or {}).get("gyro")
    if gyro is None:
        return []
    lost = np.linalg.norm(np.linalg.inv(gyro["matrix"]) - np.eye(3), 2)
    said = [f"gyroscope: scale factors and misalignment not written, for there is no place for them: {lost:.4g}"] if lost > 0 else []
    if np.any(gyro["g_sensitivity"]):
        said.append("gyroscope: g-sensitivity not written, for there is no place for it")
    return said
