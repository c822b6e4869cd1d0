r"""What one squared coefficient contributes to the Allan variance and to the spectrum: continuous, and exact for samples.

The exact Allan variance of samples follows from the generalised covariance G of their phase,

.. math:: \sigma^2(m\,dt) = \frac{3 G(0) - 4 G(m) + G(2m)}{m^2},

with G = -|h|/(2 dt) for N, (Q: 1/dt^2 at h = 0), dt (|h|^3 - |h|)/12 for K, and for flicker
:math:`G = \frac{1}{4\pi}[(4h^2-1)\,H(h) - 3h^2]`, :math:`H(h) = \sum_{j\le h} 1/(2j-1)`, whose second difference is the
semivariogram of IEEE 952 flicker sampled at dt.

Flicker whose density ends at a cut-off frequency has no G of that form. Its Allan variance is the integral over the density,
with :math:`x = \pi f\,dt`, X at the cut-off or half the rate, and :math:`u = mX`:

.. math:: \sigma^2(m\,dt) = \frac{2}{\pi m^2}\int_0^X \frac{\sin^4 mx}{\sin^3 x}\,dx
          \;\to\; \frac{2}{\pi}\int_0^u \frac{\sin^4 v}{v^3}\,dv \quad (dt \to 0).
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
import scipy.special

from .._precision import array_module
from .._types import Any

#: x below which the Gauss-Markov forms lose their digits to cancellation and the random-walk limit is exact to 1e-5
_SHORT = 2e-5

#: the u up to which flicker with a cut-off is integrated from zero (its integrand has no cancellation there); beyond it, what
#: lies above the cut-off is taken from the whole. Nodes and weights on (0, 1) and for exp(-y): both good to 1e-14 there
_NEAR = 12.0
_UNIT = tuple(0.5 * (part + shift) for part, shift in zip(np.polynomial.legendre.leggauss(32), (1.0, 0.0), strict=True))
_DECAY = np.polynomial.laguerre.laggauss(8)


def allan_column(term: str, tau, dt=None, scale: Any = None):
    """Allan variance per squared coefficient at cluster time tau (s).

    `scale` is Tc (markov), f0 (sinusoid) or the cut-off frequency (B; None for none).
    """
    xp, m = array_module(tau, dt, scale), None if dt is None else tau / dt
    if term == "Q":
        return 3.0 / tau**2
    if term == "N":
        return 1.0 / tau
    if term == "B":
        whole = xp.full_like(tau, 2.0 * math.log(2.0) / math.pi) if m is None else _flicker(m)
        return whole if scale is None else _flicker_cut(tau, dt, scale, whole)
    if term == "K":
        return tau / 3.0 if m is None else tau / 3.0 * (1.0 + 0.5 / m**2)
    if term == "R":
        return tau**2 / 2.0
    if term == "markov":
        return _markov(tau, dt, scale)
    if term == "sinusoid":
        angle = math.pi * scale * tau
        if m is None:
            return (xp.sin(angle) ** 2 / angle) ** 2
        return xp.sin(angle) ** 4 / (m * xp.sin(angle / m)) ** 2
    raise ValueError(f"unknown term {term!r}")


def _flicker(m):
    """[(16 m^2 - 1) H(2m) - (16 m^2 - 4) H(m)] / (4 pi m^2), with H by the digamma function."""
    digamma = scipy.special.digamma if array_module(m) is np else jax.scipy.special.digamma
    constant = np.euler_gamma / 2.0 + math.log(2.0)
    low, high = (digamma(j * m + 0.5) / 2.0 for j in (1.0, 2.0))
    return (4.0 * (high - low) - (high - 4.0 * low - 3.0 * constant) / (4.0 * m**2)) / math.pi


@jax.jit
def _flicker_cut(tau, dt, cutoff, whole):
    """Flicker up to the cut-off; `whole` is that without one. Cluster times are multiples of dt."""
    cut = jnp.isfinite(cutoff)
    cutoff = jnp.where(cut, cutoff, 1.0)  # every branch stays finite, so that gradients do
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
    """(2/pi) int_0^u sin^4 v / v^3 [y / sin y]^3 dv, y = v x / u the angle of a sample; the bracket is 1 in the continuous form."""
    node, weight = (jnp.asarray(part, u.dtype).reshape((1,) * u.ndim + (-1,)) for part in _UNIT)
    v = u[..., None] * node
    bend = 1.0 if x is None else jnp.sinc(x[..., None] * node / math.pi) ** -3
    return 2.0 / math.pi * u**2 * jnp.sum(weight * node * jnp.sinc(v / math.pi) ** 4 * bend, axis=-1)


def _above(u, x):
    """The same integral from u to infinity (pi m/2 for samples): sin^4 v is 3/8 - cos(2v)/2 + cos(4v)/8.

    The oscillating parts are moved to v = u + i y/k, where they decay as exp(-y). The upper end of samples adds nothing:
    there the moved integral is imaginary.
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
        else:  # sin(s (v + i y)) / s, s the step of the angle
            s = x[..., None] / v
            real, imaginary = jnp.sin(x[..., None]) * jnp.cosh(s * y) / s, jnp.cos(x[..., None]) * jnp.sinh(s * y) / s
        size = weight / k / (real**2 + imaginary**2) ** 3  # of the inverse cube
        cosine = jnp.sum(size * real * (real**2 - 3.0 * imaginary**2), axis=-1)
        sine = jnp.sum(size * imaginary * (imaginary**2 - 3.0 * real**2), axis=-1)
        total = total - amplitude * (jnp.sin(k * u) * cosine + jnp.cos(k * u) * sine)
    return 2.0 / math.pi * total


def _markov(tau, dt, correlation):
    xp = array_module(tau, dt, correlation)
    x = tau / correlation
    short = x < _SHORT
    x = xp.where(short, 1.0, x)  # both branches stay finite, so that gradients do
    walk = tau / 3.0 if dt is None else tau / 3.0 * (1.0 + 0.5 * (dt / tau) ** 2)
    if dt is None:
        u = -xp.expm1(-x)
        full = correlation / x * (1.0 - u * (2.0 + u) / (2.0 * x))
    else:
        m = tau / dt
        e, q = -xp.expm1(-dt / correlation), -xp.expm1(-x)  # 1 - a and 1 - a^m without losing digits
        full = correlation / 2.0 * (m * e * (2.0 - e) - (1.0 - e) * q * (2.0 + q)) / (m * e) ** 2
    return xp.where(short, walk, full)


def spectral_column(term: str, f, dt=None, scale: Any = None):
    """Two-sided density per squared coefficient at frequency f (Hz); `scale` is Tc (markov) or the cut-off (B; None for none)."""
    xp = array_module(f, dt, scale)
    omega = 2.0 * math.pi * f if dt is None else 2.0 / dt * xp.sin(math.pi * f * dt)
    if term == "Q":
        return xp.zeros_like(f) if dt is None else dt * omega**2
    if term == "N":
        return xp.ones_like(f)
    if term == "B":
        return 1.0 / omega if scale is None else xp.where(f <= scale, 1.0 / omega, 0.0)
    if term == "K":
        return 1.0 / omega**2
    if term == "markov":
        if dt is None:
            return scale**2 / (1.0 + (omega * scale) ** 2)
        a = xp.exp(-dt / scale)
        return scale / 2.0 * (1.0 - a**2) * dt / ((1.0 - a) ** 2 + a * (omega * dt) ** 2)
    if term in ("R", "sinusoid"):
        return xp.zeros_like(f)
    raise ValueError(f"unknown term {term!r}")
