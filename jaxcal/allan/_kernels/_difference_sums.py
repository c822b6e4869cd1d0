"""Sums of squared differences at many cluster sizes, in one pass over blocks that stay in the cache."""

import functools
import itertools
import operator

import jax
import jax.numpy as jnp
from jax import lax

from ..._compile import one_kernel, stored_jit
from ..._jax import WIDE
from ..._types import Array, Float, Int
from ._phase import BLOCK

#: points of a vector operation, two of which make a block, and sums for each cluster size, since a sum waits for the one before
_SHORT, _SUMS = BLOCK // 2, 16

Parts = tuple[Float[Array, " padded"], ...]


def difference_of(parts: Parts, take, order: int):
    """Difference of `order` of the sum of `parts`, formed from neighbouring points first so that large values cancel early."""
    differences = []
    for part in parts:
        points = [take(part, j) for j in range(order + 1)]
        while len(points) > 1:
            points = [b - a for a, b in itertools.pairwise(points)]
        differences.append(points[0])
    return functools.reduce(operator.add, differences)


def _valid(missing, take, order: int, rule: str, less: int):
    """Which differences touch no missing sample ("span": every sample in reach; "points": only the phase points used)."""
    if rule == "points":
        used = [take(missing, j) for j in range(order + 1)]
        return sum(used[1:], used[0]) == 0
    last = take(missing, order, less)
    return last == take(missing, 0)


@functools.partial(stored_jit, static_argnames=("order", "rule", "less"), compiler_options=WIDE)
@one_kernel
def block_sums(
    parts: Parts,
    missing: Int[Array, " padded"] | None,
    m: Int[Array, " clusters"],
    count: Int[Array, " clusters"],
    blocks: Int[Array, " 2"],
    *,
    order: int,
    rule: str = "none",
    less: int = 0,
) -> tuple[Array, ...]:
    """Sum of squared differences and, in a record with gaps, the number of valid ones, (clusters,), over a range of blocks.

    Every cluster size visits a block of starting points, which stays in the first-level cache, before the next block is loaded. `m` is
    ascending and `count` (number of differences in the whole record) descending. So the cluster sizes for which a block is full come
    first, then those for which the end of the record cuts it. Both are data, as are the first block and the one after the last: nothing
    here depends on the length of the record, and rows with a count of 0 cost nothing. The differences are those of the sum of
    `parts` (phase, or high and low part of its running sum). For rule "span", `missing` is the number of missing samples before each
    point, and the reach is shorter than order * m by `less`; for rule "points" it is 1 where a point is missing.
    """

    def lane(at, size, limit):
        """Squares at some starting points, and which are valid; `limit` cuts them at the end of the record."""

        def take(array, shift, back=0):
            return lax.dynamic_slice(array, (at + shift * size - back,), (_SHORT,))

        d = difference_of(parts, take, order)
        keep = None if rule == "none" else _valid(missing, take, order, rule, less)
        if limit is not None:
            inside = at + jnp.arange(_SHORT) < limit
            keep = inside if keep is None else keep & inside
        if keep is None:
            return (d * d,)
        d = jnp.where(keep, d, 0.0)  # before squaring: the points beyond the record are arbitrary (they may be NaN)
        return (d * d,) if rule == "none" else (d * d, keep.astype(d.dtype))

    def block(index, tables):
        start = index * BLOCK

        def row(j, tables, limit=None):
            halves = (lane(at, m[j], limit) for at in (start, start + _SHORT))
            return tuple(_added(table, j, one + other) for table, one, other in zip(tables, *halves, strict=True))

        full, begun = jnp.sum(start + BLOCK <= count), jnp.sum(start < count)
        tables = lax.fori_loop(0, full, row, tables)
        return lax.fori_loop(full, begun, lambda j, tables: row(j, tables, count[j]), tables)

    zero = jnp.zeros((len(m), _SUMS), parts[0].dtype)
    tables = lax.fori_loop(blocks[0], blocks[1], block, (zero,) if rule == "none" else (zero, zero))
    return tuple(_halved(table, 1)[:, 0] for table in tables)


def _added(table, j, values):
    """The table with values added to its row j, in halves."""
    old = lax.dynamic_slice(table, (j, 0), (1, _SUMS))
    return lax.dynamic_update_slice(table, old + _halved(values, _SUMS)[None], (j, 0))


def _halved(values, length: int):
    """Sums of the last axis in halves, until only `length` are left."""
    while values.shape[-1] > length:
        half = values.shape[-1] // 2
        values = values[..., :half] + values[..., half:]
    return values


@functools.partial(jax.jit, static_argnames=("less", "order", "strided", "rule"))
def direct_sums(
    parts: Parts,
    missing: Int[Array, " points"] | None,
    m: Int[Array, " clusters"],
    count: Int[Array, " clusters"],
    less: int,
    *,
    order: int,
    strided: bool,
    rule: str,
) -> tuple[Float[Array, " clusters"], Int[Array, " clusters"]]:
    """The sums of `block_sums`, one cluster size at a time over the whole record: simple, and differentiable in both directions.

    Reverse mode cannot follow the loops of the block kernel, whose length depends on the data. This function serves traced records and
    graphics cards, and the block kernel is tested against it.
    """
    points = parts[0].shape[0]
    index = jnp.arange(points)

    @jax.checkpoint
    def one(args):
        size, number = args

        def take(array, shift, back=0):
            where = index * (size if strided else 1) + shift * size - back
            return array[jnp.clip(where, 0, array.shape[0] - 1)]

        keep = index < number
        if rule != "none":
            keep = keep & _valid(missing, take, order, rule, less)
        d = jnp.where(keep, difference_of(parts, take, order), 0.0)
        return jnp.sum(d * d), jnp.sum(keep)

    return lax.map(one, (m, count))
