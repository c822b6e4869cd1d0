r"""B: bias instability (flicker), with or without a cut-off frequency above which the density is zero.

The exact Allan variance of samples is

.. math:: \sigma^2(m\,dt) = \frac{3 G(0) - 4 G(m) + G(2m)}{m^2},\qquad
          G = \frac{1}{4\pi}[(4h^2-1)\,H(h) - 3h^2],\quad H(h) = \sum_{j\le h} \frac{1}{2j-1}

where G is the generalised covariance of phase, whose second difference is the semivariogram of IEEE 952 flicker sampled at dt.

Flicker with a cut-off frequency has no G of that form. Its Allan variance is the integral over the density, with
:math:`x = \pi f\,dt`, X the value of x at the cut-off or at half the rate, and :math:`u = mX`:

.. math:: \sigma^2(m\,dt) = \frac{2}{\pi m^2}\int_0^X \frac{\sin^4 mx}{\sin^3 x}\,dx
          \;\to\; \frac{2}{\pi}\int_0^u \frac{\sin^4 v}{v^3}\,dv \quad (dt \to 0).
"""

import functools
import math
from typing import Any, ClassVar

import jax
import jax.core
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from ..._arrays import power_of_two
from ..._precision import array_module
from . import _numeric
from ._base import Term
from ._power_law import angular, outer_difference

#: flicker with a cut-off is integrated from zero up to this u, where the integrand has no cancellation. Beyond it, the integral above
#: the cut-off is subtracted from the value without a cut-off. Nodes and weights on (0, 1) and for exp(-y): both are good to 1e-14 there
_NEAR = 12.0
_UNIT = tuple(0.5 * (part + shift) for part, shift in zip(np.polynomial.legendre.leggauss(32), (1.0, 0.0), strict=True))
_DECAY = np.polynomial.laguerre.laggauss(8)
_EXACT = 1 << 16  # longest record whose ordinates are computed from the sum over lags; longer ones reuse its first ordinates, scaled
_SCALED = 4096  # number of ordinates that a longer record reuses


class Flicker(Term):
    """Bias instability with the density 1/(2 pi f); for samples 2 pi f becomes (2/dt) sin(pi f dt).

    Attributes
    ----------
    cutoff : frequency in Hz above which the density is zero; inf for no cut-off.
    """

    cutoff: Any = math.inf
    name: ClassVar[str] = "B"

    @property
    def whole(self) -> bool:
        """Whether there is no cut-off."""
        return not isinstance(self.cutoff, jax.core.Tracer) and bool(np.all(np.isposinf(self.cutoff)))

    def psd(self, f: Any, dt: Any = None) -> Any:
        """1/omega up to the cut-off, zero above it."""
        density = 1.0 / angular(f, dt)
        return density if self.whole else array_module(f, dt, self).where(f <= self.cutoff, density, 0.0)

    def avar(self, tau: Any, dt: Any = None) -> Any:
        """2 ln 2/pi. For samples it is computed by the digamma function, with a cut-off by integration."""
        xp = array_module(tau, dt, self)
        flat = xp.full_like(tau, 2.0 * math.log(2.0) / math.pi) if dt is None else _sampled(tau / dt)
        cutoff = self.cutoff if np.ndim(self.cutoff) else xp.broadcast_to(self.cutoff, xp.shape(flat))
        return flat if self.whole else _cut(tau, dt, cutoff, flat)

    def ordinates(self, k: Any, n: int, dt: float) -> Any:
        """Nearly dt/s (1 - 2/(pi^2 k)). Short records, and the first ordinates of long ones, are computed from the sum over lags."""
        k = np.asarray(k)
        table = _ratio(min(n, _EXACT))
        ratio = 1.0 - 2.0 / (np.pi**2 * k.astype(float))
        known = k <= (len(table) if n <= _EXACT else _SCALED)
        ratio[known] = table[k[known] - 1]
        return dt / (2.0 * np.sin(np.pi * k / n / 2.0)) * ratio

    def lagged(self, h: Any, small: Any, large: Any, dt: Any) -> Any:
        """From the generalised covariance (4 x^2 - 1) psi(|x| + 1/2)/(8 pi), which omits polynomials up to the third degree."""
        return outer_difference(lambda x: _inner(x, small), h, small, large) if self.whole else None

    def integral(self, h: Any) -> Any:
        """h^2 ln|h|/(2 pi); with a cut-off, computed from the density."""
        # a traced cut-off is ignored: it has no effect on means over times much longer than its inverse
        if not self.whole and not isinstance(self.cutoff, jax.core.Tracer):
            return super().integral(h)
        xp = array_module(h)
        size = xp.abs(h)
        return h**2 * xp.log(xp.where(size > 0.0, size, 1.0)) / (2.0 * math.pi)

    def simulate(self, n: int, dt: float, random: np.random.Generator) -> Any:
        """Running sum of increments, drawn by circulant embedding, which is exact, or with a cut-off bin by bin from their density."""
        edge = math.pi * dt * float(self.cutoff)
        if edge < math.pi / 2.0:
            return np.cumsum(_numeric.from_bins(*_numeric.cut_bins(n, edge), n, random))
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


