"""Deviations of several records at once: what takes a step of Python for each of them takes one for all."""

import dataclasses

import jax
import numpy as np

from .._types import Any, Float, Int
from ._edf import degrees_of_freedom, interval_factors
from ._identify import types_for_intervals, types_of_rates
from ._kinds import Kind
from ._phase import aligned, integrate
from ._result import Deviation
from ._routes import filled
from ._sums import stacked_block_sums

_SAMPLES = 1 << 21  # of all records of a group: 16 MB, which stay in the third-level cache
_LARGEST = 16  # records of a group
_VALUES = 1000  # degrees of freedom found together; of more some are interpolated


def group_size(padded: int) -> int:
    """How many records of a bucket of lengths are best taken together."""
    return min(max(_SAMPLES // padded, 1), _LARGEST)


def room(padded: int) -> Float[np.ndarray, "records padded"]:
    """A place for the phases of a group."""
    records = group_size(padded)
    return aligned(records * padded).reshape(records, padded)


@dataclasses.dataclass(frozen=True)
class Group:
    """Records of one bucket of lengths whose sums are being formed."""

    records: list[Float[np.ndarray, " _"]]
    sizes: list[Int[np.ndarray, " _"]]
    orders: list[Int[np.ndarray, " _"]]
    finite: list[int]
    theta: Float[np.ndarray, "records padded"]
    m: Int[np.ndarray, "records clusters"]
    number: Int[np.ndarray, "records clusters"]
    sums: Any


def begin(
    records: list[Float[np.ndarray, " _"]], statistic: Kind, sizes: list[Int[np.ndarray, " _"]], rows: int,
    theta: Float[np.ndarray, "records padded"],
) -> Group:  # fmt: skip
    """Hand records from one bucket of lengths to the kernel, without waiting for it.

    Parameters
    ----------
    records : rate samples in float64, at most `group_size` records.
    statistic : one of differences of the record as it is.
    sizes : cluster sizes for each record, checked.
    rows : number of cluster sizes that the program is made for.
    theta : where their phases go; in use until `finish` has returned.
    """
    m, number = np.ones((len(theta), rows), np.int64), np.zeros((len(theta), rows), np.int64)
    finite, orders = [], []
    for i, (y, chosen) in enumerate(zip(records, sizes, strict=True)):
        orders.append(np.argsort(chosen, kind="stable"))
        if integrate(y, theta[i, : len(y) + 1], 1):
            finite.append(i)
            ascending = chosen[orders[i]]
            m[i], number[i] = filled(ascending, statistic.count(len(y), ascending), rows)
    kernel = {"order": statistic.difference, "strided": not statistic.overlapped, "modified": statistic.modified}
    with jax.enable_x64(True):  # thread-local
        sums = stacked_block_sums(jax.device_put(theta, may_alias=True), m, number, **kernel)
    return Group(records, sizes, orders, finite, theta, m, number, sums)


def finish(group: Group, rates: list[float], statistic: Kind, confidence: float, alpha: Any) -> list[Deviation | None]:
    """`deviation` of the records of a group, None for one that is not finite; what does not need the sums is done before they are there.

    Parameters
    ----------
    group : as `begin` gave it.
    rates : sampling rates in Hz.
    statistic : that of `begin`.
    confidence, alpha : as for `deviation`.
    """
    if alpha is None:
        thetas = [group.theta[i, : len(group.records[i]) + 1] for i in group.finite]
        identified = types_of_rates(thetas, [group.m[i, : len(group.sizes[i])] for i in group.finite], statistic.plain)
    else:
        identified = [np.full(len(group.sizes[i]), float(alpha)) for i in group.finite]
    each = []
    for i, noise in zip(group.finite, identified, strict=True):
        chosen, samples = group.sizes[i], len(group.records[i])
        n, back = len(chosen), np.argsort(group.orders[i], kind="stable")
        noise = noise[back]
        types = types_for_intervals(noise[:, None], chosen, samples, "rate")[:, 0]
        factor = statistic.scale(chosen, rates[i]) / group.number[i, :n][back]
        tau = statistic.tau(chosen, rates[i])
        each.append((chosen, np.full(n, samples), types, tau, factor, group.number[i, :n][back], noise, back))
    step = max(_VALUES // group.m.shape[1], 1)
    parts = [_intervals(each[start : start + step], statistic, confidence) for start in range(0, len(each), step)]
    sums = np.asarray(group.sums)
    found: list[Deviation | None] = [None] * len(group.records)
    for j, i in enumerate(group.finite):
        chosen, _, _, tau, factor, count, noise, back = each[j]
        edf, low, high = (values[j % step] for values in parts[j // step])
        deviation = np.sqrt(sums[i, : len(chosen)][back] * factor)
        found[i] = _assembled(
            tau=tau, m=chosen, deviation=deviation, lower=deviation * low, upper=deviation * high, edf=edf, count=count,
            alpha=noise.astype(np.int64), skipped=np.zeros_like(count), bias=np.ones(len(chosen)), warnings=(),
            kind=statistic.name, rate=rates[i], confidence=confidence,
        )  # fmt: skip
    return found


def _assembled(**fields: Any) -> Deviation:
    """`Deviation(**fields)`, all of which are given, without what takes equinox longer than a record's intervals."""
    found = object.__new__(Deviation)
    for name, value in fields.items():
        object.__setattr__(found, name, value)
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
