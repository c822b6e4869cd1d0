"""Phase: the running sum of a record, and the running sum of phase, block by block and without loss."""

import functools

import jax
import jax.numpy as jnp
from jax import lax

from .._types import Array, Float, Int

#: samples summed at a time; the padding of every record is at least this
BLOCK = 8192
_ROW = 32  # a row is summed by a product with a triangle of ones, which is what processors do best


def padded_length(samples: int) -> int:
    """Length of the bucket (a power of two) for a record: kernels compile once per bucket, not once per length."""
    return 1 << max(samples + 2 + BLOCK - 1, 1).bit_length()


def _running(block: Float[Array, " n"]) -> Float[Array, " n"]:
    """Inclusive running sum of a block whose length is a power of `_ROW` or below it."""
    if block.shape[0] <= _ROW:
        return jnp.cumsum(block)
    triangle = jnp.triu(jnp.ones((_ROW, _ROW), block.dtype))
    rows = block.reshape(-1, _ROW) @ triangle
    before = _running(rows[:, -1]) - rows[:, -1]
    return (rows + before[:, None]).reshape(-1)


@functools.partial(jax.jit, donate_argnums=0)
def phase_from_rate(
    buffer: Float[Array, " padded"], values: Float[Array, " padded"], mean: Float[Array, ""], samples: Int[Array, ""]
) -> Float[Array, " padded"]:
    """theta_k = sum_{t<k} (x_t - mean), k = 0..samples, in units of samples; missing samples (NaN) add nothing.

    Writes into `buffer`; what lies beyond theta_samples is arbitrary. Subtracting the mean first keeps the sum small: the
    statistics do not see it.
    """

    def step(index, carry):
        theta, last = carry
        start = index * BLOCK
        x = lax.dynamic_slice(values, (start,), (BLOCK,)) - mean
        x = jnp.where(jnp.isnan(x) | (start + jnp.arange(BLOCK) >= samples), 0.0, x)
        total = last + _running(x)
        # theta_0 = 0 stands before the first sum, hence the shift by one
        return lax.dynamic_update_slice(theta, total, (start + 1,)), total[-1]

    blocks = (samples + BLOCK - 1) // BLOCK
    theta = buffer.at[0].set(0.0)
    return lax.fori_loop(0, blocks, step, (theta, jnp.zeros((), values.dtype)))[0]


def _two_sum(a, b):
    """Sum a + b as the rounded sum and what rounding lost (Knuth, TAOCP 2, 4.2.2)."""
    total = a + b
    shadow = total - a
    return total, (a - (total - shadow)) + (b - shadow)


def _two_product(a, b):
    """Product a * b as the rounded product and what rounding lost (Dekker 1971, splitting without fused multiply-add)."""
    split = 2.0**27 + 1.0 if a.dtype == jnp.float64 else 2.0**12 + 1.0
    split = jnp.asarray(split, a.dtype)
    ca, cb = split * a, split * b
    a_hi, b_hi = ca - (ca - a), cb - (cb - b)
    a_lo, b_lo = a - a_hi, b - b_hi
    product = a * b
    return product, ((a_hi * b_hi - product) + a_hi * b_lo + a_lo * b_hi) + a_lo * b_lo


def _double_add(x, y):
    hi, lo = _two_sum(x[0], y[0])
    return _two_sum(hi, lo + x[1] + y[1])


@jax.jit
def running_sum_of_phase(theta: Float[Array, " padded"]) -> tuple[Float[Array, " padded"], Float[Array, " padded"]]:
    """C_k = sum_{i<k} theta_i as an unevaluated sum of two numbers (high, low).

    C grows like n^(5/2) on a random walk of rate, and its third difference at m = 1 is of the size of one sample: a single
    float64 loses it (relative error above 1 at n = 10^7). Within a row the sum is split exactly into
    C_row + i theta_row + sum (theta - theta_row), whose last part is small.
    """
    rows = theta.reshape(-1, _ROW)
    first = rows[:, :1]
    local = rows - first
    inside = jnp.cumsum(local, axis=1)
    width = jnp.asarray(float(_ROW), theta.dtype)
    total = _double_add(_two_product(jnp.broadcast_to(width, first[:, 0].shape), first[:, 0]), (inside[:, -1], jnp.zeros_like(first[:, 0])))
    sums = lax.associative_scan(_double_add, total)
    start = tuple(jnp.concatenate([jnp.zeros(1, theta.dtype), part[:-1]])[:, None] for part in sums)
    index = jnp.broadcast_to(jnp.arange(_ROW).astype(theta.dtype)[None, :], rows.shape)
    line = _two_product(index, jnp.broadcast_to(first, rows.shape))
    before = jnp.concatenate([jnp.zeros_like(first), inside[:, :-1]], axis=1)
    hi, lo = _double_add(start, _double_add(line, (before, jnp.zeros_like(before))))
    return hi.reshape(-1), lo.reshape(-1)
