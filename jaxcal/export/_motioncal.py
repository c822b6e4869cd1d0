"""MotionCal's calibration packet, as the program sends it to a sensor: 68 bytes."""

import struct

import numpy as np

from .._errors import ExportError
from ..calibration import Calibration
from ._matrices import symmetric
from ._options import Options, Product
from ._text import plain

MICROTESLA = 1e-6
SIGNATURE = b"\x75\x54"
#: of a determinant that float32 cannot tell from 1
_UNIT = 3e-7


def motioncal(calibration: Calibration, options: Options) -> Product:
    """Hard iron in uT and the inverse of the soft iron with unit determinant."""
    mag = calibration.magnetometer
    if mag is None:
        raise ExportError("the calibration holds no magnetometer, for which alone MotionCal has a place")
    warnings: list[str] = []
    shape = symmetric(calibration, "the mounting of the sensor", warnings)
    determinant = float(np.linalg.det(shape))
    scale = 1.0 if abs(determinant - 1) < _UNIT else np.cbrt(determinant)
    shape, field = shape / scale, np.nan if mag.field is None else mag.field / scale
    if not np.isfinite(field):
        field = 50 * MICROTESLA
        warnings.append("magnetometer: 50 uT are written for the field's strength, which is not known")
    if calibration.imu is not None:
        warnings.append("the packet's offsets of accelerometer and gyroscope are zero; MotionCal does not know their units")
    values = [0.0] * 6 + [*mag.model.hard_iron / MICROTESLA, field / MICROTESLA, *shape.diagonal(), shape[0, 1], shape[0, 2], shape[1, 2]]
    for value in values:
        plain(float(value))  # float32 holds it
    body = SIGNATURE + struct.pack("<16f", *values)
    return Product(body + struct.pack("<H", checksum(body)), tuple(warnings))


def checksum(data: bytes) -> int:
    """CRC-16, reflected polynomial 0xA001, from 0xFFFF.

    Examples
    --------
    >>> from jaxcal.export._motioncal import checksum
    >>> hex(checksum(b"123456789"))
    '0x4b37'
    """
    found = 0xFFFF
    for byte in data:
        found ^= byte
        for _ in range(8):
            found = found >> 1 ^ (0xA001 if found & 1 else 0)
    return found