@jax.jit
def _cut(tau, dt, cutoff, whole):
    """Allan variance of flicker with a cut-off; `whole` is the one without. Cluster times are multiples of dt."""
    cut = jnp.isfinite(cutoff)
    cutoff = jnp.where(cut, cutoff, 1.0)  # every branch must stay finite for the gradients to be finite
    if dt is None:
        u, x = math.pi * cutoff * tau, None
    else:
        x = jnp.minimum(math.pi * dt * cutoff, math.pi / 2.0)
        u = tau / dt * x
    near = u < _NEAR
    inner = _below(jnp.where(near, u, _NEAR), x)
    outer = whole - _above(jnp.where(near, _NEAR, u), None if x is None else jnp.where(near, math.pi / 4.0, x))
    return jnp.where(cut, jnp.where(near, inner, outer), whole)


def _below(u, x):
    """(2/pi) int_0^u sin^4 v / v^3 [y / sin y]^3 dv with y = v x / u, the angle of a sample; the bracket is 1 in the continuous form."""
    node, weight = (jnp.asarray(part, u.dtype).reshape((1,) * u.ndim + (-1,)) for part in _UNIT)
    v = u[..., None] * node
    bend = 1.0 if x is None else jnp.sinc(x[..., None] * node / math.pi) ** -3
    return 2.0 / math.pi * u**2 * jnp.sum(weight * node * jnp.sinc(v / math.pi) ** 4 * bend, axis=-1)


def _above(u, x):
    """The integral of `_below` from u to infinity (to pi m/2 for samples), with sin^4 v = 3/8 - cos(2v)/2 + cos(4v)/8.

    The path of the oscillating parts is moved to v = u + i y/k, where they decay as exp(-y). For samples the upper end contributes
    nothing, because the integral along the moved path is imaginary there.
    """
    node, weight = (jnp.asarray(part, u.dtype).reshape((1,) * u.ndim + (-1,)) for part in _DECAY)
    if x is None:
        total = 0.1875 / u**2
    else:
        total = 0.1875 * (x / u) ** 2 * (jnp.cos(x) / jnp.sin(x) ** 2 - jnp.log(jnp.tan(x / 2.0)))
    for k, amplitude in ((2.0, -0.5), (4.0, 0.125)):
        v, y = u[..., None], node / k
        if x is None:
            real, imaginary = v, y
        else:  # sin(s (v + i y)) / s, where s is the step of the angle
            s = x[..., None] / v
            real, imaginary = jnp.sin(x[..., None]) * jnp.cosh(s * y) / s, jnp.cos(x[..., None]) * jnp.sinh(s * y) / s
        size = weight / k / (real**2 + imaginary**2) ** 3  # for the inverse cube of the complex number
        cosine = jnp.sum(size * real * (real**2 - 3.0 * imaginary**2), axis=-1)
        sine = jnp.sum(size * imaginary * (imaginary**2 - 3.0 * real**2), axis=-1)
        total = total - amplitude * (jnp.sin(k * u) * cosine + jnp.cos(k * u) * sine)
    return 2.0 / math.pi * total
