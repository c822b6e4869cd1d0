"""Intervals and limits by inversion of a likelihood-ratio test: the values of one coefficient at which the ratio reaches a level."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import namespace
from .._types import AnyArray, Float

#: significance above which a term is a hint, and above which it is present. Without the term, 5 % and 1 % of records exceed these,
#: because a coefficient cannot be negative (S. G. Self and K.-Y. Liang, J. Am. Stat. Assoc. 82, 1987)
HINT, PRESENT = 2.71, 5.41
#: number of steps of a search; times the level at which values of a search are capped; relative distance from the level, in the root of the
#: likelihood ratio, at which a search ends
_SEARCH, _FAR, _CLOSE = 12, 8.0, 1e-3


class Limits(NamedTuple):
    """Per term: interval ends, one-sided upper limit (squared coefficients), and the likelihood ratio at zero."""

    low: Float[AnyArray, " p"]
    high: Float[AnyArray, " p"]
    upper: Float[AnyArray, " p"]
    significance: Float[AnyArray, " p"]

    def scaled(self, unit) -> "Limits":
        """The limits of squared coefficients in another unit."""
        return Limits(self.low * unit, self.high * unit, self.upper * unit, self.significance)

    def reaching(self, index: int, low: float, high: float, upper: float) -> "Limits":
        """The limits, of which those of one term also contain the given ones."""
        own = [np.array(self.low), np.array(self.high), np.array(self.upper)]
        for ends, value, further in zip(own, (low, high, upper), (min, max, max), strict=True):
            ends[index] = further(ends[index], value)
        return Limits(own[0], own[1], own[2], self.significance)


@functools.cache
def levels_of(confidence: float) -> tuple[float, float]:
    """Likelihood ratio at the ends of a two-sided interval, and at a one-sided upper limit."""
    return 2.0 * float(scipy.special.gammaincinv(0.5, confidence)), float(scipy.special.ndtri(confidence)) ** 2


def chance(rise, freedom) -> Any:
    """Probability of a larger chi-square."""
    tail = scipy.special.gammaincc if namespace(rise, freedom) is np else jax.scipy.special.gammaincc
    return tail(freedom / 2.0, rise / 2.0)


def wald(theta, covariance, two_sided, one_sided) -> Limits:
    """Limits of squared coefficients whose estimates are normal, none below zero."""
    xp = namespace(theta, covariance)
    error = xp.sqrt(xp.diagonal(covariance))
    both, one = error * np.sqrt(two_sided), error * np.sqrt(one_sided)
    ratio = xp.where(error > 0.0, theta / xp.where(error > 0.0, error, 1.0), 0.0)
    return Limits(xp.maximum(theta - both, 0.0), theta + both, theta + one, ratio**2)


def find_limits(rise: Callable[[int, float], float], theta, reach, two_sided, one_sided) -> Limits:
    """Squared coefficients at which the likelihood ratio reaches a level.

    The square root of the ratio is nearly linear in the coefficient itself, so that false position on these two finds the crossing in few
    steps. A low end is 0 if zero cannot be excluded. An end that is not found within 2^11 times `reach` is infinite.

    Parameters
    ----------
    rise : maps the index of a term and its squared coefficient to the ratio at the best values of all other coefficients.
    theta, reach : (p,) squared coefficients at the optimum, and their standard errors.
    two_sided, one_sided : (p,) levels of the ratio at both ends and at the upper limit.
    """
    found = np.zeros((len(Limits._fields), len(theta)))
    for i, (best, error) in enumerate(zip(theta, np.maximum(reach, np.finfo(float).tiny ** 0.5), strict=True)):
        found[3, i] = rise(i, 0.0)
        for row, level, sign in ((0, two_sided[i], -1), (1, two_sided[i], 1), (2, one_sided[i], 1)):
            far, k = (0.0, found[3, i]) if sign < 0 else (best, 0.0), 0
            inside = best, 0.0
            while sign > 0 and far[1] <= level and k < _SEARCH:
                inside, far = far, (value := best + 1.1 * np.sqrt(level) * error * 2.0**k, rise(i, value))
                k += 1
            if far[1] > level:
                found[row, i] = _crossing(lambda value, i=i: rise(i, value), level, inside, far)
            elif sign > 0:
                found[row, i] = np.inf
    return Limits(*found)


def _crossing(ratio: Callable[[float], float], level: float, inside: tuple[float, float], outside: tuple[float, float]) -> float:
    """Where a ratio reaches a level between two points (N. Anderson and A. Bjoerck, BIT 13, 1973)."""
    a, b = np.sqrt(inside[0]), np.sqrt(outside[0])
    ga, gb = (np.sqrt(max(value, 0.0)) - np.sqrt(level) for value in (inside[1], outside[1]))
    gb = min(gb, _FAR * np.sqrt(level))  # false position moves too slowly from a value that is far away
    u, last = b, 0
    for _ in range(_SEARCH):
        u = (a * gb - b * ga) / (gb - ga)
        g = np.sqrt(max(ratio(u**2), 0.0)) - np.sqrt(level)
        if abs(g) <= _CLOSE * np.sqrt(level):
            break
        # a side that stays for two steps gets less weight, so that both ends close in
        if g <= 0.0:
            gb, a, ga, last = gb * (_less(g, ga) if last < 0 else 1.0), u, g, -1
        else:
            ga, b, gb, last = ga * (_less(g, gb) if last > 0 else 1.0), u, g, 1
    return float(u**2)


def _less(new: float, old: float) -> float:
    """Weight of the end that stays, from the previous and the present value at the other end."""
    weight = 1.0 - new / old
    return weight if weight > 0.0 else 0.5
