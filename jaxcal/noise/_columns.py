r"""What one squared coefficient contributes to the Allan variance and to the spectrum: continuous, and exact for samples.

The exact Allan variance of samples follows from the generalised covariance G of their phase,

.. math:: \sigma^2(m\,dt) = \frac{3 G(0) - 4 G(m) + G(2m)}{m^2},

with G = -|h|/(2 dt) for N, (Q: 1/dt^2 at h = 0), dt (|h|^3 - |h|)/12 for K, and for flicker
:math:`G = \frac{1}{4\pi}[(4h^2-1)\,H(h) - 3h^2]`, :math:`H(h) = \sum_{j\le h} 1/(2j-1)`, whose second difference is the
semivariogram of IEEE 952 flicker sampled at dt.
"""

import math

import jax
import jax.numpy as jnp

from .._types import Any

#: x below which the Gauss-Markov forms lose their digits to cancellation and the random-walk limit is exact to 1e-5
_SHORT = 2e-5


def allan_column(term: str, tau, dt=None, scale: Any = None):
    """Allan variance per squared coefficient at cluster time tau (s); `scale` is Tc (markov) or f0 (sinusoid)."""
    m = None if dt is None else tau / dt
    if term == "Q":
        return 3.0 / tau**2
    if term == "N":
        return 1.0 / tau
    if term == "B":
        return jnp.full_like(tau, 2.0 * math.log(2.0) / math.pi) if m is None else _flicker(m)
    if term == "K":
        return tau / 3.0 if m is None else tau / 3.0 * (1.0 + 0.5 / m**2)
    if term == "R":
        return tau**2 / 2.0
    if term == "markov":
        return _markov(tau, dt, scale)
    if term == "sinusoid":
        angle = math.pi * scale * tau
        if m is None:
            return (jnp.sin(angle) ** 2 / angle) ** 2
        return jnp.sin(angle) ** 4 / (m * jnp.sin(angle / m)) ** 2
    raise ValueError(f"unknown term {term!r}")


def _flicker(m):
    """[(16 m^2 - 1) H(2m) - (16 m^2 - 4) H(m)] / (4 pi m^2), with H by the digamma function."""
    constant = jnp.euler_gamma / 2.0 + math.log(2.0)
    low, high = (jax.scipy.special.digamma(j * m + 0.5) / 2.0 for j in (1.0, 2.0))
    return (4.0 * (high - low) - (high - 4.0 * low - 3.0 * constant) / (4.0 * m**2)) / math.pi


def _markov(tau, dt, correlation):
    x = tau / correlation
    short = x < _SHORT
    x = jnp.where(short, 1.0, x)  # both branches stay finite, so that gradients do
    walk = tau / 3.0 if dt is None else tau / 3.0 * (1.0 + 0.5 * (dt / tau) ** 2)
    if dt is None:
        u = -jnp.expm1(-x)
        full = correlation / x * (1.0 - u * (2.0 + u) / (2.0 * x))
    else:
        m = tau / dt
        e, q = -jnp.expm1(-dt / correlation), -jnp.expm1(-x)  # 1 - a and 1 - a^m without losing digits
        full = correlation / 2.0 * (m * e * (2.0 - e) - (1.0 - e) * q * (2.0 + q)) / (m * e) ** 2
    return jnp.where(short, walk, full)


def spectral_column(term: str, f, dt=None, scale: Any = None):
    """Two-sided density per squared coefficient at frequency f (Hz); `scale` is Tc (markov)."""
    omega = 2.0 * math.pi * f if dt is None else 2.0 / dt * jnp.sin(math.pi * f * dt)
    if term == "Q":
        return jnp.zeros_like(f) if dt is None else dt * omega**2
    if term == "N":
        return jnp.ones_like(f)
    if term == "B":
        return 1.0 / omega
    if term == "K":
        return 1.0 / omega**2
    if term == "markov":
        if dt is None:
            return scale**2 / (1.0 + (omega * scale) ** 2)
        a = jnp.exp(-dt / scale)
        return scale / 2.0 * (1.0 - a**2) * dt / ((1.0 - a) ** 2 + a * (omega * dt) ** 2)
    if term in ("R", "sinusoid"):
        return jnp.zeros_like(f)
    raise ValueError(f"unknown term {term!r}")
