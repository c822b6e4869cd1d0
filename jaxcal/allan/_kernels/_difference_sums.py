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
from ._phase import BLOCK, LANE

_SHORT, _SUMS = (
    512,
    16,
)  # points per vector operation for a record that stays in the cache, two of them unrolled; sums for each of its cluster sizes

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


def _valid(missing, take, order: int, rule: str, less, m, start):
    """Which differences touch no missing sample ("span": every sample in reach; "points": only the phase points used)."""
    if rule == "points":
        used = [take(missing, j) for j in range(order + 1)]
        return sum(used[1:], used[0]) == 0
    last = take(missing, order, less)
    return last == take(missing, 0)


@functools.partial(jax.jit, static_argnames=("order", "rule"), compiler_options=WIDE)
def block_sums(
    parts: Parts,
    missing: Int[Array, " padded"] | None,
    m: Int[Array, " clusters"],
    count: Int[Array, " clusters"],
    first: Int[Array, ""],
    last: Int[Array, ""],
    less: Int[Array, ""],
    *,
    order: int,
    rule: str,
) -> tuple[Float[Array, " clusters"], Int[Array, " clusters"]]:
    """Sum of squared differences, and the number of valid ones, over the blocks first..last-1 of starting points.

    Every cluster size visits a block of starting points before the next block is loaded. `m` is ascending and `count` (number of
    differences in the whole record) descending. So the cluster sizes for which a block is full come first, then those for which the end
    of the record cuts it. Both are data: nothing here depends on the length of the record. The differences are those of the sum of
    `parts` (phase, or high and low part of its running sum). For rule "span", `missing` is the number of missing samples before each
    point, and the reach is shorter than order * m by `less`; for rule "points" it is 1 where a point is missing.
    """
    clusters = m.shape[0]

    def lane(start, j, limit):
        """Squares over one lane, and which are valid; `limit` cuts the lane at the end of the record."""
        size = m[j]

        def take(array, shift, back=0):
            return lax.dynamic_slice(array, (start + shift * size - back,), (LANE,))

        d = difference_of(parts, take, order)
        keep = None
        if rule != "none":
            keep = _valid(missing, take, order, rule, less, size, start)
        if limit is not None:
            inside = start + jnp.arange(LANE) < limit
            keep = inside if keep is None else keep & inside
        if keep is None:
            return d * d, jnp.ones(LANE, jnp.int32)
        # the points beyond the record are arbitrary (they may be NaN), so select before squaring
        d = jnp.where(keep, d, 0.0)
        return d * d, keep.astype(jnp.int32)

    def block(index, carry):
        start = index * BLOCK
        full = jnp.sum(start + BLOCK <= count)
        begun = jnp.sum(start < count)

        def whole(j, carry):
            squares, valid = carry
            pieces = [lane(start + q * LANE, j, None) for q in range(BLOCK // LANE)]
            squares = squares.at[j].add(functools.reduce(operator.add, [p[0] for p in pieces]))
            if rule == "none":
                return squares, valid
            kept = functools.reduce(operator.add, [p[1] for p in pieces])
            return squares, valid.at[j].add(jnp.sum(kept).astype(valid.dtype))

        def cut(j, carry):
            squares, valid = carry

            def piece(q, carry):
                squares, valid = carry
                total, kept = lane(start + q * LANE, j, count[j])
                squares = squares.at[j].add(total)
                return squares, valid if rule == "none" else valid.at[j].add(jnp.sum(kept).astype(valid.dtype))

            return lax.fori_loop(0, (count[j] - start + LANE - 1) // LANE, piece, (squares, valid))

        carry = lax.fori_loop(0, full, whole, carry)
        return lax.fori_loop(full, begun, cut, carry)

    zero = (jnp.zeros((clusters, LANE), parts[0].dtype), jnp.zeros(clusters, count.dtype))
    squares, valid = lax.fori_loop(first, last, block, zero)
    if rule == "none":
        valid = jnp.clip(count - first * BLOCK, 0, (last - first) * BLOCK).astype(count.dtype)
    return jnp.sum(squares, axis=1), valid


@functools.partial(stored_jit, static_argnames=("order",), compiler_options=WIDE)
@one_kernel
def cached_sums(
    parts: Parts, m: Int[Array, " rows"], count: Int[Array, " rows"], *, order: int
) -> Float[Array, " rows"]:  # fmt: skip
    """`block_sums` for a record without gaps that stays in the second-level cache as a whole; `m` is ascending, `count` descending.

    Blocks are short, so that their starting points stay in the first-level cache for all cluster sizes. The squares of a block are added
    in halves to 16 sums per cluster size, because in a plain sum each addition waits for the one before. The number of cluster sizes is
    data too: rows with a count of 0 cost nothing.
    """
    width = 2 * _SHORT

    def block(index, sums):
        start = index * width

        def squares(at, size, limit):
            def take(array, shift):
                return lax.dynamic_slice(array, (at + shift * size,), (_SHORT,))

            d = difference_of(parts, take, order)
            if limit is not None:
                d = jnp.where(at + jnp.arange(_SHORT) < limit, d, 0.0)
            return d * d

        def row(j, sums, limit=None):
            total = squares(start, m[j], limit) + squares(start + _SHORT, m[j], limit)
            old = lax.dynamic_slice(sums, (j, 0), (1, _SUMS))
            return lax.dynamic_update_slice(sums, old + _halved(total, _SUMS)[None], (j, 0))

        full, begun = jnp.sum(start + width <= count), jnp.sum(start < count)
        sums = lax.fori_loop(0, full, row, sums)
        return lax.fori_loop(full, begun, lambda j, sums: row(j, sums, count[j]), sums)

    blocks = (count[0] + width - 1) // width
    return _halved(lax.fori_loop(0, blocks, block, jnp.zeros((len(m), _SUMS), parts[0].dtype)), 1)[:, 0]


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

    Reverse mode cannot follow the loops of the block kernel, whose length depends on the data. This function serves traced records, and
    the block kernel is tested against it.
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
            keep = keep & _valid(missing, take, order, rule, less, size, 0)
        d = jnp.where(keep, difference_of(parts, take, order), 0.0)
        return jnp.sum(d * d), jnp.sum(keep)

    return lax.map(one, (m, count))
