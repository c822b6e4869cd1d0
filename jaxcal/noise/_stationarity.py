r"""Does a record follow a regressor such as time or temperature, and is its noise equally strong in every part?

A regressor is tested by weighted least squares on the lowest ordinates. With d_k the DCT-II of the regressor and y_k that of the
record, both multiplied by sqrt(dt), its coefficient and the standard error are

.. math:: r = \frac{\sum d_k y_k/S_k}{\sum d_k^2/S_k},\qquad \mathrm{se}(r) = \Big(\sum d_k^2/S_k\Big)^{-1/2}

The likelihood assumes that the noise is stationary. The evidence of the record for coefficient theta_j is, up to a constant, the energy

.. math:: \sum_k \frac{X_{jk}}{S_k^2} P_k = \sum_t u_t^2,\qquad u = \mathrm{DCT}^{-1}\Big(y_k \sqrt{dt\,X_{jk}}\,/\,S_k\Big)

and the sum on the right shows how this energy is distributed over time. The record is divided into eight equal parts. The spread of
their energies is divided by its mean for stationary Gaussian records of the same density, which gives about 1 for a stationary record.
A warm-up, a draught or a knock makes it larger. It also raises the variance of the estimate by the same factor, because the coefficient
then rests on fewer independent parts than the Fisher information assumes. The law of the spread is found by simulation, because eight
energies are few and far from normal. B and K rest on the same evidence: if either is uneven, the intervals of both are widened, each by
its own factor.
"""

import functools
import itertools
from typing import NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import power_of_two
from .._special import chi_square_tail

ORDINATES, _FOLLOWED = 512, 48  # largest number of ordinates that are used at all, and for a regressor
_FEWEST = 32  # fewest ordinates that are used for a coefficient
_ENOUGH = 0.95  # share of the information on a coefficient that the ordinates used must hold
PARTS = 8
_DRAWS = 999
_FIRST, _RARE = 99, 4  # a spread that 1 % of draws exceed is exceeded by more than 4 of the first 99 draws once in 300 records only
_CHANCE = 0.01
_BLOCKS = 4096
#: search for levels of white noise: number of blocks in a record, fewest samples in a block, and most levels
_CUTS, _SHORTEST, _MOST_LEVELS = 256, 16, 6
#: likelihood ratio above which a record is cut, far above the 20 that chance reaches among so many blocks; logarithm of the ratio of N^2
#: below which two levels count as equal; fewest blocks in a level
_CUT, _ALIKE, _FEWEST_CUTS = 30.0, 0.4, 4


class Unevenness(NamedTuple):
    """Spread of the energy over the parts relative to a stationary record, chance of a larger spread, strongest part, and its share."""

    factor: float
    chance: float
    part: int
    share: float

    @property
    def told(self) -> bool:
        """Whether the spread is too large to be explained by chance."""
        return self.chance < _CHANCE


@functools.lru_cache(maxsize=4)
def _draws(ordinates: int) -> np.ndarray:
    """Normal draws, (draws, ordinates). They are the same for every record, so that a fit can be repeated exactly."""
    return np.random.default_rng(20260101).standard_normal((_DRAWS, ordinates), dtype=np.float32)


