r"""How well the coefficients of fits are known: errors for a real record, limits, and what they owe to the model.

*Widening.* A real record is neither stationary nor of the model, so that intervals must be wider than the likelihood says. Two measures are
taken for each coefficient, and the larger one is used, as a factor on its variance. A factor counts in full where chance does not explain
it.

*Octaves.* The influence of one octave of frequencies on a coefficient is F^-1 g, with g its part of the score and F the information. Under
the model its variance is (F^-1 F_o F^-1)_jj. The factor is the mean ratio of the squares to these variances, each averaged over three
octaves (a sandwich, P. J. Huber, Proc. 5th Berkeley Symp. 1, 1967).

*Blocks of time.* The score of a coefficient is, up to a constant, half the energy

.. math:: \sum_k \frac{X_{jk}}{S_k^2} P_k = \sum_t u_t^2,\qquad u = \mathrm{DCT}^{-1}\Big(y_k \sqrt{dt\,X_{jk}}\,/\,S_k\Big)

whose sum over time shows how it is distributed. The influences F^-1 g of 10, 5 and 2 blocks scatter about their mean, and their variance is
that of the coefficient, as in a jackknife. A draught, or a level that wanders, makes it larger than the likelihood says.

*The rival.* B and K are the coefficients of IEEE Std 952. The slow noise of a sensor may have another spectrum, and N is then wrong by more
than its error, because B and K describe a part of the white noise too, or none of it. The rival is the smoothest description of slow noise
that needs no name,

.. math:: S = \frac{Q^2}{dt}s^2 + N^2 + \frac{K^2 dt^2}{s^2} + \sum_i c_i R_i,\qquad c_i \ge 0

with R_i relaxations, first-order Gauss-Markov processes whose corner frequencies are an octave apart and end at an eighth of the band. A
sum of relaxations follows every falling spectrum of exponent up to two (A. van der Ziel, Physica 16, 1950). The model is linear in its
coefficients, and the iteration of non-negative least squares with the weights nu/S^2 ends at the maximum of the likelihood.

The interval of N is the hull of both. What lies above the highest corner could be N as well as slow noise. Corners up to the end of the
band therefore take part in the hull, at a price in likelihood that only a record of another spectrum pays. B and K are hints at most
where the rival is clearly more likely and clearly another spectrum; the low ends of their intervals fall to zero where it begins to be.

*The curve.* The overlapped Allan variance of n samples is a weighted sum of the ordinates of the record, whose weights are those of the
transfer function, :math:`w_k = \sin^4(\pi f_k\tau)/(m\sin \pi f_k dt)^2`. Each ordinate is a chi-square of one degree of freedom, so that

.. math:: \nu = \frac{(\sum_k w_k S_k)^2}{\sum_k (w_k S_k)^2}

times the share (n - 2m + 1)/n of the record that the differences cover, are its degrees of freedom. S is the spectrum of the rival, so that
an interval of the deviation does not rest on the terms of the model.
"""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._types import AnyArray
from ..evidence._uneven import BLOCKS, beyond_chance, energies_in_blocks, is_named
from ..spectrum._average import log_groups
from ._likelihood import PRESENT, Limits, density, information, inverse, levels_of, profile_limits, scoring
from ._observed import Observed
from ._solve import FAST, Solved
from ._terms import BUILT_IN, GaussMarkov, Term

_INDEPENDENT = 1.0  # energies that a block must hold; with fewer, its energy follows no known law
_OCTAVES = 3.0  # below the end of the band, at which the highest corner lies; nearer to it, N of every record has a wide interval
#: twice the gain in log likelihood, and rms logarithm of the ratio of the densities, from which the rival is another spectrum: records of
#: N, B and K reach both in less than 1 % (`benchmarks/real_noise.py`)
_GAIN, _APART = 12.0, 0.25
_NARROW = 0.1  # width of a bin in radians of the weights below which its middle stands for it, exact to 1e-3
_TINY = np.finfo(float).tiny


class Certainty(NamedTuple):
    """Of fits: squared coefficients in SI units in the order of the terms asked for, (channels, p), their covariance and limits.

    hints : the terms of each channel that are hints at most, because its slow noise has another spectrum, `apart` by an rms logarithm.
    widened : (channels, columns) factors on the variances. loudest : the part of the record (first, last; 0 to 1) with the most evidence
    on a coefficient, (channels, columns, 2), NaN where none stands out. edf : degrees of freedom of the Allan variance, (channels,
    clusters).
    """

    squares: AnyArray
    covariance: AnyArray
    limits: Limits
    hints: list[list[str]]
    apart: AnyArray
    widened: AnyArray
    loudest: AnyArray
    edf: AnyArray


