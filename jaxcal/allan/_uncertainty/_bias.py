"""Bias of the total statistics: their expectation over that of the plain variance, by noise type.

Each of them is a mean of squares of differences that a line in the phase does not affect. For a given noise type, its expectation
therefore follows from the generalised covariance of phase (C. A. Greenhall, "The generalized autocovariance: a tool for clock
statistics", TMO Progress Report 42-137, 1999). The factors of mtotdev and htotdev here are these expectations, at every cluster
size. Printed tables hold their limits for large m, or fits to simulations: htotdev 0.995, 0.851, 0.771, 0.717, 0.679 (NIST SP 1065),
which is the limit to the last digit; mtotdev 0.94, 0.83, 0.73, 0.70, 0.69 (Stable32), where the limit is 0.995, 0.851, 0.771, 0.717,
0.679. totdev: D. A. Howe and C. A. Greenhall, "Total variance: a progress report on a new
frequency stability characterization", PTTI 1997; the white phase factor is derived, the flicker phase factor fitted to the
expectation.
"""

import functools

import numpy as np
import scipy  # loads its parts when they are first used

from ..._types import Any, Float
from .._kinds import Kind, find_kind
from ._tables import WINDOWS

_LIMIT = 64  # cluster size above which the factors of the windows no longer change


def phase_covariance(alpha: int, lag: Any) -> Float[np.ndarray, "..."]:
    """Generalised covariance of the phase of power-law noise, up to a factor, a constant and a parabola; band limit 1/(2 dt).

    Use it like the covariance of a stationary process, for variances of differences that are blind to a parabola (C. A. Greenhall, TMO
    Progress Report 42-137, 1999).

    Parameters
    ----------
    alpha : noise type, 2 (white phase) .. -4.
    lag : lag in samples.

    Examples
    --------
    The Allan variance of white rate noise halves when the cluster size doubles:

    >>> from jaxcal.allan._uncertainty._bias import phase_covariance
    >>> allan = [(6 * phase_covariance(0, 0) - 8 * phase_covariance(0, m) + 2 * phase_covariance(0, 2 * m)) / (2 * m**2) for m in (1, 2)]
    >>> float(allan[0] / allan[1])
    2.0
    """
    t = np.abs(np.asarray(lag, dtype=np.float64))
    held = np.where(t > 0, t, 1.0)
    if alpha == 2:
        return np.asarray(t == 0, dtype=np.float64)
    if alpha == 1:  # flicker phase is infinite without a band limit
        return np.where(t > 0, scipy.special.sici(np.pi * held)[1] - np.log(np.pi * held) - np.euler_gamma, 0.0)
    return np.asarray({0: -t, -1: t**2 * np.log(held), -2: t**3, -3: -(t**4) * np.log(held), -4: -(t**5)}[alpha])


def bias_factors(m: Any, alpha: Any, kind: str | Kind, samples: Any) -> Float[np.ndarray, "..."]:
    """Expectation of the variance of a total statistic over that of the plain variance; `deviation` divides by it.

    Parameters
    ----------
    m : cluster sizes in samples.
    alpha : noise types, broadcast against m.
    kind : name of the statistic, such as "mtotdev"; plain statistics have a factor of one.
    samples : number of rate samples of the record, broadcast against m.

    Examples
    --------
    >>> from jaxcal.allan._uncertainty._bias import bias_factors
    >>> [round(float(v), 3) for v in bias_factors(100, [0, -1, -2], "htotdev", 10_000)]
    [0.995, 0.851, 0.771]
    """
    kind = find_kind(kind)
    sizes, types, lengths = np.broadcast_arrays(m, np.clip(np.asarray(alpha), -4 if kind.order == 3 else -2, 2), samples)
    if kind.name == "totdev":
        slopes = np.vectorize(WINDOWS["totdev"].get, otypes=[float])(types.astype(int))
        slopes = slopes - np.where(types == 1, 0.77 * sizes**-0.135, 0.0)  # flicker phase approaches white phase slowly
        return np.where(sizes > 1, 1.0 + slopes * sizes / np.maximum(lengths, 1), 1.0)  # at m = 1 nothing is reflected
    if not kind.contiguous:
        return np.ones(sizes.shape)
    one = functools.partial(_window_factor, order=kind.order)
    return np.array([one(int(size), int(noise)) for size, noise in zip(sizes.ravel(), types.ravel(), strict=True)]).reshape(sizes.shape)


@functools.lru_cache(maxsize=64)
def _window_map(m: int) -> Float[np.ndarray, "points differences"]:
    """The definition applied to unit windows: matrix from the points of a window to the third differences of its extension."""
    length = 3 * m
    unit = np.eye(length)
    half, rest = length // 2, -(-length // 2)
    slope = (unit[:, rest:].mean(axis=1) - unit[:, :half].mean(axis=1)) / rest
    line_free = unit - slope[:, None] * np.arange(length)
    extended = np.concatenate([line_free[:, ::-1], line_free, line_free[:, ::-1]], axis=1)
    running = np.concatenate([np.zeros((length, 1)), np.cumsum(extended, axis=1)], axis=1)[:, : 9 * m]
    third = running[:, length:] - 3.0 * running[:, 2 * m : -m] + 3.0 * running[:, m : -2 * m] - running[:, :-length]
    third.flags.writeable = False
    return third


def _window_factor(m: int, alpha: int, order: int) -> float:
    if order == 3 and m == 1:
        return 1.0  # htotdev equals ohdev there
    return _window_expectation(min(m, _LIMIT), alpha, order)


@functools.lru_cache(maxsize=1024)
def _window_expectation(m: int, alpha: int, order: int) -> float:
    """Mean squared third difference of the reflected windows, over that of the record itself."""
    length, differences = 3 * m, _window_map(m)
    time = np.arange(length + order - 2)
    phase = phase_covariance(alpha, time[:, None] - time[None, :])
    if order == 2:  # windows of phase
        weights = np.repeat([1.0, -2.0, 1.0], m)
        points = phase
    else:  # windows of rate, the differences of phase
        weights = np.zeros(length + 1)
        weights[[0, m, 2 * m, 3 * m]] = [-1.0, 3.0, -3.0, 1.0]
        points = np.diff(np.diff(phase, axis=0), axis=1)
    total = np.vdot(differences, points @ differences) / (6 * m)
    return float(total / (weights @ phase @ weights))
