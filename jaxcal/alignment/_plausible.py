"""Check, before any statistics, that readings can come from a turntable at rest on the Earth."""

from typing import Any

import numpy as np

from .._errors import DataError
from .._precision import is_traced
from .._units import ON_EARTH, si_unit, units_of
from ._positions import EARTH_RATE, Readings

#: gravity at the surface of the Earth, m/s^2
GRAVITIES = ON_EARTH["gravity"]
#: largest reading of an accelerometer at rest that bias and scale errors can explain, m/s^2
_LARGEST = 12.0
#: largest bias of a gyro, rad/s; largest half difference between positions in multiples of the Earth's rate, without noise
_BIAS = np.deg2rad(20.0)
_TIMES = 20.0
_NOISE = 6.0
#: limits of the magnitude of specific force at rest for an uncalibrated accelerometer, m/s^2
_NORMS = (9.2, 10.4)


def check_readings(readings: Readings) -> None:
    """Refuse readings in a wrong unit, and name the likely unit (host only)."""
    if is_traced(readings):
        return
    resting = np.asarray(readings.positions.rate) == 0
    if readings.accel is not None:
        _check_force(readings, np.asarray(readings.accel))
    if readings.gyro is not None and resting.any():
        _check_rate(readings, np.asarray(readings.gyro)[resting], resting)


def check_norm(force: np.ndarray) -> None:
    """Refuse specific force (k, 3) at rest whose magnitude is not gravity."""
    size = float(np.median(np.linalg.norm(force, axis=1)))
    if not _NORMS[0] < size < _NORMS[1]:
        raise DataError(
            f"The specific force at rest is {size:.4g} m/s^2, but gravity is {GRAVITIES[0]} to {GRAVITIES[1]} m/s^2. "
            f"{_likely('accel', lambda factor: _NORMS[0] < size * factor < _NORMS[1])}"
        )


def _check_force(readings: Readings, accel: np.ndarray) -> None:
    here = np.isfinite(accel)
    largest = float(np.max(np.abs(accel[here]), initial=0.0))
    moving = float(np.max(np.abs(np.asarray(readings.lever_arm) * np.asarray(readings.positions.rate) ** 2), initial=0.0))
    if largest > _LARGEST + moving:
        # a sensor in the plane of the table measures a small part of gravity, a remounted one all of it
        likely = _likely("accel", lambda factor: 1e-4 < largest * factor < _LARGEST)
        raise DataError(
            f"The accelerometer reads up to {largest:.4g} m/s^2 at rest, but gravity is {GRAVITIES[0]} to {GRAVITIES[1]} m/s^2. {likely}"
        )


def _check_rate(readings: Readings, gyro: np.ndarray, resting: np.ndarray) -> None:
    here = np.isfinite(gyro)
    if not here.any():
        return
    channel = readings.positions.channel[resting][here]
    values = gyro[here]
    half = max(float(np.ptp(values[channel == i])) / 2 for i in np.unique(channel))
    variance = readings.variance("gyro")
    noise = 0.0 if variance is None else _NOISE * float(np.sqrt(np.max(np.asarray(variance)[resting][here])))
    largest = float(np.max(np.abs(values)))
    earth = "the Earth turns with 15.04 deg/h (7.29e-5 rad/s)"
    if half > _TIMES * EARTH_RATE + noise:
        likely = _likely("gyro", lambda factor: 0.1 < half * factor / EARTH_RATE < 1.5)
        raise DataError(
            f"The gyro's readings differ by {2 * half:.3g} rad/s between positions, {2 * half / EARTH_RATE:.3g} times the Earth's rate, "
            f"but {earth} and they may differ by twice that. {likely} If the unit is right, the bias wanders too much to find north."
        )
    if largest > _BIAS:
        likely = _likely("gyro", lambda factor: 0.02 < largest * factor / EARTH_RATE < 100.0)
        raise DataError(f"The gyro reads {largest:.3g} rad/s at rest, more than any bias, and {earth}. {likely}")


def _likely(sensor: str, fits: Any) -> str:
    """Sentence that names the units that would make the numbers plausible, and tells the user what to do."""
    found = [unit for unit, factor in units_of(sensor).items() if factor != 1 and fits(factor)]
    if not found:
        return f"No usual unit explains that; give the readings in {si_unit(sensor)}."
    name = "gyro" if sensor == "gyro" else "accel"
    return (
        f"The numbers look like {' or '.join(found)}: write the unit behind the name of the column, as in {name} [{found[0]}], or give "
        f"--units {sensor}={found[0]} for a log."
    )
