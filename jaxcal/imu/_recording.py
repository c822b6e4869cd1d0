"""A log as the calibration takes it: arrays, stamps, saturation, units (host, NumPy)."""

from typing import Any

import equinox as eqx
import numpy as np

from .._errors import DataError
from ._static import StillIntervals

_RUN = 3  # samples in a row at the end of the range
_MOVED = 20.0  # variance of the initial rest over that of the stillest windows
_UNITS = {"g": 9.80665, "mg": 9.80665e-3, "ft/s^2": 0.3048}


class Recording(eqx.Module):
    """time (n,) s; accel, gyro (n, 3) readings, gyro None without one; temperature: mean in degC or NaN."""

    time: np.ndarray
    accel: np.ndarray
    gyro: np.ndarray | None
    rate: float
    temperature: float


def recording(log: Any, time: Any) -> Recording:
    """Arrays of a log, with stamps of the user's own where the log's even grid is not what they want."""
    accel = getattr(log, "accel", None)
    if accel is None:
        raise DataError("The log has no accelerometer, on which this calibration rests.")
    accel = np.ascontiguousarray(np.asarray(accel, dtype=float))
    gyro = None if log.gyro is None else np.ascontiguousarray(np.asarray(log.gyro, dtype=float))
    for name, values in (("accelerometer", accel), ("gyroscope", gyro)):
        if values is not None and (values.ndim != 2 or values.shape[1] != 3):
            raise DataError(f"The {name} has {1 if values.ndim == 1 else values.shape[1]} axes; this calibration needs all three.")
    stamps = np.asarray(log.time if time is None else time, dtype=float)
    if stamps.shape != (len(accel),):
        raise DataError(f"time has shape {stamps.shape}; the log has {len(accel)} samples")
    steps = np.diff(stamps)
    if not np.all(steps > 0):
        bad = int(np.flatnonzero(~(steps > 0))[0])
        raise DataError(
            f"time does not grow at sample {bad + 1}: {stamps[bad]:.6f} s is followed by {stamps[bad + 1]:.6f} s; sort the samples"
        )
    temperature = float("nan") if log.temperature is None else float(np.nanmean(log.temperature))
    return Recording(stamps - stamps[0], accel, gyro, float(log.rate), temperature)


def pinned(x: np.ndarray) -> np.ndarray:
    """(n,) whether a channel stays at the end of its range for three samples or more."""
    found = np.zeros(len(x), dtype=bool)
    for column in x.T:
        for limit in (np.nanmin(column), np.nanmax(column)):
            at = column == limit
            if np.mean(at) > 0.5:  # a channel that hardly changes is coarse, not saturated
                continue
            run = at[2:] & at[1:-1] & at[:-2]
            for shift in range(_RUN):
                found[shift : len(found) - 2 + shift] |= run
    return found


def stuck(x: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """(k,) whether an axis does not move during a still interval and is at the end of its range: it is clipped, not still."""
    low, high = np.nanmin(x, axis=0), np.nanmax(x, axis=0)
    return np.array([np.any(np.all((x[i:j] == low) | (x[i:j] == high), axis=0)) for i, j in zip(start, stop, strict=True)], dtype=bool)


def wrong_units(accel: np.ndarray, gravity: float) -> str | None:
    """Why the readings cannot be in m/s^2."""
    size = float(np.nanmedian(np.linalg.norm(accel, axis=1)))
    if 0.5 * gravity <= size <= 2 * gravity:
        return None
    text = f"The accelerometer reads {size:.3g} at rest, where {gravity:.4g} m/s^2 is expected"
    for unit, factor in _UNITS.items():
        if 0.8 < size * factor / gravity < 1.25:
            return f"{text}: the readings look like {unit}. Read the log with units accel={unit}."
    return f"{text}. Give the unit of the log (units accel=...), or raw=True for counts."


def not_still(still: StillIntervals, variance: np.ndarray) -> str | None:
    """Why the beginning is no rest."""
    quiet = float(np.quantile(variance[np.isfinite(variance)], 0.05))
    ratio = still.initial_variance / quiet if quiet > 0 else np.inf
    if ratio <= _MOVED:
        return None
    return (
        f"The initial period is not still: its variance is {ratio:.3g} times that of the stillest windows. Leave the sensor alone at the "
        "beginning, or say how long the rest lasts with initial= (None where there is none)."
    )
