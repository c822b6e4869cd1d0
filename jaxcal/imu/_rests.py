"""Detect the still intervals of a recording from accelerometer and gyroscope together (host, NumPy)."""

import itertools
from typing import Any

import equinox as eqx
import numpy as np

from .._answer import Finding, Message
from .._arrays import runs
from .._errors import DataError
from .._precision import host_float64
from ._findings import FINDINGS

MULTIPLES = tuple(range(2, 11))
#: for the joint fit, whose turns show whether a rest with some drift of the hand improves the result
_WIDER = (2, 3, 4, 6, 10, 20, 40, 100)
#: multiples of the gyroscope's variance. A hand rotates a sensor to and fro by much more than its noise, but hardly moves the mean
#: vertical; `multi_position` finds out which of these bounds gives the best rests.
GYRO_MULTIPLES = (100.0, 300.0, 1000.0, np.inf)
_BLOCK = 4  # windows in a block of the running sums
_QUANTILE = 0.05  # of the windows are at rest even in a log without a rest at its beginning
_MOVED = 20.0  # largest ratio of the variance of the initial rest to that of the stillest windows

#: start and stop of still intervals, (k,) samples each: start <= i < stop
Ends = tuple[np.ndarray, np.ndarray]
#: multiples of the variances of accelerometer and gyroscope
Multiples = tuple[float, float]


class StillIntervals(eqx.Module):
    """Still intervals of a recording.

    Attributes
    ----------
    start, stop : (k,) samples of each interval: start <= i < stop.
    threshold : bound on the norm of the three windowed variances of the accelerometer, in the squared unit of the readings.
    multiple : `threshold` divided by `initial_variance`.
    initial_variance : norm of the variances at rest: of the initial rest if its length was given, else of the stillest windows.
    gyro_multiple : the same ratio for the gyroscope; infinite if the gyroscope was not used or made no difference.
    counts : multiple -> number of intervals, for the multiples that were compared, at this `gyro_multiple`.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu._rests import static_intervals
    >>> y = np.random.default_rng(0).normal(size=(8000, 3)) * 0.01
    >>> y[5000:6000] += 5 * np.sin(np.arange(1000) / 20)[:, None]
    >>> found = static_intervals(y, 100.0)
    >>> len(found), [int(n) for n in found.stop - found.start]
    (2, [4901, 1900])
    """

    start: np.ndarray
    stop: np.ndarray
    threshold: float
    multiple: float
    initial_variance: float
    gyro_multiple: float
    counts: dict[float, int] = eqx.field(static=True)

    def __len__(self) -> int:
        return len(self.start)


def windowed_variance(x: np.ndarray, window: int) -> np.ndarray:
    """Norm of the three unbiased variances over a moving window of `window` samples: (n - window + 1,).

    Missing samples (NaN rows) are ignored; a window has an infinite variance if half of its samples or more are missing. The function
    uses running sums over blocks of a few windows, each minus its own mean, so that large counts with a small variance keep their digits.
    """
    count = len(x) - window + 1
    size = _BLOCK * window
    present = np.all(np.isfinite(x), axis=1)
    # fill gaps and padding with values near the readings; distant values would cost digits
    filled = x if present.all() else np.where(present[:, None], x, np.nanmean(x, axis=0))
    filled = np.concatenate([filled, np.repeat(filled[-1:], -count % size, axis=0)])
    there = np.concatenate([present, np.ones(len(filled) - len(x), dtype=bool)])
    blocks, kept = (
        np.lib.stride_tricks.sliding_window_view(part, size + window - 1, axis=0)[::size] for part in (filled, there[:, None].astype(float))
    )
    blocks = (blocks - blocks.mean(axis=2, keepdims=True)) * kept
    sums = np.cumsum(np.pad([blocks, blocks**2], ((0, 0), (0, 0), (0, 0), (1, 0))), axis=-1)
    first, second = sums[..., window:] - sums[..., :-window]
    number = np.cumsum(np.pad(kept, ((0, 0), (0, 0), (1, 0))), axis=-1)
    number = number[..., window:] - number[..., :-window]
    variance = (second - first**2 / np.maximum(number, 1)) / np.maximum(number - 1, 1)
    variance = np.linalg.norm(variance, axis=1).reshape(-1)[:count]
    return np.where(number.reshape(-1)[:count] * 2 > window, variance, np.inf)


