r"""Whittle likelihood of binned ordinates, on the host: its maximum, its information, and its profile.

Ordinates are nearly independent. Each, divided by the model's density S = X theta with theta the squared coefficients, follows a
chi-square law of one degree of freedom, so that the negative log-likelihood is

.. math:: \mathrm{NLL}(\theta) = \frac12\sum_b \nu_b\,[\ln S_b + P_b/S_b]

with P_b the mean of nu_b ordinates (P. Whittle, J. R. Stat. Soc. B 15, 1953, on the DCT-II in place of the periodogram). A cost is the
negative log-likelihood minus its value at S = P. The Fisher information is the expected one. The limits of a coefficient invert a
likelihood-ratio test: they are its values at which the ratio reaches a level.
"""

import functools
from typing import Any, NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import product
from .._types import AnyArray, Float

FAINT = 0.01  # in several starts one column begins with this fraction of an equal share
#: scoring: most steps, shortest part of a step, gain in log likelihood at which it ends, share of an ordinate below which the density
#: counts as this share; least squares: roundings added to the diagonal, which keep equations of nearly equal columns solvable, and the
#: slope of a coefficient at zero, over the largest, that is rounding
_STEPS, _SHORTEST, _GAINED, _DARK, _FLAT, _RIDGE = 50, 1e-3, 1e-4, 1e-9, 64.0, 1e-10
_TINY, _EPS = np.finfo(float).tiny, np.finfo(float).eps
_LEAST = np.sqrt(_TINY)  # a density above zero whose square is a number
#: significance above which a term is a hint, and above which it is present. Without the term, 5 % and 1 % of records exceed these,
#: because a coefficient cannot be negative (S. G. Self and K.-Y. Liang, J. Am. Stat. Assoc. 82, 1987)
HINT, PRESENT = 2.71, 5.41
#: most steps of a search; relative distance from the level, in the root of the likelihood ratio, from which a last step of Newton's method
#: ends it; and the gain in log likelihood at which each of its fits ends: limits are then known to 1e-3 of the error
_SEARCH, _CLOSE, _ROUGHLY = 24, 0.03, 1e-3
_eye = functools.cache(np.eye)  # it takes as long as a step of the solver


def density(columns: AnyArray, theta: AnyArray) -> AnyArray:
    """Density S of the model, (..., bins) of coefficients (..., p), kept above zero."""
    return np.maximum(theta @ columns.T, _LEAST)


def information(columns: AnyArray, weight: AnyArray, theta: AnyArray, among: AnyArray) -> AnyArray:
    """Expected Fisher information of the squared coefficients, F = 1/2 sum nu X X' / S^2, zero of those not `among` them, (..., p)."""
    rows = columns * (np.sqrt(0.5 * weight) / density(columns, theta))[..., None] * among[..., None, :]
    return np.swapaxes(rows, -1, -2) @ rows


def inverse(matrix: AnyArray) -> AnyArray:
    """Inverse of positive semidefinite (..., p, p) matrices whose rows may differ by many powers of ten; rows of zeros stay zero."""
    diagonal = np.diagonal(matrix, axis1=-2, axis2=-1)
    there = diagonal > 0.0
    scale = 1.0 / np.sqrt(np.where(there, diagonal, 1.0))
    scale = scale[..., :, None] * scale[..., None, :]
    unit = matrix * scale + _eye(matrix.shape[-1]) * ~there[..., None]
    return np.where(there[..., :, None] & there[..., None, :], np.linalg.inv(unit) * scale, 0.0)


def several_starts(columns: AnyArray, target: AnyArray, weight: AnyArray, among: AnyArray) -> AnyArray:
    """(channels, starts, p) initial guesses, needed because the likelihood has local minima.

    First every column `among` them, (channels, p), explains an equal share of the ordinates, then each column in turn is faint. A column
    without a positive value starts from zero.
    """
    used, positive = (weight > 0.0).astype(float), columns > 0.0
    count, logs = used @ positive, np.log(np.where(positive, columns, 1.0))
    level = np.exp(((used * np.log(np.maximum(target, _LEAST))) @ positive - used @ logs) / np.maximum(count, 1.0))
    there = among & (count > 0.0)
    flat = np.where(there, level, 0.0) / np.maximum(np.sum(there, axis=1, keepdims=True), 1)
    own = _eye(columns.shape[1])
    return flat[:, None, :] * np.concatenate([np.ones_like(own[:1]), 1.0 - (1.0 - FAINT) * own])