def certainty(solved: Solved, observed: Sequence[Observed], terms: Sequence[Term], m: AnyArray, confidence: float) -> Certainty:
    """How well the coefficients of the records `observed` are known, and the Allan variance at cluster sizes m.

    The slope of a ramp is the only factor of the mean. What the record does not determine is zero without an upper limit.
    """
    n, dt, levels, names = len(observed[0].y), observed[0].dt, levels_of(confidence), solved.names
    widened, loudest = _widening(solved, dt, observed)
    covariance = inverse(information(solved.bins.columns, solved.weight, solved.theta, solved.among))
    lanes: Any = np.nonzero(solved.own)
    fit, ratios = (solved.theta, solved.cost, covariance), (level * widened[lanes] for level in levels)
    found = profile_limits(solved.bins, solved.weight, fit, ~solved.among, lanes, *ratios)
    low, high, upper, rise = (np.full(widened.shape, unknown) for unknown in (0.0, np.inf, np.inf, 0.0))
    for whole, part in zip((low, high, upper, rise), found, strict=True):
        whole[lanes] = part
    rise /= widened
    scale = widened[:, names.index("N")] if "N" in names else np.ones(len(observed))
    rival, apart, left, white = _rival(solved, dt, n * dt, levels, scale)
    slow = np.array([name in ("B", "K") for name in names])
    hints = slow & (left[:, None] == 0.0) & (rise > PRESENT)
    low *= np.where(slow, left[:, None], 1.0)
    if white is not None:
        i = names.index("N")
        for of, end, wider in zip((np.minimum, np.maximum, np.maximum), (low, high, upper), white, strict=True):
            end[:, i] = of(end[:, i], wider)
    # in SI units, in the order of the terms
    own, unit = solved.own, solved.bins.unit[:, None]
    place = [names.index(term.name) if term.name != "R" else 0 for term in terms]
    known, root = own[:, :, None] & own[:, None, :], np.sqrt(widened) * unit
    spread = (covariance * (root[:, :, None] * root[:, None, :]) * known)[:, place][:, :, place]
    squares, ends = (solved.theta * unit * own)[:, place], np.stack([low * unit, high * unit, upper * unit, rise])[:, :, place]
    for i in (i for i, term in enumerate(terms) if term.name == "R"):
        slope, error = np.array([one.factors[0] for one in observed]), np.array([one.covariance[0, 0] for one in observed]) ** 0.5
        spread[:, i], spread[:, :, i] = 0.0, 0.0
        squares[:, i], spread[:, i, i] = slope**2, (2.0 * slope * error) ** 2
        # the slope is a linear function of the record, and therefore normal
        away, (both, one) = abs(slope), (np.sqrt(level) * error for level in levels)
        ends[:, :, i] = np.maximum(away - both, 0.0) ** 2, (away + both) ** 2, (away + one) ** 2, (slope / error) ** 2
    doubts = [[names[k] for k in np.flatnonzero(one).tolist()] for one in hints]
    return Certainty(squares, spread, Limits(*ends), doubts, apart, widened, loudest, _edf(m, n, solved, rival, widened))


def _widening(solved: Solved, dt: float, observed: Sequence[Observed]) -> tuple[AnyArray, AnyArray]:
    """Factors on the variances of fits, and the loudest parts of the records; see `Certainty`."""
    bins, theta, weight, model = solved.bins, solved.theta, solved.weight, solved.level
    factor, there = _of_octaves(solved, model), theta != 0.0
    loudest, scale = np.full((*theta.shape, 2), np.nan), np.sign(bins.columns[-1]) * (dt / bins.unit)[:, None]
    evidence = np.where(weight[:, None] > 0, np.abs(bins.columns.T) / model[:, None], 0.0) * there[..., None]
    energies, worth = np.zeros((*theta.shape, BLOCKS[0])), np.zeros(theta.shape)
    count = log_groups(len(observed[0].y) - 1, keep_tail=True)[1]
    for i, one in enumerate(observed):
        energies[i], worth[i] = energies_in_blocks(one.spectrum(), count, evidence[i], model[i])
    energies *= scale[..., None]
    back = inverse(information(bins.columns, weight, theta, there))
    own = np.maximum(np.diagonal(back, axis1=1, axis2=2), _TINY)
    for blocks in BLOCKS:
        influence = back @ energies.reshape(*theta.shape, blocks, -1).sum(axis=-1) / 2.0
        influence -= influence.mean(axis=-1, keepdims=True)
        spread = np.vecdot(influence, influence) * blocks / (blocks - 1.0) / own
        # energies of few chi-squares have long tails, which make their scatter less certain
        known = there & (worth >= _INDEPENDENT * blocks)
        freedom = (blocks - 1.0) / (1.0 + 6.0 * blocks / np.where(known, worth, 1.0))
        found, named = np.where(known, beyond_chance(spread, freedom), 1.0), known & is_named(spread, freedom)
        # the level wanders, and the variance of few blocks is itself uncertain
        found *= np.where(named, (scipy.special.stdtrit(np.maximum(freedom, 4.0), 0.975) / scipy.special.ndtri(0.975)) ** 2, 1.0)
        more = found > factor
        part = np.argmax(influence, axis=-1)[more]
        factor[more] = found[more]
        loudest[more] = np.where(named[more, None], np.stack([part, part + 1], axis=-1) / blocks, np.nan)
    for i, one in enumerate(observed):
        if len(one.doubts):  # the search holds the fast terms, which no change of the mean looks like
            moved = (one.doubts / bins.unit[i] * 0.5 * weight[i] / model[i] ** 2) @ (bins.columns * solved.among[i])
            back = inverse(information(bins.columns, weight[i : i + 1], theta[i : i + 1], solved.among[i : i + 1]))[0]
            doubt = np.sum((moved @ back) ** 2, axis=0) / np.maximum(np.diagonal(back), _TINY)
            factor[i] += np.where([name in FAST for name in solved.names], 0.0, doubt)
    return factor, loudest


