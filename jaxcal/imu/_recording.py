"""A log as the calibration takes it: arrays, still intervals, means over them and turns between them (host, NumPy)."""

import itertools
from typing import Any

import equinox as eqx
import numpy as np

from .._errors import DataError
from .._precision import host_float64
from ._residuals import Poses, Turns, Weighted

MULTIPLES = tuple(range(2, 11))
_BLOCK = 4  # windows to a block of the running sums
_QUANTILE = 0.05
_RUN = 3  # samples in a row at the end of the range
_MOVED = 20.0  # variance of the initial rest over that of the stillest windows
_UNITS = {"g": 9.80665, "mg": 9.80665e-3, "ft/s^2": 0.3048}

#: start and stop of still intervals, (k,) samples each: start <= i < stop
Ends = tuple[np.ndarray, np.ndarray]


class StillIntervals(eqx.Module):
    """Still stretches of a recording.

    Attributes
    ----------
    start, stop : (k,) samples of each: start <= i < stop.
    threshold : on the norm of the three variances, (m/s^2)^2 or what the readings' unit squared is.
    multiple : threshold over `initial_variance`.
    initial_variance : the same norm over the initial still period, or the 5 % quantile of the windows where there is none.
    counts : multiple -> number of intervals, of the multiples that were compared.
    warnings : sentences.
    """

    start: np.ndarray
    stop: np.ndarray
    threshold: float
    multiple: float
    initial_variance: float
    counts: dict[float, int] = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True)

    def __len__(self) -> int:
        return len(self.start)


def windowed_variance(x: np.ndarray, window: int) -> np.ndarray:
    """Norm of the three unbiased variances over `window` samples about each: (n - window + 1,), infinite where samples are missing.

    Running sums of blocks of a few windows, each less its own mean: counts of a million with a variance of four keep their digits.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import windowed_variance
    >>> print(windowed_variance(np.array([[0.0, 0, 0], [2, 0, 0], [4, 0, 0]]), 3))
    [4.]
    """
    count = len(x) - window + 1
    size = _BLOCK * window
    missing = np.any(~np.isfinite(x), axis=1)
    # neither padding nor gaps may lie far from the readings, whose digits they would cost
    filled = np.where(missing[:, None], np.nanmean(x, axis=0), x)
    filled = np.concatenate([filled, np.repeat(filled[-1:], -count % size, axis=0)])
    blocks = np.lib.stride_tricks.sliding_window_view(filled, size + window - 1, axis=0)[::size]
    blocks = blocks - blocks.mean(axis=2, keepdims=True)
    sums = np.cumsum(np.pad([blocks, blocks**2], ((0, 0), (0, 0), (0, 0), (1, 0))), axis=-1)
    first, second = sums[..., window:] - sums[..., :-window]
    variance = np.linalg.norm((second - first**2 / window) / (window - 1), axis=1).reshape(-1)[:count]
    if missing.any():
        lost = np.cumsum(np.pad(missing, (1, 0)))
        variance = np.where(lost[window:] > lost[:-window], np.inf, variance)
    return variance


def _runs(variance: np.ndarray, threshold: float, half: int, least: int) -> Ends:
    """Start and stop of the stretches below the threshold, of at least so many samples."""
    below = np.concatenate([[False], variance < threshold, [False]])
    edges = np.flatnonzero(np.diff(below.astype(np.int8)))
    start, stop = edges[::2] + half, edges[1::2] + half
    kept = stop - start >= least
    return start[kept], stop[kept]


