"""Check, before any statistics, that readings can come from a turntable at rest on the Earth."""

from collections.abc import Callable
from typing import Any

import numpy as np

from .._errors import DataError
from .._precision import is_traced
from .._units import ON_EARTH, si_unit, units_of
from ._positions import EARTH_RATE, Readings

_LARGEST = 12.0  # m/s^2: largest reading of an accelerometer at rest that bias and scale errors can explain
_BIAS = np.deg2rad(20.0)  # rad/s: largest bias of a gyro
#: largest half difference between positions in multiples of the Earth's rate, without noise, and the standard deviations allowed for noise
_TIMES, _NOISE = 20.0, 6.0
_NORMS = (9.2, 10.4)  # m/s^2: magnitude of the specific force at rest, for an uncalibrated accelerometer
_GRAVITY = "gravity is {} to {} m/s^2".format(*ON_EARTH["gravity"])
_EARTH = "the Earth turns with 15.04 deg/h (7.29e-5 rad/s)"


def check_readings(readings: Readings) -> None:
    """Refuse readings in a wrong unit, and name the likely unit (host only)."""
    if is_traced(readings):
        return
    resting = np.asarray(readings.positions.rate) == 0
    if readings.accel is not None:
        accel = np.asarray(readings.accel)
        largest = float(np.nanmax(np.abs(accel), initial=0.0))
        moving = float(np.max(np.abs(np.asarray(readings.lever_arm) * np.asarray(readings.positions.rate) ** 2), initial=0.0))
        # a sensor in the plane of the table measures a small part of gravity, a remounted one all of it
        said = f"The accelerometer reads up to {largest:.4g} m/s^2 at rest, but {_GRAVITY}."
        _refuse(largest > _LARGEST + moving, said, "accel", lambda factor: 1e-4 < largest * factor < _LARGEST)
    if readings.gyro is None:
        return
    here = resting & np.isfinite(np.asarray(readings.gyro))
    values, channel, variance = np.asarray(readings.gyro)[here], readings.positions.channel[here], readings.variance("gyro")
    half = max((float(np.ptp(values[channel == i])) / 2 for i in np.unique(channel)), default=0.0) / EARTH_RATE
    noise = 0.0 if variance is None else _NOISE * float(np.sqrt(np.max(np.asarray(variance)[here], initial=0.0))) / EARTH_RATE
    said = f"The gyro's readings differ by {2 * half:.3g} times the Earth's rate, but {_EARTH}: at rest they may differ by twice that."
    _refuse(half > _TIMES + noise, said, "gyro", lambda factor: 0.1 < half * factor < 1.5)
    largest = float(np.max(np.abs(values), initial=0.0))
    said = f"The gyro reads {largest:.3g} rad/s at rest, more than any bias, and {_EARTH}."
    _refuse(largest > _BIAS, said, "gyro", lambda factor: 0.02 < largest * factor / EARTH_RATE < 100.0)


def check_norm(force: np.ndarray) -> None:
    """Refuse specific force (k, 3) at rest whose magnitude is not gravity."""
    size = float(np.median(np.linalg.norm(force, axis=1)))
    said = f"The specific force at rest is {size:.4g} m/s^2, but {_GRAVITY}."
    _refuse(not _NORMS[0] < size < _NORMS[1], said, "accel", lambda factor: _NORMS[0] < size * factor < _NORMS[1])


def _refuse(wrong: Any, said: str, sensor: str, fits: Callable[[float], bool]) -> None:
    """Raise an error that names the units which would make the numbers plausible, and what to type."""
    if not wrong:
        return
    found = [unit for unit, factor in units_of(sensor).items() if factor != 1 and fits(factor)]
    cure = f"No usual unit explains that; give the readings in {si_unit(sensor)}."
    if found:
        cure = (
            f"The numbers look like {' or '.join(found)}: write the unit behind the name of the column, as in {sensor} [{found[0]}], or "
            f"give --units {sensor}={found[0]} for a log."
        )
    raise DataError(f"{said} {cure}", code="implausible")
