r"""Heavy tails: the law of the white noise by maximum likelihood, and a record in which this noise is normal.

The innovation of a sample is the difference between the sample and its prediction from all others under the fitted spectrum,

.. math:: r_t = y_t - \hat y_t,\qquad \hat y = x - \frac{Q x}{Q_{tt}}

with Q the precision of the record. Five laws are fitted to the innovations: a normal one, Student's t, a normal one with uniform bursts
in a share of the samples, and mixtures of two and of three normal ones. The Bayesian information criterion chooses one. Each innovation
is then replaced by the normal value of the same probability, and the noise is fitted again, three times. Flicker and random walk stay,
since the prediction carries them. The standard deviation of the normal values is that of the core for bursts and mixtures, and that of the
law for Student's t.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._types import AnyArray

_ROUNDS = 3  # number of fits of the spectrum
_FARTHEST = 1e6  # distance in standard deviations of the core beyond which bursts have the density of this distance
_CLIP = 3.0  # robust standard deviations at which the record is clipped before the first fit
_BLOCK = 64  # number of samples of a running median
_FINE = 500.0  # groups of innovations per standard deviation, and per factor e beyond it
_FURTHER = 0.5  # error of the core for an unknown law, as a share of the change that the third component of a mixture made
_STEP = 1e-3  # step of the second differences of a log likelihood


class Tails(NamedTuple):
    """A record with normal white noise, the law of its own in words, the variance of N^2 over that for normal noise, and what N is of."""

    y: np.ndarray
    law: str
    factor: float
    of: str = ""


class _Law(NamedTuple):
    """A law of innovations: first parameters for a scale, log density, probability of a value below a negative one, and words.

    The first parameter is the logarithm of the scale of the normal values.
    """

    start: Callable[[float], np.ndarray]
    log_density: Callable
    below: Callable
    words: Callable


def _normal(x, scale):
    return -0.5 * (x / scale) ** 2 - np.log(scale) - 0.5 * np.log(2.0 * np.pi)


def _student(p):
    """Scale and degrees of freedom, which exceed two; the first parameter is the logarithm of the standard deviation."""
    freedom = 2.0 + np.exp(p[1])
    return np.exp(p[0]) * np.sqrt((freedom - 2.0) / freedom), freedom


def _student_density(p, x):
    scale, freedom = _student(p)
    constant = scipy.special.gammaln((freedom + 1.0) / 2.0) - scipy.special.gammaln(freedom / 2.0) - 0.5 * np.log(freedom * np.pi)
    return constant - np.log(scale) - (freedom + 1.0) / 2.0 * np.log1p((x / scale) ** 2 / freedom)


def _student_below(p, x):
    scale, freedom = _student(p)
    return scipy.special.stdtr(freedom, x / scale)


def _bursts(p):
    """Scale of the core, and share and half width of the uniform bursts that are added to it."""
    scale = np.exp(p[0])
    return scale, 1.0 / (1.0 + np.exp(-p[1])), scale * (1.0 + np.exp(p[2]))


def _bursts_density(p, x):
    scale, share, width = _bursts(p)
    # a search may try scales so small that both probabilities round to the same number
    far = np.minimum(np.abs(x) / scale, _FARTHEST)
    above, below = (scipy.special.log_ndtr(sign * width / scale - far) for sign in (1.0, -1.0))
    burst = above + np.log1p(-np.exp(below - above)) - np.log(2.0 * width)
    return np.logaddexp(np.log(1.0 - share) + _normal(x, scale), np.log(share) + burst)


def _bursts_below(p, x):
    scale, share, width = _bursts(p)
    # the integral of the normal probability is t Phi(t) + phi(t)
    upper, lower = (t * scipy.special.ndtr(t) + np.exp(_normal(t, 1.0)) for t in ((x + width) / scale, (x - width) / scale))
    burst = np.maximum(upper - lower, np.finfo(float).tiny) * scale / (2.0 * width)
    return (1.0 - share) * scipy.special.ndtr(x / scale) + share * burst


def _bursts_words(p) -> str:
    scale, share, width = _bursts(p)
    return f"uniform bursts of up to {width / scale:.2g} times its size in {100 * share:.2g} % of the samples"


def _mixture(p):
    """Scales of the components, the core first, and their shares; `p` has two parameters for each component beside the core."""
    share = np.exp(np.append(0.0, p[1::2]))
    return np.exp(p[0]) * np.append(1.0, 1.0 + np.exp(p[2::2])), share / share.sum()


def _mixture_density(p, x):
    return functools.reduce(np.logaddexp, (np.log(share) + _normal(x, scale) for scale, share in zip(*_mixture(p), strict=True)))


def _mixture_below(p, x):
    return sum(share * scipy.special.ndtr(x / scale) for scale, share in zip(*_mixture(p), strict=True))


def _mixture_words(p) -> str:
    scales, shares = _mixture(p)
    wide = sorted(zip(scales[1:] / scales[0], shares[1:], strict=True))
    return " and ".join(f"{100 * share:.2g} % of the samples {scale:.2g} times as wide" for scale, share in wide)


_LAWS = (
    _Law(lambda s: np.log([s]), lambda p, x: _normal(x, np.exp(p[0])), lambda p, x: scipy.special.ndtr(x / np.exp(p[0])), lambda p: ""),
    _Law(
        lambda s: np.array([np.log(1.3 * s), 0.5]),
        _student_density,
        _student_below,
        lambda p: f"Student's t with {_student(p)[1]:.2g} degrees of freedom",
    ),
    _Law(lambda s: np.array([np.log(s), -2.5, 2.0]), _bursts_density, _bursts_below, _bursts_words),
    _Law(lambda s: np.array([np.log(s), -2.5, 1.5]), _mixture_density, _mixture_below, _mixture_words),
    _Law(lambda s: np.array([np.log(s), -3.0, 0.0, -3.0, 2.5]), _mixture_density, _mixture_below, _mixture_words),
)


def tamed(y, dt: float, spectrum: Callable[[np.ndarray], tuple[AnyArray, AnyArray]]) -> Tails:
    """The record (n,), NaN where a sample is missing, with normal white noise.

    `spectrum` fits a record, and returns frequencies in Hz and the density there.
    """
    there = ~np.isnan(y)
    clean = _clipped(y, there)
    law, p, factor = _LAWS[0], np.zeros(1), 1.0
    for _ in range(_ROUNDS):
        predicted = _predicted(clean, dt, *spectrum(np.where(there, clean, np.nan)))
        innovation = (y - predicted)[there]
        law, p, factor = _likeliest(innovation)
        scale = np.exp(p[0])
        normal = -np.sign(innovation) * scale * scipy.special.ndtri(law.below(p, -np.abs(innovation)))
        clean = predicted.copy()
        clean[there] += normal
    if law is _LAWS[0]:
        return Tails(y, "", 1.0)
    return Tails(np.where(there, clean, np.nan), law.words(p), factor, "all samples" if law is _LAWS[1] else "the core")


def _clipped(y, there):
    """The record with values clipped that are far from a running median, and straight lines in its gaps."""
    at = np.arange(len(y))
    filled = np.interp(at, at[there], y[there])
    count = max(len(y) // _BLOCK, 1)
    blocks = np.array_split(filled, count)
    middle = np.interp(at, [block.mean() for block in np.array_split(at, count)], [np.median(block) for block in blocks])
    apart = filled - middle
    most = _CLIP * 1.4826 * np.median(np.abs(apart))
    return middle + np.clip(apart, -most, most)


def _predicted(x, dt: float, frequency, density):
    """(n,) predictions of each sample from all others."""
    at = np.arange(1, len(x)) / (2.0 * len(x) * dt)
    precision = dt * np.exp(-np.interp(np.log(at), np.log(frequency), np.log(density)))
    ordinates = np.asarray(scipy.fft.dct(x, norm="ortho"))
    ordinates[0], ordinates[1:] = 0.0, ordinates[1:] * precision
    return x - scipy.fft.idct(ordinates, norm="ortho") / precision.mean()


def _likeliest(innovation) -> tuple[_Law, np.ndarray, float]:
    """The likeliest law, its parameters, and the variance of its squared scale over that for normal noise."""
    n, scale = len(innovation), 1.4826 * float(np.median(np.abs(innovation)))
    x, count = _grouped(innovation, scale)
    fitted = []
    for law in _LAWS:

        def cost(p, law=law):
            return -float(np.sum(count * law.log_density(p, x)))

        start = law.start(scale)
        bounds = [(None, None), *[(-8.0, 6.0), (-3.0, 6.0)] * 2][: len(start)]
        found = scipy.optimize.minimize(cost, start, method="L-BFGS-B", bounds=bounds)
        fitted.append((2.0 * found.fun + len(found.x) * np.log(n), law, found.x, cost))
    _, law, p, cost = min(fitted, key=lambda one: one[0])
    steps = _STEP * np.eye(len(p))
    second = np.array([[cost(p + a + b) - cost(p + a - b) - cost(p - a + b) + cost(p - a - b) for a in steps] for b in steps])
    variance = float(np.linalg.pinv(second / (4.0 * _STEP**2), hermitian=True)[0, 0])
    if law is _LAWS[-1]:  # one component more moved the core: the next one, which is not fitted, would move it further
        variance += (_FURTHER * (p[0] - fitted[-2][2][0])) ** 2
    return law, p, max(2.0 * n * variance, 1.0)


def _grouped(innovation, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Root mean squares and counts of innovations of nearly one size, which give the likelihood of these symmetric laws much faster."""
    size = np.abs(innovation)
    group = np.unique(np.round(np.arcsinh(size / scale) * _FINE), return_inverse=True)[1]
    count = np.bincount(group)
    return np.sqrt(np.bincount(group, size**2) / count), count