def scoring(
    columns: AnyArray, target: AnyArray, weight: AnyArray, start: AnyArray, base: Any = 0.0, held: Any = False, *, enough: float = _GAINED
) -> tuple[AnyArray, Any]:
    """Non-negative coefficients of highest likelihood, and their cost; it ends when a step gains no more than `enough`.

    Each step is a non-negative least squares fit, first with the weights nu/S^2 (Fisher scoring), whose fixed points are those of the
    likelihood.
    A column with negative values belongs to a coefficient of either sign. Several searches run at once, which costs little more than one.

    Parameters
    ----------
    columns, target, weight : (bins, p), (bins,) and (bins,) model per unit of each coefficient, ordinates and their number.
    start : (p,) where a search begins, or (searches, p).
    base : density that is always there. Like target and weight, each search may have its own.
    held : (searches, p) coefficients that stay as they start.
    """
    used = weight > 0 if np.ndim(weight) == 1 else (weight > 0).any(axis=0)
    used = slice(None) if used.all() else used
    x, rows, products, scale, free = _prepared(columns[used].tobytes(), columns.shape[1])
    theta = np.atleast_2d(start * scale)
    p, base, weight = (np.broadcast_to(values, (len(theta), len(columns)))[:, used] for values in (target, base, weight))
    p, held = np.maximum(p, _TINY**0.25), np.broadcast_to(held, theta.shape)
    floor, dark = np.where(held, theta, 0.0) @ rows + base, _DARK * p

    def cost_of(theta: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray]:
        s = np.maximum(product(theta, rows) + base, dark)
        ratio = p / s
        return s, ratio, 0.5 * np.vecdot(ratio - 1.0 - np.log(ratio), weight)

    s, ratio, cost = cost_of(theta)
    begin, last, active, on = theta, cost, ((theta > 0.0) | free) & ~held, np.arange(len(theta))  # on: the searches that go on
    for k in range(_STEPS):
        # near the maximum the mean of expected and observed information has half the error of the expected one
        own = weight / s
        each = own / s * ratio if k > 1 else own / s
        goal = product(each * (s - floor) + own * (ratio - 1.0), x)
        wanted, active = nonnegative(product(each, products).reshape(*goal.shape, -1), goal, free, active, held)
        step, trial = 1.0, (wanted := np.where(held, begin, wanted))
        s, ratio, new = cost_of(trial)
        while (worse := (new > last) & (step > _SHORTEST)).any():
            step = np.where(worse, 0.5, 1.0) * step
            trial = begin + step[:, None] * (wanted - begin)
            s, ratio, new = cost_of(trial)
        gained = last - new
        better, more = gained >= 0.0, gained > enough
        theta[on], cost[on] = np.where(better[:, None], trial, begin), np.where(better, new, last)
        if not more.any():
            break
        begin, last = trial, new
        if not more.all():
            on, kept = on[more], (s, ratio, active, p, dark, base, floor, held, weight, begin, last)
            s, ratio, active, p, dark, base, floor, held, weight, begin, last = (values[more] for values in kept)
    return (theta / scale, cost) if np.ndim(start) > 1 else (theta[0] / scale, float(cost[0]))


@functools.lru_cache(maxsize=16)
def _prepared(held: bytes, count: int) -> tuple[AnyArray, ...]:
    """So many columns, the largest value of each one, as (bins, p) and (p, bins); their products; their scales; which have either sign."""
    x = np.frombuffer(held).reshape(-1, count)
    scale = np.maximum(np.abs(x).max(axis=0), _TINY)
    x = x / scale
    return x, np.ascontiguousarray(x.T), (x[:, :, None] * x[:, None, :]).reshape(len(x), -1), scale, np.any(x < 0, axis=0)


def nonnegative(gram: AnyArray, target: AnyArray, free: Any, active: AnyArray, held: Any = False) -> tuple[AnyArray, AnyArray]:
    """Least squares from normal equations, (..., p, p) and (..., p), with coefficients at or above zero, unless `free`.

    Returns the coefficients, and which are above zero, which begin as `active`; those that are `held` stay zero. Coefficients that violate
    a condition of the minimum change sides, all together while they get fewer, and then the worst one (J. J. Júdice and F. M. Pires,
    Comput. Oper. Res. 21, 1994).
    """
    size = np.sqrt(np.maximum(gram.diagonal(axis1=-2, axis2=-1), _TINY))
    unit, goal, own = gram / (size[..., :, None] * size[..., None, :]), target / size, _eye(gram.shape[-1])
    unit += _FLAT * _EPS * own
    enough = np.where(held, np.inf, _RIDGE * np.abs(goal).max(axis=-1, keepdims=True))
    theta, least, fewest = goal, np.where(free, -np.inf, 0.0), np.inf
    for _ in range(10 * len(own)):
        both = active[..., :, None] & active[..., None, :]
        theta = np.linalg.solve(np.where(both, unit, own), np.where(active, goal, 0.0)[..., None])[..., 0]
        slope = goal - (unit @ theta[..., None])[..., 0]
        wrong = np.where(active, theta < least, slope > enough)
        if not wrong.any():
            break
        number, amount = wrong.sum(axis=-1, keepdims=True), np.where(wrong, np.where(active, -theta, slope), 0.0)
        wrong &= (number < fewest) | (amount == amount.max(axis=-1, keepdims=True))
        active, fewest = active ^ wrong, np.minimum(number, fewest)
    return np.maximum(theta, least) / size, active


def chance(rise: AnyArray | float, freedom: AnyArray | float) -> Any:
    """Probability of a larger chi-square."""
    return scipy.special.gammaincc(freedom / 2.0, rise / 2.0)


class Limits(NamedTuple):
    """Per term: interval ends, one-sided upper limit (squared coefficients), and the likelihood ratio at zero."""

    low: Float[AnyArray, " p"]
    high: Float[AnyArray, " p"]
    upper: Float[AnyArray, " p"]
    significance: Float[AnyArray, " p"]


@functools.cache
def levels_of(confidence: float) -> tuple[float, float]:
    """Likelihood ratio at the ends of a two-sided interval, and at a one-sided upper limit."""
    return 2.0 * float(scipy.special.gammaincinv(0.5, confidence)), float(scipy.special.ndtri(confidence)) ** 2


def profile_limits(
    bins: Any, weight: AnyArray, fit: tuple[AnyArray, AnyArray, AnyArray], out: AnyArray, lanes: tuple[AnyArray, AnyArray],
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
        last[lanes], found = scoring(columns, target, counted, start, held=held | out[rows], enough=_ROUGHLY)
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
