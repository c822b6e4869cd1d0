"""Choose how to compute the sums of a record: block by block, from correlations, or strided."""

import itertools
import os
from collections.abc import Callable

import jax
import numpy as np

from ..._errors import DataError
from .._kinds import MANY, Kind
from .._noise_type._segments import Segments, steps
from ._correlation_sums import LARGEST_ERROR, correlation_sums
from ._difference_sums import TILE, block_sums, direct_sums
from ._phase import IN_CACHE, running_sum_of_phase

#: number of differences above which a second thread saves more time than it costs
PARALLEL_FROM = 20_000_000
_PER_SAMPLE = 1000  # differences per sample above which correlations cost less
_LONG = 1 << 24  # points beyond which shared ones repay in the first call the 0.1 s that they take to compile
_MOST = 5e11  # largest number of differences for the block kernel: about half an hour on two cores


def record_sums(prepared, sizes, number, kind: Kind, workers: int, run: Callable) -> tuple[np.ndarray, np.ndarray]:
    """Sums of squared differences and number of valid ones, at ascending cluster sizes, (clusters,).

    This function alone chooses the route:

    1. adev and hdev: strided sums, with or without gaps; n ln n differences in all.
    2. At most 512 cluster sizes: the block kernel, with or without gaps.
    3. More, of a record without gaps, with over 1,000 differences per sample: correlations, O(n log^2 n).
       The smallest cluster sizes, those with few differences, and those whose relative error could exceed 1e-8 use the block kernel.
    4. Otherwise the block kernel; more than 5e11 differences are refused.

    `prepared` is the result of `_prepare` for one channel, `number` the number of differences at each cluster size without gaps. `run`
    maps a function over stretches of the record, in threads if it belongs to a pool.
    """
    parts, theta, marks, missing, rule, less = prepared

    def direct(chosen):
        return by_blocks(parts, missing, sizes[chosen], number[chosen], less, kind, rule, workers, run, len(parts[0]) > _LONG)

    if not kind.overlapped:
        return strided_sums(theta, marks if rule != "none" else None, rule, sizes, number, kind.order)
    if len(sizes) <= MANY or missing is not None or number.sum() <= _PER_SAMPLE * len(theta):
        return direct(slice(None))
    total, error = correlation_sums(theta, sizes, kind, min(os.cpu_count() or 1, 16))
    again = np.flatnonzero(~(error <= LARGEST_ERROR))  # also true if the error is NaN
    if len(again):
        total[again], _ = direct(again)
    return total, number.copy()


def sums_in_cache(theta, sizes, number, kind: Kind) -> Callable[[], np.ndarray]:
    """Start the sums of a record without gaps that stays in the cache, at up to 512 cluster sizes; returns a function that waits for them.

    One compiled program serves every length and every number of cluster sizes, because both are data. theta is the padded phase.
    """
    # a compiled function reads an aligned array in place, and `device_put` would take longer than the call
    parts = running_sum_of_phase(theta) if kind.modified else (theta,)
    span = np.array([0, -(-int(number[0]) // TILE)])
    sums = block_sums(parts, None, *filled(sizes, number), span, order=kind.difference)[0]
    return lambda: np.asarray(sums)[: len(sizes)]


def by_blocks(
    parts, missing, sizes, number, less, kind: Kind, rule: str, workers: int, run: Callable, shared: bool
) -> tuple[np.ndarray, np.ndarray]:
    """The block kernel over stretches of equal work in threads, and over at most 512 cluster sizes at a time."""
    cost = float(number.sum())
    if len(sizes) > MANY and cost > _MOST:
        why = "rounding spoils the quick sums of this record" if missing is None else "a record with gaps has no quick sums"
        raise DataError(
            f'{kind.name} at {len(sizes)} cluster sizes take {cost:.1g} differences, and {_MOST:.0g} are the most: {why}; use m="log"',
            code="too_many",
        )
    found = []
    for first in range(0, len(sizes), MANY):
        some = slice(first, first + MANY)
        found.append(_group(parts, missing, sizes[some], number[some], less, kind, rule, workers, run, shared))
    total, count = (np.concatenate(values) for values in zip(*found, strict=True))
    return total, count


def filled(m, count):
    """Cluster sizes and numbers of differences, padded by the largest size without any difference, so that all share one program."""
    extra = MANY - len(m)
    return np.concatenate([m, np.full(extra, m[-1])]), np.concatenate([count, np.zeros(extra, count.dtype)])


def _group(parts, missing, sizes, number, less: int, kind: Kind, rule: str, workers: int, run, shared: bool):
    options = {"order": kind.difference, "rule": rule, "less": less}
    if jax.default_backend() != "cpu":  # a graphics card would start each block of each cluster size by itself
        return [np.asarray(found) for found in direct_sums(parts, missing, sizes, number, strided=False, **options)]
    options["shared"], given, (sizes, number) = shared, len(sizes), filled(sizes, number)
    tiles = -(-int(number[0]) // TILE)
    edges = [0, tiles]
    if workers > 1:
        # give each part the same work: the number of cluster sizes that visit a tile decreases along the record
        visits = len(number) - np.searchsorted(number[::-1], np.arange(tiles) * TILE, side="right")
        inner = np.searchsorted(np.cumsum(visits), np.linspace(0, visits.sum(), workers + 1)[1:-1])
        edges = [0, *(int(e) for e in inner), tiles]

    def part(span):
        with jax.enable_x64(True):  # thread-local
            return [np.asarray(found) for found in block_sums(parts, missing, sizes, number, np.array(span), **options)]

    found = list(run(part, itertools.pairwise(edges)))
    total, *valid = (np.sum(values, axis=0) for values in zip(*found, strict=True))
    return total[:given], valid[0].astype(np.int64)[:given] if valid else number[:given]


def strided_sums(theta, marks, rule: str, sizes, number, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Sums over every m-th starting point and number of valid ones, at ascending cluster sizes; the series are joined end to end."""
    total, count = np.zeros(len(sizes)), number.copy()
    for part in np.split(np.arange(len(sizes)), np.flatnonzero(np.diff(np.cumsum(number + order) // IN_CACHE)) + 1):
        series = Segments(number[part] + order)
        at = (np.arange(series.stops[-1]) - np.repeat(series.starts, series.lengths)) * np.repeat(sizes[part], series.lengths)
        d = theta[at]
        for _ in range(order):
            d, series = steps(d), series.shorter
        if marks is not None:
            lost = np.lib.stride_tricks.sliding_window_view(np.pad(marks[at], (0, order)), order + 1)
            valid = lost[:, -1] == lost[:, 0] if rule == "span" else ~lost.any(axis=1)
            d, count[part] = np.where(valid, d, 0.0), series.sums(valid.astype(np.int64))
        total[part] = series.sums(d * d)
    return total, count
