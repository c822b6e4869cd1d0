r"""B: bias instability (flicker).

The exact Allan variance of samples is

.. math:: \sigma^2(m\,dt) = \frac{3 G(0) - 4 G(m) + G(2m)}{m^2},\qquad
          G = \frac{1}{4\pi}[(4h^2-1)\,H(h) - 3h^2],\quad H(h) = \sum_{j\le h} \frac{1}{2j-1}

where G is the generalised covariance of phase, whose second difference is the semivariogram of IEEE 952 flicker sampled at dt.
"""

import functools
import math
from typing import Any, ClassVar

import jax
import jax.core
import numpy as np
import scipy  # loads its parts when they are first used

from ..._arrays import namespace, power_of_two
from ..._precision import array_module
from ..._types import AnyArray, Real
from ._base import Term
from ._power_law import angular, outer_difference

#: longest record whose ordinates are computed from the sum over lags; longer ones reuse its first ordinates, scaled; number of ordinates
#: that a longer record reuses
_EXACT, _SCALED = 1 << 16, 4096


class Flicker(Term):
    """Bias instability with the density 1/(2 pi f); for samples 2 pi f becomes (2/dt) sin(pi f dt)."""

    name: ClassVar[str] = "B"

    def psd(self, f: Real, dt: Real | None = None) -> Any:
        """1/omega."""
        return 1.0 / angular(f, dt)

    def avar(self, tau: Real, dt: Real | None = None) -> Any:
        """2 ln 2/pi. For samples it is computed by the digamma function."""
        xp = array_module(tau, dt, self)
        return xp.full_like(tau, 2.0 * math.log(2.0) / math.pi) if dt is None else _sampled(tau / dt)

    def ordinates(self, k: AnyArray, n: int, dt: float) -> Any:
        """Nearly dt/s (1 - 2/(pi^2 k)). Short records, and the first ordinates of long ones, are computed from the sum over lags."""
        k = np.asarray(k)
        table = _ratio(min(n, _EXACT))
        ratio = 1.0 - 2.0 / (np.pi**2 * k.astype(float))
        known = k <= (len(table) if n <= _EXACT else _SCALED)
        ratio[known] = table[k[known] - 1]
        return dt / (2.0 * np.sin(np.pi * k / n / 2.0)) * ratio

    def lagged(self, h: Real, small: Real, large: Real, dt: Real) -> Any:
        """From the generalised covariance (4 x^2 - 1) psi(|x| + 1/2)/(8 pi), which omits polynomials up to the third degree."""
        return outer_difference(lambda x: _inner(x, small), h, small, large)

    def integral(self, h: Real) -> Any:
        """h^2 ln|h|/(2 pi)."""
        xp = namespace(h)
        size = xp.abs(h)
        return h**2 * xp.log(xp.where(size > 0.0, size, 1.0)) / (2.0 * math.pi)

    def simulate(self, n: int, dt: float, random: np.random.Generator) -> Any:
        """Running sum of increments, drawn by circulant embedding, which is exact."""
        half = power_of_two(n)  # a fast length for the transform; any length of at least n is exact
        h = np.arange(half + 1, dtype=float)
        row = -(4.0 / math.pi) / (4.0 * h**2 - 1.0)  # the autocovariance of the increments
        eigenvalues = np.maximum(np.fft.rfft(np.concatenate([row, row[-2:0:-1]])).real, 0.0)  # only rounding is negative
        length = 2 * half
        z = random.standard_normal(half + 1) + 1j * random.standard_normal(half + 1)
        z[[0, -1]] = z[[0, -1]].real * math.sqrt(2.0)
        return np.cumsum(np.fft.irfft(np.sqrt(eigenvalues * length / 2.0) * z, length)[:n])


@functools.lru_cache(maxsize=8)
def _ratio(n: int) -> np.ndarray:
    """Expected ordinates k = 1 .. n-1, multiplied by s/dt, from the sum over lags."""
    h = np.arange(n, dtype=float)
    g = np.concatenate([[0.0], -(2.0 / np.pi) * np.cumsum(1.0 / (2.0 * h[1:] - 1.0))])
    cosine = np.fft.rfft(g * (n - h), 2 * n)[1:n].real
    sine = -np.fft.rfft(g, 2 * n)[1:n].imag
    a = np.pi * h[1:] / n
    return 2.0 / n * (cosine - sine / np.sin(a)) * 2.0 * np.sin(a / 2.0)


def _inner(x, m):
    """Second difference of the covariance of phase with step m.

    Far from zero the difference would lose its digits, so a series from the derivatives of its asymptotic form 4 x^2 ln x - ln x + 1/6
    replaces it. Linear terms of the result do not matter, because the outer second difference removes them.
    """
    x, m = np.broadcast_arrays(np.abs(np.asarray(x, dtype=float)), m)
    far = x > 32 * m + 64
    out = np.empty_like(x)
    z, step = x[far], m[far]
    r = (step / z) ** 2
    series = 4.0 * np.log(z) + 6.0 - r * (1 / 3 + r * (1 / 15 + r / 42)) + (0.5 + 0.25 * r) / z**2
    out[far] = 2.0 * step**2 * series
    near, step = x[~far], m[~far]
    out[~far] = _phase(near - step) - 2.0 * _phase(near) + _phase(near + step)
    return out / (8.0 * np.pi)


def _phase(x):
    x = np.abs(x)
    return (4.0 * x**2 - 1.0) * scipy.special.digamma(x + 0.5)


def _sampled(m):
    """Allan variance of samples, [(16 m^2 - 1) H(2m) - (16 m^2 - 4) H(m)] / (4 pi m^2), with H by the digamma function."""
    digamma = scipy.special.digamma if array_module(m) is np else jax.scipy.special.digamma
    constant = np.euler_gamma / 2.0 + math.log(2.0)
    low, high = (digamma(j * m + 0.5) / 2.0 for j in (1.0, 2.0))
    return (4.0 * (high - low) - (high - 4.0 * low - 3.0 * constant) / (4.0 * m**2)) / math.pi
