"""Groups of neighbouring ordinates, whose averages make a spectrum of few and precise values.

A grouping is a pair of arrays (start, count): index of the first ordinate of each group, from 0, and number of ordinates. Ordinate
0 is the first above zero frequency, which the tables number 1. With `keep_tail` the last group is kept even if the ordinates do not
fill it.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from .._types import Any, Int

Groups = tuple[Int[np.ndarray, " groups"], Int[np.ndarray, " groups"]]

_OCTAVE_SINGLE = 32
_LOG_SINGLE, _PER_DECADE = 48, 40


@functools.lru_cache(maxsize=64)
def single_groups(ordinates: int, *, keep_tail: bool = False) -> Groups:
    """Groups of a single ordinate each."""
    return _cut(np.arange(ordinates + 1), ordinates, keep_tail)


@functools.lru_cache(maxsize=64)
def octave_groups(ordinates: int, *, keep_tail: bool = False) -> Groups:
    """Ordinates 1-32 single; then each octave 2^k+1 .. 2^(k+1) in 16 groups of 2^(k-4): thesis Table 5.1."""
    edges, first = [np.arange(_OCTAVE_SINGLE)], _OCTAVE_SINGLE
    while first < ordinates:
        edges.append(np.arange(first, 2 * first, first // 16))
        first *= 2
    return _cut(np.append(np.concatenate(edges), first), ordinates, keep_tail)


@functools.lru_cache(maxsize=64)
def log_groups(ordinates: int, *, keep_tail: bool = False) -> Groups:
    """Ordinates 1-48 single, then 40 groups per decade."""
    decades = np.log10(max(ordinates / _LOG_SINGLE, 1.0))
    beyond = _LOG_SINGLE * 10.0 ** (np.arange(int(np.ceil(decades * _PER_DECADE)) + 2) / _PER_DECADE)
    return _cut(np.append(np.arange(_LOG_SINGLE), np.round(beyond).astype(np.int64)), ordinates, keep_tail)


#: name of an average -> its groups
GROUPS = {None: single_groups, "octave": octave_groups, "log": log_groups}


def _cut(edges: np.ndarray, ordinates: int, keep_tail: bool) -> Groups:
    """The groups between `edges` that begin within the ordinates; an incomplete last group is kept with its true count, or dropped."""
    begun = np.count_nonzero(edges < ordinates)
    start, full = edges[:begun].astype(np.int64), np.diff(edges)[:begun]
    count = np.minimum(start + full, ordinates) - start
    kept = slice(None) if keep_tail else count == full
    start, count = start[kept], count[kept]
    start.flags.writeable = count.flags.writeable = False
    return start, count


def average(values: Any, groups: Groups) -> Any:
    """Means over the groups along the last axis; ordinates after the last group are left out."""
    start, count = groups
    values = values[..., : start[-1] + count[-1]]
    if count.max() == 1:
        return values
    if isinstance(values, np.ndarray):
        return np.add.reduceat(values, start, axis=-1) / count
    group = np.repeat(np.arange(len(start)), count)
    sums = jax.ops.segment_sum(jnp.moveaxis(values, -1, 0), group, num_segments=len(start), indices_are_sorted=True)
    return jnp.moveaxis(sums, 0, -1) / jnp.asarray(count, dtype=values.dtype).reshape((1,) * (values.ndim - 1) + (-1,))
