"""MotionCal's calibration packet of 68 bytes, which the program sends to a sensor."""

import struct
from typing import Any

import numpy as np

from .._errors import DataError, ExportError
from .._units import si_unit
from ..calibration import Calibration, Part
from ..magnetometer import MagModel
from ._models import inverse, symmetric, symmetric_of, upper_of
from ._options import Options, Product, plain

_MICROTESLA = 1e-6
_SIGNATURE = b"\x75\x54"
#: largest departure of a determinant from 1 that float32 cannot represent
_UNIT = 3e-7


def motioncal(calibration: Calibration, options: Options) -> Product:
    """Write the hard iron in uT and the inverse of the soft iron, scaled to unit determinant."""
    mag = calibration.magnetometer
    if mag is None:
        raise ExportError("the calibration holds no magnetometer, for which alone MotionCal has a place", code="no_part")
    warnings: list[str] = []
    shape = symmetric(calibration, "the mounting of the sensor", warnings)
    determinant = float(np.linalg.det(shape))
    scale = 1.0 if abs(determinant - 1) < _UNIT else np.cbrt(determinant)
    shape, field = shape / scale, np.nan if mag.field is None else mag.field / scale
    if not np.isfinite(field):
        field = 50 * _MICROTESLA
        warnings.append("magnetometer: 50 uT are written for the field's strength, which is not known")
    if calibration.imu is not None:
        warnings.append("the packet's offsets of accelerometer and gyroscope are zero; MotionCal does not know their units")
    values = [0.0] * 6 + [*mag.model.hard_iron / _MICROTESLA, field / _MICROTESLA, *shape.diagonal(), *upper_of(shape)]
    for value in values:
        plain(float(value))  # refuses values outside the range of float32
    body = _SIGNATURE + struct.pack("<16f", *values)
    return Product(body + struct.pack("<H", _checksum(body)), tuple(warnings))


def read_motioncal(data: bytes, options: dict[str, Any]) -> Calibration:
    """Read a packet of 68 bytes, or of 52 bytes from older programs, which does not state the field's strength."""
    if data[:2] != _SIGNATURE or len(data) not in (52, 68):
        raise DataError(
            f"the file has {len(data)} bytes and begins with {data[:2].hex(' ')}; expected 68 or 52 that begin with 75 54", code="no_part"
        )
    sent, found = struct.unpack("<H", data[-2:])[0], _checksum(data[:-2])
    if sent != found:
        raise DataError(f"the checksum of the packet is {sent:04x}, and its bytes give {found:04x}; receive it again", code="no_part")
    values = np.array(struct.unpack(f"<{(len(data) - 4) // 4}f", data[2:-2]), dtype=np.float64)
    if not np.isfinite(values).all():
        raise DataError("the packet holds numbers that are not finite", code="no_part")
    if len(data) == 52:
        hard, correction, field = values[:3], values[3:].reshape(3, 3), None
    else:
        hard, field, correction = values[6:9], float(values[9]) * _MICROTESLA, symmetric_of(values[10:13], values[13:])
    return Calibration(magnetometer=Part(MagModel(inverse(correction), hard * _MICROTESLA), si_unit("mag"), field))


def _checksum(data: bytes) -> int:
    """CRC-16 with the reflected polynomial 0xA001 and the initial value 0xFFFF."""
    found = 0xFFFF
    for byte in data:
        found ^= byte
        for _ in range(8):
            found = found >> 1 ^ (0xA001 if found & 1 else 0)
    return found
