"""Statistics that need a stretch without gaps (total, errors of time), on the host."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import scipy  # loads its parts when they are first used

from ..._arrays import longest_run
from ..._errors import DataError
from .._findings import FINDINGS
from .._kinds import Kind
from .._noise_type._identify import identify
from ._phase import integrate
from ._total import reflected_record, total_sum, window_sum


def measure_whole(columns, missing: list, sizes, statistic: Kind, rate: float, data: str, alpha):
    """Sums, counts and noise types, (clusters, channels), and a finding for every channel of which only a part was used.

    `columns` holds (points, channels) samples of rate or of phase. `missing` has one entry per channel: where the channel is NaN, or None
    without gaps. `alpha` is the noise type, or None to identify it.
    """
    order = np.argsort(sizes, kind="stable")
    ascending, channels = sizes[order], columns.shape[1]

    def channel(index):
        subject = (f"channel {index}",) if channels > 1 else ()
        total, count, noise, told = _stretch(columns[:, index], missing[index], ascending, statistic, rate, data, alpha is None, subject)
        return total, count, noise if alpha is None else np.full(len(ascending), float(alpha)), told

    with ThreadPoolExecutor(min(os.cpu_count() or 1, channels)) as pool:
        *found, told = zip(*(pool.map if channels > 1 else map)(channel, range(channels)), strict=True)
    back = np.argsort(order, kind="stable")
    return *(np.stack(values, axis=1)[back] for values in found), tuple(one for one in told if one)


def _stretch(column, gone, sizes, statistic: Kind, rate: float, data: str, identified: bool, subject: tuple[str, ...]):
    """One channel of a statistic that needs an unbroken stretch; in a record with gaps, the longest stretch (the first if several)."""
    told = None
    if gone is not None:
        a, b = longest_run(~gone)
        told = FINDINGS("longest_stretch", subject, kind=statistic.name, share=(b - a) / len(column), start=a, stop=b - 1)
        column = column[a:b]
    theta, x = _phase_and_rate(column, rate, data, statistic)
    samples = len(theta) - 1
    fits = sizes <= statistic.largest(samples)
    total = np.zeros(len(sizes))
    count = np.where(fits, statistic.count(samples, sizes), 0)
    reflected = reflected_record(theta) if statistic.name == "totdev" else None
    for i in np.flatnonzero(fits):
        m = int(sizes[i])
        if statistic.family == "error":
            total[i] = _error_sum(theta, m) if statistic.name == "tierms" else count[i] * _largest_error(theta, m) ** 2
        elif reflected is not None:
            total[i] = total_sum(reflected, m)
        elif statistic.modified:
            total[i] = window_sum(theta, m)
        elif m == 1:  # a window of one sample per cluster has no line to remove: NIST SP 1065 uses the plain statistic
            total[i] = np.sum(np.diff(x, 2) ** 2)
        else:
            total[i] = window_sum(x, m)
    noise = np.zeros(len(sizes))
    if identified and samples > 0 and statistic.family != "error":
        noise = identify(theta, None, sizes, statistic.plain, samples, data)
    return total, count, noise, told


def _error_sum(theta, m: int) -> float:
    """Sum of the squared changes of phase over m samples."""
    return float(np.sum((theta[m:] - theta[:-m]) ** 2))


def _largest_error(theta, m: int) -> float:
    """Largest range of the phase in any window of m + 1 points."""
    inside = slice((m + 1) // 2, (m + 1) // 2 + len(theta) - m)
    high, low = (one(theta, m + 1)[inside] for one in (scipy.ndimage.maximum_filter1d, scipy.ndimage.minimum_filter1d))
    return float(np.max(high - low))


def _phase_and_rate(column, rate: float, data: str, statistic: Kind):
    """Phase in samples minus the line through its ends; with it the rate for three-sample statistics. An error of time keeps its line."""
    if statistic.family == "error":
        return column * rate if data == "phase" else np.concatenate([[0.0], np.cumsum(column)]), column
    if data == "rate":
        theta = np.empty(len(column) + 1)
        integrate(column, theta)
        return theta, column - np.mean(column)
    theta = (column - np.linspace(column[0], column[-1], len(column))) * rate
    return theta, np.diff(theta) if statistic.order == 3 else theta


def refuse_traced(statistic: Kind) -> None:
    """Raise a clear error for a statistic that cannot be traced."""
    if statistic.contiguous and statistic.name != "totdev":
        raise DataError(
            f"{statistic.name} is computed on the host: it can be neither differentiated, nor batched by vmap, nor compiled by jit. Of a "
            "traced record take adev, oadev, mdev, tdev, hdev, ohdev or totdev; several records at once are channels of one y",
            code="traced",
        )
