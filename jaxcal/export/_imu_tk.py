"""imu_tk's `.calib` files: T (3, 3), K (3, 3) and B (3), applied as T K (raw - B)."""

from typing import Any

import numpy as np

from .._errors import ExportError
from .._types import AnyArray
from ..calibration import Calibration
from ..imu import Triad
from ._formats import IMU_TK
from ._models import correction, dropped_of_gyro, triads
from ._options import Product, plain

_DIGITS = 12  # of a number; T, whose diagonal is 1, has one decimal more


def write_imu_tk(calibration: Calibration, options: Any) -> Product:
    """Make one text for each sensor in the calibration."""
    parts = triads(calibration)
    if not parts:
        raise ExportError("the calibration holds no imu, of which imu_tk's files could be made", code="no_part")
    return Product({IMU_TK[name]: _text(part) for name, part in parts.items()}, dropped_of_gyro(calibration, matrix=False))


def _text(part: Triad) -> str:
    correction(part.matrix)  # only to refuse a singular matrix; its rounded result would change the twelfth digit of T
    full = np.linalg.inv(part.matrix)
    scale = np.diag(full)
    if not np.all(scale):
        raise ExportError("an axis has no scale factor of its own, by which T and K differ; look at the mounting", code="no_part")
    return "".join(_block(rows) for rows in (np.round(full / scale, _DIGITS + 1), np.diag(scale), part.bias[:, None]))


def _block(rows: AnyArray) -> str:
    return "".join(" ".join(plain(float(value), _DIGITS) for value in row) + "\n" for row in rows) + "\n"