def _runs(still: np.ndarray, half: int, least: int) -> Ends:
    """Start and stop of the runs of still windows with at least `least` samples."""
    start, stop = (edges + half for edges in runs(still))
    kept = stop - start >= least
    return start[kept], stop[kept]


def _plateau(counts: dict[float, int]) -> float:
    """Multiple in the middle of the longest range over which the number of intervals does not change."""
    stretches = [list(part) for count, part in itertools.groupby(counts, key=counts.get) if count] or [list(counts)]
    longest = max(stretches, key=len)
    return longest[len(longest) // 2]


@host_float64
def static_intervals(
    accel: Any,
    rate: float | int,
    *,
    gyro: Any = None,
    threshold: float | int | None = None,
    gyro_threshold: float | int = 300.0,
    window: float | int = 1.0,
    initial: float | int | None = None,
    least: float | int = 1.0,
    multiples: tuple[float | int, ...] = MULTIPLES,
) -> StillIntervals:
    r"""Find still intervals, in which the windowed variances of accelerometer and gyroscope stay near their values at rest.

    .. math:: v_i = \|(\mathrm{var}\,x, \mathrm{var}\,y, \mathrm{var}\,z)\| < k\,v_\mathrm{rest}

    The unbiased variances are those of a window centred at sample i. An interval begins and ends half a window away from the motion.

    Parameters
    ----------
    accel : (n, 3) readings in any unit; NaN marks a missing sample. A window needs more than half of its samples.
    rate : sample rate, Hz.
    gyro : (n, 3) readings of the gyroscope; None uses the accelerometer alone.
    threshold : multiple k of the accelerometer's variance at rest. None tries all `multiples` and uses the middle of the longest range
        over which the number of intervals stays the same. (`multi_position` instead compares the resulting calibrations.)
    gyro_threshold : multiple of the gyroscope's variance at rest.
    window : length of the window, s; rounded to an odd number of samples.
    initial : length of a rest at the beginning, s, whose variance is the reference; None uses the 5 % quantile of v.
    least : shortest interval, s.
    multiples : values of k to try.

    Returns
    -------
    StillIntervals

    Raises
    ------
    DataError
        If the readings are not (n, 3), the record is shorter than two windows or than the initial rest, the readings are constant at
        rest, or an option is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu._rests import static_intervals
    >>> y = np.random.default_rng(0).normal(size=(8000, 3)) * 0.01
    >>> y[5000:6000] += 5 * np.sin(np.arange(1000) / 20)[:, None]
    >>> found = static_intervals(y, 100.0)
    >>> print(found.start, found.stop)
    [  50 6050] [4951 7950]

    References
    ----------
    D. Tedaldi, A. Pretto and E. Menegatti, ICRA 2014, section IV-A.
    """
    windows = Windows(accel, gyro, rate, window, initial, least)
    return windows.intervals(_positive("gyro_threshold", gyro_threshold), multiples, threshold)


def given_rests(rests: Any, samples: int) -> Ends:
    """Check the rests given by the caller, and sort them."""
    ends = np.asarray(rests)
    if ends.ndim != 2 or ends.shape[1] != 2:
        raise DataError(
            f"rests has shape {ends.shape}; expected (k, 2): the first sample of each rest, and the one after its last", code="rests"
        )
    ends = ends[np.argsort(ends[:, 0])].astype(int)
    bad = (ends[:, 1] - ends[:, 0] < 10) | (ends[:, 0] < 0) | (ends[:, 1] > samples)
    bad[1:] |= ends[1:, 0] < ends[:-1, 1] + 2
    if bad.any():
        first, last = ends[np.argmax(bad)]
        raise DataError(
            f"the rest from sample {first} to {last} is outside of the log, shorter than 10 samples, or meets another", code="rests"
        )
    return ends[:, 0], ends[:, 1]


def _positive(name: str, value: Any) -> float:
    if not (value > 0 and not np.isnan(value)):
        raise DataError(f"{name}={value!r} must be positive", code="not_positive")
    return float(value)


def _triads(name: str, readings: Any) -> np.ndarray:
    x = np.asarray(readings, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] != 3:
        raise DataError(f"{name} has shape {x.shape}; expected (n, 3)", code="axes")
    return x


class Windows:
    """Windowed variances of a recording, and their reference values at rest."""

    def __init__(self, accel: Any, gyro: Any, rate: Any, window: Any, initial: Any, least: Any):
        x, y = _triads("accel", accel), None if gyro is None else _triads("gyro", gyro)
        for name, value in (("rate", rate), ("window", window), ("least", least), ("initial", initial)):
            if value is not None and not (np.isfinite(value) and value > 0):
                raise DataError(f"{name}={value!r} must be positive", code="not_positive")
        self.half = max(round(float(window) * float(rate) / 2), 1)
        size = 2 * self.half + 1
        if len(x) < 2 * size:
            raise DataError(f"{len(x)} samples are less than two windows of {size}; record longer", code="too_short")
        if y is not None and len(y) != len(x):
            raise DataError(f"gyro has {len(y)} samples, accel {len(x)}; give one for each", code="lengths")
        if initial is not None and round(float(initial) * float(rate)) >= len(x):
            said = Message("the record lasts {duration:.3g} s; give a shorter rest with {option.initial}", duration=len(x) / rate)
            raise DataError(said, code="initial_too_long")
        self.shortest, self.initial, self.rate = max(round(float(least) * float(rate)), 2), initial, float(rate)
        self.variance, self.reference = self._referred(x, size, "accelerometer")
        self.gyro_variance, self.gyro_reference = (None, np.nan) if y is None else self._referred(y, size, "gyroscope")

    def _referred(self, x: np.ndarray, size: int, name: str) -> tuple[np.ndarray, float]:
        """Windowed variance and its value at rest: in the initial rest if given, else in the stillest windows that are not constant."""
        variance = windowed_variance(x, size)
        changing = variance[np.isfinite(variance) & (variance > 0)]
        if self.initial is not None:
            last = round(float(self.initial) * self.rate)
            reference = float(np.linalg.norm(np.nanvar(x[: last + 1], axis=0, ddof=1)))
        else:
            reference = float(np.quantile(changing, _QUANTILE)) if len(changing) else 0.0
        if not reference > 0:
            where = "during the initial rest" if self.initial is not None else "in every window that has samples"
            raise DataError(
                f"the {name} is constant {where}: its noise is below its resolution, or it repeats one sample. Log it at full resolution.",
                code="constant",
            )
        return variance, reference

    def ends(self, multiples: Multiples) -> Ends:
        """Start and stop of the still intervals."""
        still = self.variance < multiples[0] * self.reference
        if self.gyro_variance is not None:
            still &= self.gyro_variance < multiples[1] * self.gyro_reference
        return _runs(still, self.half, self.shortest)

    def intervals(self, gyro_multiple: float, multiples: tuple[float | int, ...] = MULTIPLES, chosen: Any = None) -> StillIntervals:
        """The still intervals for one gyroscope multiple, at the `chosen` accelerometer multiple or that of the plateau."""
        counts = {float(k): len(self.ends((float(k), gyro_multiple))[0]) for k in multiples}
        multiple = _plateau(counts) if chosen is None else _positive("threshold", chosen)
        ends = self.ends((multiple, gyro_multiple))
        bound = np.inf if self.gyro_variance is None else gyro_multiple
        return StillIntervals(*ends, multiple * self.reference, multiple, self.reference, bound, counts)

    def tried(self, threshold: Any, both: bool) -> dict[Multiples, Ends]:
        """Still intervals of every pair of multiples; if `both`, pairs that give the same intervals appear once."""
        first = (_WIDER if both else MULTIPLES) if threshold is None else (_positive("threshold", threshold),)
        second = GYRO_MULTIPLES if both and self.gyro_variance is not None else (np.inf,)
        found: dict[Multiples, Ends] = {}
        seen = set()
        # of pairs with equal intervals keep the loosest bound on the gyroscope, which made no difference
        for pair in itertools.product(map(float, first), reversed(second)):
            ends = self.ends(pair)
            key = (ends[0].tobytes(), ends[1].tobytes())
            if not both or key not in seen:
                found[pair] = ends
                seen.add(key)
        return found

    def moved(self) -> Finding | None:
        """The finding that the initial rest is not still, or None; only if its length was given."""
        if self.initial is None:
            return None
        quiet = float(np.quantile(self.variance[np.isfinite(self.variance)], _QUANTILE))
        ratio = self.reference / quiet if quiet > 0 else np.inf
        return FINDINGS("not_still", ratio=ratio) if ratio > _MOVED else None
