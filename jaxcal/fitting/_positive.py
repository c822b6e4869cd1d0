"""Small positive definite systems, by elimination."""

import jax
import jax.numpy as jnp

from .._types import Array


def solve_positive(matrix: Array, side: Array) -> tuple[Array, Array]:
    """Solution of a symmetric positive definite (p, p) system, and its pivots.

    With a unit diagonal a pivot is the part of its column that the columns before it do not explain. Elimination without
    pivoting is stable here. It is written out because a batch of LAPACK factorisations next to another one can hang on a CPU
    (jaxlib 0.10), and is slower for a handful of unknowns.
    """
    p = side.size
    rows = jnp.arange(p)[:, None]

    def eliminate(k: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        table, pivots = carry
        row = table[k] / table[k, k]
        return jnp.where(rows == k, row[None, :], table - table[:, k][:, None] * row[None, :]), pivots.at[k].set(table[k, k])

    table, pivots = jax.lax.fori_loop(0, p, eliminate, (jnp.concatenate([matrix, side[:, None]], axis=1), jnp.zeros_like(side)))
    return table[:, p], pivots
