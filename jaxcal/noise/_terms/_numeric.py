r"""Numerical integration of a term's density over the angle :math:`\omega = 2\pi f dt` of a sample, for terms without closed forms.

The density S is evaluated at the nodes of Gauss-Legendre panels that are evenly spaced in the logarithm of the angle. They reach down
to angles that contribute nothing if the density rises more slowly than f^-3. A factor cos(p omega) is integrated exactly against the
polynomial of each panel (Filon's rule, with spherical Bessel functions), so that the cost does not depend on the length of a record.
With s = 2 sin(omega/2),

.. math:: \sigma^2(m\,dt) = \frac{8}{\pi m^2 dt}\int_0^\pi S\,\frac{\sin^4(m\omega/2)}{s^2}\,d\omega

is the Allan variance. The expected DCT-II ordinate k of n samples is, with theta = pi k/n and F = s^2 S,

.. math:: S(\theta) + \frac{2}{\pi n}\cos^2\frac\theta2 \int_0^\pi \Big\{{\sin^2\atop\cos^2}\Big\}\frac{n\omega}{2}\;
          \frac{F(\omega) - F(\theta) - F'(\theta)(\cos\omega - \cos\theta)}{(\cos\omega - \cos\theta)^2}\,d\omega

(sine for even, cosine for odd k; F' is the derivative with respect to the cosine). The second part is leakage from other frequencies.
It is an integral over the spectrum of the truncated basis function. A random walk (F constant) and white noise (F linear in the
cosine) do not leak and are subtracted before the integration.
"""

import functools
import math

import jax
import jax.core
import numpy as np
import scipy  # loads its parts when they are first used

from ..._arrays import power_of_two
from ..._errors import DataError

_NODES = 8
#: edges of the panels: four panels per octave, and one per four octaves at the low end, where a density is a power law
_EDGES = np.concatenate([2.0 ** np.arange(-84.0, -44.0, 4.0), 2.0 ** np.arange(-44.0, 0.1, 0.25)]) * np.pi
_UNIT, _WEIGHT = np.polynomial.legendre.leggauss(_NODES)
_CENTRE, _HALF = (_EDGES[1:] + _EDGES[:-1]) / 2.0, np.diff(_EDGES) / 2.0
#: angles of the nodes, and weights of an integral over 0 .. pi without a cosine
ANGLE = (_CENTRE[:, None] + _HALF[:, None] * _UNIT).ravel()
_PLAIN = (_HALF[:, None] * _WEIGHT).ravel()
#: m omega up to which the kernel of the Allan variance is smooth within a panel; samples per cluster that stand for a continuous signal
_SMOOTH, _CONTINUOUS = 4.0, 4096.0
#: first ordinates whose leakage is computed one by one; how many per decade of the others
_SINGLE, _PER_DECADE = 64, 96
_LONGER = 8  # length of what is drawn, over the length of the record that is its middle


def _step(angle):
    """Modulus of the transfer function of a difference."""
    return 2.0 * np.sin(angle / 2.0)


def _cosine(p):
    """(p, nodes) weights that integrate S cos(p omega), a row for each p."""
    order = np.arange(_NODES)
    legendre = (order + 0.5)[:, None] * np.polynomial.legendre.legvander(_UNIT, _NODES - 1).T * _WEIGHT
    bessel = scipy.special.spherical_jn(order, np.multiply.outer(p, _HALF)[..., None])
    turn = np.multiply.outer(p, _CENTRE)[..., None] + np.pi / 2.0 * order  # i^l e^{i p omega}
    return 2.0 * (_HALF[:, None] * ((bessel * np.cos(turn)) @ legendre)).reshape(len(p), -1)


