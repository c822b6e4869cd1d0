"""Detect the rests of a turntable from its sensors and its recorded angle (host, NumPy)."""

import numpy as np

from .._arrays import runs, windowed_variance
from .._errors import DataError
from .._message import Message

#: length of a window: s, and least number of samples
_WINDOW, _SAMPLES = 0.25, 20
#: share of the windows that rest; ratio of a window's variance to theirs above which the sensor moves, by chance in one of 1e12 windows
_QUANTILE, _MOVES = 0.3, 6.0
#: largest change of the angle of a table at rest over a window, rad: a smooth rotation does not show in the variance
_STEADY = np.deg2rad(0.03)


def rests_of(samples: dict[str, np.ndarray], recorded: np.ndarray | None, rate: float, least: float) -> tuple[np.ndarray, np.ndarray]:
    """First sample of each rest, and the sample after its last one."""
    half = max(round(_WINDOW * rate), _SAMPLES) // 2
    size = 2 * half + 1
    n = len(next(iter(samples.values())))
    if n < 4 * size:
        raise DataError(f"The log has {n} samples, less than four windows of {size}; record longer.", code="too_short")
    still = np.ones(n, dtype=bool) if recorded is None else _unmoved(recorded[:, None], half)
    # ignore a sensor that is slower than the log and therefore missing in most samples
    there = {name: np.isfinite(x).all(axis=1) for name, x in samples.items()}
    samples = {name: x for name, x in samples.items() if np.mean(there[name]) > 0.5} or samples
    for name, x in samples.items():
        variance = windowed_variance(np.repeat(x, 3 // x.shape[1], axis=1), size)
        changing = variance[np.isfinite(variance) & (variance > 0)]
        if len(changing):
            still &= np.pad(variance < _MOVES * np.quantile(changing, _QUANTILE), half)
        if name == "gyro" and x.shape[1] == 3:
            still &= _unmoved(np.cumsum(np.nan_to_num(x - np.nanmedian(x, axis=0)), axis=0) / rate, half)
    edges = zip(*(edges.tolist() for edges in runs(still)), strict=True)
    ends = [(i, j) for i, j in edges if j - i >= max(least * rate, size)]
    if len(ends) < 2:
        said = "the table {what} for {least:g} s or more; a test takes rests on several positions. Shorter rests need {option.least}"
        raise DataError(Message(said, what="rests once" if ends else "never rests", least=least), code="few_rests")
    start, stop = np.array(ends).T
    return start, stop


def _unmoved(angle: np.ndarray, half: int) -> np.ndarray:
    """True for samples around which no angle (n, axes) changes by more than its noise over a window."""
    padded = np.pad(angle, ((half, half), (0, 0)), mode="edge")
    change = np.abs(padded[2 * half :] - padded[: -2 * half])
    noise = np.quantile(change, _QUANTILE, axis=0) / 0.385  # the quantile of a normal distribution
    return np.all(change < np.maximum(6 * noise, _STEADY), axis=1)
