"""Intervals and limits by inversion of a likelihood-ratio test: the values of one coefficient at which the ratio reaches a level."""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._types import AnyArray, Float
from ._likelihood import scoring
from ._ordinates import Bins

#: significance above which a term is a hint, and above which it is present. Without the term, 5 % and 1 % of records exceed these,
#: because a coefficient cannot be negative (S. G. Self and K.-Y. Liang, J. Am. Stat. Assoc. 82, 1987)
HINT, PRESENT = 2.71, 5.41
#: number of steps of a search; times the level at which values of a search are capped; relative distance from the level, in the root of the
#: likelihood ratio, at which a search ends
_SEARCH, _FAR, _CLOSE = 12, 8.0, 1e-4


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


def profile_limits(
    bins: Bins, theta: AnyArray, cost: float, covariance: AnyArray, own: Sequence[int], two_sided: AnyArray, one_sided: AnyArray
) -> Limits:  # fmt: skip
    """Squared coefficients at which the profile likelihood ratio of the `own` columns reaches a level, found for all of them at once.

    The square root of the ratio is nearly linear in the coefficient itself, so that false position on these two finds the crossing in few
    steps (N. Anderson and A. Bjoerck, BIT 13, 1973). A low end is 0 if zero cannot be excluded. An end that is not found within 2^11 times
    the error is infinite.

    Parameters
    ----------
    theta, cost, covariance : (p,), scalar and (p, p) squared coefficients at the optimum, their cost there, and their covariance.
    two_sided, one_sided : (own,) levels of the ratio at both ends and at the upper limit.
    """
    count, index = len(own), np.tile(own, 4)
    level = np.sqrt(np.concatenate([two_sided, two_sided, one_sided, two_sided]))
    best, error = theta[index], np.sqrt(np.diagonal(covariance))[index]
    slope, free = covariance[index] / np.where(error > 0.0, error, np.inf)[:, None] ** 2, np.any(bins.columns < 0.0, axis=0)
    last = np.tile(theta, (len(index), 1))  # each search starts from the one before

    def root_of(lanes: AnyArray, value: AnyArray) -> AnyArray:
        """Root of the ratio if coefficients are held at values, less that of the level."""
        held = np.arange(len(theta)) == index[lanes, None]
        start = last[lanes] + slope[lanes] * (value - last[lanes, index[lanes]])[:, None]
        start = np.where(held, value[:, None], np.where(free, start, np.maximum(start, 0.0)))
        last[lanes], found = scoring(bins.columns, bins.density, bins.weight, start, held=held)
        return np.sqrt(np.maximum(2.0 * (found - cost), 0.0)) - level[lanes]

    zero = np.arange(3 * count, 4 * count)
    at_zero = root_of(zero, np.zeros(count)) + level[zero]
    sign = np.repeat([-1.0, 1.0, 1.0], count)
    b, gb, found = best.copy(), -level, np.where(level > 0.0, 0.0, best)[: 3 * count]  # a level of zero is reached at the optimum
    a, ga = b.copy(), gb.copy()
    todo = np.flatnonzero(np.append(at_zero > level[zero], level[count : 3 * count] > 0.0))
    for k in range(_SEARCH):
        a[todo], ga[todo] = b[todo], gb[todo]
        b[todo] = np.maximum(best[todo] + sign[todo] * 1.1 * level[todo] * error[todo] * 2.0**k, 0.0)
        gb[todo] = root_of(todo, b[todo])
        todo = todo[gb[todo] <= 0.0]
        if not len(todo):
            break
    found[todo] = np.inf
    a, b, todo, side = np.sqrt(a), np.sqrt(b), np.flatnonzero(gb[: 3 * count] > 0.0), np.zeros(3 * count)
    gb = np.minimum(gb, _FAR * level)  # false position moves too slowly from a value that is far away
    for _ in range(_SEARCH):
        if not len(todo):
            break
        gap = gb[todo] - ga[todo]  # zero where the level is, as at a confidence of 50 %
        u = np.where(gap > 0.0, (a[todo] * gb[todo] - b[todo] * ga[todo]) / np.where(gap > 0.0, gap, 1.0), a[todo])
        g, found[todo] = root_of(todo, u**2), u**2
        inner = g <= 0.0
        # a side that stays for two steps gets less weight, so that both ends close in
        beside = np.where(inner, ga[todo], gb[todo])
        less = 1.0 - g / np.where(beside != 0.0, beside, 1.0)
        less = np.where(side[todo] == np.where(inner, -1, 1), np.where(less > 0.0, less, 0.5), 1.0)
        for one, (ends, values, others) in zip((inner, ~inner), ((a, ga, gb), (b, gb, ga)), strict=True):
            others[todo[one]] *= less[one]
            ends[todo[one]], values[todo[one]] = u[one], g[one]
        side[todo] = np.where(inner, -1, 1)
        todo = todo[np.abs(g) > _CLOSE * level[todo]]
    low, high, upper = found.reshape(3, count)
    return Limits(low, high, upper, at_zero**2)