@functools.lru_cache(maxsize=32)
def _allan_weights(sizes: tuple[float, ...]) -> np.ndarray:
    """(nodes, sizes) weights of S in the Allan variance at the cluster sizes, multiplied by dt."""
    m = np.array(sizes)[:, None]
    smooth = np.repeat(m * _EDGES[None, 1:] < _SMOOTH, _NODES, axis=1)
    oscillating = (3.0 * _PLAIN - 4.0 * _cosine(m[:, 0]) + _cosine(2.0 * m[:, 0])) / 8.0
    return (8.0 / np.pi * np.where(smooth, _PLAIN * np.sin(m * ANGLE / 2.0) ** 4, oscillating) / (m * _step(ANGLE)) ** 2).T


def allan_variance(psd, tau, dt):
    """Allan variance of a density at cluster times; without dt, that of samples close enough to stand for the continuous signal."""
    if isinstance(tau, jax.core.Tracer) or isinstance(dt, jax.core.Tracer):
        raise DataError("the Allan variance of a term without closed form needs cluster times that are not traced; give them as an array")
    tau = np.asarray(tau, dtype=float)
    m, step = (np.full_like(tau, _CONTINUOUS), tau / _CONTINUOUS) if dt is None else (tau / dt, np.full_like(tau, dt))
    weights = _allan_weights(tuple(m.ravel().tolist())).reshape(-1, *m.shape)
    nodes = ANGLE.reshape(-1, *(1,) * m.ndim) / (2.0 * np.pi)
    return (weights * psd(nodes / (step if dt is None else dt), dt)).sum(axis=0) / step


def ordinates(psd, k, n: int, dt: float) -> np.ndarray:
    """`Term.ordinates` of a density: its level, corrected for leakage that is computed at some ordinates and interpolated between them."""
    k = np.asarray(k)
    angle = np.pi * k / n
    level = _at(psd, angle, dt)
    single = min(_SINGLE, n - 1)
    number = math.ceil(_PER_DECADE * math.log10((n - 1) / single)) + 1
    many = np.unique(np.concatenate([np.arange(1.0, single), np.round(np.geomspace(single, n - 1, number))]))
    theta = np.pi * many / n
    density = _step(ANGLE) ** 2 * _at(psd, ANGLE, dt)
    near = [_step(a) ** 2 * _at(psd, a, dt) for a in (theta, theta * (1.0 - 1e-4), theta * (1.0 - 2e-4))]
    slope = -(3.0 * near[0] - 4.0 * near[1] + near[2]) / (2e-4 * theta * np.sin(theta))
    away = -2.0 * np.sin((ANGLE + theta[:, None]) / 2.0) * np.sin((ANGLE - theta[:, None]) / 2.0)
    curved = (density - near[0][:, None] - slope[:, None] * away) / away**2
    leak = curved @ _PLAIN - np.where(many < _SINGLE, 1.0 - 2.0 * (many % 2), 0.0) * (curved @ _cosine(np.array([float(n)]))[0])
    leak *= np.cos(theta / 2.0) ** 2 / (np.pi * n)
    return level * (1.0 + np.interp(np.log(k), np.log(many), leak / _at(psd, theta, dt)))


def _at(psd, angle, dt) -> np.ndarray:
    """The density at angles, padded to a power of two of them so that `jax.numpy` compiles few programs."""
    pad = power_of_two(len(angle)) - len(angle)
    return np.asarray(psd(np.pad(angle, (0, pad), mode="edge") / (2.0 * np.pi * dt), dt))[: len(angle)]


def simulate(psd, n: int, dt: float, random: np.random.Generator) -> np.ndarray:
    """Samples whose DCT-II ordinates are independent: the middle of a longer record, which has a mean of its own there."""
    length = int(scipy.fft.next_fast_len(_LONGER * n, real=True))
    drawn = np.sqrt(ordinates(psd, np.arange(1, length), length, dt) / dt) * random.standard_normal(length - 1)
    first = (length - n) // 2
    return np.asarray(scipy.fft.idct(np.append(0.0, drawn), norm="ortho"))[first : first + n]
