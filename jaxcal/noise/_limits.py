"""Intervals and limits by inversion of a likelihood-ratio test: the values of one coefficient at which the ratio reaches a level."""

import functools
from typing import NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._types import AnyArray, Float
from ._likelihood import density, scoring
from ._ordinates import Bins

#: significance above which a term is a hint, and above which it is present. Without the term, 5 % and 1 % of records exceed these,
#: because a coefficient cannot be negative (S. G. Self and K.-Y. Liang, J. Am. Stat. Assoc. 82, 1987)
HINT, PRESENT = 2.71, 5.41
#: most steps of a search; relative distance from the level, in the root of the likelihood ratio, from which a last step of Newton's method
#: ends it; and the gain in log likelihood at which each of its fits ends: limits are then known to 1e-3 of the error
_SEARCH, _CLOSE, _GAINED = 24, 0.03, 1e-3


class Limits(NamedTuple):
    """Per term: interval ends, one-sided upper limit (squared coefficients), and the likelihood ratio at zero."""

    low: Float[AnyArray, " p"]
    high: Float[AnyArray, " p"]
    upper: Float[AnyArray, " p"]
    significance: Float[AnyArray, " p"]

    def scaled(self, unit) -> "Limits":
        """The limits of squared coefficients in another unit."""
        return Limits(self.low * unit, self.high * unit, self.upper * unit, self.significance)


@functools.cache
def levels_of(confidence: float) -> tuple[float, float]:
    """Likelihood ratio at the ends of a two-sided interval, and at a one-sided upper limit."""
    return 2.0 * float(scipy.special.gammaincinv(0.5, confidence)), float(scipy.special.ndtri(confidence)) ** 2


def profile_limits(
    bins: Bins, weight: AnyArray, fit: tuple[AnyArray, AnyArray, AnyArray], out: AnyArray, lanes: tuple[AnyArray, AnyArray],
    two_sided: AnyArray, one_sided: AnyArray,
) -> Limits:  # fmt: skip
    """Squared coefficients at which profile likelihood ratios reach a level, found for all lanes at once.

    The square root of the ratio is nearly linear in the coefficient itself, and its slope is the score of the coefficient, so that Newton's
    method takes few steps; it is kept between values on either side of the level. A low end is 0 if zero cannot be excluded. An end that is
    not found within 2^12 times the error is infinite.

    Parameters
    ----------
    bins, weight : ordinates of channels, and their number in the fit, (channels, bins).
    fit : (channels, p), (channels,) and (channels, p, p) squared coefficients at the optimum, their cost there, and their covariance.
    out : (channels, p) columns that take no part.
    lanes : channel and column of each coefficient looked at.
    two_sided, one_sided : (lanes,) levels of the ratio at both ends and at the upper limit.
    """
    count, channel, index = len(lanes[0]), np.tile(lanes[0], 4), np.tile(lanes[1], 4)
    theta, covariance = fit[0][channel], fit[2][channel]
    each, columns = np.arange(len(index)), bins.columns
    level = np.sqrt(np.concatenate([two_sided, two_sided, one_sided, two_sided]))
    best, error = theta[each, index], np.sqrt(covariance[each, index, index])
    slope = covariance[each, index] / np.where(error > 0.0, error, np.inf)[:, None] ** 2
    free, last = np.any(columns < 0.0, axis=0), theta.copy()  # each search starts from the one before

    def root_of(lanes: AnyArray, value: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Root of the ratio if coefficients are held at values, and its derivative with respect to the roots of the values."""
        rows, own = channel[lanes], index[lanes]
        held = np.arange(theta.shape[1]) == own[:, None]
        start = last[lanes] + slope[lanes] * (value - last[lanes, own])[:, None]
        start = np.where(held, value[:, None], np.where(free, start, np.maximum(start, 0.0)))
        target, counted = bins.density[rows], weight[rows]
        last[lanes], found = scoring(columns, target, counted, start, held=held | out[rows], enough=_GAINED)
        root, s = np.sqrt(np.maximum(2.0 * (found - fit[1][rows]), 0.0)), density(columns, last[lanes])
        with np.errstate(over="ignore", invalid="ignore"):  # at zero, where no slope is needed
            score = 0.5 * np.sum(counted * columns.T[own] * (s - target) / s**2, axis=1)
            return root, 2.0 * np.sqrt(value) * score / np.maximum(root, np.finfo(float).tiny)

    sign = np.repeat([-1.0, 1.0, 1.0], count)
    near, far = np.sqrt(best[: 3 * count]), np.where(sign > 0.0, np.inf, 0.0)  # roots of values on either side of the level
    found = np.where(level[: 3 * count] > 0.0, np.append(np.zeros(count), np.full(2 * count, np.inf)), near)
    u = np.sqrt(np.maximum(best + np.append(sign, np.zeros(count)) * level * error, 0.0))[: 3 * count]
    u = np.append(np.where(u > 0.0, u, 0.5 * near), np.zeros(count))
    roots, rises = root_of(np.arange(4 * count), u**2)  # the last are those at zero
    at_zero = roots[3 * count :]
    todo = np.flatnonzero(np.append(at_zero > level[3 * count :], np.ones(2 * count, dtype=bool)) & (level[: 3 * count] > 0.0))
    root, rise = roots[todo], rises[todo]
    for _ in range(_SEARCH):
        off = root - level[todo]
        inner = off < 0.0
        near[todo[inner]], far[todo[~inner]] = u[todo[inner]], u[todo[~inner]]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            new = u[todo] - off / rise
        done = np.abs(off) <= _CLOSE * level[todo]
        found[todo[done]] = new[done]
        low, high = np.minimum(near, far)[todo], np.maximum(near, far)[todo]
        middle = np.where(np.isfinite(high), 0.5 * (low + high), 2.0 * low)
        u[todo] = np.where((new > low) & (new < np.minimum(high, 4.0 * low + error[todo])), new, middle)
        todo = todo[~done]
        if not len(todo):
            break
        root, rise = root_of(todo, u[todo] ** 2)
    return Limits._make((*(found**2).reshape(3, count), at_zero**2))
