"""MotionCal's calibration packet of 68 bytes, which the program sends to a sensor."""

import struct
from typing import Any

import numpy as np

from .._answer import Finding
from .._errors import DataError, ExportError
from .._units import factor, si_unit
from ..calibration import Calibration, Part
from ..magnetometer import MagModel
from ._findings import FINDINGS
from ._models import inverse, symmetric, symmetric_of, upper_of
from ._options import Product, plain

_MICROTESLA = factor("uT", "mag")
_SIGNATURE = b"\x75\x54"


def write_motioncal(calibration: Calibration, options: Any) -> Product:
    """Write the hard iron in uT and the inverse of the soft iron, scaled to unit determinant."""
    mag = calibration.magnetometer
    if mag is None:
        raise ExportError("the calibration holds no magnetometer, for which alone MotionCal has a place", code="no_part")
    found: list[Finding] = []
    shape = symmetric(calibration, "The mounting of the sensor", found)
    determinant = float(np.linalg.det(shape))
    # float32 cannot tell a determinant this close to 1 from 1: a file that is read and written again stays the same
    scale = 1.0 if abs(determinant - 1) < 3 * np.finfo(np.float32).eps else np.cbrt(determinant)
    shape, field = shape / scale, np.nan if mag.field is None else mag.field / scale
    if not np.isfinite(field):
        field = 50 * _MICROTESLA
        found.append(FINDINGS("placeholder", "mag", what="strength of the field", value="50 uT"))
    values = [0.0] * 6 + [*mag.model.hard_iron / _MICROTESLA, field / _MICROTESLA, *shape.diagonal(), *upper_of(shape)]
    for value in values:
        plain(float(value))  # refuses values outside the range of float32
    body = _SIGNATURE + struct.pack("<16f", *values)
    return Product(body + struct.pack("<H", _checksum(body)), found)


def read_motioncal(data: bytes, options: dict[str, Any]) -> Calibration:
    """Read a packet of 68 bytes."""
    if data[:2] != _SIGNATURE or len(data) != 68:
        raise DataError(f"{len(data)} bytes that begin with {data[:2].hex(' ')}; expected 68 that begin with 75 54", code="unreadable")
    sent, found = struct.unpack("<H", data[-2:])[0], _checksum(data[:-2])
    if sent != found:
        raise DataError(f"the checksum of the packet is {sent:04x}, and its bytes give {found:04x}; receive it again", code="unreadable")
    values = np.array(struct.unpack("<16f", data[2:-2]), dtype=np.float64)
    if not np.isfinite(values).all():
        raise DataError("the packet holds numbers that are not finite", code="unreadable")
    model = MagModel(inverse(symmetric_of(values[10:13], values[13:])), values[6:9] * _MICROTESLA)
    return Calibration(magnetometer=Part(model, si_unit("mag"), float(values[9]) * _MICROTESLA))


def _checksum(data: bytes) -> int:
    """CRC-16 with the reflected polynomial 0xA001 and the initial value 0xFFFF."""
    found = 0xFFFF
    for byte in data:
        found ^= byte
        for _ in range(8):
            found = found >> 1 ^ (0xA001 if found & 1 else 0)
    return found
