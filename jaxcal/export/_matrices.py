"""Matrices as other tools hold them: full, triangular, symmetric, diagonal, or not at all; with what is lost."""

from typing import Any

import numpy as np
from scipy.linalg import polar

from .._errors import ExportError
from .._types import AnyArray
from .._units import STANDARD_GRAVITY
from ..calibration import Calibration
from ..imu import Triad

_DECIMALS = 14  # below the largest entry; what is smaller is rounding of the inverse


def correction(matrix: AnyArray) -> AnyArray:
    """Inverse of a forward matrix, its zeros exact.

    Raises
    ------
    ExportError
        If the matrix has no inverse.
    """
    try:
        return rounded(np.linalg.inv(matrix))
    except np.linalg.LinAlgError:
        raise ExportError("a matrix of the calibration has no inverse; calibrate again") from None


def rounded(values: AnyArray) -> AnyArray:
    """Values without what rounding left of them, fourteen decimals below the largest."""
    values = np.asarray(values, dtype=np.float64)
    largest = np.max(np.abs(values), initial=0.0)
    if not (np.isfinite(largest) and largest > 0):
        return values
    unit = 10.0 ** np.ceil(np.log10(largest))
    return np.round(values / unit, _DECIMALS) * unit + 0.0


def factored(matrix: AnyArray, shape: str) -> tuple[AnyArray, AnyArray]:
    """A triangular matrix with positive diagonal and a rotation whose product is `matrix`; `shape` "lower" or "upper".

    Raises
    ------
    ExportError
        If the matrix turns right-handed axes into left-handed ones, or has no inverse.
    """
    if not np.linalg.det(matrix) > 0:
        raise ExportError("a matrix of the calibration mirrors the axes, which no rotation can hold; exchange or negate an axis of the log")
    if shape == "lower":
        q, r = np.linalg.qr(matrix.T)
        triangle, turn = r.T, q.T
    else:
        q, r = np.linalg.qr(matrix[::-1].T)
        triangle, turn = r.T[::-1, ::-1], q.T[::-1]
    sign = np.sign(np.diag(triangle))
    return rounded(triangle * sign), rounded(turn * sign[:, None])


def angle(turn: AnyArray) -> float:
    """Angle of a rotation in degrees, exact for small ones."""
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return float(np.degrees(np.arctan2(np.linalg.norm(axis), np.trace(turn) - 1)))


def triads(calibration: Calibration) -> dict[str, Triad]:
    """Sensor -> its model."""
    return {} if calibration.imu is None else {name: part.model for name, part in calibration.imu.parts.items()}


def diagonal(calibration: Calibration, warnings: list[str]) -> AnyArray:
    """Scale factors of the accelerometer's correction, (3,)."""
    full = correction(triads(calibration)["accel"].matrix)
    scale = np.diag(full)
    lost = np.linalg.norm(full - np.diag(scale), 2)
    if lost > 0:
        warnings.append(
            f"accelerometer: misalignment not written, for it has no place: {lost:.4g} ({lost * STANDARD_GRAVITY:.4g} m/s^2 at 1 g)"
        )
    return scale


def symmetric(calibration: Calibration, mounting: str, warnings: list[str]) -> AnyArray:
    """Correction of the magnetometer as a symmetric matrix, (3, 3): A = U P gives P, and U is lost."""
    mag: Any = calibration.magnetometer
    full = correction(mag.model.soft_iron)
    if np.linalg.det(full) < 0:
        raise ExportError("the soft iron mirrors the axes, which a symmetric matrix cannot hold; exchange or negate an axis of the log")
    turn, shape = polar(full)
    lost = angle(turn)
    if lost > 1e-3:
        warnings.append(f"magnetometer: a rotation of {lost:.3g} degrees not written; {mounting} could hold it")
    unknown_field(calibration, warnings)
    return rounded((shape + shape.T) / 2)


def unknown_field(calibration: Calibration, warnings: list[str]) -> None:
    """Say that the scale of the magnetometer is arbitrary, where it is."""
    mag: Any = calibration.magnetometer
    asked = (calibration.provenance or {}).get("options")
    guessed = isinstance(asked, dict) and "field" in asked and asked["field"] is None and asked.get("place") is None
    if mag.field is None or not np.isfinite(mag.field) or guessed:
        warnings.append("magnetometer: the field's strength was not known, so that the overall scale is arbitrary")


def dropped_of_gyro(calibration: Calibration) -> list[str]:
    """What a gyroscope loses where only its bias is written."""
    gyro = triads(calibration).get("gyro")
    if gyro is None:
        return []
    lost = np.linalg.norm(correction(gyro.matrix) - np.eye(3), 2)
    said = [f"gyroscope: scale factors and misalignment not written, for there is no place for them: {lost:.4g}"] if lost > 0 else []
    return said + dropped_g_sensitivity(calibration)


def dropped_g_sensitivity(calibration: Calibration) -> list[str]:
    """The gyroscope's g-sensitivity, where a format has no place for it."""
    gyro = triads(calibration).get("gyro")
    if gyro is None or not np.any(gyro.g_sensitivity):
        return []
    size = np.linalg.norm(gyro.g_sensitivity, 2)
    return [
        f"gyroscope: g-sensitivity not written, for there is no place for it: {size:.4g} rad/s per m/s^2 "
        f"({size * STANDARD_GRAVITY:.4g} rad/s at 1 g)"
    ]
