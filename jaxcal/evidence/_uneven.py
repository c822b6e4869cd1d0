r"""Whether noise is uneven in time: its energy in blocks of the record scatters more than chance explains.

The scatter of m blocks, over what stationary noise has, is chi-square over its degrees of freedom. Chance is told from wandering by the
energies of short neighbours, which hardly differ in level, so that tails and correlation of the noise matter to both alike.
"""

from typing import Any, NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding, Table
from .._types import AnyArray
from ._values import HIDDEN

#: blocks of the record; fewer ones see slower changes of the level
BLOCKS = (10, 5, 2)
_CHANCES = (0.1, 0.02)  # chances of a larger scatter of stationary noise between which a factor grows from one to its full size
_NAMED = 1e-3  # chance of a larger scatter below which a part of the record is named; at 0.02, one of six stationary records named one
#: short neighbours, a multiple of all numbers of blocks: at most, and at least, where 0.9 % of records were named
_NEIGHBOURS, _FEWEST = 240, 40
#: samples in a neighbour at least, so that its energy is nearly normal, and those used at most, so that long records cost no more
_SHORT, _USED = 256, 2048
#: share of the information on a coefficient that the ordinates used must hold; ordinates that are used at least
_ENOUGH, _ORDINATES = 0.95, 64
#: ordinates in a band, whose transform stays in the cache (of 10^6 ordinates it takes a quarter of the time), and bands at least
_BAND, _BANDS = 4096, 8


def quantile(freedom: Any, chance: float) -> Any:
    """What chi-square over its degrees of freedom exceeds by chance."""
    return 2.0 * scipy.special.gammainccinv(freedom / 2.0, chance) / freedom


def beyond_chance(factor: Any, freedom: Any) -> Any:
    """The factor, as far as chance does not explain it of a chi-square over its degrees of freedom; 1 at least."""
    none, full = (quantile(freedom, one) for one in _CHANCES)
    return 1.0 + np.clip((factor - none) / (full - none), 0.0, 1.0) * np.maximum(factor - 1.0, 0.0)


def is_named(factor: Any, freedom: Any) -> Any:
    """Whether a part of the record is to be named for such a factor."""
    return factor > quantile(freedom, _NAMED)


class Unevenness(NamedTuple):
    """Variance of the mean square of noise that its wandering level adds, relative to its square; the loudest part (0 to 1).

    Without evidence of a wandering level these are 0 and None, in 99 % of steady records.
    """

    variance: float
    loudest: tuple[float, float] | None


def widened(freedom: np.ndarray, columns: np.ndarray, order: int, duration: float, findings: Table) -> tuple[np.ndarray, list[Finding]]:
    """Degrees of freedom (values, channels) of mean squares of the columns (n, channels), and a finding for each uneven one.

    The differences of this `order` are the noise without slow parts. A level that wanders adds its variance to that of all mean squares.
    """
    found = [unevenness(column, order) for column in columns.T]
    wider = 2.0 / (2.0 / freedom + np.array([one.variance for one in found]))
    said = []
    for channel, one in enumerate(found):
        if one.loudest:
            factor = float(np.sqrt(np.max(freedom[:, channel] / wider[:, channel])))
            start, stop = (duration * end for end in one.loudest)
            about = (f"channel {channel}",) if len(found) > 1 else ()
            said += findings.over("uneven", factor, about, start=start, stop=stop, factor=factor)
    return wider, said


def unevenness(values: np.ndarray, order: int = 1) -> Unevenness:
    """How uneven the noise of a record (n,) is, without its slow parts: the differences of an order; NaN where missing.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.evidence._uneven import unevenness
    >>> y = np.random.default_rng(0).normal(size=50_000)
    >>> unevenness(y).loudest
    >>> y[40_000:45_000] *= 1.5
    >>> unevenness(y).loudest
    (0.8, 0.9)
    """
    parts = _neighbours(values, order)
    energy = np.vecdot(parts, parts)
    if not np.isfinite(energy.sum()):
        values = np.diff(values, order)
        parts = _neighbours(values[np.isfinite(values)], 0)
        energy = np.vecdot(parts, parts)
    if not (count := len(energy)):
        return Unevenness(0.0, None)
    # where the step of the values hides the noise, the level of the readings decides how often they change
    if np.count_nonzero(parts == 0.0) > HIDDEN * parts.size or not (mean := energy.mean()) > 0.0:
        return Unevenness(0.0, None)
    energy /= mean
    steps = energy[1:] - energy[:-1]
    own = float(steps @ steps) / (2.0 * len(steps))  # variance of a short part
    variance, named = 0.0, False
    for blocks in BLOCKS:
        level = energy.reshape(blocks, -1).mean(axis=1) - 1.0
        factor = float(level @ level) / (blocks - 1.0) / max(own * blocks / count, np.finfo(float).tiny)
        freedom = 1.0 / (1.0 / (blocks - 1.0) + 1.5 / count)  # the squared differences of neighbours are worth two thirds of their number
        if is_named(factor, freedom):
            variance, named = max(variance, (factor - 1.0) * own / count), True
    if not named:
        return Unevenness(0.0, None)
    loudest = int(np.argmax(energy.reshape(BLOCKS[0], -1).sum(axis=1)))
    return Unevenness(variance, (loudest / BLOCKS[0], (loudest + 1) / BLOCKS[0]))


