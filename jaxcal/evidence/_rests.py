"""Rests of a recording, of a sensor in a hand, on a block or on a turntable: one detector for all estimators that need them (NumPy).

A sensor is at rest where the variance of its readings over a second stays below a multiple of that of the stillest seconds, at least that
of rounding, and where the table's angle stays.
"""

import itertools
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import numpy as np

from .._arrays import runs, windowed_variance
from .._errors import DataError

#: multiples of the variance at rest; the turns of a calibration show whether a rest with some drift of the hand improves it
MULTIPLES = (2.0, 3.0, 4.0, 6.0, 10.0, 20.0, 40.0, 100.0)
#: the same for the gyroscope, which sees a hand rotate to and fro far above its noise although the mean vertical hardly moves
GYRO_MULTIPLES = (100.0, 300.0, 1000.0, np.inf)
#: s, length of a window and of the shortest rest; samples in it at least; share of the windows that are at rest in any recording with rests
_WINDOW, _SAMPLES, _QUANTILE = 1.0, 20, 0.05
#: s: lag at which a hand's tremor has changed and slower motion has not; how much more than such changes explain a sensor varies that never
#: rests: 0.8 to 1.8 times in the stillest windows of an accelerometer of 26 public logs, 4 to 9 times where it moved all the time (8 logs)
_LAG, _SLOW = 0.05, 2.0
#: rad by which a table at rest turns over a window at most: a smooth rotation does not show in the variance
_STEADY = np.deg2rad(0.03)

#: start and stop of still intervals, (k,) samples each: start <= i < stop
Ends = tuple[np.ndarray, np.ndarray]
#: multiples of the variances of accelerometer and gyroscope
Multiples = tuple[float, float]


class StillIntervals(eqx.Module):
    """Still intervals of a recording.

    Attributes
    ----------
    start, stop : (k,) samples of each interval: start <= i < stop.
    multiple, gyro_multiple : bounds on the windowed variances of accelerometer and gyroscope, relative to those at rest; infinite if the
        intervals were given, or if the gyroscope made no difference.
    """

    start: np.ndarray
    stop: np.ndarray
    multiple: float = np.inf
    gyro_multiple: float = np.inf

    def __len__(self) -> int:
        return len(self.start)

    @property
    def ends(self) -> np.ndarray:
        """(k, 2) start and stop."""
        return np.stack([self.start, self.stop], axis=1)


