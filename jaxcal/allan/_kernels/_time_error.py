"""Errors of time, which need a stretch without gaps, on the host."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import scipy  # loads its parts when they are first used

from ..._arrays import longest_run
from .._findings import FINDINGS
from .._kinds import Kind


def measure_whole(columns, missing: list, sizes, statistic: Kind, rate: float, data: str):
    """Sums and counts, (clusters, channels), and a finding for every channel of which only a part was used.

    `columns` holds (points, channels) samples of rate or of phase. `missing` has one entry per channel: where the channel is NaN, or None
    without gaps.
    """

    def channel(index):
        subject = (f"channel {index}",) if columns.shape[1] > 1 else ()
        return _stretch(columns[:, index], missing[index], sizes, statistic, rate, data, subject)

    with ThreadPoolExecutor(min(os.cpu_count() or 1, columns.shape[1])) as pool:
        *found, told = zip(*pool.map(channel, range(columns.shape[1])), strict=True)
    return *(np.stack(values, axis=1) for values in found), tuple(one for one in told if one)


def _stretch(column, gone, sizes, statistic: Kind, rate: float, data: str, subject: tuple[str, ...]):
    """One channel; in a record with gaps, the longest stretch (the first if several)."""
    told = None
    if gone is not None:
        a, b = longest_run(~gone)
        told = FINDINGS("longest_stretch", subject, kind=statistic.name, share=(b - a) / len(column), start=a, stop=b - 1)
        column = column[a:b]
    theta = column * rate if data == "phase" else np.concatenate([[0.0], np.cumsum(column)])
    fits = sizes <= statistic.largest(len(theta) - 1)
    total, count = np.zeros(len(sizes)), np.where(fits, statistic.count(len(theta) - 1, sizes), 0)
    for i in np.flatnonzero(fits):
        m = int(sizes[i])
        total[i] = _error_sum(theta, m) if statistic.name == "tierms" else count[i] * _largest_error(theta, m) ** 2
    return total, count, told


def _error_sum(theta, m: int) -> float:
    """Sum of the squared changes of phase over m samples."""
    return float(np.sum((theta[m:] - theta[:-m]) ** 2))


def _largest_error(theta, m: int) -> float:
    """Largest range of the phase in any window of m + 1 points."""
    inside = slice((m + 1) // 2, (m + 1) // 2 + len(theta) - m)
    high, low = (one(theta, m + 1)[inside] for one in (scipy.ndimage.maximum_filter1d, scipy.ndimage.minimum_filter1d))
    return float(np.max(high - low))
