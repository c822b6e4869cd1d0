"""Sum of Theo1 over all windows and offsets, in O(n log n + m log^2 m) for a cluster size.

D. A. Howe and T. K. Peppler, "Very long-term frequency stability: estimation using a special-purpose statistic", Proc. IEEE
Frequency Control Symposium, 2003. With h = m/2, I = n + 1 - m windows and w_d = 1/(h - d) the sum is

    sum_i sum_{d<h} w_d (theta_i - theta_{i-d+h} + theta_{i+m} - theta_{i+d+h})^2.

The squares come from running sums, the products of the ends with the inner points from one convolution. The products of
the two inner points, q_d = sum_i theta_{i+h-d} theta_{i+h+d}, come from the autocorrelation at lag 2 d minus the
pairs whose centre lies within h of either end. Those are sums over a triangle i + j < h (of the even and of the odd points),
which consists of a square, one FFT correlation, and two triangles of half the size.
"""

import numpy as np
import scipy  # loads its parts when they are first used

from ..._types import Float
from ._phase import LANE
from ._total import dot

_BASE = 32  # number of windows, or offsets, up to which the double sum is formed directly, and size of the triangles


def theo1_sum(theta: Float[np.ndarray, " points"], m: int) -> float:
    """The weighted sum of squares of a phase record at the even cluster size m."""
    windows = len(theta) - m
    if min(m // 2, windows) <= _BASE:
        return _double_sum(theta, m)
    # subtract a line from each chunk, to keep the products as small as the result: the sum does not depend on a line, the products do
    chunk = max(16 * m, LANE)
    return sum(_fast(theta[first : min(first + chunk, windows) + m], m) for first in range(0, windows, chunk))


def _fast(theta, m: int) -> float:
    n, h = len(theta), m // 2
    windows = n - m
    if windows <= _BASE:
        return _double_sum(theta, m)
    time = np.linspace(-1.0, 1.0, n)
    theta = theta - theta.mean()
    theta -= (dot(theta, time) / dot(time, time)) * time
    squares = np.concatenate([[0.0], np.cumsum(theta**2)])
    d = np.arange(h)
    w = 1.0 / (h - d)
    first, last = theta[:windows], theta[m:]
    total = w.sum() * (squares[windows] + squares[n] - squares[m] + 2.0 * dot(first, last))
    total += dot(w, squares[windows + h - d] - squares[h - d] + squares[windows + h + d] - squares[h + d])
    size: int = scipy.fft.next_fast_len(2 * n, real=True)  # type: ignore[assignment]
    spectrum = np.fft.rfft(theta, size)
    kernel = np.zeros(size)
    kernel[:h] = w
    kernel[0] *= 2.0
    kernel[size - h + 1 :] = w[:0:-1]
    inner = np.fft.irfft(np.fft.rfft(kernel) * spectrum, size)[h : h + windows]
    total -= 2.0 * dot(first + last, inner)
    pairs = np.fft.irfft(np.abs(spectrum) ** 2, size)[2 * d]
    pairs -= _near_the_start(theta, h) + _near_the_start(theta[::-1], h)
    return float(total + 2.0 * dot(w, pairs))


def _double_sum(theta, m: int) -> float:
    """The definition, summed over the shorter of windows and offsets, with all of the longer at once."""
    h, windows = m // 2, len(theta) - m
    total = 0.0
    if h <= windows:
        ends = theta[:windows] + theta[m:]
        for d in range(h):
            e = ends - theta[h - d : h - d + windows] - theta[h + d : h + d + windows]
            total += dot(e, e) / (h - d)
        return total
    w = 1.0 / np.arange(h, 0, -1)
    for i in range(windows):
        e = (theta[i] + theta[i + m]) - theta[i + 1 : i + h + 1][::-1] - theta[i + h : i + m]
        total += dot(e * e, w)
    return total


def _near_the_start(z, h: int):
    """For d = 0 .. h-1, the sum of z_p z_{p+2d} over p >= 0 with p + d < h: the pairs whose centre lies before h."""
    z = z[: 2 * h]
    found = _triangle(z[0::2], h)
    found[:-1] += _triangle(z[1::2], h - 1)
    return found


def _triangle(x, size: int):
    """For d = 0 .. size - 1, the sum of x_k x_{k+d} over k >= 0 with 2 k + d < size."""
    whole = _BASE
    while whole < size:
        whole *= 2
    # zeros before the first factor make the size a power of two, and shift the lag by their number
    shift = whole - size
    left, right = np.zeros(whole), np.zeros(whole)
    left[shift:] = x[:size]
    right[:size] = x[:size]
    found = np.zeros(2 * whole)  # lag - whole .. whole - 1 of right against left
    width = whole
    while width > _BASE:
        half = width // 2
        # triangles of this level: left from t width, right from (count - 1 - t) width; each has a square, then two halves
        a = left.reshape(-1, width)[:, :half]
        b = right.reshape(-1, width)[::-1, :half]
        product = np.conj(np.fft.rfft(a, width, axis=1)) * np.fft.rfft(b, width, axis=1)
        square = np.fft.fftshift(np.fft.irfft(product, width, axis=1), axes=1)  # lag -half .. half - 1
        for_t = found.reshape(len(a), 2 * width)[::-1]  # lag (count - 1 - 2 t) width is the middle of its row
        for_t[:, half : half + width] += square
        width = half
    a, b = left.reshape(-1, width), right.reshape(-1, width)[::-1]
    for_t = found.reshape(len(a), 2 * width)[::-1]
    for i in range(width):
        for_t[:, width - i : 2 * width - 2 * i] += a[:, i : i + 1] * b[:, : width - i]
    return found[size : 2 * size]
