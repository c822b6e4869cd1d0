"""`static_intervals`: where a recording is still, from the windowed variance (host, NumPy)."""

from typing import Any

import equinox as eqx
import numpy as np

from .._errors import DataError
from .._precision import host_float64

_BLOCK = 4  # windows to a block of the running sums
_QUANTILE = 0.05
MULTIPLES = tuple(range(2, 11))


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
    blocks = -(-count // size)
    missing = np.any(~np.isfinite(x), axis=1)
    # neither padding nor gaps may lie far from the readings, whose digits they would cost
    filled = np.where(missing[:, None], np.nanmean(x, axis=0), x)
    padded = np.concatenate([filled, np.repeat(filled[-1:], max(blocks * size + window - 1 - len(x), 0), axis=0)])
    found = np.empty((blocks, size))
    for block in range(blocks):
        part = padded[block * size : (block + 1) * size + window - 1]
        part = part - part.mean(axis=0)
        sums = np.zeros((2, len(part) + 1, 3))
        np.cumsum(part, axis=0, out=sums[0, 1:])
        np.cumsum(part**2, axis=0, out=sums[1, 1:])
        first, second = sums[:, window:] - sums[:, :-window]
        found[block] = np.linalg.norm((second - first**2 / window) / (window - 1), axis=1)
    variance = found.reshape(-1)[:count]
    if missing.any():
        lost = np.concatenate([np.zeros(1, dtype=int), np.cumsum(missing)])
        variance = np.where(lost[window:] > lost[:-window], np.inf, variance)
    return variance


def variance_norm(x: np.ndarray) -> float:
    """Norm of the three unbiased variances of the samples that are there."""
    return float(np.linalg.norm(np.nanvar(x, axis=0, ddof=1)))


def runs(variance: np.ndarray, threshold: float, half: int, least: int) -> tuple[np.ndarray, np.ndarray]:
    """Start and stop of the stretches below the threshold, of at least so many samples."""
    below = np.concatenate([[False], variance < threshold, [False]])
    edges = np.flatnonzero(np.diff(below.astype(np.int8)))
    start, stop = edges[::2] + half, edges[1::2] + half
    kept = stop - start >= least
    return start[kept], stop[kept]


def plateau(counts: dict[float, int]) -> float:
    """Multiple in the middle of the longest run over which the number of intervals does not change."""
    multiples, values = list(counts), list(counts.values())
    best: list[float] = []
    here: list[float] = []
    for i, multiple in enumerate(multiples):
        here = [*here, multiple] if i and values[i] == values[i - 1] else [multiple]
        if len(here) > len(best) and values[i] > 0:
            best = here
    return best[len(best) // 2] if best else multiples[len(multiples) // 2]


@host_float64
def static_intervals(
    accel: Any,
    rate: float | int,
    *,
    threshold: float | int | None = None,
    window: float | int = 1.0,
    initial: float | int | None = 30.0,
    least: float | int = 1.0,
    multiples: tuple[float, ...] = MULTIPLES,
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
        start_variance = variance_norm(x[: last + 1])
    if not start_variance > 0:
        raise DataError(
            "the accelerometer is constant during the initial rest: its noise is below its resolution, or it repeats one sample. "
            "Log it at full resolution."
        )
    shortest = max(round(float(least) * float(rate)), 2)
    counts = {float(k): len(runs(variance, k * start_variance, half, shortest)[0]) for k in multiples}
    multiple = plateau(counts) if threshold is None else float(threshold)
    start, stop = runs(variance, multiple * start_variance, half, shortest)
    return StillIntervals(start, stop, multiple * start_variance, multiple, start_variance, counts, warnings)
