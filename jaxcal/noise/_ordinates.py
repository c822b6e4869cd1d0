r"""DCT-II ordinates of a record, averaged in bins, and the contribution of each squared coefficient to them.

With y the orthonormal DCT-II of n samples, P_k = dt y_k^2 estimates the two-sided density at f_k = k/(2T), k = 1 .. n-1. The mean
does not enter, there is almost no leakage, and the ordinates are nearly independent. For a process with (generalised) autocovariance g,

.. math:: E\,P_k = dt\Big\{g_0 + \frac2n\sum_{h=1}^{n-1} g_h\Big[(n-h)\cos\frac{\pi k h}{n}
          - \frac{\sin(\pi k h/n)}{\sin(\pi k/n)}\Big]\Big\}

With s_k = 2 sin(pi k/2n) this is exactly K^2 dt^2/s_k^2 for a random walk, and nearly B^2 dt/s_k (1 - 2/(pi^2 k)) for flicker. The
expectation is linear in the squared coefficients. If density and columns are averaged in the same way, over bins, the averages therefore
obey the same relation exactly.
"""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import runs
from .._types import Any, AnyArray, Array, Float
from ..spectrum._average import log_groups
from ._terms import Term

#: search for lines: farthest neighbour on either side; chance of a false line in the whole spectrum; number of passes
_REACH, _CHANCE, _PASSES = 9, 0.01, 4
#: widest line in bins, including its skirts, of which one of twice the width is none; ratio to the level above which a wider run is a line
#: all the same, and one of half the ratio an error of the first fit; least number of neighbours on each side from which a level is computed
_WIDEST, _TOWERING, _FEWEST = 8, 3.0, 4
#: standard deviations below and above the limit of a line between which the share of a bin that is a line grows from 0 to 1; largest
#: chance of a bin that is looked at; the share at the limit
_BELOW, _ABOVE, _NEAR = 0.6, 1.4, 0.01
LINE = _BELOW / (_BELOW + _ABOVE)


class Bins(NamedTuple):
    """Ordinates averaged in bins of frequency.

    density : mean ordinate divided by `unit`, which is in the unit of B squared per Hz. weight : number of ordinates, which are the
    degrees of freedom; 0 for bins that are left out. columns : (bins, p) expected mean ordinate per squared coefficient. frequency :
    mean frequency in Hz.
    """

    density: AnyArray
    weight: AnyArray
    columns: AnyArray
    frequency: AnyArray
    unit: Any


