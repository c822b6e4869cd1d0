"""Small pieces of array work that many modules share: runs of flags, lengths of buckets, NumPy or `jax.numpy`,
rotations of vectors, and variances in moving windows.
"""

from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used
from jax.core import Tracer

#: v @ _CROSS is the matrix of the cross product, [v] x = v cross x; matrix products compile faster than single components
_CROSS = np.array([[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]], dtype=float)
_BLOCK = 4  # windows in a block of the running sums
#: values of a running sum that are added one after another, in the first-level cache, and those of a piece, in the second
_LANE, _PIECE = 1 << 12, 1 << 18
#: multiplications in a matrix product up to which OpenBLAS uses one thread. Beside other work two wait longer for one another than they
#: compute: noise fits of 32 channels took twice the time of the processor
ALONE = 1 << 18


def product(one: Any, other: Any) -> np.ndarray:
    """`one @ other` of matrices by one thread, in parts of the columns.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal._arrays import product
    >>> product(np.ones((2, 1024)), np.ones((1024, 300))).shape
    (2, 300)
    """
    width = max(ALONE // one.size, 1)
    if other.shape[1] <= width:
        return one @ other
    return np.concatenate([one @ other[:, i : i + width] for i in range(0, other.shape[1], width)], axis=1)


def runs(flags: Any) -> tuple[np.ndarray, np.ndarray]:
    """First index, and index after the last, of each run of True.

    Examples
    --------
    >>> from jaxcal._arrays import runs
    >>> starts, stops = runs([True, True, False, True])
    >>> starts.tolist(), stops.tolist()
    ([0, 3], [2, 4])
    """
    flags = np.asarray(flags, dtype=np.int8)
    edges = np.flatnonzero(np.diff(flags, prepend=0, append=0)) if flags.any() else np.zeros(0, dtype=int)
    return edges[::2], edges[1::2]


def longest_run(flags: Any) -> tuple[int, int]:
    """First index, and index after the last, of the longest run of True, the first of several; (0, 0) without any."""
    starts, stops = runs(flags)
    if not len(starts):
        return 0, 0
    longest = int(np.argmax(stops - starts))
    return int(starts[longest]), int(stops[longest])


def quantile(values: np.ndarray, *shares: float) -> np.ndarray:
    """Of the last axis, (..., shares) or (...) of a single one, ascending; the nearest values, much faster than `numpy.quantile`.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal._arrays import quantile
    >>> quantile(np.arange(101.0)[::-1], 0.5, 0.9).tolist()
    [50.0, 90.0]
    """
    found, first, count = [], 0, values.shape[-1]
    for place in (round(share * (count - 1)) for share in shares):  # two places at once take several times as long
        values = np.partition(values, place - first)[..., place - first :]  # a larger quantile lies among these
        found.append(values[..., 0])
        first = place
    return np.stack(found, axis=-1) if len(shares) > 1 else found[0]


def interpolated(values: np.ndarray, share: float) -> Any:
    """`numpy.quantile` along the last axis, in a third of the time.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal._arrays import interpolated
    >>> interpolated(np.array([3.0, 0.0, 1.0, 2.0]), 0.5).item()
    1.5
    """
    first, last = int(place := share * (values.shape[-1] - 1)), -int(-place // 1)
    parted = np.partition(values, (first, last))
    low = parted[..., first]
    return low + (place - first) * (parted[..., last] - low)


def transposed(table: np.ndarray) -> np.ndarray:
    """The table (n, k) as contiguous (k, n). Parts that fit a cache take a third of the time of the whole, if k is large."""
    out = np.empty(table.shape[::-1], table.dtype)
    for first in range(0, len(table), _LANE):
        out[:, first : first + _LANE] = table[first : first + _LANE].T
    return out


def running_sum(values: np.ndarray, less: float, out: np.ndarray) -> np.ndarray:
    """Running sum of values minus `less`, (n,), into `out`, which may be the values, in 0.4 of the time of `numpy.cumsum`.

    In a simple sum each addition waits for the one before. So pairs are added first, their running sum is formed in the same way, and a
    value is subtracted where the sum ends in the middle of a pair.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal._arrays import running_sum
    >>> float(running_sum(np.full(10_000, 3.0), 2.0, np.empty(10_000))[-1])
    10000.0
    """
    for first in range(0, len(values), _PIECE):
        piece = np.subtract(values[first : first + _PIECE], less, out=out[first : first + _PIECE])
        piece[0] += out[first - 1] if first else 0.0
        _summed(piece)
    return out


def decaying_sum(values: np.ndarray, keep: float) -> np.ndarray:
    """Sums s_k = keep s_(k-1) + x_k along the first axis, without the half second that `scipy.signal` takes to load.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal._arrays import decaying_sum
    >>> decaying_sum(np.array([1.0, 0.0, 1.0]), 0.5).tolist()
    [1.0, 0.5, 1.25]
    """
    band = np.full((2, len(values)), -keep, order="F")
    columns = values.reshape(len(values), -1).T
    return np.stack([scipy.linalg.blas.dtbsv(1, band, one, lower=1, diag=1) for one in columns], axis=1).reshape(values.shape)


def _summed(values: np.ndarray) -> np.ndarray:
    """Running sum of few values in place."""
    if len(values) <= _LANE:
        return np.cumsum(values, out=values)
    seconds = values[1::2]
    firsts = values[: 2 * len(seconds) : 2]
    pairs = _summed(firsts + seconds)
    np.subtract(pairs, seconds, out=firsts)
    seconds[:] = pairs
    if len(values) % 2:
        values[-1] += pairs[-1]
    return values


def power_of_two(count: int, least: int = 1) -> int:
    """Smallest power of two that is at least `count`, but not below `least`: arrays padded to it share compiled programs."""
    return max(1 << max(count - 1, 0).bit_length(), least)


def padded(values: Any, length: int, fill: float | None = None) -> Any:
    """Values of NumPy or JAX, extended to `length` rows by copies of their first row, or by `fill`.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal._arrays import padded
    >>> padded(np.array([1.0, 2.0]), 4).tolist(), padded(np.array([1.0, 2.0]), 3, np.inf).tolist()
    ([1.0, 2.0, 1.0, 1.0], [1.0, 2.0, inf])
    """
    xp = namespace(values, concrete=True)
    more = xp.repeat(values[:1], length - len(values), axis=0)
    return xp.concatenate([values, more if fill is None else xp.full_like(more, fill)])


def namespace(*trees: Any, concrete: bool = False) -> ModuleType:
    """`jax.numpy` if a leaf is traced (or, with `concrete`, any array of JAX), otherwise `numpy`.

    `_precision.array_module` also detects a trace in progress that touches none of the leaves, which takes longer.
    """
    kind = jax.Array if concrete else Tracer
    return jnp if any(isinstance(leaf, kind) for leaf in jax.tree.leaves(trees)) else np


def summed_product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Sum of a_k' b_k over k, of (k, r, p) and (k, r, q): a small product for each k. A large one wakes the threads of BLAS, which spin."""
    return (np.swapaxes(a, 1, 2) @ b).sum(axis=0)


def skew(v: Any) -> Any:
    """Matrices (..., 3, 3) of the cross product with v (..., 3), of NumPy or JAX."""
    if not isinstance(v, np.ndarray):
        return (v @ jnp.asarray(_CROSS, dtype=v.dtype)).reshape(*v.shape, 3)
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def axis_turns() -> np.ndarray:
    """The 24 rotations that exchange axes, (24, 3, 3), the identity first; their negatives mirror."""
    found = scipy.spatial.transform.Rotation.create_group("O").as_matrix().round()
    return found[np.argsort(-np.trace(found, axis1=1, axis2=2), kind="stable")]


def axis_words(turn: np.ndarray) -> str:
    """Rows of a signed permutation as axes of another sensor, in the form of the option `axes`.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal._arrays import axis_words
    >>> axis_words(np.array([[0, 0, 1], [-1, 0, 0], [0, 1, 0]]))
    'z,-x,y'
    """
    return ",".join(f"{'' if row.sum() > 0 else '-'}{'xyz'[int(np.argmax(np.abs(row)))]}" for row in turn)


def axis_fault(turn: np.ndarray) -> str:
    """What a signed permutation does to the axes, in words.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal._arrays import axis_fault
    >>> axis_fault(np.diag([1, -1, 1])), axis_fault(np.eye(3)[[1, 0, 2]]), axis_fault(-np.eye(3)[[1, 0, 2]])
    ('y is reversed', 'x and y are exchanged', 'x and y are exchanged, and x, y and z are reversed')
    """
    moved, signs = np.diag(turn) == 0, turn.sum(axis=1)
    done = {"exchanged": [axis for axis, own in zip("xyz", moved, strict=True) if own],
            "reversed": [axis for axis, sign in zip("xyz", signs, strict=True) if sign < 0]}  # fmt: skip
    said = [f"{_listed(axes)} {'is' if len(axes) == 1 else 'are'} {how}" for how, axes in done.items() if axes]
    return ", and ".join(said)


def _listed(words: list[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def from_vector(v: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3), of NumPy."""
    angle = np.sqrt(np.sum(v * v, axis=-1))[..., None, None]
    cross = skew(v)
    return np.eye(3) + np.sinc(angle / np.pi) * cross + np.sinc(angle / (2 * np.pi)) ** 2 / 2 * (cross @ cross)


def to_vector(r: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3) of rotations by less than 180 degrees, of NumPy."""
    twice = np.stack([r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]], axis=-1)
    sine = np.linalg.norm(twice, axis=-1, keepdims=True) / 2
    angle = np.arctan2(sine, (np.trace(r, axis1=-2, axis2=-1)[..., None] - 1) / 2)
    return twice / 2 * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1)


def left_jacobian(v: np.ndarray) -> np.ndarray:
    """Left Jacobian (..., 3, 3) of rotation vectors below 1 rad, by its series, of NumPy."""
    cross, square = skew(v), np.sum(v * v, axis=-1)[..., None, None]
    one, two = 1 - square / 12 * (1 - square / 30), 1 - square / 20 * (1 - square / 42)
    return np.eye(3) + one / 2 * cross + two / 6 * (cross @ cross)


def windowed_variance(x: np.ndarray, window: int) -> np.ndarray:
    """Norm of the three unbiased variances over a moving window of `window` samples: (n - window + 1,).

    Missing samples (NaN rows) are ignored; a window has an infinite variance if it has half of the usual number of samples or less. The
    function uses running sums over blocks of a few windows, each minus its own mean, so that large counts with a small variance keep their
    digits.
    """
    count = len(x) - window + 1
    size = _BLOCK * window
    present = np.all(np.isfinite(x), axis=1)
    # fill gaps and padding with values near the readings; distant values would cost digits
    filled = x if present.all() else np.where(present[:, None], x, np.nanmean(x, axis=0))
    filled = np.concatenate([filled, np.repeat(filled[-1:], -count % size, axis=0)])
    there = np.concatenate([present, np.ones(len(filled) - len(x), dtype=bool)])
    blocks, kept = (
        np.lib.stride_tricks.sliding_window_view(part, size + window - 1, axis=0)[::size] for part in (filled, there[:, None].astype(float))
    )
    blocks = (blocks - blocks.mean(axis=2, keepdims=True)) * kept
    sums = np.cumsum(np.pad([blocks, blocks**2], ((0, 0), (0, 0), (0, 0), (1, 0))), axis=-1)
    first, second = sums[..., window:] - sums[..., :-window]
    number = np.cumsum(np.pad(kept, ((0, 0), (0, 0), (1, 0))), axis=-1)
    number = number[..., window:] - number[..., :-window]
    variance = (second - first**2 / np.maximum(number, 1)) / np.maximum(number - 1, 1)
    variance = np.linalg.norm(variance, axis=1).reshape(-1)[:count]
    number = number.reshape(-1)[:count]
    return np.where(2 * number > np.median(number), variance, np.inf)
