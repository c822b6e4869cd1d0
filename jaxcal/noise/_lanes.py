"""Solve many small problems of the same shape: as lanes of one compiled program on the host, one after another in a trace.

Such problems are the fits from several starts, in several bands, for several correlation times, and along likelihood profiles. On the
host they are padded to batches of a fixed size, so that one compilation serves every fit; the loops around them are NumPy. In a trace
the same functions run in `jax.numpy`.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._arrays import namespace
from .._compile import filter_jit

_LANES = 16


@filter_jit
def _first(one: Callable[..., Any], shared: Any, lanes: Any, count: Any, found: Any) -> Any:
    """Solve the first `count` lanes and store the results in `found`; padded lanes cost nothing."""

    def body(k, found):
        new = one(shared, jax.tree.map(lambda leaf: leaf[k], lanes))
        return jax.tree.map(lambda all_, value: all_.at[k].set(value), found, new)

    return jax.lax.fori_loop(0, count, body, found)


def filled(array: Any, *shape: int, at: Any = 0, value: Any = 0) -> np.ndarray:
    """Pad an array to `shape` with `value`; its first element goes to the index `at`. Ten times as fast as `np.pad`."""
    found = np.full(shape, value, dtype=array.dtype)
    where = at if isinstance(at, tuple) else (at,) * array.ndim
    found[tuple(slice(first, first + size) for first, size in zip(where, array.shape, strict=True))] = array
    return found


def whole(count: int) -> int:
    """Number of lanes of the calls of the compiled program that compute so many."""
    return -(-count // _LANES) * _LANES


def run(one: Callable[..., Any], shared: Any, lanes: Any, like: Any, count: int | None = None) -> Any:
    """Compute `one(shared, lane)` for every lane, or for the first `count` of them.

    Lanes are the first axis of `lanes` and of the result; `like` is one lane of a result. Arrays with `whole` lanes are not copied.
    """
    if namespace(shared, lanes) is jnp:
        # one at a time: under vmap a branch on data would evaluate both sides and their derivatives, and programs with batches of
        # LAPACK calls have hung on CPUs
        return jax.lax.map(partial(one, shared), lanes)
    total, parts = len(jax.tree.leaves(lanes)[0]) if count is None else count, []
    none = jax.tree.map(lambda leaf: np.zeros((_LANES, *np.shape(leaf)), np.result_type(leaf)), like)
    for k in range(0, total, _LANES):
        some = min(total - k, _LANES)
        part = jax.tree.map(lambda leaf: _part(leaf[k : k + _LANES]), lanes)  # noqa: B023
        found = _first(one, shared, part, np.asarray(some), none)
        parts.append(jax.tree.map(lambda leaf: np.asarray(leaf)[:some], found))  # noqa: B023
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def _part(leaf: Any) -> Any:
    return leaf if len(leaf) == _LANES else filled(leaf, _LANES, *leaf.shape[1:])


def inverse(matrix: Any) -> Any:
    """Inverse of a positive semidefinite (p, p) matrix whose rows may differ by many powers of ten; rows of zeros stay zero."""
    xp = namespace(matrix)
    diagonal = xp.diagonal(matrix)
    there = diagonal > 0.0
    scale = xp.sqrt(xp.where(there, diagonal, 1.0))
    unit = matrix / scale[:, None] / scale[None, :] + xp.diag(xp.where(there, 0.0, 1.0))
    return xp.where(there[:, None] & there[None, :], xp.linalg.inv(unit) / scale[:, None] / scale[None, :], 0.0)
