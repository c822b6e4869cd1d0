"""Fits side by side: lanes of one compiled program on the host, one after another in a trace.

Attempts, bands, correlation times and profiles are small problems of one shape. On the host a batch of them is filled up to a fixed
number, so that one compilation serves every fit; the loops around are NumPy. In a trace the same functions run in `jax.numpy`.
"""

from collections.abc import Callable
from functools import partial
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._compile import jit

_LANES = 16


def namespace(*trees: Any) -> ModuleType:
    """`jax.numpy` where a leaf is traced, otherwise `numpy`: cheaper than `array_module`, which also asks for a trace in progress."""
    return jnp if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(trees)) else np


@partial(jit, static_argnums=0)
def _first(one: Callable[..., Any], shared: Any, lanes: Any, count: Any, found: Any) -> Any:
    """The first `count` of the lanes, put into `found`; the others cost nothing."""

    def body(k, found):
        new = one(shared, jax.tree.map(lambda leaf: leaf[k], lanes))
        return jax.tree.map(lambda all_, value: all_.at[k].set(value), found, new)

    return jax.lax.fori_loop(0, count, body, found)


def run(one: Callable[..., Any], shared: Any, lanes: Any, like: Any) -> Any:
    """`one(shared, lane)` of every lane; lanes are the first axis of `lanes` and of the result, whose lanes look `like` this."""
    if namespace(shared, lanes) is jnp:
        # one at a time: a branch on data would become a choice between both under vmap, with the derivatives of both, and
        # batches of LAPACK calls in one program have hung on CPUs
        return jax.lax.map(partial(one, shared), lanes)
    total, parts = len(jax.tree.leaves(lanes)[0]), []
    none = jax.tree.map(lambda leaf: np.zeros((_LANES, *np.shape(leaf)), np.result_type(leaf)), like)
    for k in range(0, total, _LANES):
        count = min(total - k, _LANES)
        part = jax.tree.map(lambda leaf: np.pad(leaf[k : k + count], ((0, _LANES - count), *((0, 0),) * (leaf.ndim - 1))), lanes)  # noqa: B023
        found = _first(one, shared, part, np.asarray(count), none)
        parts.append(jax.tree.map(lambda leaf: np.asarray(leaf)[:count], found))  # noqa: B023
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def iterate(going: Callable[[Any], Any], body: Callable[[Any], Any], state: Any) -> Any:
    """A while loop: of the compiled program in a trace, of Python on the host."""
    if namespace(state) is jnp:
        return jax.lax.while_loop(going, body, state)
    while going(state):
        state = body(state)
    return state


def some(lanes: Any, function: Callable[..., Any], otherwise: Any, *arguments: Any) -> Any:
    """`function` of the arguments in the lanes named, `otherwise` in the others: on the host for the named ones alone.

    Parameters
    ----------
    lanes : (lanes,) True where wanted.
    function : of arrays with lanes first, to a tree of such arrays.
    otherwise : tree like its result.
    """

    def chosen(new, old):
        return jnp.where(lanes.reshape(-1, *(1,) * (jnp.ndim(new) - 1)), new, old)

    if namespace(lanes, otherwise, arguments) is jnp:
        return jax.tree.map(chosen, function(*arguments), otherwise)
    index = np.flatnonzero(lanes)
    if not index.size:
        return otherwise

    def scattered(new, old):
        out = np.array(old)
        out[index] = new
        return out

    return jax.tree.map(scattered, function(*(np.asarray(one)[index] for one in arguments)), otherwise)


def inverse(matrix: Any) -> Any:
    """Inverse of a positive semidefinite (p, p) matrix whose rows differ by many powers of ten; rows of zeros stay zero."""
    xp = namespace(matrix)
    diagonal = xp.diagonal(matrix)
    there = diagonal > 0.0
    scale = xp.sqrt(xp.where(there, diagonal, 1.0))
    unit = matrix / scale[:, None] / scale[None, :] + xp.diag(xp.where(there, 0.0, 1.0))
    return xp.where(there[:, None] & there[None, :], xp.linalg.inv(unit) / scale[:, None] / scale[None, :], 0.0)
