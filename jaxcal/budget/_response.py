r"""The errors of a strapdown navigator, or of an attitude filter, at the end of a span for unit errors of its sensors.

The errors x = (attitude, velocity, position) in the level frame obey x' = A x + sum over the sensors of B C e, with e the errors in the
body and C its attitude. So x(t) is an integral of e with the kernel h(s) = Phi(t, s) B C(s), and for noise with the generalised
covariance G of its integral over cells of length d

.. math:: \operatorname{cov} x = \sum_{ij} h_i h_j [2 G((i-j)d) - G((i-j+1)d) - G((i-j-1)d)],

which is exact for a kernel that is constant in each cell, whatever the law of the noise. White noise needs only the mean of h h' in a cell.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._arrays import skew
from .._compile import filter_jit
from .._types import Array
from .._units import EARTH_RATE, STANDARD_GRAVITY

CELLS = 1024  # of a span; parts of 1e-6 of a flicker or a random walk are then lost
SENSORS = ("gyro", "accel", "mag")
_EARTH_RADIUS = 6371e3  # m
#: the tilt that an accelerometer's error makes: -(up x error)/g
LEVEL = -skew(np.array([0.0, 0.0, 1.0])) / STANDARD_GRAVITY


def dynamics(aid: float | None, dip: float, field: float, latitude: float | None) -> tuple[np.ndarray, np.ndarray]:
    """A (9, 9) without the specific force, and B (3, 9, 3) of the sensors.

    aid : s, time constant of level and heading from accelerometer and magnetometer; None without.
    dip, field : rad and T, of the Earth's field.
    latitude : rad, for a rotating Earth; None for none.
    """
    a, b = np.zeros((9, 9)), np.zeros((3, 9, 3))
    b[0, :3] = np.eye(3)
    if latitude is not None:
        earth = skew(EARTH_RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)]))
        a[:3, :3], a[3:6, 3:6] = -earth, -2 * earth
        # the plumb line is the sum of the attraction, which points to the centre, and of the centrifugal acceleration
        out = np.array([0.0, 0.0, STANDARD_GRAVITY]) - _EARTH_RADIUS * (earth @ earth)[:, 2]
        a[3:6, 6:] = (3 * np.outer(out, out) / (out @ out) - np.eye(3)) * np.linalg.norm(out) / _EARTH_RADIUS - earth @ earth
    if aid is None:
        a[6:, 3:6] = b[1, 3:6] = np.eye(3)
        return a, b
    a[:3, :3] -= np.eye(3) / aid
    a[2, 1] -= np.tan(dip) / aid  # a tilt about north turns the horizontal field
    b[1, :3], b[2, 2, 0] = LEVEL / aid, 1 / (aid * field * np.cos(dip))
    return a, b


def lags(term: Any, start: float, stop: float, count: int, rest: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Covariances of the integral of a term over cells: by lag (count + 1,), with its mean over the rest before, and of that mean.

    Without a rest there is no mean to know, and these two are zero.
    """
    size = (stop - start) / count
    lag = size * np.arange(-1.0, count + 2)
    ends = start + size * np.arange(count + 1.0)
    g, near, far, (none, whole) = (np.asarray(term.integral(at)) for at in (lag, -ends, -rest - ends, np.array([0.0, rest])))
    known = 1 / rest if rest else 0.0
    return 2 * g[1:-1] - g[:-2] - g[2:], known * (near[1:] - near[:-1] - far[1:] + far[:-1]), 2 * known**2 * (none - whole)


@filter_jit
def response(a: Any, b: Any, cells: Any, size: Any, tables: Any) -> dict[str, Array]:
    """Transition over the span (9, 9), the integral of the kernel times each driver (3, 9, 3, k), and covariances for unit noise.

    tables : (toeplitz (t, n + 1), mean (t, n), square (t,)) of t terms, from `lags`.

    Returns
    -------
    dictionary with "transition", "driven", "white" (3, 3, 9, 9) by sensor and axis, and "coloured" (t, 3, 3, 9, 9).
    """
    # the attitude error turns the specific force, unless the level is aided and velocity is no part of it
    turned = -skew(cells["force"]) * a[6, 3]
    rates = jnp.zeros((len(turned), 9, 9)).at[:].set(a).at[:, 3:6, :3].add(turned)
    whole, back, halfway = (_exponential(rates * step) for step in (size, -size, -size / 2))
    one, square = jnp.eye(9), rates @ rates * size**2
    end = jax.lax.scan(lambda first, then: (then @ first, None), one, whole)[0]
    before = jnp.einsum("ab,nbc,ncd->nad", end, jax.lax.scan(lambda first, then: (first @ then, first), one, back)[1], halfway)
    gain = jnp.einsum("nab,nbc,scd->snad", before, one[None] + square / 24 + square @ square / 1920, b)  # mean of Phi(t, s) B over a cell
    slope = jnp.einsum("nab,nbc,scd->snad", before, rates, b) * size / 12**0.5  # and how it changes there
    driven = jnp.einsum("snab,nbck->sack", gain, cells["driven"]) * size
    white: Any = sum(jnp.einsum("snax,ncxy,snby->scab", part, cells["outer"], part) * size for part in (gain, slope))
    kernel = jnp.einsum("snab,nbc->scan", gain, cells["driven"][..., 0])
    toeplitz, mean, square = tables
    # a circulant of twice the length holds the Toeplitz matrix
    spectrum = jnp.fft.rfft(jnp.concatenate([toeplitz[:, :-1], toeplitz[:, :1] * 0, toeplitz[:, -2:0:-1]], axis=1)).real
    weight = jnp.full(len(turned) + 1, 2.0).at[jnp.array([0, -1])].set(1.0) / (2 * len(turned))
    wave = jnp.fft.rfft(kernel, 2 * len(turned))
    waves = jnp.stack([wave.real, wave.imag])
    coloured = jnp.einsum("xscaf,xscbf,tf->tscab", waves, waves, spectrum * weight[None])
    sums, cross = driven[..., 0], jnp.einsum("scan,tn->tsca", kernel, mean)
    product = jnp.einsum("sac,tscb->tscab", sums, cross)
    coloured += jnp.einsum("t,sac,sbc->tscab", square, sums, sums) - product - jnp.swapaxes(product, -1, -2)
    return {"transition": end, "driven": driven, "white": white, "coloured": coloured}


def _exponential(m: Array) -> Array:
    """Matrix exponential of small steps; exact without aids and Earth, where the third power is zero."""
    total = power = jnp.broadcast_to(jnp.eye(9), m.shape)
    for order in range(1, 5):
        power = power @ m / order
        total = total + power
    return total
