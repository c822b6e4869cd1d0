"""Exact generators of every noise term.

Q: differenced white noise. N: white noise. K: its running sum. B: the increments of flicker are stationary with
autocovariance -(4 B^2/pi)/(4 h^2 - 1), so they are drawn exactly by circulant embedding and summed. Gauss-Markov: a
first-order recursion from its stationary law. R: a line. Sinusoid: random phase.
"""

import math

import numpy as np
import scipy.signal

from .._errors import DataError
from .._types import Any


def simulate(noise, n, rate, seed) -> np.ndarray:
    """(n,) samples of `noise`, or (n, channels); see `Noise.simulate`."""
    n, dt = _checked(noise, n, rate)
    random = np.random.default_rng(seed)
    channels = {np.size(c) for c in _coefficients(noise) if np.ndim(c)}
    if len(channels) > 1:
        raise DataError(f"coefficients are arrays over channels of different lengths: {sorted(channels)}")
    if channels:
        return np.stack([_one(noise.channel(i), n, dt, random) for i in range(channels.pop())], axis=1)
    return _one(noise, n, dt, random)


def _one(noise, n: int, dt: float, random: np.random.Generator) -> np.ndarray:
    x = np.zeros(n)
    if noise.Q:
        x += float(noise.Q) / dt * np.diff(random.standard_normal(n + 1))
    if noise.N:
        x += float(noise.N) / math.sqrt(dt) * random.standard_normal(n)
    if noise.K:
        x += float(noise.K) * math.sqrt(dt) * np.cumsum(random.standard_normal(n))
    if noise.B:
        x += float(noise.B) * _flicker(n, random)
    if noise.R:
        x += float(noise.R) * dt * np.arange(n)
    for strength, correlation in noise.markov:
        a = math.exp(-dt / correlation)
        sigma = float(strength) * math.sqrt(correlation / 2.0)
        z = random.standard_normal(n)
        z[1:] *= math.sqrt(-math.expm1(-2.0 * dt / correlation))
        x += sigma * np.asarray(scipy.signal.lfilter([1.0], [1.0, -a], z))
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


def _coefficients(noise) -> list[Any]:
    return [noise.Q, noise.N, noise.B, noise.K, noise.R, *(v for pair in (*noise.markov, *noise.sinusoid) for v in pair)]


def _checked(noise, n: Any, rate: Any) -> tuple[int, float]:
    if not (isinstance(n, (int, np.integer)) and n >= 1):
        raise DataError(f"n must be a positive whole number of samples; got {n!r}")
    if not (isinstance(rate, (int, float, np.number)) and 0.0 < float(rate) < math.inf):
        raise DataError(f"rate must be positive and finite, in Hz; got {rate!r}")
    for value in _coefficients(noise):
        if not np.all(np.isfinite(value)) or np.any(np.asarray(value) < 0):
            raise DataError(f"noise coefficients must be finite and not negative; got {value!r}")
    return int(n), 1.0 / float(rate)
