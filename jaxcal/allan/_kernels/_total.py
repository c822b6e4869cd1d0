"""Sums of the total statistics: totdev on the record reflected about its ends, mtotdev and htotdev on reflected windows.

C. A. Greenhall, D. A. Howe and D. B. Percival, "Total variance, an estimator of long-term frequency stability", IEEE Trans.
UFFC 46, 1999; D. A. Howe and F. Vernotte, "Generalization of the total variance approach to the modified Allan variance",
PTTI 1999; D. A. Howe et al., "A total estimator of the Hadamard function used for GPS operations", PTTI 2000.

By their definition, the windows of mtotdev and htotdev cost O(3 m) each. Here all of them together cost O(n). The extension of
a window is even and has the period 6 m, so its third differences at an offset s from the end of the window at i + 3 m are

    D(i, s) = F(i) + R(i - s) + H(i + s),

where F, R and H are combinations of the running sum P of the record: one combination for s <= m, another for m <= s < 2 m. The start
of the window is treated in the same way, with the record reversed. The squares summed over all i and s then need running sums of F, R
and H, and one with stride 2 for R(i - s) H(i + s). Removing the window's line b_i changes D by -b_i g(s), where g is -s^2 on the first
range and 2 s^2 - 6 m s + 3 m^2 on the second.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..._types import Array, Float, Int
from ._phase import IN_CACHE

#: largest cluster size at which every D(i, s) is formed and squared: this is faster there, and nothing large cancels
LITERAL = 16


def dot(a, b) -> float:
    """Sum of products over all entries, in this thread alone; the linear algebra library would start threads for each small sum."""
    return float(np.einsum(*((a, [0], b, [0]) if a.ndim == 1 else (a, [0, 1], b, [0, 1])), []))


def reflected_record(theta, xp=np):
    """The phase reflected through its first and last point, (3 n + 1,): entry n + k is theta_k."""
    inner = theta[1:]
    before = 2.0 * theta[:1] - inner[::-1]
    after = 2.0 * theta[-1:] - theta[:-1][::-1]
    return xp.concatenate([before, theta, after])


def total_sum(reflected: Float[np.ndarray, " points"], m: int) -> float:
    """Sum over the n - 1 inner phase points of the squared second difference with step m."""
    n = (len(reflected) - 1) // 3
    total = 0.0
    for first in range(n + 1, 2 * n, IN_CACHE):
        last = min(first + IN_CACHE, 2 * n)
        d = reflected[first - m : last - m] - reflected[first:last]
        d += reflected[first + m : last + m] - reflected[first:last]
        total += dot(d, d)
    return total


def traced_total_sums(theta: Float[Array, " points"], m: Int[Array, " clusters"]) -> Float[Array, " clusters"]:
    """`total_sum` at every cluster size, by plain algebra that JAX can differentiate."""
    n = theta.shape[0] - 1
    reflected = reflected_record(theta, jnp)
    inner = n + jnp.arange(1, n)

    @jax.checkpoint
    def one(size):
        d = (reflected[inner + size] - reflected[inner]) - (reflected[inner] - reflected[inner - size])
        return jnp.sum(d * d)

    return lax.map(one, m)


def window_sum(z: Float[np.ndarray, " points"], m: int) -> float:
    """Sum, over all windows of 3 m points, of the mean squared third difference of the running sum of the reflected window.

    The differences have the step m and 6 m positions, which is one period of the extension.
    """
    windows = len(z) - 3 * m + 1
    chunk = min(8 * max(m, LITERAL), windows)
    reach = chunk + 3 * m - 1
    pieces = np.lib.stride_tricks.sliding_window_view(z, reach)[::chunk]
    rows = max(IN_CACHE // reach, 1)
    total = 0.0
    for start in range(0, len(pieces), rows):
        total += _chunks(pieces[start : start + rows], m)
    done = len(pieces) * chunk
    if done < windows:
        total += _chunks(z[None, done:], m)
    return total / (6 * m)


def _chunks(z, m: int) -> float:
    """Sum over all windows of every row of z."""
    length = z.shape[1]
    time = np.linspace(-1.0, 1.0, length)
    z = z - z.mean(axis=1, keepdims=True)
    z -= (np.einsum("ij,j->i", z, time) / dot(time, time))[:, None] * time
    return _one_end(z, m) + _one_end(z[:, ::-1], m)


def _one_end(z, m: int) -> float:
    """Sum, over windows and rows, of the squared differences that reach beyond the end of their window."""
    rows, length = z.shape
    windows = length - 3 * m + 1
    sums = np.zeros((rows, length + 1))
    np.cumsum(z, axis=1, out=sums[:, 1:])
    half, rest = 3 * m // 2, -(-3 * m // 2)
    before, after = sums[:, half : half + windows] - sums[:, :windows], sums[:, 3 * m :] - sums[:, rest : rest + windows]
    slope = (after - before) / (half * rest)
    ends = sums[:, 3 * m :]
    if m <= LITERAL:
        return _one_by_one(sums, slope, m)

    def point(first, count, shift):
        return sums[:, first + shift : first + shift + count]

    # s = 0 .. m: R and H on k = -m .. windows - 1 and 0 .. windows + m - 1
    many = windows + m
    outer = point(0, many, m) - point(0, many, 2 * m)
    near = _squares(2.0 * ends, -point(-m, many, 3 * m), 3.0 * outer - point(0, many, 0), 0, m, slope, (0.0, 0.0, -1.0))
    first = point(0, windows, 3 * m) - 3.0 * point(0, windows, 2 * m) + 3.0 * point(0, windows, m) - point(0, windows, 0)
    # s = m + 1 .. 2 m - 1
    far = 0.0
    if m > 1:
        many = windows + m - 2
        back = 3.0 * point(1 - 2 * m, many, 4 * m) - point(1 - 2 * m, many, 3 * m)
        ahead = 3.0 * point(m + 1, many, m) - point(m + 1, many, 0)
        far = _squares(-4.0 * ends, back, ahead, m + 1, 2 * m - 1, slope, (3.0 * m**2, -6.0 * m, 2.0))
    return 2.0 * near - dot(first, first) + far


def _one_by_one(sums, slope, m: int) -> float:
    """`_one_end` for small m, offset by offset."""
    windows = slope.shape[1]

    def point(shift):
        return sums[:, shift : shift + windows]

    total = 0.0
    for s in range(2 * m):
        if s <= m:
            d = (point(3 * m) - point(3 * m - s)) - 3.0 * (point(2 * m + s) - point(m + s)) + (point(3 * m) - point(s))
            line = -float(s * s)
        else:
            d = 3.0 * (point(4 * m - s) - point(3 * m)) - (point(3 * m - s) - point(m + s)) + 2.0 * point(m + s) - point(3 * m) - point(s)
            line = float(2 * s * s - 6 * m * s + 3 * m * m)
        d -= line * slope
        total += (2.0 if 1 <= s <= m else 1.0) * dot(d, d)
    return total


def _squares(f, r, h, low: int, high: int, slope, line) -> float:
    """Sum over rows, windows i and offsets s = low .. high of (f_i + r_{i-s} + h_{i+s} - slope_i g(s))^2.

    r starts at k = -high, h at k = low; g(s) = line[0] + line[1] s + line[2] s^2.
    """
    windows, offsets = f.shape[1], high - low + 1
    many = windows + offsets - 1
    j = np.arange(many)
    ways = np.minimum(np.minimum(j + 1, many - j), min(windows, offsets)).astype(np.float64)  # pairs (i, s) of one i - s, or i + s
    total = offsets * dot(f, f) + float(np.einsum("ij,j->", r * r + h * h, ways))
    # over s, for every i: sums of s^p r_{i-s} and s^p h_{i+s}, p = 0, 1, 2, from running sums about the middle of the window range
    at = np.arange(windows) - (windows - 1) / 2.0
    behind, ahead = _moments(r, offsets, high, windows), _moments(h, offsets, -low, windows)
    total += 2.0 * dot(f, behind[0] + ahead[0])
    # r_{i-s} h_{i+s}: with u = i + s, multiply h_u by the sum of r_{u-2s} over all s that keep i inside
    total += 2.0 * dot(h, _strided(r, low, high, windows))
    s = np.arange(low, high + 1, dtype=np.float64)
    g = line[0] + line[1] * s + line[2] * s**2
    with_line = f * g.sum() + line[0] * (behind[0] + ahead[0])
    with_line += line[1] * (at * (behind[0] - ahead[0]) - behind[1] + ahead[1])
    with_line += line[2] * (at**2 * (behind[0] + ahead[0]) - 2.0 * at * (behind[1] + ahead[1]) + behind[2] + ahead[2])
    return total - 2.0 * dot(slope, with_line) + dot(slope, slope) * dot(g, g)


def _moments(values, width: int, before: int, windows: int):
    """Sums of k^p values_k, p = 0, 1, 2, over every run of `width` values; values start at k = -before, and k counts from the middle."""
    k = np.arange(values.shape[1]) - before - (windows - 1) / 2.0
    found = []
    weighted = values
    for power in range(3):
        sums = np.zeros((values.shape[0], values.shape[1] + 1))
        np.cumsum(weighted, axis=1, out=sums[:, 1:])
        found.append(sums[:, width:] - sums[:, :-width])
        if power < 2:
            weighted = weighted * k
    return found


def _strided(r, low: int, high: int, windows: int):
    """For u = low .. windows - 1 + high, the sum of r_{u-2s} over s = max(low, u - windows + 1) .. min(high, u); r starts at -high."""
    rows, many = r.shape
    padded = np.zeros((rows, many + 2 + many % 2))
    padded[:, 2 : 2 + many] = r
    sums = np.cumsum(padded.reshape(rows, -1, 2), axis=1).reshape(rows, -1)  # entry 2 + j holds r_j + r_{j-2} + ...
    u = np.arange(low, windows + high)
    first, last = np.maximum(low, u - windows + 1), np.minimum(high, u)
    return sums[:, u - 2 * first + high + 2] - sums[:, u - 2 * last + high]
