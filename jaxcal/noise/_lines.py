"""Spectral lines in binned ordinates: bins that stand far above their neighbours."""

import numpy as np
import scipy.special

from .._types import Bool, Float
from ._ordinates import Bins

_REACH = 9  # neighbours to either side
_CHANCE = 0.01  # of a false line in the whole spectrum
_SIDE = 1e-4  # chance in one bin, beside a line
_PASSES = 4
_WIDEST = 8  # bins, with skirts; a wider run is a resonance, or a first fit that is wrong there
_TOWERING = 3.0  # times the level, which a wider run must exceed to count as a line with broad skirts
_FEWEST = 4  # neighbours on each side that make a level


def find_lines(bins: Bins, model) -> Bool[np.ndarray, " bins"]:
    """Bins that a line occupies.

    The ordinates are divided by a first fit, `model`, which is smooth even where it is wrong. A bin of nu ordinates has nu P/S
    distributed as chi-square of nu degrees of freedom; S is the geometric mean of the medians of the neighbours on either side,
    and twice its own uncertainty. A bin counts if its chance is below 1 % shared by all bins; its neighbours count below 1e-4.
    Several passes, since a line raises the level beside it; then one more bin on each side, for the skirts. A low rise that more
    than eight bins share is not a line.
    """
    weight, density = np.asarray(bins.weight), np.asarray(bins.density) / np.asarray(model)
    used = weight > 0
    number = int(used.sum())
    taken = np.zeros(len(weight), dtype=bool)
    offsets = np.array([k for k in range(-_REACH, _REACH + 1) if abs(k) > 1])
    index = np.arange(len(weight))[:, None] + offsets[None, :]
    inside = (index >= 0) & (index < len(weight))
    index = np.clip(index, 0, len(weight) - 1)
    for _ in range(_PASSES):
        there = inside & (used & ~taken)[index]
        # the median of chi-square over nu, Wilson and Hilferty; a median of k values is uncertain by 1.25 sd/sqrt(k)
        middle = (1.0 - 2.0 / (9.0 * np.maximum(weight, 1.0))) ** 3
        values = np.where(there, (density / middle)[index], np.nan)
        sides = [there & (offsets < 0)[None, :], there & (offsets > 0)[None, :]]
        known = used & np.all([side.sum(axis=1) >= _FEWEST for side in sides], axis=0)
        level = np.ones(len(weight))
        # the geometric mean of the two sides does not see a slope
        level[known] = np.sqrt(np.prod([np.nanmedian(np.where(side, values, np.nan)[known], axis=1) for side in sides], axis=0))
        share = np.where(there, weight[index], 0.0).sum(axis=1)
        level *= 1.0 + 2.0 * 1.25 * np.sqrt(2.0 / np.maximum(share, 1.0))
        chance = scipy.special.gammaincc(weight / 2.0, weight * density / level / 2.0)
        beside = np.convolve(taken, [1, 1, 1], mode="same") > 0
        new = known & (chance < np.where(beside, _SIDE, _CHANCE / max(number, 1)))
        if not (new & ~taken).any():
            break
        taken |= new
    # the skirts of a line are too low to be told one by one
    taken = used & (np.convolve(taken, [1, 1, 1], mode="same") > 0)
    for a, b in _runs(taken):
        taken[a:b] &= b - a <= _WIDEST or np.max(density[a:b] / level[a:b]) > _TOWERING
    return taken


def _runs(taken) -> list[tuple[int, int]]:
    """First bin, and that after the last, of each run."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(taken, dtype=np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def amplitudes(bins: Bins, taken, model, duration: float) -> list[tuple[float, float]]:
    """(amplitude, frequency in Hz) of each run of taken bins, strongest first: A^2/2 is the power above the model.

    Parameters
    ----------
    bins : the bins, weights untouched.
    taken : (bins,) which of them lines occupy.
    model : (bins,) density of the noise, in units of `bins.unit`.
    duration : length of the record in s.
    """
    lines = []
    for a, b in _runs(taken):
        excess: Float[np.ndarray, " run"] = np.asarray(bins.weight[a:b] * (bins.density[a:b] - model[a:b]))
        power = excess.sum() * float(bins.unit) / duration
        above = np.maximum(excess, 0.0)
        if power > 0:
            lines.append((float(np.sqrt(2.0 * power)), float(np.dot(above, bins.frequency[a:b]) / above.sum())))
    return sorted(lines, reverse=True)
