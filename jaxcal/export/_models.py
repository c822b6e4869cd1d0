"""Models in the forms of other tools, with findings on what is lost: triangular, symmetric or diagonal matrices; thermal cubics."""

from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding
from .._errors import DataError, ExportError
from .._types import AnyArray
from .._units import STANDARD_GRAVITY, si_unit
from ..calibration import Calibration
from ..calibration._thermal import AXES, cubic
from ..imu import Triad
from ._findings import FINDINGS

_DECIMALS = 14  # decimals relative to the largest entry; further ones are rounding errors of the inverse
_DEGREE = 3
_MIRRORS = "{} of the calibration mirrors the axes, for which there is no place; exchange or negate an axis of the log"


def correction(matrix: AnyArray) -> AnyArray:
    """Inverse of a forward matrix, with exact zeros."""
    try:
        return rounded(np.linalg.inv(matrix))
    except np.linalg.LinAlgError:
        raise ExportError("a matrix of the calibration has no inverse; calibrate again", code="no_part") from None


def inverse(matrix: AnyArray) -> AnyArray:
    """Forward matrix of a correction matrix from a file."""
    try:
        return np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        raise DataError("a matrix of the file has no inverse", code="unreadable") from None


def rounded(values: AnyArray) -> AnyArray:
    """Round values to fourteen decimals relative to the largest, to remove rounding errors."""
    values = np.asarray(values, dtype=np.float64)
    largest = np.max(np.abs(values), initial=0.0)
    if not (np.isfinite(largest) and largest > 0):
        return values
    unit = 10.0 ** np.ceil(np.log10(largest))
    return np.round(values / unit, _DECIMALS) * unit + 0.0


def factored(matrix: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Factor `matrix` into a lower triangular matrix with positive diagonal and a rotation."""
    if not np.linalg.det(matrix) > 0:
        raise ExportError(_MIRRORS.format("a matrix"), code="no_part")
    q, r = np.linalg.qr(matrix.T)
    sign = np.sign(np.diag(r))
    return rounded(r.T * sign), rounded(q.T * sign[:, None])


def angle(turn: AnyArray) -> float:
    """Angle of a rotation in degrees, accurate for small angles, too."""
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return float(np.degrees(np.arctan2(np.linalg.norm(axis), np.trace(turn) - 1)))


def triads(calibration: Calibration) -> dict[str, Triad]:
    """Sensor -> its model, for the sensors in the imu section."""
    return {} if calibration.imu is None else {name: part.model for name, part in calibration.imu.parts.items()}


def diagonal(calibration: Calibration, found: list[Finding]) -> AnyArray:
    """(3,) scale factors of the accelerometer's correction; the misalignment is lost, with a finding."""
    full = correction(triads(calibration)["accel"].matrix)
    scale = np.diag(full)
    lost = np.linalg.norm(full - np.diag(scale), 2)
    if lost > 0:
        found.append(FINDINGS("matrix_left_out", "accel", what="misalignment", lost=lost))
    return scale


def symmetric(calibration: Calibration, place: str, found: list[Finding]) -> AnyArray:
    """Correction of the magnetometer as a symmetric matrix (3, 3): P of the polar decomposition A = U P; the rotation U is lost."""
    mag: Any = calibration.magnetometer
    full = correction(mag.model.soft_iron)
    if np.linalg.det(full) < 0:
        raise ExportError(_MIRRORS.format("the soft iron"), code="no_part")
    turn, shape = scipy.linalg.polar(full)
    lost = angle(turn)
    if lost > 1e-3:
        found.append(FINDINGS("rotation_left_out", "mag", lost=lost, place=place))
    unknown_field(calibration, found)
    return rounded((shape + shape.T) / 2)


def upper_of(matrix: AnyArray) -> tuple[Any, Any, Any]:
    """The entries xy, xz and yz, in the order that all tools use."""
    return matrix[0, 1], matrix[0, 2], matrix[1, 2]


def symmetric_of(diagonal: AnyArray, upper: AnyArray) -> AnyArray:
    """Make a symmetric matrix from its diagonal and its entries xy, xz, yz."""
    (xx, yy, zz), (xy, xz, yz) = diagonal, upper
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def unknown_field(calibration: Calibration, found: list[Finding]) -> None:
    """Add a finding if the scale of the magnetometer is arbitrary."""
    mag: Any = calibration.magnetometer
    asked = (calibration.provenance or {}).get("options")
    guessed = isinstance(asked, dict) and "field" in asked and asked["field"] is None and asked.get("place") is None
    if mag.field is None or not np.isfinite(mag.field) or guessed:
        found.append(FINDINGS("scale_unknown", "mag"))


def dropped_of_gyro(calibration: Calibration) -> list[Finding]:
    """Findings on the gyroscope parameters that are lost if only its bias is written."""
    gyro, said = triads(calibration).get("gyro"), []
    if gyro is not None and (lost := np.linalg.norm(correction(gyro.matrix) - np.eye(3), 2)) > 0:
        said.append(FINDINGS("matrix_left_out", "gyro", what="scale factors and misalignment", lost=lost))
    if gyro is not None and (lost := np.linalg.norm(gyro.g_sensitivity, 2) * STANDARD_GRAVITY) > 0:
        said.append(FINDINGS("g_sensitivity_left_out", "gyro", lost=lost))
    return said


def gyro_bias(calibration: Calibration) -> AnyArray | None:
    """Bias of the gyroscope at the reference temperature, rad/s, from the imu section or else from the thermal model; None without."""
    parts, section = triads(calibration), calibration.temperature
    if "gyro" in parts:
        return parts["gyro"].bias
    if section is None or len(section.of("gyro")) < len(AXES) or section.powers("gyro") is not None:
        return None
    return np.array([section.constant(f"gyro_{axis}") for axis in AXES])


def cubics(calibration: Calibration, sensor: str, reference: float | None, said: list[Finding]) -> AnyArray | None:
    """Thermal model of a sensor as a cubic: (3, 3) coefficients of d, d^2, d^3 for each axis, or None without a thermal model.

    d = T - `reference`; `reference` None uses that of the model. Findings report what the cubic loses.
    """
    section = calibration.temperature
    if section is None:
        return None
    about = section.reference if reference is None else reference
    found = cubic(section, sensor, _DEGREE, about)
    if found is None:
        return None
    coefficients, _, lost = found
    models = section.of(sensor)
    for axis, departure in zip(AXES, lost, strict=True):
        if departure > 0:
            jumps = ", ".join(f"{centre:.2f}" for centre in getattr(models[axis].curve, "centre", ()))
            what = f"; it smears out the jump at {jumps} degC" if jumps else ""
            said.append(FINDINGS("cubic_departs", f"{sensor}_{axis}", departure=departure, unit=si_unit(sensor), jumps=what))
        if axis in models and (models[axis].lag > 0 or models[axis].play > 0 or models[axis].rate != 0):
            said.append(FINDINGS("hysteresis_left_out", f"{sensor}_{axis}"))
    if not section.minimum <= section.reference <= section.maximum:
        limits = {name: getattr(section, name) for name in ("reference", "minimum", "maximum")}
        said.append(FINDINGS("reference_outside", sensor, **limits))
    reach = np.abs(np.array([section.minimum, section.maximum]) - about).max() ** np.arange(1, _DEGREE + 1)
    share = np.abs(coefficients) * reach
    # smaller terms are rounding errors from the change of the reference
    return np.where(share > 10.0 ** (1 - _DECIMALS) * share.max(initial=0.0), coefficients, 0.0)