def _plateau(counts: dict[float, int]) -> float:
    """Multiple in the middle of the longest run over which the number of intervals does not change."""
    stretches = [list(part) for count, part in itertools.groupby(counts, key=counts.get) if count] or [list(counts)]
    longest = max(stretches, key=len)
    return longest[len(longest) // 2]


@host_float64
def static_intervals(
    accel: Any,
    rate: float | int,
    *,
    threshold: float | int | None = None,
    window: float | int = 1.0,
    initial: float | int | None = 30.0,
    least: float | int = 1.0,
    multiples: tuple[float | int, ...] = MULTIPLES,
) -> StillIntervals:
    r"""Still stretches: where the windowed variance of the accelerometer stays below a multiple of that of the initial rest.

    .. math:: v_i = \|(\mathrm{var}\,x, \mathrm{var}\,y, \mathrm{var}\,z)\| < k\,v_\mathrm{init}

    with unbiased variances over a window centred at sample i.

    Parameters
    ----------
    accel : (n, 3) readings in any unit; NaN marks a gap and is never still.
    rate : Hz.
    threshold : multiple k of the initial variance. None tries all `multiples` and takes the middle of the longest run over which
        the number of intervals stays the same; `multi_position` judges them by what they leave of the calibration.
    window : length of the window, s; made an odd number of samples.
    initial : length of the initial rest, s; None where there is none. Then the 5 % quantile of v takes its place.
    least : shortest interval, s.
    multiples : those to try.

    Returns
    -------
    StillIntervals

    Raises
    ------
    DataError
        If the readings are not (n, 3), the record is shorter than a window or than the initial rest, the sensor does not move or is
        constant at the beginning, or an option is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import static_intervals
    >>> y = np.random.default_rng(0).normal(size=(8000, 3)) * 0.01
    >>> y[5000:6000] += 5 * np.sin(np.arange(1000) / 20)[:, None]
    >>> found = static_intervals(y, 100.0)
    >>> print(found.start, found.stop)
    [  50 6050] [4951 7950]

    References
    ----------
    D. Tedaldi, A. Pretto and E. Menegatti, ICRA 2014, section IV-A.
    """
    return still_tried(accel, rate, threshold, window, initial, least, multiples)[0]


def still_tried(
    accel: Any, rate: Any, threshold: Any, window: Any, initial: Any, least: Any, multiples: tuple[float | int, ...] = MULTIPLES
) -> tuple[StillIntervals, dict[float, Ends], np.ndarray]:
    """As `static_intervals`; with the intervals of every multiple that may be chosen, and the windowed variance."""
    x = np.asarray(accel, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] != 3:
        raise DataError(f"accel has shape {x.shape}; expected (n, 3)")
    for name, value in (("rate", rate), ("window", window), ("least", least), ("threshold", threshold), ("initial", initial)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise DataError(f"{name}={value!r} must be positive")
    half = max(round(float(window) * float(rate) / 2), 1)
    size = 2 * half + 1
    if len(x) < 2 * size:
        raise DataError(f"{len(x)} samples are less than two windows of {size}; record longer, or give a shorter window=")
    variance = windowed_variance(x, size)
    warnings: tuple[str, ...] = ()
    if initial is None:
        start_variance = float(np.quantile(variance[np.isfinite(variance)], _QUANTILE))
        warnings = ("No initial rest was given: the 5 % quantile of the windowed variance stands for it.",)
    else:
        last = round(float(initial) * float(rate))
        if last >= len(x):
            raise DataError(f"the record lasts {len(x) / rate:.3g} s, the initial rest should last {initial:g} s; give initial=")
        start_variance = float(np.linalg.norm(np.nanvar(x[: last + 1], axis=0, ddof=1)))
    if not start_variance > 0:
        raise DataError(
            "the accelerometer is constant during the initial rest: its noise is below its resolution, or it repeats one sample. "
            "Log it at full resolution."
        )
    shortest = max(round(float(least) * float(rate)), 2)
    tried = {float(k): _runs(variance, k * start_variance, half, shortest) for k in multiples}
    counts = {k: len(start) for k, (start, _) in tried.items()}
    if threshold is not None:
        tried = {float(threshold): _runs(variance, threshold * start_variance, half, shortest)}
    multiple = _plateau(counts) if threshold is None else float(threshold)
    still = StillIntervals(*tried[multiple], multiple * start_variance, multiple, start_variance, counts, warnings)
    return still, tried, variance


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
    for limit in (np.nanmin(x, axis=0), np.nanmax(x, axis=0)):
        at = x == limit
        at &= np.mean(at, axis=0) <= 0.5  # a channel that hardly changes is coarse, not saturated
        run = np.any(at[2:] & at[1:-1] & at[:-2], axis=1)
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


class Rests(eqx.Module):
    """Means over k still intervals: readings (k, 3), middle (s from the middle of the record), duration (s), and rows of the padding."""

    accel: np.ndarray
    gyro: np.ndarray
    time: np.ndarray
    duration: np.ndarray
    slots: int

    def poses(self, sigma: np.ndarray, gyro_sigma: np.ndarray) -> Poses:
        """Padded poses with the given standard deviations, (k,) and (k, 3)."""
        accel, gyro, time = (padded(x, self.slots) for x in (self.accel, self.gyro, self.time))
        return Poses(accel, padded(sigma, self.slots, np.inf), gyro, padded(gyro_sigma, self.slots, np.inf), time)


def padded(x: np.ndarray, slots: int, fill: float | None = None) -> np.ndarray:
    """Up to so many rows: of the first row, or of a number."""
    more = np.repeat(x[:1], slots - len(x), axis=0)
    return np.concatenate([x, more if fill is None else np.full_like(more, fill)])


def norms(accel: np.ndarray, slots: int, gravity: float, sigma: float = 1.0) -> Weighted:
    """Readings at rest, padded, as a fit of the accelerometer alone takes them."""
    return Weighted(Poses(padded(accel, slots), padded(np.full(len(accel), sigma), slots, np.inf)), None, gravity)


def power_of_two(n: int, least: int = 1) -> int:
    """Smallest power of two of at least n."""
    return max(1 << max(n - 1, 0).bit_length(), least)


def means(readings: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """Mean over each interval."""
    return np.array([readings[i:j].mean(axis=0) for i, j in zip(start, stop, strict=True)])


def rests_of(recording: Recording, start: np.ndarray, stop: np.ndarray) -> Rests:
    """Means over whole intervals."""
    accel = means(recording.accel, start, stop)
    gyro = 0 * accel if recording.gyro is None else means(recording.gyro, start, stop)
    middle = (recording.time[start] + recording.time[stop - 1]) / 2 - recording.time[-1] / 2
    return Rests(accel, gyro, middle, (stop - start) / recording.rate, power_of_two(len(start) + 1, 32))


def turns_of(recording: Recording, start: np.ndarray, stop: np.ndarray, slots: int) -> Turns:
    """Turns from the last sample of each interval to the last before the next one; sigma is one, infinite where samples are missing."""
    gyro, accel = recording.gyro, recording.accel
    assert gyro is not None
    first, last = stop[:-1] - 1, start[1:]  # samples first <= i < last
    n = power_of_two(int((last - first).max()) - 1, 64)
    index = np.minimum(first[:, None] + np.arange(n + 1)[None, :], last[:, None] - 1)
    index = np.concatenate([index, np.repeat(index[:1, :1], slots - 1 - len(first), axis=0) + np.zeros(n + 1, dtype=int)])
    good = np.isfinite(np.concatenate([gyro[index], accel[index]], axis=2)).all(axis=(1, 2))
    sigma = np.where(good & (np.arange(slots - 1) < len(first)), 1.0, np.inf)
    kept = np.reshape(good, (-1, 1, 1))
    return Turns(np.where(kept, gyro[index], 0.0), np.where(kept, accel[index], 0.0), np.diff(recording.time[index], axis=1), sigma)
