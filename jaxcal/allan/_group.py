"""Deviations of several records at once: what takes a step of Python for each of them takes one for all."""

import threading

import jax
import numpy as np

from .._types import Any, Float, Int
from ._edf import degrees_of_freedom, interval_factors
from ._identify import types_for_intervals
from ._kinds import Kind
from ._noise_types import noise_types
from ._phase import integrate, padded_length, scratch
from ._result import Deviation
from ._routes import filled
from ._sums import stacked_block_sums

_SAMPLES = 1 << 20  # of all records of a group: 8 MB, which stay in the third-level cache
_LARGEST = 16  # records of a group
# held by the one thread that is at many short NumPy steps: two at once wait for the interpreter at each of them, and both take
# longer than one after the other; meanwhile another is in the kernel
_short_steps = threading.Lock()
_VALUES = 1000  # degrees of freedom found together; of more some are interpolated


def group_size(padded: int) -> int:
    """How many records of a bucket of lengths are best taken together."""
    return min(max(_SAMPLES // padded, 1), _LARGEST)


def group_deviations(
    records: list[Float[np.ndarray, " _"]], rates: list[float], statistic: Kind, sizes: list[Int[np.ndarray, " _"]], rows: int,
    confidence: float, alpha: Any,
) -> list[Deviation | None]:  # fmt: skip
    """`deviation` of records from one bucket of lengths, none of them longer than the others' bucket; None for one that is not finite.

    Parameters
    ----------
    records : rate samples in float64, at most `group_size` records.
    rates : sampling rates in Hz.
    statistic : one of differences of the record as it is.
    sizes : cluster sizes for each record, checked.
    rows : number of cluster sizes that the program is made for.
    confidence, alpha : as for `deviation`.
    """
    padded = padded_length(len(records[0]))
    theta = scratch(group_size(padded), padded)
    m, number = np.ones((len(theta), rows), np.int64), np.zeros((len(theta), rows), np.int64)
    finite, orders = [], []
    for i, (y, chosen) in enumerate(zip(records, sizes, strict=True)):
        orders.append(np.argsort(chosen, kind="stable"))
        if integrate(y, theta[i, : len(y) + 1], 1):
            finite.append(i)
            ascending = chosen[orders[i]]
            m[i], number[i] = filled(ascending, Kind.count(statistic, len(y), ascending), rows)
    kernel = {"order": statistic.difference, "strided": not statistic.overlapped, "modified": statistic.modified}
    found: list[Deviation | None] = [None] * len(records)
    # the kernel runs beside what follows, which does not need its sums
    with jax.enable_x64(True):  # thread-local
        running = stacked_block_sums(jax.device_put(theta, may_alias=True), m, number, **kernel)
    with _short_steps:
        each = []
        for i in finite:
            back, samples, n = np.argsort(orders[i], kind="stable"), len(records[i]), len(sizes[i])
            if alpha is None:
                noise = noise_types(theta[i, : samples + 1], None, m[i, :n], statistic.plain, samples, "rate")[back]
            else:
                noise = np.full(n, float(alpha))
            types = types_for_intervals(noise[:, None], sizes[i], samples, "rate")[:, 0]
            factor = Kind.scale(statistic, sizes[i], rates[i]) / number[i, :n][back]
            tau = Kind.tau(statistic, sizes[i], rates[i])
            each.append((sizes[i], np.full(n, samples), types, tau, factor, number[i, :n][back], noise))
        step = max(_VALUES // rows, 1)
        parts = [_intervals(each[start : start + step], statistic, confidence) for start in range(0, len(finite), step)]
    sums = np.asarray(running)
    with _short_steps:
        for j, i in enumerate(finite):
            chosen, _, _, tau, factor, count, noise = each[j]
            edf, low, high = (values[j % step] for values in parts[j // step])
            deviation = np.sqrt(sums[i, : len(chosen)][np.argsort(orders[i], kind="stable")] * factor)
            found[i] = Deviation(
                tau=tau, m=chosen, deviation=deviation, lower=deviation * low, upper=deviation * high, edf=edf, count=count,
                alpha=noise.astype(np.int64), skipped=np.zeros_like(count), bias=np.ones(len(chosen)),
                kind=statistic.name, rate=rates[i], confidence=confidence,
            )  # fmt: skip
    return found


def _intervals(parts: list, statistic: Kind, confidence: float) -> list[list[np.ndarray]]:
    """The edf and the two factors of the limits, of each of several records."""
    m, samples, types, *_ = (np.concatenate(values) for values in zip(*parts, strict=True))
    if statistic.interval_error:
        edf = low = high = np.full(len(m), np.nan)
    else:
        edf = degrees_of_freedom(m, types, statistic, samples)
        low, high = interval_factors(edf, confidence)
    ends = np.cumsum([len(part[0]) for part in parts])[:-1]
    return [np.split(values, ends) for values in (edf, low, high)]
