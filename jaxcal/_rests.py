"""Still intervals of a recording: one detector for all estimators that need rests (host, NumPy)."""

import itertools
from typing import Any

import equinox as eqx
import numpy as np

from ._arrays import runs, windowed_variance
from ._errors import DataError

#: multiples of the variance at rest; the turns of a calibration show whether a rest with some drift of the hand improves it
MULTIPLES = (2.0, 3.0, 4.0, 6.0, 10.0, 20.0, 40.0, 100.0)
#: the same for the gyroscope, which sees a hand rotate to and fro far above its noise although the mean vertical hardly moves
GYRO_MULTIPLES = (100.0, 300.0, 1000.0, np.inf)
#: s, length of a window and of the shortest rest; share of the windows that are at rest in any recording with rests
_WINDOW, _QUANTILE = 1.0, 0.05

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
    """Windowed variances of a recording, and their values at rest.

    Parameters
    ----------
    accel, gyro : (n, 3) readings in any unit, NaN where missing; gyro may be None.
    rate : Hz.

    Raises
    ------
    DataError
        If the record is shorter than two windows, or a sensor never changes.
    """

    def __init__(self, accel: np.ndarray, gyro: np.ndarray | None, rate: float):
        self.half = max(round(_WINDOW * rate / 2), 1)
        self.least = max(round(_WINDOW * rate), 2)
        size = 2 * self.half + 1
        if len(accel) < 2 * size:
            raise DataError(f"{len(accel)} samples are less than two windows of {size}; record longer", code="too_short")
        sensors = {"accelerometer": accel} | ({} if gyro is None else {"gyroscope": gyro})
        #: of each sensor, relative to its value at rest
        self.relative = [_relative(x, size, name) for name, x in sensors.items()]

    def ends(self, multiples: Multiples) -> Ends:
        """Start and stop of the intervals in which the variances stay below these multiples of those at rest, half a window inside."""
        still = np.all([variance < most for variance, most in zip(self.relative, multiples, strict=False)], axis=0)
        start, stop = (edges + self.half for edges in runs(still))
        kept = stop - start >= self.least
        return start[kept], stop[kept]

    def tried(self) -> dict[Multiples, Ends]:
        """Still intervals of every pair of multiples; of pairs with the same intervals, the one with the loosest bound on the gyroscope."""
        bounds = GYRO_MULTIPLES if len(self.relative) > 1 else (np.inf,)
        found: dict[Any, tuple[Multiples, Ends]] = {}
        for pair in itertools.product(MULTIPLES, reversed(bounds)):
            ends = self.ends(pair)
            found.setdefault((ends[0].tobytes(), ends[1].tobytes()), (pair, ends))
        return dict(found.values())


def _relative(x: np.ndarray, size: int, name: str) -> np.ndarray:
    """Windowed variance, divided by its value at rest: that of the stillest windows, at least that of rounding."""
    variance = windowed_variance(x, size)
    steps = np.abs(np.diff(x[np.isfinite(x).all(axis=1)], axis=0))
    if not np.any(steps > 0):
        raise DataError(
            f"the {name} is constant in every window that has samples: it repeats one reading. Log it at full resolution.", code="constant"
        )
    # coarse readings of a still sensor are constant, or jump between two neighbouring values
    step = np.array([np.min(column[column > 0], initial=np.inf) for column in steps.T])
    rounding = float(np.linalg.norm(np.where(np.isfinite(step), step, 0.0) ** 2 / 12))
    return variance / max(float(np.quantile(variance[np.isfinite(variance)], _QUANTILE)), rounding)


def still_intervals(
    readings: np.ndarray, rate: float, gyro: np.ndarray | None = None, multiples: tuple[float, ...] = tuple(map(float, range(2, 11)))
) -> StillIntervals:
    """Still intervals by the multiple in the middle of the longest range over which their number stays the same.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal._rests import still_intervals
    >>> y = np.random.default_rng(0).normal(size=(8000, 3)) * 0.01
    >>> y[5000:6000] += 5 * np.sin(np.arange(1000) / 20)[:, None]
    >>> still_intervals(y, 100.0).ends.tolist()
    [[50, 4951], [6050, 7950]]
    """
    variances, bound = Variances(readings, gyro, rate), GYRO_MULTIPLES[1]
    counts = {multiple: len(variances.ends((multiple, bound))[0]) for multiple in multiples}
    stretches = [list(part) for count, part in itertools.groupby(counts, key=counts.get) if count] or [list(counts)]
    longest = max(stretches, key=len)
    multiple = longest[len(longest) // 2]
    return StillIntervals(*variances.ends((multiple, bound)), float(multiple), bound)
