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
from collections.abc import Sequence
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
    """Ordinates of a channel, or of channels (channels, bins) of the same bins, averaged in bins of frequency.

    density : mean ordinate divided by `unit`, (channels,), which is in the unit of B squared per Hz. weight : number of ordinates, which
    are the degrees of freedom; 0 for bins that are left out. columns : (bins, p) expected mean ordinate per squared coefficient.
    frequency : (bins,) mean frequency in Hz.
    """

    density: AnyArray
    weight: AnyArray
    unit: Any
    columns: AnyArray
    frequency: AnyArray

    def of(self, rows: Any) -> "Bins":
        """The bins of some channels."""
        return Bins._make((*(values[rows] for values in self[:3]), *self[3:]))


def beside(channels: Sequence[Bins]) -> Bins:
    """The bins of channels of one length, in one table."""
    return Bins._make((*map(np.array, zip(*(one[:3] for one in channels), strict=True)), *channels[0][3:]))


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
    return Bins(found / unit, count, unit, columns, frequency)


def _median(values, there) -> np.ndarray:
    """Median of the last axis, of those values that are `there`; `numpy.nanmedian` takes ten times as long for so few."""
    ordered, count = np.sort(np.where(there, values, np.inf), axis=-1), np.maximum(there.sum(axis=-1, keepdims=True), 1)
    middle = [np.take_along_axis(ordered, place, axis=-1)[..., 0] for place in ((count - 1) // 2, count // 2)]
    return 0.5 * (middle[0] + middle[1])


def find_lines(bins: Bins, model) -> Float[np.ndarray, "channels bins"]:
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
    weight, density = bins.weight, bins.density / model
    used, count = weight > 0, weight.shape[1]
    limit = _CHANCE / np.maximum(used.sum(axis=1), 1)
    taken, share = np.zeros(weight.shape, dtype=bool), np.zeros(weight.shape)
    places = [np.arange(count)[:, None] + side * np.arange(2, _REACH + 1) for side in (-1, 1)]
    inside, places = [(place >= 0) & (place < count) for place in places], [np.clip(place, 0, count - 1) for place in places]
    # median of chi-square over nu by Wilson and Hilferty; the standard error of a median of k values is 1.25 sd/sqrt(k)
    middle = density / (1.0 - 2.0 / (9.0 * np.maximum(weight, 1.0))) ** 3
    for _ in range(_PASSES):
        sides = [own & (used & ~taken)[:, place] for own, place in zip(inside, places, strict=True)]
        known = used & np.logical_and.reduce([side.sum(axis=-1) >= _FEWEST for side in sides])
        # a slope of the spectrum cancels in the geometric mean of the two sides
        medians = [_median(middle[:, place], side) for place, side in zip(places, sides, strict=True)]
        level = np.sqrt(np.where(known, medians[0], 1.0) * np.where(known, medians[1], 1.0))
        ordinates = sum(np.where(side, weight[:, place], 0.0).sum(axis=-1) for place, side in zip(places, sides, strict=True))
        level *= 1.0 + 2.0 * 1.25 * np.sqrt(2.0 / np.maximum(ordinates, 1.0))
        chance = np.ones(weight.shape)
        high = known & (density > level)
        chance[high] = scipy.special.gammaincc(weight[high] / 2.0, (weight * density)[high] / level[high] / 2.0)
        new, near = chance < limit[:, None], chance < _NEAR
        apart = scipy.special.ndtri(limit)[np.nonzero(near)[0]] - scipy.special.ndtri(np.maximum(chance[near], np.finfo(float).tiny))
        share[near] = np.maximum(share[near], np.clip((apart + _BELOW) / (_BELOW + _ABOVE), 0.0, 1.0))
        if not (new & ~taken).any():
            break
        taken |= new
    # the skirts of a line are too low to be detected one by one
    share = np.where(used, scipy.ndimage.maximum_filter1d(share, 3), 0.0)
    for i in np.flatnonzero((share >= LINE).any(axis=1)):
        for a, b in zip(*runs(share[i] >= LINE), strict=True):
            wide, high = np.sum(share[i, a:b]) / _WIDEST, np.max(density[i, a:b] / level[i, a:b]) / _TOWERING
            share[i, a:b] *= np.clip(max(2.0 - wide, 2.0 * high - 1.0), 0.0, 1.0)
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
