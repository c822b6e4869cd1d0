"""Sums of products over a range that grows with the lag, at every lag, by divide and conquer over batched FFTs."""

import numpy as np
import scipy.fft

from ..._types import Any

#: sizes of the triangles that are summed directly; with factors 2, 3 and 5 only, even
_BASES = (32, 36, 40, 48, 54, 60, 64)


def size_below(limit: int) -> tuple[int, int]:
    """Largest base * 2**doublings that is at most `limit` (32 or more), as that pair."""
    doublings = (limit // _BASES[0]).bit_length() - 1
    return max(b for b in _BASES if b << doublings <= limit), doublings


def size_above(limit: int) -> tuple[int, int]:
    """Least base * 2**doublings that is at least `limit`, as that pair."""
    doublings = max((limit // _BASES[-1]).bit_length() - 1, 0)
    while _BASES[-1] << doublings < limit:
        doublings += 1
    return min(b for b in _BASES if b << doublings >= limit), doublings


def products(first, second, length: int) -> np.ndarray:
    """Spectrum of the products of two arrays at every lag, along the last axis, circular over `length`."""
    spectrum = np.asarray(scipy.fft.rfft(first, length))
    np.conj(spectrum, out=spectrum)
    spectrum *= np.conj(spectrum) if second is first else np.asarray(scipy.fft.rfft(second, length))
    return spectrum


def at_lags(spectrum, length: int) -> np.ndarray:
    """The products of such a spectrum, lag by lag; the spectrum is spoilt."""
    return np.asarray(scipy.fft.irfft(spectrum, length, overwrite_x=True))


def fast_length(least: int) -> int:
    """Length of `least` or a little more whose real FFT is quick."""
    length: Any = scipy.fft.next_fast_len(least, real=True)
    return int(length)


def half_range(z: np.ndarray, a: int, c: int, base: int, doublings: int) -> np.ndarray:
    """G(m) = sum_{i < a m} z_i z_{i + c m} for m = 0 .. M-1, M = base * 2**doublings, (windows, M).

    The pairs (m, i) fill a triangle: a rectangle of half its height, which is one correlation, and two triangles of half its
    size. All rectangles of a size are one batch of FFTs; the triangles left at the end are summed as they stand.

    Parameters
    ----------
    z : (windows, (a + c) M or more).
    a : the range, in units of m.
    c : the lag, in units of m: 1, or 2 with a = 1.
    base, doublings : M; `base` is the size of the triangles left.
    """
    windows, size = z.shape[0], base << doublings
    out = np.zeros((windows, size))
    near, far = (np.ascontiguousarray(z[:, : reach * size]) for reach in (a, a + c))
    half = size // 2
    while half >= base:
        # block j: m = 2 half j + half + q, i from 2 a half j on; every c-th lag is kept, so every c-th point is a series of its own
        split = (windows, size // (2 * half), -1, c)
        first = near.reshape(split)[:, :, : a * half // c]
        second = far.reshape(split)[:, :, half : half + (a + c) * half // c]
        length = fast_length((a + c) * half // c)
        spectrum = sum(products(first[..., phase], second[..., phase], length) for phase in range(c))
        out.reshape(windows, split[1], 2 * half)[:, :, half:] += at_lags(spectrum, length)[..., :half]
        half //= 2
    first, second = near.reshape(-1, a * base), far.reshape(-1, (a + c) * base)
    rest = out.reshape(-1, base)
    for q in range(1, base):
        rest[:, q] += np.einsum("ij,ij->i", first[:, : a * q], second[:, c * q : (a + c) * q])
    return out
