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
from ._ordinates import Bins
from ._solve import Fitted
from ._terms import BUILT_IN, GaussMarkov

_OCTAVES = 3.0  # below the end of the band, at which the highest corner lies; nearer to it, N of every record has a wide interval
#: twice the gain in log likelihood, and rms logarithm of the ratio of the densities, from which the rival is another spectrum: records of
#: N, B and K reach both in less than 1 % (`benchmarks/real_noise.py`)
_GAIN, _APART = 12.0, 0.25


class Rival(NamedTuple):
    """Density of the rival in the bins of a fit, rms logarithm of its ratio to the model, the share of the low ends of B^2 and K^2 that it
    leaves, which is 0 if the record shows another spectrum than that of the model, and limits of its N^2 (low, high, one-sided upper limit)
    in units of `Bins.unit`, or None without N.
    """

    density: AnyArray
    apart: float
    left: float
    white: tuple[float, float, float] | None


def rival_of(fitted: Fitted, names: tuple[str, ...], dt: float, duration: float, levels: tuple[float, float], widened: float) -> Rival:
    """Fit the rival to the bins of a fit, whose columns have these names; N is judged at two levels of the likelihood ratio.

    The variance of N is `widened`, which adds to what the shape of the rival leaves open.
    Where the model does not describe the slow noise, relaxations up to the end of the band may take part of N.
    """
    bins, used = fitted.bins, fitted.bins.weight > 0
    kept = np.array([name not in ("B", "K") for name in names])
    columns, start = _columns(bins, kept, fitted.theta, dt, duration, _OCTAVES)
    theta, cost = scoring(columns, bins.density, bins.weight, start)
    model, own = density(bins.columns, fitted.theta), density(columns, theta)
    # octaves count alike, however many ordinates they have
    share = np.gradient(np.log(bins.frequency)) * used
    apart = float(np.sqrt(np.sum(share * np.log(own / model) ** 2) / np.sum(share)))
    gain = 2.0 * float(fitted.cost - cost)
    left = float(np.clip((_GAIN - gain) / levels[0], 0.0, 1.0)) if apart > _APART else 1.0
    white = [name for name, keep in zip(names, kept, strict=True) if keep].index("N") if "N" in names else None
    if white is None:
        return Rival(own, apart, left, None)
    error = float(np.sqrt(inverse(information(bins._replace(columns=columns * (theta != 0.0)), theta))[white, white]))
    both = np.array([levels[0], *levels])
    middle, reach = float(theta[white]), error * np.sqrt(both)
    if gain > _GAIN - levels[0]:
        columns, start = _columns(bins, kept, fitted.theta, dt, duration, 0.0)
        wide, cost = scoring(columns, bins.density, bins.weight, start)
        spread = np.diag(np.arange(len(wide)) == white) * (error**2 or middle**2)
        less = max(_GAIN - 2.0 * float(fitted.cost - cost), 0.0)  # what is left of the price
        within = (np.array([max(level - less, 0.0)]) for level in levels)
        ends = profile_limits(bins._replace(columns=columns), wide, cost, spread, [white], *within)
        reach = np.maximum(reach, [middle - ends.low[0], ends.high[0] - middle, ends.upper[0] - middle])
    reach = np.hypot(reach, error * np.sqrt((widened - 1.0) * both))
    return Rival(own, apart, left, (max(middle - reach[0], 0.0), middle + reach[1], middle + reach[2]))


def _columns(
    bins: Bins, kept: AnyArray, theta: AnyArray, dt: float, duration: float, octaves: float
) -> tuple[AnyArray, AnyArray]:  # fmt: skip
    """Columns of the rival, with corners that end so many octaves below the band, and coefficients to start from."""
    used = bins.weight > 0
    slow = _relaxations(bins.frequency.tobytes(), dt, duration, float(np.log2(bins.frequency[used].max())) - octaves)
    start = np.concatenate([theta[kept], np.full(slow.shape[1], np.mean(bins.density[used]) / slow.shape[1])])
    return np.column_stack([bins.columns[:, kept], slow]), start


@functools.lru_cache(maxsize=16)
def _relaxations(held: bytes, dt: float, duration: float, last: float) -> AnyArray:
    """Densities (bins, processes) of a random walk and of relaxations an octave apart; records of one length and band share them."""
    frequency = np.frombuffer(held)
    corners = np.exp2(np.arange(float(np.log2(0.25 / duration)), last + 1e-9))
    walk = BUILT_IN["K"].psd(frequency, dt)
    relaxations = np.asarray(GaussMarkov(time=0.5 / (np.pi * corners)).psd(frequency[:, None], dt))
    return np.column_stack([walk / walk.max(), relaxations / relaxations.max(axis=0)])
