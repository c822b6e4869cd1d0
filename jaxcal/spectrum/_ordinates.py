r"""Ordinates of a record, and degrees of freedom of means over them.

Ordinates estimate the two-sided density at equally spaced frequencies above zero. The functions take centred samples (channels, n),
NumPy on the host or traced, and return (channels, ordinates). Ordinate k of the periodogram and of Welch's method belongs to k/(n dt),
k = 1 .. n/2 (n is the length of a segment for Welch), that of the DCT-II to k/(2 n dt), k = 1 .. n-1.

For white noise the ordinates k and l of a real record have, relative to the squared density, the covariance v(k-l) + v(k+l),

.. math:: v(q) = \frac{1}{K^2} \sum_{|d|<K} (K - |d|)\,\Big|\frac{\sum_t w_t w_{t+dD}\, e^{-2\pi i q t/L}}{\sum_t w_t^2}\Big|^2

with K segments of length L at a distance D under the window w; the periodogram is one segment under a window of ones, v(0) = 1.
The mean of ordinates of relative size a_k then has 2 (sum a)^2 / sum a_k a_l [v(k-l) + v(k+l)] degrees of freedom. v(k+l) matters
near zero frequency and near half the sampling rate, where an ordinate is real. If the density changes across a group, the number holds
as far as the density is flat within it.

P. D. Welch, IEEE Trans. Audio Electroacoust. 15, 1967, 70-73; his edf is the case of a single ordinate.
"""

import os

import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from .._types import Any, Float
from ._average import Groups

_REACH = 16  # number of ordinates; over more, windows correlate by less than 1e-6
_PARALLEL_FROM = 50_000  # number of samples above which threads save more time than they cost


def periodogram(x: Any, dt: float) -> Any:
    """(dt/n) |X_k|^2, X the discrete Fourier transform."""
    return _squares(x)[..., 1:] * (dt / x.shape[-1])


def dct(x: Any, dt: float) -> Any:
    """Squares of the orthonormal DCT-II, times dt."""
    if isinstance(x, np.ndarray):
        y = np.asarray(scipy.fft.dct(x, norm="ortho", workers=_workers(x)))
    else:
        y = jax.scipy.fft.dct(x, norm="ortho")
    y = y[..., 1:]
    return dt * y * y


def welch(x: Any, dt: float, segment: int, step: int) -> Any:
    """Mean over segments of |X_k|^2, in units of its expectation for white noise; segments have no mean and a Hann window.

    The expectation is the sum of the squared window, except for the first ordinate, which loses a sixth with the segment's mean.
    """
    window = hann(segment)
    transform = np.abs(np.asarray(scipy.fft.rfft(window)))[1:]
    expected = np.sum(window**2) - transform**2 / segment
    if isinstance(x, np.ndarray):
        segments = np.lib.stride_tricks.sliding_window_view(x, segment, axis=-1)[:, ::step]
        # go channel by channel, because the segments take twice the memory of the record
        power = [_squares((part - part.mean(axis=-1, keepdims=True)) * window).mean(axis=0)[1:] for part in segments]
        return np.stack(power) * (dt / expected)
    index = np.arange(0, x.shape[-1] - segment + 1, step)[:, None] + np.arange(segment)
    segments = x[:, index] - jnp.mean(x[:, index], axis=-1, keepdims=True)
    mean = jnp.mean(_squares(segments * jnp.asarray(window, dtype=x.dtype)[None, None, :]), axis=1)
    return mean[:, 1:] * jnp.asarray(dt / expected, dtype=x.dtype)[None, :]


def hann(length: int) -> np.ndarray:
    """The periodic Hann window."""
    return 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)


def _squares(x: Any) -> Any:
    """|X_k|^2 of the real transform along the last axis."""
    transform: Any = scipy.fft.rfft(x, workers=_workers(x)) if isinstance(x, np.ndarray) else jnp.fft.rfft(x)
    return transform.real**2 + transform.imag**2


def _workers(x: np.ndarray) -> int:
    return min(os.cpu_count() or 1, 16) if x.size > _PARALLEL_FROM else 1


def welch_correlation(segments: int, segment: int, step: int) -> Float[np.ndarray, " reach"]:
    """v(q), q = 0 .. 16, for `segments` segments with a distance of `step` samples under a Hann window."""
    window = hann(segment)
    total = np.zeros(segment // 2 + 1)
    for d in range(min(segments, -(-segment // step))):
        product = window[d * step :] * window[: segment - d * step]
        transform = np.abs(np.asarray(scipy.fft.rfft(product, segment))) ** 2
        total += (segments - d) * transform * (1.0 if d == 0 else 2.0)
    return (total / (segments * np.sum(window**2)) ** 2)[: _REACH + 1]


def first_of_welch(segments: int, segment: int, step: int) -> float:
    """Degrees of freedom of ordinate 1, which is affected by the mean that is subtracted from each segment."""
    window, t = hann(segment), np.arange(segment)
    filtered = window * np.exp(-2j * np.pi * t / segment)
    filtered -= filtered.mean()
    total = 0.0
    for d in range(min(segments, -(-segment // step))):
        ahead, behind = filtered[d * step :], filtered[: segment - d * step]
        squares = abs(np.vdot(ahead, behind)) ** 2 + abs(np.dot(ahead, behind)) ** 2
        total += (segments - d) * squares * (1.0 if d == 0 else 2.0)
    return 2.0 * (segments * np.vdot(filtered, filtered).real) ** 2 / total


def degrees_of_freedom(v: Float[np.ndarray, " reach"], groups: Groups, size: Float[np.ndarray, " ordinates"], length: int) -> np.ndarray:
    """Degrees of freedom of the mean over each group, for ordinates of relative expected `size`; bin `length` equals bin 0."""
    start, count = groups
    size = size[: start[-1] + count[-1]]
    group = np.repeat(np.arange(len(start)), count)
    total = np.add.reduceat(size, start)
    variance = v[0] * np.add.reduceat(size**2, start)
    bins = np.arange(1, len(size) + 1)
    for q in range(len(v)):
        if 0 < q < count.max():
            together = np.where(group[q:] == group[:-q], size[q:] * size[:-q], 0.0)
            variance += 2.0 * v[q] * np.add.reduceat(np.append(together, np.zeros(q)), start)
        for mirror in {q, length - q}:  # the sum k + l
            k = bins[(bins < mirror) & (mirror - bins <= len(bins))]
            k = k[group[k - 1] == group[mirror - k - 1]]
            np.add.at(variance, group[k - 1], v[q] * size[k - 1] * size[mirror - k - 1])
    return 2.0 * total**2 / variance


def interval_factors(edf, confidence: float) -> tuple[np.ndarray, np.ndarray]:
    """Factors from a density to the limits of its interval: edf / chi2_{1-a/2}, edf / chi2_{a/2}, a = 1 - confidence."""
    tail = (1.0 - confidence) / 2.0
    low, high = (2.0 * scipy.special.gammaincinv(edf / 2.0, p) for p in (tail, 1.0 - tail))
    return edf / high, edf / low