class Variances:
    """Windowed variances of a recording, relative to those at rest.

    Parameters
    ----------
    sensors : "accel", "gyro" -> readings (n, axes) in any unit, NaN where missing.
    rate : Hz.
    table : whether the sensors lie on a table, so that a gyroscope in rad/s with three axes shows no rotation at rest.
    angle : (n,) angle of the table, rad; None without one.
    levels : the variance of each sensor at rest, the norm over its axes, if it is known; else that of the stillest windows.

    Raises
    ------
    DataError
        If the record is shorter than two windows, or no sensor ever changes.
    """

    def __init__(
        self, sensors: Mapping[str, np.ndarray], rate: float, table: bool = False, angle: np.ndarray | None = None, levels: Any = None
    ):
        # a table stops at once, and half of a window is lost at each end of its rests
        self.half = max(round(_WINDOW * rate / (8 if table else 2)), _SAMPLES // 2)
        self.least = max(round(_WINDOW * rate), 2)
        size, count = 2 * self.half + 1, len(next(iter(sensors.values())))
        if count < 2 * size:
            raise DataError(f"{count} samples are less than two windows of {size}; record longer", code="too_short")
        steps = {name: _step(x) for name, x in sensors.items()}
        if not any(np.isfinite(step).any() for step in steps.values()):
            said = f"{' and '.join(sensors)} are constant in every window that has samples: one reading repeats. Log at full resolution."
            raise DataError(said, code="constant")
        found = [_relative(x, size, steps[name], round(_LAG * rate), (levels or {}).get(name)) for name, x in sensors.items()]
        self.relative = [relative for relative, _ in found]
        self.rests = bool(levels) or any(rests for _, rests in found)
        self.unmoved = np.ones(count - size + 1, bool) if angle is None else _unmoved(angle[:, None], size, 0.0)
        if table and (gyro := sensors.get("gyro")) is not None and gyro.shape[1] == 3:
            turned = np.cumsum(np.nan_to_num(gyro - np.nanmedian(gyro, axis=0)), axis=0) / rate
            # the rate is known to half a step of its readings
            self.unmoved &= _unmoved(turned, size, 0.5 * steps["gyro"] * size / rate)

    def still(self, multiples: Multiples) -> np.ndarray:
        """(n,) whether the variances around a sample stay below these multiples of those at rest; nowhere if the sensors never rest."""
        below = [variance < most for variance, most in zip(self.relative, multiples, strict=False)]
        return np.pad(np.all([*below, self.unmoved], axis=0) & self.rests, self.half)

    def ends(self, multiples: Multiples, least: int = 0) -> Ends:
        """Start and stop of the intervals in which it is still, for a second at least."""
        start, stop = runs(self.still(multiples))
        kept = stop - start >= max(self.least, least)
        return start[kept], stop[kept]

    def tried(self) -> dict[Multiples, Ends]:
        """Still intervals of every pair of multiples; of pairs with the same intervals, the one with the loosest bound on the gyroscope."""
        bounds = GYRO_MULTIPLES if len(self.relative) > 1 else (np.inf,)
        found: dict[Any, tuple[Multiples, Ends]] = {}
        for pair in itertools.product(MULTIPLES, reversed(bounds)):
            ends = self.ends(pair)
            found.setdefault((ends[0].tobytes(), ends[1].tobytes()), (pair, ends))
        return dict(found.values())


def _step(x: np.ndarray) -> np.ndarray:
    """(axes,) smallest change of the readings; infinite for an axis that never changes."""
    steps = np.abs(np.diff(x[np.isfinite(x).all(axis=1)], axis=0))
    return np.min(steps, axis=0, initial=np.inf, where=steps > 0)


def _relative(x: np.ndarray, size: int, step: np.ndarray, lag: int, level: float | None) -> tuple[np.ndarray, bool]:
    """Windowed variance, divided by its value at rest: that of the stillest windows, at least that of rounding; and whether these rest."""
    variance = windowed_variance(x, size)
    if level is not None:
        return variance / level, True
    level = float(np.quantile(variance[np.isfinite(variance)], _QUANTILE))
    quiet = np.flatnonzero(variance <= 1.5 * level)
    middle = quiet + size // 2
    squares = (x[middle] - x[middle - max(lag, 1)]) ** 2
    change = np.nansum(squares, axis=0) / np.maximum(np.isfinite(squares).sum(axis=0), 1) / 2
    rests = not np.mean(variance[quiet]) > _SLOW * np.linalg.norm(change)
    # coarse readings of a still sensor are constant, or jump between two neighbouring values
    return variance / (max(level, float(np.linalg.norm(np.where(np.isfinite(step), step, 0.0) ** 2 / 12))) or 1.0), rests


def _unmoved(angle: np.ndarray, size: int, known: Any) -> np.ndarray:
    """Windows over which no angle (n, axes), whose change is `known` so well, changes by more than its noise."""
    change = np.abs(angle[size - 1 :] - angle[: 1 - size])
    noise = np.quantile(change, 0.3, axis=0) / 0.385  # the quantile of a normal distribution
    return np.all(change < np.maximum(6 * noise, _STEADY) + known, axis=1)


def still_intervals(
    sensors: Mapping[str, np.ndarray], rate: float, table: bool = False, angle: np.ndarray | None = None, least: float = 0.0
) -> StillIntervals:
    """Still intervals by the multiple in the middle of the longest range over which their number stays the same.

    Parameters
    ----------
    sensors, rate, table, angle : as for `Variances`. On a table the same multiple counts for both sensors.
    least : shortest rest, s.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.evidence._rests import still_intervals
    >>> y = np.random.default_rng(0).normal(size=(8000, 3)) * 0.01
    >>> y[5000:6000] += 5 * np.sin(np.arange(1000) / 20)[:, None]
    >>> still_intervals({"accel": y}, 100.0).ends.tolist()
    [[50, 4951], [6050, 7950]]
    """
    variances = Variances(sensors, rate, table, angle)
    pairs = [(float(multiple), float(multiple) if table else GYRO_MULTIPLES[1]) for multiple in range(2, 11)]
    found = {pair: variances.ends(pair, round(least * rate)) for pair in pairs}
    stretches = [list(part) for count, part in itertools.groupby(pairs, key=lambda pair: len(found[pair][0])) if count] or [pairs]
    longest = max(stretches, key=len)
    pair = longest[len(longest) // 2]
    return StillIntervals(*found[pair], *pair)
