"""Check, before any statistics, that readings can come from a turntable at rest on the Earth."""

from collections.abc import Callable
from typing import Any

import numpy as np

from .._errors import DataError
from .._precision import is_traced
from .._units import ON_EARTH, STANDARD_GRAVITY, si_unit, units_of
from ._positions import EARTH_RATE, Readings

_OFF = 0.2  # share of gravity that bias and scale errors of an accelerometer at rest can explain; a MEMS part has up to 0.15
#: largest half difference between positions in multiples of the Earth's rate, without noise, and the standard deviations allowed for noise
_TIMES, _NOISE = 20.0, 6.0
_GRAVITY = "gravity is {} to {} m/s^2".format(*ON_EARTH["gravity"])


def check_readings(readings: Readings) -> None:
    """Refuse readings in a wrong unit, and name the likely unit (host only)."""
    if is_traced(readings):
        return
    resting = np.asarray(readings.positions.rate) == 0
    if readings.accel is not None:
        # a sensor in the plane of the table measures a small part of gravity, a remounted one all of it
        largest = float(np.nanmax(np.abs(np.asarray(readings.accel)[resting]), initial=0.0)) / STANDARD_GRAVITY
        said = f"The accelerometer reads up to {largest * STANDARD_GRAVITY:.4g} m/s^2 at rest, but {_GRAVITY}."
        _refuse(largest > 1 + _OFF, said, "accel", lambda factor: largest * factor < 1 + _OFF)
    if readings.gyro is None:
        return
    here = resting & np.isfinite(np.asarray(readings.gyro))
    values, channel, variance = np.asarray(readings.gyro)[here], readings.positions.channel[here], readings.variance("gyro")
    half = max((float(np.ptp(values[channel == i])) / 2 for i in np.unique(channel)), default=0.0) / EARTH_RATE
    noise = 0.0 if variance is None else _NOISE * float(np.sqrt(np.max(np.asarray(variance)[here], initial=0.0))) / EARTH_RATE
    said = f"The gyro's readings differ by {2 * half:.3g} times the Earth's rate, 15.04 deg/h; at rest they may differ by twice that."
    _refuse(half > _TIMES + noise, said, "gyro", lambda factor: 0.1 < half * factor < 1.5)


def check_norm(force: np.ndarray) -> None:
    """Refuse specific force (k, 3) at rest whose magnitude is not gravity."""
    size = float(np.median(np.linalg.norm(force, axis=1))) / STANDARD_GRAVITY
    said = f"The specific force at rest is {size * STANDARD_GRAVITY:.4g} m/s^2, but {_GRAVITY}."
    _refuse(abs(size - 1) > _OFF, said, "accel", lambda factor: abs(size * factor - 1) < _OFF)


def _refuse(wrong: Any, said: str, sensor: str, fits: Callable[[float], bool]) -> None:
    """Raise an error that names the units which would make the numbers plausible, and what to type."""
    if not wrong:
        return
    found = [unit for unit, factor in units_of(sensor).items() if factor != 1 and fits(factor)]
    cure = f"No usual unit explains that; give the readings in {si_unit(sensor)}."
    if found:
        cure = f"They look like {' or '.join(found)}: name the column {sensor} [{found[0]}], or give --units {sensor}={found[0]} for a log."
    raise DataError(f"{said} {cure}", code="implausible")