def _of_octaves(solved: Solved, model: AnyArray) -> AnyArray:
    bins, used, p = solved.bins, solved.weight > 0, solved.theta.shape[1]
    lowest = np.min(np.where(used, bins.frequency, np.inf), axis=1, keepdims=True)
    octave = np.maximum(np.floor(np.log2(bins.frequency / lowest) + 1e-9).astype(int), 0)
    member = ((octave[:, None, :] == np.arange(octave.max() + 1)[:, None]) & used[:, None, :]).astype(float)
    rows = bins.columns * solved.among[:, None, :] / model[..., None]
    half = 0.5 * solved.weight
    score = member @ (rows * (half * (bins.density / model - 1.0))[..., None])
    products = (rows * half[..., None])[..., :, None] * rows[..., None, :]
    each = (member @ products.reshape(*rows.shape[:2], -1)).reshape(*score.shape, p)
    back = inverse(each.sum(axis=1))[:, None]
    squares, variances = (score[..., None, :] @ back)[..., 0, :] ** 2, np.diagonal(back @ each @ back, axis1=-2, axis2=-1)
    near = (np.abs(np.subtract.outer(*(np.arange(squares.shape[1]),) * 2)) <= 1).astype(float)
    whole = np.maximum(near @ variances, _TINY)
    share = near @ (variances / whole)  # weight of the square of each octave in the mean of smoothed ratios
    total = np.maximum(variances.sum(axis=1, keepdims=True), _TINY)
    expected = share * variances / total
    freedom = expected.sum(axis=1) ** 2 / np.maximum(np.sum(expected**2, axis=1), _TINY)
    return beyond_chance(np.sum(share * squares, axis=1) / total[:, 0], np.maximum(freedom, 1.0))


def _rival(solved: Solved, dt: float, duration: float, levels: tuple[float, float], widened: AnyArray) -> tuple[Any, ...]:
    """Density of the rival in the bins of fits, rms logarithm of its ratio to the model, the share of the low ends of B^2 and K^2 that it
    leaves, which is 0 if the record shows another spectrum than that of the model, and limits of its N^2, (3, channels): low, high, and
    one-sided upper limit at two levels of the likelihood ratio; or None without N.

    The variance of N is `widened`, (channels,), which adds to what the shape of the rival leaves open.
    Where the model does not describe the slow noise, relaxations up to the end of the band may take part of N.
    """
    bins, names = solved.bins, solved.names
    used, kept = solved.weight > 0, np.array([name not in ("B", "K") for name in names])
    columns, start, out = _columns(solved, kept, dt, duration, _OCTAVES)
    theta, cost = scoring(columns, bins.density, solved.weight, start, held=out)
    own = density(columns, theta)
    # octaves count alike, however many ordinates they have
    share = np.gradient(np.log(bins.frequency)) * used
    apart = np.sqrt(np.vecdot(share, np.log(own / solved.level) ** 2) / np.sum(share, axis=1))
    gain = 2.0 * (solved.cost - cost)
    left = np.where(apart > _APART, np.clip((_GAIN - gain) / levels[0], 0.0, 1.0), 1.0)
    white = [name for name, keep in zip(names, kept, strict=True) if keep].index("N") if "N" in names else None
    if white is None:
        return own, apart, left, None
    error = np.sqrt(inverse(information(columns, solved.weight, theta, theta != 0.0))[:, white, white])
    both = np.sqrt([levels[0], *levels])[:, None]
    middle, reach = theta[:, white], error * both
    if len(rows := np.flatnonzero(gain > _GAIN - levels[0])):
        columns, start, out = _columns(solved.of(rows), kept, dt, duration, 0.0)
        part, weight = bins.of(rows)._replace(columns=columns), solved.weight[rows]
        wide, cost = scoring(columns, part.density, weight, start, held=out)
        spread = np.zeros((len(rows), len(wide[0]), len(wide[0])))
        spread[:, white, white] = np.where(error[rows] > 0.0, error[rows], middle[rows]) ** 2
        less = np.maximum(_GAIN - 2.0 * (solved.cost[rows] - cost), 0.0)  # what is left of the price
        within = (np.maximum(level - less, 0.0) for level in levels)
        lanes = np.arange(len(rows)), np.full(len(rows), white)
        ends = profile_limits(part, weight, (wide, cost, spread), out, lanes, *within)
        found = [middle[rows] - ends.low, ends.high - middle[rows], ends.upper - middle[rows]]
        reach[:, rows] = np.maximum(reach[:, rows], found)
    reach = np.hypot(reach, error * np.sqrt(widened - 1.0) * both)
    return own, apart, left, np.stack([np.maximum(middle - reach[0], 0.0), middle + reach[1], middle + reach[2]])


