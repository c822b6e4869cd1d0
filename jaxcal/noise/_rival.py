r"""The rival: the smoothest description of slow noise that needs no name, against which Q, N, B and K are judged.

B and K are the coefficients of IEEE Std 952. The slow noise of a sensor may have another spectrum, and N is then wrong by more than its
error, because B and K describe a part of the white noise too, or none of it. The rival is

.. math:: S = \frac{Q^2}{dt}s^2 + N^2 + \frac{K^2 dt^2}{s^2} + \sum_i c_i R_i,\qquad c_i \ge 0

with R_i relaxations, first-order Gauss-Markov processes whose corner frequencies are an octave apart and end at an eighth of the band. A
sum of relaxations follows every falling spectrum of exponent up to two (A. van der Ziel, Physica 16, 1950). The model is linear in its
coefficients, and the iteration of non-negative least squares with the weights nu/S^2 ends at the maximum of the likelihood.

The interval of N is the hull of both. What lies above the highest corner could be N as well as slow noise. Corners up to the end of the
band therefore take part in the hull, at a price in likelihood that only a record of another spectrum pays. B and K are hints at most
where the rival is clearly more likely and clearly another spectrum; the low ends of their intervals fall to zero where it begins to be.
"""

import functools
from typing import NamedTuple

import numpy as np

from .._types import AnyArray
from ._likelihood import density, information, inverse, scoring
from ._limits import profile_limits
from ._solve import Solved
from ._terms import BUILT_IN, GaussMarkov

_OCTAVES = 3.0  # below the end of the band, at which the highest corner lies; nearer to it, N of every record has a wide interval
#: twice the gain in log likelihood, and rms logarithm of the ratio of the densities, from which the rival is another spectrum: records of
#: N, B and K reach both in less than 1 % (`benchmarks/real_noise.py`)
_GAIN, _APART = 12.0, 0.25


class Rival(NamedTuple):
    """Of each channel: density of the rival in the bins of a fit, rms logarithm of its ratio to the model, the share of the low ends of B^2
    and K^2 that it leaves, which is 0 if the record shows another spectrum than that of the model, and limits of its N^2, (channels, 3):
    low, high, one-sided upper limit in units of `Bins.unit`, or None without N.
    """

    density: AnyArray
    apart: AnyArray
    left: AnyArray
    white: AnyArray | None


def rival_of(solved: Solved, dt: float, duration: float, levels: tuple[float, float], widened: AnyArray) -> Rival:
    """Fit the rival to the bins of fits; N is judged at two levels of the likelihood ratio.

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
        return Rival(own, apart, left, None)
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
    return Rival(own, apart, left, np.stack([np.maximum(middle - reach[0], 0.0), middle + reach[1], middle + reach[2]], axis=1))


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
