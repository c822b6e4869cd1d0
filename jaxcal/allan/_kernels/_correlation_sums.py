"""Sums of squared differences at very many cluster sizes, from correlations.

A sum of squared differences over K starting points is a combination of sums of x_k x_{k+m}, x_k x_{k+2m}, ... . Over a window
these are one correlation minus the products that fall off its two ends. Those are sums over ranges that grow with m, which
`_half_range` computes for all m at once. A record of n samples then takes O(n log^2 n) for all n/2 cluster sizes, not O(n^2).

The products are as large as x^2, but the result may be far smaller. So x is cut into windows in proportion to m, and each window loses
the polynomial to which the difference is blind: its line, or, for the running sum of phase, its parabola. The remaining rounding error
is estimated, and cluster sizes for which it could matter are summed directly.
"""

import functools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import scipy  # loads its parts when they are first used

from ..._types import Any
from .._kinds import Kind, autocorrelation, difference_weights
from ._phase import BLOCK, IN_CACHE

_STEP = 2  # number of doublings from the smallest to the largest cluster size of a range that shares its windows
_RATIO = 4  # ratio of the starting points of a window to the largest cluster size
#: largest relative error of a sum; where the bound is larger, the sum is formed directly
LARGEST_ERROR = 1e-8
#: rounding error of a sum of order 2, over machine epsilon times the sum of x^2: a few times the largest measured value; four times that
#: for order 3. And the rounding error of the removal of a polynomial over its standard deviation
_ROUNDING, _ROUNDING_OF_REMOVAL = 400.0, 100.0

#: sizes of the triangles that are summed directly; they are even and have only the prime factors 2, 3 and 5
_BASES = (32, 36, 40, 48, 54, 60, 64)
# by order, the products at the two ends as (weight, a, c) of `_half_range`
_ENDS = {2: ((4.0, 1, 1),), 3: ((18.0, 1, 1), (6.0, 2, 1), (-6.0, 1, 2))}