def _columns(solved: Solved, kept: AnyArray, dt: float, duration: float, octaves: float) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Columns of the rival, coefficients to start from, and which columns take no part: corners end so many octaves below the band."""
    bins = solved.bins
    used = solved.weight > 0
    ends = np.log2(np.max(np.where(used, bins.frequency, 0.0), axis=1, keepdims=True)) - octaves + 1e-9
    corners, slow = _relaxations(bins.frequency.tobytes(), dt, duration, float(ends.max()))
    above = corners > ends
    level = np.sum(bins.density * used, axis=1, keepdims=True) / np.sum(used, axis=1, keepdims=True)
    start = np.hstack([solved.theta[:, kept], np.where(above, 0.0, level / np.sum(~above, axis=1, keepdims=True))])
    return np.column_stack([bins.columns[:, kept], slow]), start, np.hstack([~solved.among[:, kept], above])


@functools.lru_cache(maxsize=16)
def _relaxations(held: bytes, dt: float, duration: float, last: float) -> tuple[AnyArray, AnyArray]:
    """Logarithms of corners up to a last one, and densities (bins, processes) of a random walk, which has none, and of relaxations an
    octave apart; records of one length share them.
    """
    frequency, corners = np.frombuffer(held), np.arange(float(np.log2(0.25 / duration)), last)
    times = 0.5 / (np.pi * np.exp2(corners))
    densities = [BUILT_IN["K"].psd(frequency, dt)[:, None], np.asarray(GaussMarkov(time=times).psd(frequency[:, None], dt))]
    slow = np.hstack(densities)
    return np.append(-np.inf, corners), slow / slow.max(axis=0)


@functools.lru_cache(maxsize=16)
def _weights(n: int, sizes: tuple[int, ...]) -> tuple[AnyArray, AnyArray]:
    """Sums over the ordinates of each bin of w and of w^2, (clusters, bins)."""
    starts, count = log_groups(n - 1, keep_tail=True)
    edges = np.append(starts, starts[-1] + count[-1]) + 0.5
    middle = starts + 0.5 * (count + 1.0)
    x = np.pi * np.array(sizes)[:, None] * edges[None, :] / (2.0 * n)
    fourth = 3.0 * x / 8.0 - np.sin(2 * x) / 4.0 + np.sin(4 * x) / 32.0
    eighth = 35.0 * x / 128.0 - 7.0 * np.sin(2 * x) / 32.0 + 7.0 * np.sin(4 * x) / 128.0 - np.sin(6 * x) / 96.0 + np.sin(8 * x) / 1024.0
    lower = np.sin(np.pi * middle / (2.0 * n)) ** 2
    # the antiderivatives lose their digits where a bin is narrow beside the oscillation of the weights
    narrow, centre = np.diff(x, axis=1) < _NARROW, np.sin(0.5 * (x[:, 1:] + x[:, :-1]))
    mean4, mean8 = (np.where(narrow, centre**power, np.diff(one, axis=1) / np.diff(x, axis=1)) for one, power in ((fourth, 4), (eighth, 8)))
    return mean4 * count / lower, mean8 * count / lower**2


def _edf(m: AnyArray, n: int, solved: Solved, level: AnyArray, widened: AnyArray) -> AnyArray:
    """Degrees of freedom at cluster sizes of records of n samples whose densities in the bins are `level`: (channels, clusters).

    Each coefficient says by how much the variance of its share in a deviation is `widened`, (channels, p).
    """
    first, second = _weights(n, tuple(m.tolist()))
    edf = (level @ first.T) ** 2 / (level**2 @ second.T) * (n - 2.0 * m + 1.0) / n
    parts = np.abs(solved.theta[:, None, :] * (first @ solved.bins.columns))
    return edf / np.maximum(np.vecdot(parts, widened[:, None, :]) / np.maximum(parts.sum(axis=-1), _TINY), 1.0)