def _ordinates(x, dt: float) -> np.ndarray:
    """Lowest DCT-II ordinates times sqrt(dt), computed from means over blocks of samples."""
    size = max(len(x) // _BLOCKS, 1)
    x = x[: len(x) // size * size].reshape(-1, size).mean(axis=1)
    return np.sqrt(size * dt) * np.asarray(scipy.fft.dct(x - x.mean(), norm="ortho"))[1:]


def follows(y, regressor, density, dt: float) -> tuple[float, float]:
    """Coefficient of a regressor in a gap-free record (n,) and its standard error; (0, inf) for a constant regressor.

    `density` is the density of the noise at the first ordinates.
    """
    y, d = _ordinates(y, dt)[:_FOLLOWED], _ordinates(regressor, dt)[:_FOLLOWED]
    count = min(len(density), len(y))
    information = float(np.sum(d[:count] ** 2 / density[:count]))
    if not information > 0.0:
        return 0.0, np.inf
    return float(np.sum(y[:count] * d[:count] / density[:count])) / information, information**-0.5


def _energies(u) -> np.ndarray:
    """(..., parts) energy of a signal in each of several equal parts, divided by the mean over the parts."""
    energy = np.sum(u[..., : u.shape[-1] // PARTS * PARTS].reshape(*u.shape[:-1], PARTS, -1) ** 2, axis=-1)
    return energy / np.maximum(energy.mean(axis=-1, keepdims=True), np.finfo(energy.dtype).tiny)


def unevenness(y, column, density, dt: float) -> Unevenness:
    """How unevenly the evidence for a coefficient is distributed over the eight parts of a gap-free record (n,).

    `column` are the expected first ordinates per squared coefficient, `density` those of the whole fitted model.
    """
    ordinates = _ordinates(y, dt)
    count = min(len(density), len(ordinates))
    share = column[:count] / density[:count]
    needed = int(np.searchsorted(np.cumsum(share**2), _ENOUGH * np.sum(share**2))) + 1
    count = min(power_of_two(needed, _FEWEST), count)
    share = np.sqrt(share[:count] / share[:count].max())

    def spread(whitened):
        # u is padded to twice as many samples, because u^2 has twice the bandwidth of u
        u = np.asarray(scipy.fft.idct(np.pad(share.astype(whitened.dtype) * whitened, [(0, 0), (1, count - 1)]), norm="ortho"))
        energy = _energies(u)
        return np.sum((energy - 1.0) ** 2, axis=1), energy

    (found,), (energy,) = spread((ordinates[:count] / np.sqrt(density[:count]))[None, :])
    drawn = _draws(count)
    by_chance = spread(drawn[:_FIRST])[0]
    if np.sum(by_chance >= found) <= _RARE:  # the spread may be significant: only all draws give its chance
        by_chance = np.concatenate([by_chance, spread(drawn[_FIRST:])[0]])
    chance = (1.0 + np.sum(by_chance >= found)) / (1.0 + len(by_chance))
    return Unevenness(float(found / by_chance.mean()), float(chance), int(np.argmax(energy)), float(energy.max() / PARTS))


class Level(NamedTuple):
    """White noise in one part of a record, samples `start` to `stop`: N relative to the whole record, and its relative standard error."""

    start: int
    stop: int
    ratio: float
    error: float


def levels_of_white(spectrum, share, density, dt: float) -> list[Level]:
    """Parts of a gap-free record whose white noise differs in strength, in order of time; one part if it is the same everywhere.

    `spectrum`, (n - 1,), are all ordinates of the record but the mean, by the orthonormal DCT-II.
    The energy that is evidence for N is averaged in blocks. The record is cut where two levels describe the blocks better than one, by a
    likelihood ratio that allows for the observed scatter between neighbouring blocks. Each part is then cut in the same way.
    """
    u, samples = _white_part(spectrum, share, density, dt), len(spectrum) + 1
    size = max(len(u) // _CUTS, _SHORTEST)
    energy = np.mean(u[: len(u) // size * size].reshape(-1, size) ** 2, axis=1)
    if len(energy) < 4 or not np.all(energy > 0.0):
        return [Level(0, samples, 1.0, 0.0)]
    freedom = size * np.sum(share) ** 2 / (len(u) * np.sum(share**2))
    seen = 1.4826 * np.median(np.abs(np.diff(np.log(energy))))  # a difference of two logarithms has the variance 4 / freedom
    freedom = min(freedom, 4.0 / seen**2)
    total, edges = np.concatenate([[0.0], np.cumsum(energy)]), [0, len(energy)]

    def cut(first: int, last: int) -> int | None:
        k = np.arange(first + _FEWEST_CUTS, last - _FEWEST_CUTS + 1)
        if not len(k):
            return None
        both = (last - first) * np.log((total[last] - total[first]) / (last - first))
        parts = sum((b - a) * np.log((total[b] - total[a]) / (b - a)) for a, b in ((first, k), (k, last)))
        gain = freedom * (both - parts)
        return int(k[np.argmax(gain)]) if gain.max() > _CUT else None

    for _ in range(_MOST_LEVELS - 1):
        found = [at for first, last in itertools.pairwise(edges) if (at := cut(first, last)) is not None]
        if not found:
            break
        edges = sorted({*edges, *found})
    means = np.array([(total[b] - total[a]) / (b - a) for a, b in itertools.pairwise(edges)])
    if len(edges) > _MOST_LEVELS + 1 or np.any(np.abs(np.diff(np.log(means))) < _ALIKE):
        return [Level(0, samples, 1.0, 0.0)]
    ratios = np.sqrt(means / energy.mean())
    ends = [edge * size for edge in edges[:-1]] + [samples]
    return [
        Level(start, stop, float(ratio), float(np.sqrt(0.5 / (freedom * (b - a)))))
        for start, stop, ratio, (a, b) in zip(ends, ends[1:], ratios, itertools.pairwise(edges), strict=False)
    ]


def _white_part(spectrum, share, density, dt: float):
    """The signal whose energy is the evidence for N. `share` is that of N in the fitted density at the first ordinates, 0 if left out."""
    weighted = np.zeros(len(density) + 1, dtype=np.float32)  # seven digits of whitened ordinates are enough, in half the time
    weighted[1:] = spectrum[: len(density)] * np.sqrt(dt * share / density)
    return np.asarray(scipy.fft.idct(weighted, norm="ortho", overwrite_x=True))


def unevenness_of_level(spectrum, share, density, dt: float) -> Unevenness:
    """`unevenness` for N, from the ordinates (n - 1,) of the record by the orthonormal DCT-II.

    Nearly every ordinate is evidence for N, so many that the energies of the parts follow a normal law.
    """
    energy = _energies(_white_part(spectrum, share, density, dt))
    stationary = 2.0 * PARTS * np.sum(share**2) / np.sum(share) ** 2  # variance of one part of a stationary record
    total = np.sum((energy - 1.0) ** 2) / stationary
    chance = float(chi_square_tail(total, PARTS - 1))
    return Unevenness(total / (PARTS - 1), chance, int(np.argmax(energy)), float(energy.max() / PARTS))
