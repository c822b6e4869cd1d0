"""Phase of a record and its running sum without loss of digits, and the buckets of length that all kernels share."""

import functools
import itertools
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jax import lax

from ..._arrays import running_sum
from ..._compile import one_kernel, stored_jit
from ..._jax import WIDE
from ..._types import Array, Float

#: number of starting points that all cluster sizes visit in turn, and padding of every record; they stay in the first-level cache
BLOCK = 1024
#: number of points that stay in the second-level cache (2 MB)
IN_CACHE = 1 << 18
_ROW = 32  # points of a row of the running sum of phase, within which it is split exactly


def padded_length(samples: int) -> int:
    """Padded length for a record, a power of two plus a block: kernels compile once per bucket, not once per length."""
    return max(1 << samples.bit_length(), BLOCK) + BLOCK


def integrate(values, out, run: Callable = map, parts: int = 1) -> bool:
    """Running sum of the values minus their mean, from 0, into `out` (one longer); False, with `out` undefined, if one is not finite.

    The mean is subtracted first, so that the sum stays small and keeps its digits; its rounding error is a line in the phase, and the
    statistics depend on neither. `run` maps a function over parts of the record, in threads if it belongs to a pool.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.allan._kernels._phase import integrate
    >>> y, one, three = np.arange(10.0), np.empty(11), np.empty(11)
    >>> integrate(y, one), integrate(y, three, parts=3), bool((one == three).all()), one[5:7].tolist()
    (True, True, True, [-12.5, -12.0])
    """
    first, edges = float(values[0]), [len(values) * part // parts for part in range(parts + 1)]
    spans = [slice(*ends) for ends in itertools.pairwise(edges)]
    total = sum(float(one) for one in run(lambda span: np.add.reduce(values[span]), spans))
    # use no more binary places than the first value has, so that the differences of a coarse record are exact
    mean = first + (total / len(values) - first)
    if not np.isfinite(mean):
        return False
    out[0], after = 0.0, out[1:]
    list(run(lambda span: running_sum(values[span], mean, after[span]), spans))
    for span in spans[1:]:
        after[span] += out[span.start]
    return True


def _two_sum(a, b):
    """Sum a + b as the rounded sum and its rounding error (Knuth, TAOCP 2, 4.2.2)."""
    total = a + b
    shadow = total - a
    return total, (a - (total - shadow)) + (b - shadow)


def _two_product(a, b):
    """Product a * b as the rounded product and its rounding error (Dekker 1971, splitting without fused multiply-add)."""
    split = 2.0**27 + 1.0 if a.dtype == jnp.float64 else 2.0**12 + 1.0
    split = jnp.asarray(split, a.dtype)
    ca, cb = split * a, split * b
    a_hi, b_hi = ca - (ca - a), cb - (cb - b)
    a_lo, b_lo = a - a_hi, b - b_hi
    product = a * b
    return product, ((a_hi * b_hi - product) + a_hi * b_lo + a_lo * b_hi) + a_lo * b_lo


def double_add(x, y):
    """Sum of two unevaluated sums of two numbers."""
    hi, lo = _two_sum(x[0], y[0])
    return _two_sum(hi, lo + x[1] + y[1])


@functools.partial(stored_jit, compiler_options=WIDE)
@one_kernel
def running_sum_of_phase(theta: Float[Array, " padded"]) -> tuple[Float[Array, " padded"], Float[Array, " padded"]]:
    """C_k = sum_{i<k} theta_i as an unevaluated sum of two numbers (high, low).

    C grows like n^(5/2) for a random walk of rate, but its third difference at m = 1 is as small as one sample. A single float64
    would lose it (relative error above 1 at n = 10^7). Within a row the sum is split exactly into
    C_row + i theta_row + sum (theta - theta_row), whose last part is small.
    """
    rows = theta.reshape(-1, _ROW)
    first, zero = rows[:, :1], jnp.zeros((), theta.dtype)
    inside = jnp.cumsum(rows - first, axis=1)
    width = jnp.full(len(rows), float(_ROW), theta.dtype)
    total = double_add(_two_product(width, first[:, 0]), (inside[:, -1], jnp.zeros_like(width)))
    start = lax.scan(lambda before, row: (double_add(before, row), before), (zero, zero), total)[1]
    index = jnp.broadcast_to(jnp.arange(_ROW).astype(theta.dtype)[None, :], rows.shape)
    # a row that begins at the end of the record begins with any value, even NaN
    line = tuple(jnp.where(index > 0.0, part, zero) for part in _two_product(index, jnp.broadcast_to(first, rows.shape)))
    before = jnp.concatenate([jnp.zeros_like(first), inside[:, :-1]], axis=1)
    hi, lo = double_add(tuple(part[:, None] for part in start), double_add(line, (before, jnp.zeros_like(before))))
    return hi.reshape(-1), lo.reshape(-1)


def aligned(length: int, dtype=np.float64) -> np.ndarray:
    """Uninitialised array whose address is aligned for JAX, so that JAX can use it without a copy."""
    item = np.dtype(dtype).itemsize
    raw = np.empty(length + 64 // item, dtype)
    return raw[(-raw.__array_interface__["data"][0] // item) % (64 // item) :][:length]