def _size_below(limit: int) -> tuple[int, int]:
    """Largest base * 2**doublings that does not exceed `limit` (32 or more), as the pair (base, doublings)."""
    doublings = (limit // _BASES[0]).bit_length() - 1
    return max(b for b in _BASES if b << doublings <= limit), doublings


def _size_above(limit: int) -> tuple[int, int]:
    """Smallest base * 2**doublings that is at least `limit`, as the pair (base, doublings)."""
    doublings = max((limit - 1) // _BASES[-1], 0).bit_length()
    return min(b for b in _BASES if b << doublings >= limit), doublings


def _products(first, second, length: int) -> np.ndarray:
    """Spectrum of the products of two arrays at every lag, along the last axis, circular over `length`."""
    spectrum = np.asarray(scipy.fft.rfft(first, length))
    np.conj(spectrum, out=spectrum)
    spectrum *= np.conj(spectrum) if second is first else np.asarray(scipy.fft.rfft(second, length))
    return spectrum


def _at_lags(spectrum, length: int) -> np.ndarray:
    """The products from such a spectrum, lag by lag; the spectrum is overwritten."""
    return np.asarray(scipy.fft.irfft(spectrum, length, overwrite_x=True))


def _fast_length(least: int) -> int:
    """Smallest length from `least` on whose real FFT is fast."""
    length: Any = scipy.fft.next_fast_len(least, real=True)
    return int(length)


def _half_range(z: np.ndarray, a: int, c: int, base: int, doublings: int) -> np.ndarray:
    """G(m) = sum_{i < a m} z_i z_{i + c m} for m = 0 .. M-1, M = base * 2**doublings, (windows, M).

    The pairs (m, i) fill a triangle. It consists of a rectangle of half its height, which is one correlation, and two triangles of half its
    size. All rectangles of one size are one batch of FFTs; the remaining triangles, of size `base`, are summed directly.
    z is (windows, (a + c) M or more); c is 1, or 2 with a = 1.
    """
    windows, size = z.shape[0], base << doublings
    out = np.zeros((windows, size))
    near, far = (np.ascontiguousarray(z[:, : reach * size]) for reach in (a, a + c))
    half = size // 2
    while half >= base:
        # block j: m = 2 half j + half + q, i from 2 a half j on; only every c-th lag is needed, so every c-th point forms a separate series
        split = (windows, size // (2 * half), -1, c)
        first = near.reshape(split)[:, :, : a * half // c]
        second = far.reshape(split)[:, :, half : half + (a + c) * half // c]
        length = _fast_length((a + c) * half // c)
        spectrum = sum(_products(first[..., phase], second[..., phase], length) for phase in range(c))
        out.reshape(windows, split[1], 2 * half)[:, :, half:] += _at_lags(spectrum, length)[..., :half]
        half //= 2
    first, second = near.reshape(-1, a * base), far.reshape(-1, (a + c) * base)
    rest = out.reshape(-1, base)
    for q in range(1, base):
        rest[:, q] += np.einsum("ij,ij->i", first[:, : a * q], second[:, c * q : (a + c) * q])
    return out


def _detrended(theta, starts, points: int, kind: Kind) -> tuple[np.ndarray, float]:
    """Windows of phase, or of its running sum, without the polynomials to which the difference is blind, (windows, points).

    Also returns the sum of the squares that were rounded on the way, which still contain the polynomials.
    """
    z = np.lib.stride_tricks.sliding_window_view(theta, points - 1 if kind.modified else points)[starts]
    z -= z[:, :1]  # subtract this first, so that the fit keeps its digits
    rounded = float(np.einsum("ij,ij->", z, z))
    if kind.modified:
        _remove_polynomial(z, 1)
        z = _running_sum(z)
        rounded += float(np.einsum("ij,ij->", z, z))
    _remove_polynomial(z, kind.difference - 1)
    return z, rounded


def _remove_polynomial(z, degree: int) -> None:
    """Subtract the least-squares polynomial in time from every row, in place."""
    t = np.linspace(-1.0, 1.0, z.shape[1])
    basis = [np.ones_like(t), t, t**2 - np.mean(t**2)]
    for one in basis[: degree + 1]:
        # do not use a matrix product: its library would start threads of its own inside these
        z -= (np.einsum("ij,j->i", z, one) / np.sum(one * one))[:, None] * one


def _running_sum(z) -> np.ndarray:
    """Sum of the values before each point, (windows, points + 1), in two steps; rounding then grows with the root of a row's length."""
    windows, points = z.shape
    rows = -(-points // BLOCK)
    total = np.zeros((windows, rows * BLOCK + 1))
    inside = total[:, 1:].reshape(windows, rows, BLOCK)  # a view of `total`
    total[:, 1 : points + 1] = z
    np.cumsum(inside, axis=2, out=inside)
    inside[:, 1:] += np.cumsum(inside[:, :-1, -1], axis=1)[:, :, None]
    return total[:, : points + 1]


def _ends(z, order: int, base: int, doublings: int) -> np.ndarray:
    """The products at one end, (windows, M), by which the correlations of a window must be corrected."""
    reach = 3 * base << doublings
    if z.shape[1] < reach:
        z = np.pad(z, ((0, 0), (0, reach - z.shape[1])))
    total = np.zeros((len(z), base << doublings))
    for weight, a, c in _ENDS[order]:
        total += weight * _half_range(z, a, c, base, doublings)
    return total


def _window_sums(z, order: int, base: int, doublings: int, low: int) -> tuple[np.ndarray, float]:
    """Sums over the first _RATIO M starting points of every window, for m = low .. M-1, and the sum of squares of the windows."""
    size = base << doublings
    starts, m = _RATIO * size, np.arange(low, size)
    length = _fast_length(z.shape[1])
    lagged = _at_lags(_products(z[:, :starts], z, length), length).sum(axis=0)
    total = (_ends(z, order, base, doublings) - _ends(z[:, starts:], order, base, doublings))[:, low:].sum(axis=0)
    squares = _running_sum(z * z)
    inside = (squares[:, starts:] - squares[:, : z.shape[1] + 1 - starts]).sum(axis=0)
    for lag, weight in enumerate(difference_weights(order) ** 2):
        total += weight * inside[lag * m]
    for lag, weight in enumerate(2.0 * autocorrelation(order)[1:], start=1):
        total += weight * lagged[lag * m]
    return total, float(squares[:, -1].sum())


def _record_sums(z, rounded: float, order: int, largest: int, low: int) -> list[Callable[[], tuple[np.ndarray, float, float]]]:
    """`_window_sums` over all starting points of one record, for m = low .. largest: three calls whose results add up."""
    points, m = z.shape[1], np.arange(low, largest + 1)

    def middle():
        length = _fast_length(points + order * largest)
        row = z[0]
        lagged = _at_lags(_products(row, row, length), length)
        squares = _running_sum(z * z)[0]
        total = np.zeros(len(m))
        for lag, weight in enumerate(difference_weights(order) ** 2):
            total += weight * (squares[points - (order - lag) * m] - squares[lag * m])
        for lag, weight in enumerate(2.0 * autocorrelation(order)[1:], start=1):
            total += weight * lagged[lag * m]
        return total, float(squares[-1]), rounded

    def end(z):
        return _ends(z, order, *_size_above(largest + 1))[0, low : largest + 1], 0.0, 0.0

    return [middle, lambda: end(z), lambda: end(z[:, ::-1])]


def correlation_sums(theta, m, kind: Kind, workers: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Sums of squared differences at ascending cluster sizes m, (clusters,), and bounds on their relative errors.

    The bound is infinite if the sum is not formed here: for the smallest cluster sizes, and for those with few differences.
    """
    order, points = kind.difference, len(theta) + (1 if kind.modified else 0)
    largest = int(m[-1])
    fewest = _BASES[-1]  # cluster sizes with fewer differences are summed directly
    edges = [fewest]
    widest = points // (2 * (_RATIO + order))  # a window for larger cluster sizes would be more than half the record
    if widest >= fewest:
        base, doublings = _size_below(widest)
        edges = [base << k for k in range(doublings % _STEP, doublings + 1, _STEP)]

    def window(low, size, starts):
        z, rounded = _detrended(theta, starts, (_RATIO + order) * size, kind)
        return *_window_sums(z, order, *_size_below(size), low), rounded

    def tail(low, size, start):
        calls = _record_sums(*_detrended(theta[start:], [0], points - start, kind), order, size - 1, low)
        parts, squares, rounded = zip(*(call() for call in calls), strict=True)
        return np.sum(parts, axis=0), sum(squares), sum(rounded)

    tasks: list[tuple[int, int, Callable]] = []
    energy = np.zeros((2, max(largest + 1, edges[-1])))
    sums = np.zeros(energy.shape[1])
    if largest >= edges[-1]:
        tasks = [(edges[-1], largest + 1, call) for call in _record_sums(*_detrended(theta, [0], points, kind), order, largest, edges[-1])]
    for low, high in zip(edges[-2::-1], edges[:0:-1], strict=True):
        if np.searchsorted(m, low) < np.searchsorted(m, high):
            step = _RATIO * high
            starts = np.arange(0, points - order * high - step + 1, step)
            tasks.append((low, high, functools.partial(tail, low, high, len(starts) * step)))
            for part in np.array_split(starts, min(len(starts), -(-len(starts) * step // IN_CACHE))):
                tasks.append((low, high, functools.partial(window, low, high, part)))

    with ThreadPoolExecutor(workers) as pool:
        for low, high, (part, squares, rounded) in pool.map(lambda task: (*task[:2], task[2]()), tasks):
            sums[low:high] += part
            energy[0, low:high] += squares
            energy[1, low:high] += rounded
    absent = (m < edges[0]) | (points - order * m < fewest)
    return sums[m], _relative_error(sums[m], energy[0, m], energy[1, m], m, points, kind, absent)


def _relative_error(sums, energy, rounded, m, points: int, kind: Kind, absent) -> np.ndarray:
    """Bound on the relative error of sums, from the sum of squares `energy`, and `rounded` before the polynomials were removed."""
    epsilon = np.finfo(np.float64).eps
    # The rounding by the removal differs from point to point, so that its products with the differences add up like a random walk.
    # A running sum accumulates it in the same way, over m steps.
    steps = m if kind.modified else 1
    positive = np.maximum(sums, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        square = steps * rounded / positive * epsilon**2
        error = _ROUNDING * 4 ** (kind.difference - 2) * epsilon * energy / positive + _ROUNDING_OF_REMOVAL * (
            np.sqrt(square * steps / points) + square
        )
    return np.where(absent, np.inf, np.where((energy == 0.0) & (rounded == 0.0), 0.0, error))
