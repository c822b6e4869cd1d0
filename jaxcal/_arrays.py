"""Small pieces of array work that many modules share: runs of flags, lengths of buckets, NumPy or `jax.numpy`."""

from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer


def runs(flags: Any) -> tuple[np.ndarray, np.ndarray]:
    """First index, and index after the last, of each run of True.

    Examples
    --------
    >>> from jaxcal._arrays import runs
    >>> starts, stops = runs([True, True, False, True])
    >>> starts.tolist(), stops.tolist()
    ([0, 3], [2, 4])
    """
    edges = np.flatnonzero(np.diff(np.asarray(flags, dtype=np.int8), prepend=0, append=0))
    return edges[::2], edges[1::2]


def longest_run(flags: Any) -> tuple[int, int]:
    """First index, and index after the last, of the longest run of True, the first of several; (0, 0) without any."""
    starts, stops = runs(flags)
    if not len(starts):
        return 0, 0
    longest = int(np.argmax(stops - starts))
    return int(starts[longest]), int(stops[longest])


def power_of_two(count: int, least: int = 1) -> int:
    """Smallest power of two that is at least `count`, but not below `least`: arrays padded to it share compiled programs."""
    return max(1 << max(count - 1, 0).bit_length(), least)


def namespace(*trees: Any, concrete: bool = False) -> ModuleType:
    """`jax.numpy` if a leaf is traced (or, with `concrete`, any array of JAX), otherwise `numpy`.

    `_precision.array_module` also detects a trace in progress that touches none of the leaves, which takes longer.
    """
    kind = jax.Array if concrete else Tracer
    return jnp if any(isinstance(leaf, kind) for leaf in jax.tree.leaves(trees)) else np
