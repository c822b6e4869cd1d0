"""Generators of every noise term, exact but for flicker with a cut-off.

Q: differenced white noise. N: white noise. K: its running sum. B: the increments of flicker are stationary with
autocovariance -(4 B^2/pi)/(4 h^2 - 1), so they are drawn exactly by circulant embedding and summed. Gauss-Markov: a
first-order recursion from its stationary law. R: a line. Sinusoid: random phase.

B with a cut-off: the increments have the density (4 B^2/pi) sin x, x = pi f dt, up to the cut-off. Its edge rules out a circulant
embedding, so it is cut into bins eight times as narrow as those of the record, and each gives a sinusoid of random phase
and amplitude with the variance of its bin; the lowest, around zero, gives a line of random slope.
"""

import math

import numpy as np
import scipy.fft

from .._errors import DataError
from .._types import Any
from ._model import numbers

#: bins of the density of flicker with a cut-off: per bin of the record, at least so many in all, and the most there may be
_FINER, _FEWEST, _MOST = 8, 256, 2**28


def simulate(noise, n, rate, seed, resolution=None) -> np.ndarray:
    """(n,) samples of `noise`, or (n, channels); see `Noise.simulate`."""
    n, dt = checked(noise, n, rate)
    random = np.random.default_rng(seed)
    channels = {np.size(c) for c in numbers(noise) if np.ndim(c)}
    if len(channels) > 1:
        raise DataError(f"coefficients are arrays over channels of different lengths: {sorted(channels)}")
    step = None if resolution is None else _checked_resolution(resolution, max(channels, default=1))
    if channels:
        x = np.stack([_one(noise.channel(i), n, dt, random) for i in range(channels.pop())], axis=1)
    else:
        x = _one(noise, n, dt, random)
    return x if step is None else np.round(x / step) * step


def _one(noise, n: int, dt: float, random: np.random.Generator) -> np.ndarray:
    x = np.zeros(n)
    if noise.Q:
        x += float(noise.Q) / dt * np.diff(random.standard_normal(n + 1))
    if noise.N:
        x += float(noise.N) / math.sqrt(dt) * random.standard_normal(n)
    if noise.K:
        x += float(noise.K) * math.sqrt(dt) * np.cumsum(random.standard_normal(n))
    if noise.B:
        edge = math.pi * dt * float(noise.cutoff)
        x += float(noise.B) * (_flicker(n, random) if edge >= math.pi / 2.0 else _flicker_cut(n, edge, random))
    if noise.R:
        x += float(noise.R) * dt * np.arange(n)
    for strength, correlation in noise.markov:
        from scipy.signal import lfilter  # slow to import, seldom needed

        a = math.exp(-dt / correlation)
        sigma = float(strength) * math.sqrt(correlation / 2.0)
        z = random.standard_normal(n)
        z[1:] *= math.sqrt(-math.expm1(-2.0 * dt / correlation))
        x += sigma * np.asarray(lfilter([1.0], [1.0, -a], z))
    for amplitude, frequency in noise.sinusoid:
        x += float(amplitude) * np.sin(2.0 * math.pi * frequency * dt * np.arange(n) + random.uniform(0.0, 2.0 * math.pi))
    return x


def _flicker(n: int, random: np.random.Generator) -> np.ndarray:
    """Flicker of unit B: running sum of increments drawn by circulant embedding, which is exact here."""
    half = 1 << (n - 1).bit_length()  # a quick length for the transform; any from n on is exact
    h = np.arange(half + 1, dtype=float)
    row = -(4.0 / math.pi) / (4.0 * h**2 - 1.0)
    eigenvalues = np.maximum(np.fft.rfft(np.concatenate([row, row[-2:0:-1]])).real, 0.0)  # rounding only
    length = 2 * half
    z = random.standard_normal(half + 1) + 1j * random.standard_normal(half + 1)
    z[[0, -1]] = z[[0, -1]].real * math.sqrt(2.0)
    return np.cumsum(np.fft.irfft(np.sqrt(eigenvalues * length / 2.0) * z, length)[:n])


def _flicker_cut(n: int, edge: float, random: np.random.Generator) -> np.ndarray:
    """Flicker of unit B up to x = `edge`: running sum of increments drawn bin by bin of their density."""
    length, variance = cut_bins(n, edge)
    z = random.standard_normal(len(variance)) + 1j * random.standard_normal(len(variance))
    z[0] = z[0].real * math.sqrt(2.0)
    # the transform divides by the length and joins every bin but the first with its mirror image
    share = np.concatenate([variance[:1], 0.5 * variance[1:]])
    return np.cumsum(np.fft.irfft(np.sqrt(share / 2.0) * length * z, length)[:n])


def cut_bins(n: int, edge: float) -> tuple[int, np.ndarray]:
    """The number of values of the transform, and the variance of the increments in each bin x = pi k/length, k = 0, 1, ..."""
    wanted = 2 * max(_FINER * n // 2, math.ceil(0.5 * math.pi * _FEWEST / edge))
    if wanted > _MOST:
        raise DataError(
            f"a cutoff of {edge / math.pi:.3g} times the sampling rate and {n} samples need a spectrum of {wanted} values, more than "
            f"{_MOST}; simulate fewer samples, or a higher cut-off"
        )
    length: int = scipy.fft.next_fast_len(wanted, real=True)  # type: ignore[assignment]
    width = math.pi / length  # of a bin, in x
    bins = np.arange(min(math.floor(edge / width + 0.5), (length - 1) // 2) + 1)
    low, high = np.maximum(bins - 0.5, 0.0) * width, (bins + 0.5) * width
    high[-1] = edge
    return length, 8.0 / math.pi * np.sin((low + high) / 2.0) * np.sin((high - low) / 2.0)


def checked(noise, n: Any, rate: Any) -> tuple[int, float]:
    """The number of samples and the sampling interval, once these and the coefficients are in order."""
    if not (isinstance(n, (int, np.integer)) and n >= 1):
        raise DataError(f"n must be a positive whole number of samples; got {n!r}")
    if not (isinstance(rate, (int, float, np.number)) and 0.0 < float(rate) < math.inf):
        raise DataError(f"rate must be positive and finite, in Hz; got {rate!r}")
    for value in numbers(noise)[:-1]:
        if not np.all(np.isfinite(value)) or np.any(np.asarray(value) < 0):
            raise DataError(f"noise coefficients must be finite and not negative; got {value!r}")
    if not np.all(np.asarray(noise.cutoff) > 0):
        raise DataError(f"cutoff must be positive, in Hz, or inf for flicker without one; got {noise.cutoff!r}")
    return int(n), 1.0 / float(rate)


def _checked_resolution(resolution: Any, channels: int) -> np.ndarray:
    try:
        step = np.asarray(resolution, dtype=float)
    except (TypeError, ValueError):
        step = np.asarray(math.nan)
    if not (np.all(np.isfinite(step)) and np.all(step > 0)) or (step.ndim and step.shape != (channels,)):
        raise DataError(
            f"resolution must be the positive step of the output, or one for each of the {channels} channel"
            f"{'s' if channels > 1 else ''}; got {resolution!r}"
        )
    return step
