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
#: starting points that all cluster sizes visit before the next ones
TILE = 16 * BLOCK
#: from this cluster size on, differences of so many clusters next to one another share points, in strips: memory is read half as often
_WIDE, _ROWS, _STRIP = BLOCK, 4, 4 * _SUMS

Parts = tuple[Float[Array, " padded"], ...]


def differences_of(parts: Parts, take, order: int, rows: int = 1):
    """Differences of `order` of the sum of `parts`, in each row: formed from neighbouring points so that large values cancel early."""
    differences = []
    for part in parts:
        points = [take(part, j) for j in range(order + rows)]
        for _ in range(order):
            points = [b - a for a, b in itertools.pairwise(points)]
        differences.append(points)
    return [functools.reduce(operator.add, row) for row in zip(*differences, strict=True)]


def _valid(missing, take, order: int, rule: str, less: int):
    """Which differences touch no missing sample ("span": every sample in reach; "points": only the phase points used)."""
    if rule == "points":
        used = [take(missing, j) for j in range(order + 1)]
        return sum(used[1:], used[0]) == 0
    last = take(missing, order, less)
    return last == take(missing, 0)


@functools.partial(stored_jit, static_argnames=("order", "rule", "less", "shared"), compiler_options=WIDE)
@one_kernel
def block_sums(
    parts: Parts,
    missing: Int[Array, " padded"] | None,
    m: Int[Array, " clusters"],
    count: Int[Array, " clusters"],
    tiles: Int[Array, " 2"],
    *,
    order: int,
    rule: str = "none",
    less: int = 0,
    shared: bool = False,
) -> tuple[Array, ...]:
    """Sum of squared differences and, in a record with gaps, the number of valid ones, (clusters,), over a range of tiles.

    Every cluster size visits a block of starting points, which stays in the first-level cache, before the next block is loaded. `m` is
    ascending and `count` (number of differences in the whole record) descending. So the cluster sizes for which a block is full come
    first, then those for which the end of the record cuts it. Both are data, as are the first tile and the one after the last: nothing
    here depends on the length of the record, and rows with a count of 0 cost nothing. The differences are those of the sum of
    `parts` (phase, or high and low part of its running sum). For rule "span", `missing` is the number of missing samples before each
    point, and the reach is shorter than order * m by `less`; for rule "points" it is 1 where a point is missing. If points are `shared`,
    large cluster sizes of a record beyond the cache take half of the time.
    """
    shared = shared and rule == "none"

    def lane(at, size, length, limit=None):
        """Squares at some starting points, and which are valid; `limit` cuts them at the end of the record."""

        def take(array, shift, back=0):
            return lax.dynamic_slice(array, (at + shift * size - back,), (length,), allow_negative_indices=False)

        (d,) = differences_of(parts, take, order)
        keep = None if rule == "none" else _valid(missing, take, order, rule, less)
        if limit is not None:
            inside = at + lax.iota(m.dtype, length) < limit
            keep = inside if keep is None else keep & inside
        if keep is None:
            return (d * d,)
        d = jnp.where(keep, d, 0.0)  # before squaring: the points beyond the record are arbitrary (they may be NaN)
        return (d * d,) if rule == "none" else (d * d, keep.astype(d.dtype))

    def block(start, few, tables):
        def row(j, tables):
            halves = (lane(at, m[j], _SHORT) for at in (start, start + _SHORT))
            return tuple(_added(table, j, one + other) for table, one, other in zip(tables, *halves, strict=True))

        def last(j, tables):
            def strip(i, tables):
                sums = lane(start + i * _STRIP, m[j], _STRIP, count[j])
                return tuple(_added(table, j, new) for table, new in zip(tables, sums, strict=True))

            return lax.fori_loop(0, _up(count[j] - start, _STRIP), strip, tables)

        full, begun = (jnp.minimum(few, jnp.sum(stop <= count)) for stop in (start + BLOCK, start + 1))
        tables = lax.fori_loop(0, full, row, tables)
        return tables if shared else lax.fori_loop(full, begun, last, tables)

    def group(at, size, number, sums):
        """Add the squares at the starting points of neighbouring clusters, from `at` on: one row for each cluster."""

        def strip(i, sums, cut=False):
            start = at + i * _STRIP

            def take(array, shift):
                return lax.dynamic_slice(array, (start + shift * size,), (_STRIP,), allow_negative_indices=False)

            rows = differences_of(parts, take, order, _ROWS)
            if cut:
                lane, zero = start + lax.iota(m.dtype, _STRIP), jnp.zeros(_STRIP, sums.dtype)
                ends = (lax.min(at + size, number - row * size) for row in range(_ROWS))
                rows = [lax.select(lane < end, d, zero) for d, end in zip(rows, ends, strict=True)]
            return sums + _halved(functools.reduce(operator.add, (d * d for d in rows)), _SUMS)

        whole = lax.select(at + _ROWS * size <= number, lax.div(size, jnp.full_like(size, _STRIP)), jnp.zeros_like(size))
        sums = lax.fori_loop(0, whole, strip, sums)
        return lax.fori_loop(whole, _up(lax.min(size, number - at), _STRIP), functools.partial(strip, cut=True), sums)

    def tile(index, tables):
        start = index * TILE

        def cluster(j, tables):
            size, number = m[j], count[j]
            # of a small cluster size, the whole blocks are done
            done = lax.select(j < few, number - lax.rem(number, jnp.full_like(number, BLOCK)), jnp.zeros_like(number))
            first, last = (lax.max(edge - done, jnp.zeros_like(done)) for edge in (start, lax.min(number, start + TILE)))
            add, none = lambda i, sums: group(done + i * _ROWS * size, size, number, sums), jnp.zeros(_SUMS, tables[0].dtype)
            return (_added(tables[0], j, lax.fori_loop(_up(first, _ROWS * size), _up(last, _ROWS * size), add, none)),)

        few = jnp.sum(m < _WIDE) if shared else len(m)
        begun = _up(lax.clamp(jnp.zeros_like(start), count[0] - start, jnp.full_like(start, TILE)), BLOCK)
        tables = lax.fori_loop(0, begun, lambda i, tables: block(start + i * BLOCK, few, tables), tables)
        return lax.fori_loop(0, jnp.sum(start < count), cluster, tables) if shared else tables

    zero = jnp.zeros((len(m), _SUMS), parts[0].dtype)
    tables = lax.fori_loop(tiles[0], tiles[1], tile, (zero,) if rule == "none" else (zero, zero))
    return tuple(_halved(table, 1)[:, 0] for table in tables)


def _up(number, step):
    """Number of steps that reach a number, which is not negative."""
    return lax.div(number + (step - 1), jnp.asarray(step, number.dtype))


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
        d = jnp.where(keep, differences_of(parts, take, order)[0], 0.0)
        return jnp.sum(d * d), jnp.sum(keep)

    return lax.map(one, (m, count))