def _neighbours(values: np.ndarray, order: int) -> np.ndarray:
    """Differences of an order in short neighbours, (neighbours, differences); no row if there are too few."""
    count = min(len(values) // _SHORT // BLOCKS[0] * BLOCKS[0], _NEIGHBOURS)
    if count < _FEWEST:
        return np.empty((0, 1))
    return np.diff(values[: len(values) // count * count].reshape(count, -1)[:, :_USED], order)


def energies_in_blocks(spectrum: AnyArray, count: AnyArray, evidence: AnyArray, model: AnyArray) -> tuple[np.ndarray, np.ndarray]:
    """Energies of the scores of coefficients of a noise model in ten blocks of time, (p, blocks), and their worth in chi-squares, (p,).

    `spectrum` are the ordinates by the orthonormal DCT-II without that of the mean, of which each bin holds the `count`. `evidence` are the
    densities per squared coefficient over that of the `model` in the bins, (p, bins), zero of coefficients that are not looked at.
    """
    n = len(spectrum)
    # single precision is enough for energies, and takes half the time; of a step alone nothing is left as noise, which exceeds its range
    largest = float(np.max(np.abs(spectrum[:_BAND]))) or 1.0
    single = np.divide(spectrum, largest, dtype=np.float32, casting="same_kind")
    energies, worth, fast = np.zeros((len(evidence), BLOCKS[0])), np.zeros(len(evidence)), []
    for row in np.flatnonzero(evidence.any(axis=1)):
        own = evidence[row]
        # ordinates that hold nearly all information, in a number with a fast transform
        total = np.cumsum(count * own**2)
        wanted = max(int(np.sum(count[: np.searchsorted(total, _ENOUGH * total[-1]) + 1])), _ORDINATES)
        needed = n if wanted > n // 4 else min(int(scipy.fft.next_fast_len(wanted, real=True)), n)
        held, share = np.diff(np.minimum(np.cumsum(count), needed), prepend=0), own / own.max()  # ordinates of each bin
        worth[row] = float((held @ share) ** 2 / (held @ share**2))
        if needed == n > _BANDS * _BAND:
            fast.append(row)
        else:  # u^2 has twice the bandwidth of u
            energies[row] = _in_blocks(single, np.sqrt(own / model), held, (1, n + 1 if needed == n else 2 * needed))[0]
    if fast:
        # what all these coefficients share is transformed once, in bands in which the evidence on each is nearly level
        own, bands = evidence[fast], n // _BAND + 1
        used, places = (own > 0.0).any(axis=0), np.clip(np.arange(bands + 1) * _BAND - 1, 0, n)
        known = [np.interp(places, np.append(0, np.cumsum(count)), np.append(0.0, np.cumsum(count * one))) for one in (*own**2, used)]
        known = np.diff(known)
        energies[fast] = np.sqrt(known[:-1] / np.maximum(known[-1], 1.0)) @ _in_blocks(single, used / np.sqrt(model), count, (bands, _BAND))
    return energies * largest**2, worth


def _in_blocks(spectrum: AnyArray, root: AnyArray, held: AnyArray, shape: tuple[int, int]) -> np.ndarray:
    """Energies (bands, blocks of time) of ordinates times the root in their bins, with so many `held`; `shape`: bands, and their width."""
    level, ordinates = float(root.max()), np.zeros(shape, dtype=np.float32)
    count = int(held.sum())
    np.multiply(np.repeat((root / level).astype(np.float32), held), spectrum[:count], out=ordinates.ravel()[1 : count + 1])
    u = np.asarray(scipy.fft.idct(ordinates, norm="ortho", overwrite_x=True))
    blocks = np.split(u, np.rint(np.arange(1, BLOCKS[0]) * shape[1] / BLOCKS[0]).astype(int), axis=1)
    return level**2 * np.stack([np.vecdot(one, one) for one in blocks], axis=1, dtype=float)
