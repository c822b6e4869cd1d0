"""Readers of imu_tk's files, MotionCal's packets, and the table."""

import csv
import io
import struct
from typing import Any

import numpy as np

from .._errors import DataError
from .._types import AnyArray
from .._units import si_unit
from ..calibration import Calibration, Part, Thermal, polynomials
from ..imu import Triad
from ..magnetometer import MagModel
from ._csv import AXES, HEADER, TERMS
from ._motioncal import MICROTESLA, SIGNATURE, checksum
from ._read_filters import inverse

_NUMBERS = 21  # T, K and B
_LARGEST = 1e15


def imu_tk(texts: dict[str, str]) -> Calibration:
    """One or both of the files, by sensor."""
    imu = {}
    for sensor, text in texts.items():
        words = text.split()
        if len(words) != _NUMBERS:
            raise DataError(f"the file of the {sensor} has {len(words)} numbers; expected {_NUMBERS}: T, K and B")
        values = np.array([_number(word) for word in words])
        matrix = inverse(values[:9].reshape(3, 3) @ values[9:18].reshape(3, 3))
        imu[sensor] = Triad(matrix, values[18:])
    return Calibration(imu=imu)


def motioncal(data: bytes) -> Calibration:
    """A packet of 68 bytes, or of 52 as older programs sent it, in which the field's strength is not known."""
    if data[:2] != SIGNATURE or len(data) not in (52, 68):
        raise DataError(f"the file has {len(data)} bytes and begins with {data[:2].hex(' ')}; expected 68 or 52 that begin with 75 54")
    sent, found = struct.unpack("<H", data[-2:])[0], checksum(data[:-2])
    if sent != found:
        raise DataError(f"the checksum of the packet is {sent:04x}, and its bytes give {found:04x}; receive it again")
    values = np.array(struct.unpack(f"<{(len(data) - 4) // 4}f", data[2:-2]), dtype=np.float64)
    if not np.isfinite(values).all():
        raise DataError("the packet holds numbers that are not finite")
    if len(data) == 52:
        hard, correction, field = values[:3], values[3:].reshape(3, 3), None
    else:
        hard, field = values[6:9], float(values[9]) * MICROTESLA
        xx, yy, zz, xy, xz, yz = values[10:]
        correction = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Calibration(magnetometer=Part(MagModel(inverse(correction), hard * MICROTESLA), si_unit("mag"), field))


def table(text: str) -> Calibration:
    """The table of `write`: forward models and noise; covariances and the limits of matrices are not in it."""
    rows = list(csv.reader(io.StringIO(text)))
    if not rows or ",".join(rows[0]) != HEADER:
        raise DataError(f"the first line is not {HEADER}")
    found: dict[tuple[str, str], dict[str, AnyArray]] = {}
    for row in rows[1:]:
        if len(row) != 7:
            raise DataError(f"the row {','.join(row)!r:.80} has {len(row)} cells; expected 7")
        limits = [_number(cell) if cell else np.nan for cell in row[3:5]]
        found.setdefault((row[0], row[6]), {})[row[1]] = np.array([_number(row[2]), *limits])
    return Calibration(noise=_noise(found), imu=_imu(found), magnetometer=_mag(found), temperature=_temperature(found))


Cells = dict[tuple[str, str], dict[str, AnyArray]]


def _noise(found: Cells) -> dict[str, Any] | None:
    if ("noise", "rate") not in found:
        return None
    noise: dict[str, Any] = {"rate": float(found["noise", "rate"].get("", [np.nan])[0])}
    for sensor in ("gyro", "accel", "mag"):
        cells = {term: found[sensor, kind] for term, kind in TERMS.items() if (sensor, kind) in found}
        if not cells:
            continue
        part: dict[str, Any] = {"unit": si_unit(sensor), **dict.fromkeys(TERMS)}
        limits: dict[str, Any] = {"low": {}, "high": {}}
        for term, values in cells.items():
            rows = np.array([values.get(axis, np.full(3, np.nan)) for axis in AXES])
            part[term] = rows[:, 0]
            for i, name in enumerate(("low", "high"), 1):
                if np.isfinite(rows[:, i]).any():
                    limits[name][term] = rows[:, i]
        noise[sensor] = part | {name: values for name, values in limits.items() if values}
    return noise


def _imu(found: Cells) -> dict[str, Triad] | None:
    imu = {}
    for sensor in ("accel", "gyro"):
        if (sensor, "matrix") in found:
            felt = [_square(found, sensor, "g_sensitivity")] if sensor == "gyro" else []
            imu[sensor] = Triad(_square(found, sensor, "matrix"), _three(found, sensor, "bias"), *felt)
    return imu or None


def _mag(found: Cells) -> Part[MagModel] | None:
    if ("mag", "matrix") not in found:
        return None
    field = found.get(("mag", "field"), {}).get("")
    model = MagModel(_square(found, "mag", "matrix"), _three(found, "mag", "bias"))
    return Part(model, si_unit("mag"), None if field is None else float(field[0]))


def _temperature(found: Cells) -> Thermal | None:
    if ("temperature", "reference") not in found:
        return None
    reference, low, high = (float(_cell(found, "temperature", key, "")[0]) for key in ("reference", "minimum", "maximum"))
    sensors = {}
    for sensor in ("accel", "gyro"):
        powers = []
        while (sensor, f"bias_temperature_{len(powers) + 1}") in found:
            powers.append(_three(found, sensor, f"bias_temperature_{len(powers) + 1}"))
        if powers:
            sensors[sensor] = np.stack(powers, axis=1)
    return polynomials(reference, low, high, **sensors)


def _square(found: Cells, quantity: str, kind: str) -> AnyArray:
    return np.array([[_cell(found, quantity, kind, a + b)[0] for b in AXES] for a in AXES])


def _three(found: Cells, quantity: str, kind: str) -> AnyArray:
    return np.array([_cell(found, quantity, kind, axis)[0] for axis in AXES])


def _cell(found: Cells, quantity: str, kind: str, axis: str) -> AnyArray:
    cells = found.get((quantity, kind), {})
    if axis not in cells:
        raise DataError(f"the row of {quantity}, axis {axis or '(none)'}, kind {kind} is missing")
    return cells[axis]


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not abs(value) < _LARGEST:
        raise DataError(f"{text!r:.80} stands where a number should")
    return value
