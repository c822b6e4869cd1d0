"""Detect the rests of a turntable from its sensors and its recorded angle (host, NumPy)."""

import numpy as np

from .._arrays import runs, windowed_variance
from .._errors import DataError
from .._message import Message

#: length of the variance window: s, and least number of samples
_WINDOW, _SAMPLES = 0.25, 20
#: share of the windows that rest; ratio of a window's variance to theirs above which the sensor moves, by chance in one of 1e12 windows
_QUANTILE, _MOVES = 0.3, 6.0
#: standard deviations beyond which the mean over a block does not belong to a rest; length of a block, s; largest share to cut off
_BLOCK_MEAN, _BLOCK, _MOST = 5.0, 0.1, 0.25
#: largest change of the angle of a table at rest, rad, and its largest rate, rad/s: a smooth rotation does not show in the variance
_STEADY, _TURNS = np.deg2rad(0.01), np.deg2rad(0.1)


def rests_of(samples: dict[str, np.ndarray], recorded: np.ndarray | None, rate: float, least: float) -> tuple[np.ndarray, np.ndarray]:
    """First sample of each rest, and the sample after its last one."""
    half = max(round(_WINDOW * rate), _SAMPLES) // 2
    size = 2 * half + 1
    n = len(next(iter(samples.values())))
    if n < 4 * size:
        raise DataError(f"The log has {n} samples, less than four windows of {size}; record longer.", code="too_short")
    still = np.ones(n, dtype=bool)
    # ignore a sensor that is slower than the log and therefore missing in most samples
    there = {name: np.isfinite(x).all(axis=1) for name, x in samples.items()}
    samples = {name: x for name, x in samples.items() if np.mean(there[name]) > 0.5} or samples
    for name, x in samples.items():
        variance = windowed_variance(np.repeat(x, 3 // x.shape[1], axis=1), size)
        changing = variance[np.isfinite(variance) & (variance > 0)]
        if len(changing):
            quiet = np.concatenate([np.zeros(half, bool), variance < _MOVES * np.quantile(changing, _QUANTILE), np.zeros(half, bool)])
            still &= quiet
        if name == "gyro" and x.shape[1] == 3:
            still &= ~_turning(x, size)
    if recorded is not None:
        still &= _unmoved(recorded, size)
    # windows with more missing than present samples are already excluded, so only short gaps are interpolated
    samples = {
        name: np.stack([np.interp(np.arange(n), np.flatnonzero(there[name]), column[there[name]]) for column in x.T], axis=1)
        for name, x in samples.items()
    }
    whole, block = np.concatenate(list(samples.values()), axis=1), max(round(_BLOCK * rate), 2)
    found = zip(*(edges.tolist() for edges in runs(still)), strict=True)
    ends = [_settled(whole[i:j], i, block) for i, j in found if j - i >= max(0.5 * least * rate, size, 6 * block)]
    ends = [(i, j) for i, j in ends if j - i >= least * rate]
    if len(ends) < 2:
        what = "never rests" if not ends else "rests once"
        raise DataError(
            Message(
                "the table {what} for {least:g} s or more; a test takes rests on several positions. Shorter rests need {option.least}",
                what=what,
                least=least,
            ),
            code="few_rests",
        )
    start, stop = np.array(ends).T
    return start, stop


def _turning(gyro: np.ndarray, size: int) -> np.ndarray:
    """True for samples at which the mean rate over a window differs from the median by more than that of a table at rest."""
    filled = np.where(np.isfinite(gyro).all(axis=1, keepdims=True), gyro - np.nanmedian(gyro, axis=0), 0.0)
    sums = np.cumsum(np.concatenate([np.zeros((1, 3)), filled]), axis=0)
    low, high = (np.clip(np.arange(len(gyro)) + shift, 0, len(gyro)) for shift in (-(size // 2), size // 2 + 1))
    mean = (sums[high] - sums[low]) / (high - low)[:, None]
    scatter = 1.4826 * np.nanmedian(np.abs(np.diff(gyro, axis=0)), axis=0) / np.sqrt(2)
    return np.any(np.abs(mean) > _TURNS + 6 * scatter / np.sqrt(size), axis=1)


def _unmoved(angle: np.ndarray, size: int) -> np.ndarray:
    """True for samples around which the table angle changes by no more than its noise over a window."""
    half = size // 2
    padded = np.pad(angle, half, mode="edge")
    change = np.abs(padded[2 * half :] - padded[: -2 * half])
    noise = np.quantile(change, _QUANTILE)
    return change < max(6 * noise, _STEADY)


def _settled(x: np.ndarray, start: int, block: int) -> tuple[int, int]:
    """Start and stop of a rest without the blocks at its ends whose means differ from the middle, because the table still swings."""
    most = int(_MOST * len(x))
    inside = x[most : len(x) - most]
    level = np.mean(inside, axis=0)
    means = np.mean(inside[: len(inside) // block * block].reshape(-1, block, x.shape[1]), axis=1)
    scatter = np.maximum(np.std(means, axis=0), np.std(inside, axis=0) / np.sqrt(block))

    def swings(part: np.ndarray) -> bool:
        return bool(np.any(np.abs(np.mean(part, axis=0) - level) > _BLOCK_MEAN * scatter))

    low, high = 0, len(x)
    while low + block <= most and swings(x[low : low + block]):
        low += block
    while high - block >= len(x) - most and swings(x[high - block : high]):
        high -= block
    return start + low, start + high