@functools.lru_cache(maxsize=256)
def layout(n: int, dt: float, terms: tuple[Term, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """First ordinate, count, columns (bins, p) and mean frequency of the bins of a gap-free stretch of n samples."""
    starts, count = log_groups(n - 1, keep_tail=True)
    count = count.astype(float)
    with jax.ensure_compile_time_eval():  # the columns do not depend on the record
        expected = [np.asarray(term.ordinates(np.arange(1, n), n, dt)) for term in terms]
    columns = np.stack([np.add.reduceat(values, starts) / count for values in expected], axis=1)
    frequency = np.add.reduceat(np.arange(1.0, n), starts) / count / (2.0 * n * dt)
    for array in (starts, count, columns, frequency):
        array.flags.writeable = False
    return starts, count, columns, frequency


def bins_of(y: Array, dt: float, terms: tuple[Term, ...]) -> Bins:
    """Bins of a traced record (n,), which has no gaps, with a column for each term."""
    starts, count, columns, frequency = layout(y.shape[0], dt, terms)
    y = eqx.error_if(y, jnp.any(jnp.isnan(y)), "a traced record must not have gaps; cut it into gap-free stretches before tracing")
    ordinates = dt * jax.scipy.fft.dct(y - jnp.mean(y), norm="ortho")[1:] ** 2
    group = np.repeat(np.arange(len(starts)), count.astype(int))
    found = jax.ops.segment_sum(ordinates, group, len(starts), indices_are_sorted=True) / count.astype(y.dtype)
    unit = jax.lax.stop_gradient(jnp.mean(found))
    count, columns, frequency = (np.asarray(array, dtype=found.dtype) for array in (count, columns, frequency))
    return Bins(found / unit, count, columns, frequency, unit)


def _median(values, count) -> np.ndarray:
    """Median of the `count` smallest of each row; `numpy.nanmedian` takes ten times as long for so few."""
    values, row = np.sort(values, axis=1), np.arange(len(values))
    return 0.5 * (values[row, (count - 1) // 2] + values[row, count // 2])


def find_lines(bins: Bins, model) -> Float[np.ndarray, " bins"]:
    """Find the bins that spectral lines occupy: the share of each bin that is a line, 1 in a line and 0 elsewhere.

    The ordinates P are divided by a first fit, `model`, which is smooth even where it is wrong. In a bin of nu ordinates, nu P/S follows
    a chi-square law of nu degrees of freedom. The level S is the geometric mean of the medians of the neighbours on either side, raised
    by twice its uncertainty. A bin is part of a line if the chance of its value is below 1 %, divided by the number of bins. The search
    runs in several passes, because a line raises the level next to it. At the end one more bin on each side is added for the skirts. The
    wider a low rise beyond eight bins, the less of it is a line.

    A bin whose chance is close to the limit has a share between 0 and 1, so that a small change of the record changes the fit little. From
    the share `LINE` on the bin is reported as a line. The share grows evenly with the normal value of the same chance, like a weight that
    falls to zero gradually in a robust fit (F. R. Hampel, J. Am. Stat. Assoc. 69, 1974).
    """
    weight, density = np.asarray(bins.weight), np.asarray(bins.density / model)
    used = weight > 0
    limit = _CHANCE / max(int(used.sum()), 1)
    taken, share = np.zeros(len(weight), dtype=bool), np.zeros(len(weight))
    offsets = np.array([k for k in range(-_REACH, _REACH + 1) if abs(k) > 1])
    index = np.arange(len(weight))[:, None] + offsets[None, :]
    inside = (index >= 0) & (index < len(weight))
    index = np.clip(index, 0, len(weight) - 1)
    for _ in range(_PASSES):
        there = inside & (used & ~taken)[index]
        # median of chi-square over nu by Wilson and Hilferty; the standard error of a median of k values is 1.25 sd/sqrt(k)
        middle = (1.0 - 2.0 / (9.0 * np.maximum(weight, 1.0))) ** 3
        values = np.where(there, (density / middle)[index], np.nan)
        sides = [there & (offsets < 0)[None, :], there & (offsets > 0)[None, :]]
        known = used & np.all([side.sum(axis=1) >= _FEWEST for side in sides], axis=0)
        level = np.ones(len(weight))
        # a slope of the spectrum cancels in the geometric mean of the two sides
        level[known] = np.sqrt(np.prod([_median(np.where(side, values, np.inf)[known], side[known].sum(axis=1)) for side in sides], axis=0))
        ordinates = np.where(there, weight[index], 0.0).sum(axis=1)
        level *= 1.0 + 2.0 * 1.25 * np.sqrt(2.0 / np.maximum(ordinates, 1.0))
        chance = scipy.special.gammaincc(weight / 2.0, weight * density / level / 2.0)
        new = known & (chance < limit)
        near = known & (chance < _NEAR)
        apart = scipy.special.ndtri(limit) - scipy.special.ndtri(np.maximum(chance[near], np.finfo(float).tiny))
        share[near] = np.maximum(share[near], np.clip((apart + _BELOW) / (_BELOW + _ABOVE), 0.0, 1.0))
        if not (new & ~taken).any():
            break
        taken |= new
    # the skirts of a line are too low to be detected one by one
    share = np.where(used, scipy.ndimage.maximum_filter1d(share, 3), 0.0)
    for a, b in zip(*runs(share >= LINE), strict=True):
        wide, high = np.sum(share[a:b]) / _WIDEST, np.max(density[a:b] / level[a:b]) / _TOWERING
        share[a:b] *= np.clip(max(2.0 - wide, 2.0 * high - 1.0), 0.0, 1.0)
    return share


def amplitudes(bins: Bins, taken, model, duration: float) -> list[tuple[float, float]]:
    """(amplitude, frequency in Hz) of the line in each run of taken bins, strongest first.

    An amplitude A has the power A^2/2 above the `model` of all bins, in a record of `duration` s. The bins must have their full weights.
    """
    lines = []
    for a, b in zip(*runs(taken), strict=True):
        excess = bins.weight[a:b] * (bins.density[a:b] - model[a:b])
        power = excess.sum() * float(bins.unit) / duration
        above = np.maximum(excess, 0.0)
        if power > 0:
            lines.append((float(np.sqrt(2.0 * power)), float(np.dot(above, bins.frequency[a:b]) / above.sum())))
    return sorted(lines, reverse=True)
