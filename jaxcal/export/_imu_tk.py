"""imu_tk's `.calib` files: T (3, 3), K (3, 3) and B (3), applied as T K (raw - B)."""

from typing import Any

import numpy as np

from .._errors import DataError, ExportError
from .._types import AnyArray
from ..calibration import Calibration
from ..imu import Triad
from ._formats import IMU_TK
from ._models import correction, dropped_of_gyro, inverse, triads
from ._options import Product, finite, plain

_DIGITS = 12  # of a number; T, whose diagonal is 1, has one decimal more


def write_imu_tk(calibration: Calibration, options: Any) -> Product:
    """Make one text for each sensor in the calibration."""
    parts = triads(calibration)
    if not parts:
        raise ExportError("the calibration holds no imu, of which imu_tk's files could be made", code="no_part")
    return Product({IMU_TK[name]: _text(part) for name, part in parts.items()}, dropped_of_gyro(calibration, matrix=False))


def read_imu_tk(texts: dict[str, str], options: dict[str, Any]) -> Calibration:
    """Read the files of one or both sensors."""
    imu = {}
    for sensor, text in texts.items():
        words = text.split()
        if len(words) != 21:
            raise DataError(f"the file of the {sensor} has {len(words)} numbers; expected {21}: T, K and B", code="unreadable")
        values = np.array([finite(word, f"a number of the {sensor}") for word in words])
        matrix = inverse(values[:9].reshape(3, 3) @ values[9:18].reshape(3, 3))
        imu[sensor] = Triad(matrix, values[18:])
    return Calibration(imu=imu)


def _text(part: Triad) -> str:
    correction(part.matrix)  # only to refuse a singular matrix; its rounded result would change the twelfth digit of T
    full = np.linalg.inv(part.matrix)
    scale = np.diag(full)
    if not np.all(scale):
        raise ExportError("an axis has no scale factor of its own, by which T and K differ; look at the mounting", code="no_part")
    return "".join(_block(rows) for rows in (np.round(full / scale, _DIGITS + 1), np.diag(scale), part.bias[:, None]))


def _block(rows: AnyArray) -> str:
    return "".join(" ".join(plain(float(value), _DIGITS) for value in row) + "\n" for row in rows) + "\n"
