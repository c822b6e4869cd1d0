r"""Ordinates of a record: estimates of its two-sided density at equally spaced frequencies above zero.

The functions take centred samples (channels, n), NumPy on the host or traced, and give (channels, ordinates). Ordinate k of the
periodogram and of Welch's method stands at k/(n dt), k = 1 .. n/2 (n the length of a segment for Welch), that of the DCT-II at
k/(2 n dt), k = 1 .. n-1.
"""

import os

import jax
import jax.numpy as jnp
import numpy as np
import scipy.fft

from .._types import Any

_PARALLEL_FROM = 50_000  # samples; below, starting threads costs more than they bring


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
    """Mean over segments, each less its mean and under a Hann window, of |X_k|^2 in units of its expectation for white noise.

    That expectation is the sum of the squared window, but for the first ordinate, of which the segment's mean takes a sixth.
    """
    window = hann(segment)
    transform = np.abs(np.asarray(scipy.fft.rfft(window)))[1:]
    expected = np.sum(window**2) - transform**2 / segment
    if isinstance(x, np.ndarray):
        segments = np.lib.stride_tricks.sliding_window_view(x, segment, axis=-1)[:, ::step]
        # channel by channel: the segments hold the record twice
        power = [_squares((part - part.mean(axis=-1, keepdims=True)) * window).mean(axis=0)[1:] for part in segments]
        return np.stack(power) * (dt / expected)
    index = np.arange(0, x.shape[-1] - segment + 1, step)[:, None] + np.arange(segment)
    segments = x[:, index]
    segments = segments - jnp.mean(segments, axis=-1, keepdims=True)
    squares = _squares(segments * jnp.asarray(window, dtype=x.dtype)[None, None, :])
    return jnp.mean(squares, axis=1)[:, 1:] * jnp.asarray(dt / expected, dtype=x.dtype)[None, :]


def hann(length: int) -> np.ndarray:
    """The periodic Hann window."""
    return 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)


def _squares(x: Any) -> Any:
    """|X_k|^2 of the real transform along the last axis."""
    transform: Any = scipy.fft.rfft(x, workers=_workers(x)) if isinstance(x, np.ndarray) else jnp.fft.rfft(x)
    return transform.real**2 + transform.imag**2


def _workers(x: np.ndarray) -> int:
    return min(os.cpu_count() or 1, 16) if x.size > _PARALLEL_FROM else 1
