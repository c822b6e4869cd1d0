"""Statistics that need a stretch without gaps (total, Theo1) or extremes in windows (mtie), on the host."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ..._arrays import longest_run
from ..._errors import DataError
from ..._types import Float, Int
from .._findings import FINDINGS
from .._kinds import Kind
from .._noise_type._identify import identify
from ._phase import integrate
from ._theo1 import theo1_sum
from ._total import reflected_record, total_sum, window_sum


def measure_whole(columns, missing: list, sizes, statistic: Kind, rate: float, data: str, alpha):
    """Sums, counts and noise types, (clusters, channels), and a finding for every channel of which only a part was used.

    `columns` holds (points, channels) samples of rate or of phase. `missing` has one entry per channel: where the channel is NaN, or None
    without gaps. `alpha` is the noise type, or None to identify it.
    """
    order = np.argsort(sizes, kind="stable")
    ascending, channels = sizes[order], columns.shape[1]
    one = _extremes if statistic.family == "range" else _stretch

    def channel(index):
        subject = (f"channel {index}",) if channels > 1 else ()
        total, count, noise, told = one(columns[:, index], missing[index], ascending, statistic, rate, data, alpha is None, subject)
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
        if reflected is not None:
            total[i] = total_sum(reflected, m)
        elif statistic.family == "theo1":
            total[i] = theo1_sum(theta, m)
        elif statistic.modified:
            total[i] = window_sum(theta, m)
        elif m == 1:  # a window of one sample per cluster has no line to remove: NIST SP 1065 uses the plain statistic
            total[i] = np.sum(np.diff(x, 2) ** 2)
        else:
            total[i] = window_sum(x, m)
    noise = np.zeros(len(sizes))
    if identified and samples > 0:
        noise = identify(theta, None, effective_sizes(sizes, statistic), statistic.plain, samples, data)
    return total, count, noise, told


def effective_sizes(sizes, statistic: Kind):
    """Cluster sizes at which a plain statistic averages over the same time."""
    return np.maximum(np.round(0.75 * sizes), 1).astype(np.int64) if statistic.family == "theo1" else sizes


def _phase_and_rate(column, rate: float, data: str, statistic: Kind):
    """Phase in samples minus its first value, or minus the line through its ends; with it the rate for three-sample statistics."""
    if data == "rate":
        theta = np.empty(len(column) + 1)
        integrate(column, theta, 1)
        return theta, column - np.mean(column)
    line = column[0] if statistic.interval_error else np.linspace(column[0], column[-1], len(column))
    theta = (column - line) * rate
    return theta, np.diff(theta) if statistic.order == 3 else theta


def _extremes(column, gone, sizes, statistic: Kind, rate: float, data: str, identified: bool, subject: tuple[str, ...]):
    """One channel of mtie, over windows without gaps."""
    del subject
    lost = marks = None
    if gone is not None:
        lost = np.concatenate([[0], np.cumsum(gone)])
        marks = lost if data == "rate" else gone.astype(np.int64)
        filled = np.where(gone, np.mean(column[~gone]), column) if data == "rate" else np.where(gone, column[~gone][0], column)
        column = filled
    theta, _ = _phase_and_rate(column, rate, data, statistic)
    greatest, count = _ranges(theta, sizes, lost, 0 if data == "rate" else 1)
    noise = identify(theta, marks, sizes, statistic.plain, len(theta) - 1, data) if identified else np.zeros(len(sizes))
    return greatest**2 * count, count, noise, None


def _ranges(
    theta: Float[np.ndarray, " points"], m: Int[np.ndarray, " clusters"], lost: Int[np.ndarray, " reach"] | None, less: int
) -> tuple[Float[np.ndarray, " clusters"], Int[np.ndarray, " clusters"]]:
    """Largest range of m + 1 successive phase points, and number of windows free of gaps, at ascending cluster sizes.

    ITU-T G.810, 1996, section II.5; S. Bregni, IEEE Trans. Instrum. Meas. 45, 1996. The extremes of a window of any length are those of
    two overlapping windows whose length is a power of two; the tables of these are doubled while going through the cluster sizes.
    `lost` is the running number of missing samples (None without gaps). If it counts phase points instead of rate samples, a window
    reaches further by `less`, 1.
    """
    low = high = theta
    length = 1  # number of points that an entry of the tables spans
    greatest, counts = np.zeros(len(m)), np.zeros(len(m), dtype=np.int64)
    for i, size in enumerate(int(size) for size in m):
        while 2 * length <= size + 1:
            low, high = np.minimum(low[:-length], low[length:]), np.maximum(high[:-length], high[length:])
            length *= 2
        windows, back = len(theta) - size, size + 1 - length
        spread = np.maximum(high[:windows], high[back : back + windows])
        spread -= np.minimum(low[:windows], low[back : back + windows])
        if lost is not None:
            whole = lost[size + less : size + less + windows] == lost[:windows]
            spread = spread[whole]
        counts[i] = len(spread)
        greatest[i] = spread.max(initial=0.0)
    return greatest, counts


def refuse_traced(statistic: Kind) -> None:
    """Raise a clear error for a statistic that cannot be traced."""
    if statistic.name in ("mtotdev", "ttotdev", "htotdev", "theo1", "mtie"):
        raise DataError(
            f"{statistic.name} is computed on the host: it can be neither differentiated, nor batched by vmap, nor compiled by jit. Of a "
            "traced record take adev, oadev, mdev, tdev, hdev, ohdev, totdev or tierms; several records at once are channels of one y"
        )
