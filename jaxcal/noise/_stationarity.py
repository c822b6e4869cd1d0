r"""What moves a record as a whole: a line in time, its temperature; and whether its noise is as strong in every part.

A regressor with DCT-II d_k, in a record with y_k, both times sqrt(dt), is followed by weighted least squares on the lowest ordinates,

.. math:: r = \frac{\sum d_k y_k/S_k}{\sum d_k^2/S_k},\qquad \mathrm{se}(r) = \Big(\sum d_k^2/S_k\Big)^{-1/2}

The likelihood takes the noise as stationary. What speaks for coefficient theta_j is, up to a constant, the energy

.. math:: \sum_k \frac{X_{jk}}{S_k^2} P_k = \sum_t u_t^2,\qquad u = \mathrm{DCT}^{-1}\Big(y_k \sqrt{dt\,X_{jk}}\,/\,S_k\Big)

and the right-hand side says when it came. Over eight equal parts its spread, divided by what a stationary Gaussian record of
the same density has on average, is 1; a warm-up, a draught or a knock makes it larger, and with it the variance of the estimate by
the same factor, for then fewer independent parts speak for the coefficient than the information counts. The law of the spread is found
by drawing, for its parts are few and far from normal. B and K share their evidence: where either is uneven, both are widened, each by
its own factor.
"""

import functools
import itertools
from typing import NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

ORDINATES, _FOLLOWED = 512, 48  # most that are looked at, and of these for a regressor
_FEWEST = 32
_ENOUGH = 0.95  # of the information on the coefficient
PARTS = 8
_DRAWS = 999
_FIRST, _RARE = 99, 4  # of a spread that 1 % exceed, more than 4 of the first 99 do so once in 300 records
_CHANCE = 0.01
_BLOCKS = 4096
#: blocks of a record in which levels of white noise are looked for, the fewest samples of one, and the most levels
_CUTS, _SHORTEST, _MOST_LEVELS = 256, 16, 6
#: likelihood ratio at which a record is cut, far above the 20 that chance reaches among so many blocks; logarithm of the ratio of N^2
#: below which two levels are one; blocks that one level has at least
_CUT, _ALIKE, _FEWEST_CUTS = 30.0, 0.4, 4


class Unevenness(NamedTuple):
    """Spread over the parts relative to a stationary record, the chance of a larger one, and the share of the strongest part."""

    factor: float
    chance: float
    part: int
    share: float

    @property
    def told(self) -> bool:
        """Whether it is too large for chance."""
        return self.chance < _CHANCE


@functools.lru_cache(maxsize=4)
def _draws(ordinates: int) -> np.ndarray:
    """Normal draws, (draws, ordinates); the same for every record, so that a fit repeats exactly."""
    return np.random.default_rng(20260101).standard_normal((_DRAWS, ordinates), dtype=np.float32)


def _ordinates(x, dt: float) -> np.ndarray:
    """DCT-II times sqrt(dt), from means over blocks, which keep the lowest ordinates."""
    size = max(len(x) // _BLOCKS, 1)
    x = x[: len(x) // size * size].reshape(-1, size).mean(axis=1)
    return np.sqrt(size * dt) * np.asarray(scipy.fft.dct(x - x.mean(), norm="ortho"))[1:]


def follows(y, regressor, density, dt: float) -> tuple[float, float]:
    """Coefficient of a regressor in a gap-free record (n,) and its standard error; (0, inf) for a regressor that does not move.

    `density` is that of the noise at the first ordinates.
    """
    y, d = _ordinates(y, dt)[:_FOLLOWED], _ordinates(regressor, dt)[:_FOLLOWED]
    count = min(len(density), len(y))
    information = float(np.sum(d[:count] ** 2 / density[:count]))
    if not information > 0.0:
        return 0.0, np.inf
    return float(np.sum(y[:count] * d[:count] / density[:count])) / information, information**-0.5


def _energies(u) -> np.ndarray:
    """(..., parts) energy of a signal in equal parts over their mean."""
    energy = np.sum(u[..., : u.shape[-1] // PARTS * PARTS].reshape(*u.shape[:-1], PARTS, -1) ** 2, axis=-1)
    return energy / np.maximum(energy.mean(axis=-1, keepdims=True), np.finfo(energy.dtype).tiny)


def unevenness(y, column, density, dt: float) -> Unevenness:
    """How unevenly the energy that speaks for a coefficient is spread over eight parts of a gap-free record (n,).

    `column` and `density` are the expected first ordinates per squared coefficient, and in all, as fitted.
    """
    ordinates = _ordinates(y, dt)
    count = min(len(density), len(ordinates))
    share = column[:count] / density[:count]
    needed = int(np.searchsorted(np.cumsum(share**2), _ENOUGH * np.sum(share**2))) + 1
    count = min(max(1 << (needed - 1).bit_length(), _FEWEST), count)
    share = np.sqrt(share[:count] / share[:count].max())

    def spread(whitened):
        # u^2 has twice the bandwidth of u
        u = np.asarray(scipy.fft.idct(np.pad(share.astype(whitened.dtype) * whitened, [(0, 0), (1, count - 1)]), norm="ortho"))
        energy = _energies(u)
        return np.sum((energy - 1.0) ** 2, axis=1), energy

    (found,), (energy,) = spread((ordinates[:count] / np.sqrt(density[:count]))[None, :])
    drawn = _draws(count)
    by_chance = spread(drawn[:_FIRST])[0]
    if np.sum(by_chance >= found) <= _RARE:  # few of the first: all are needed to tell how few
        by_chance = np.concatenate([by_chance, spread(drawn[_FIRST:])[0]])
    chance = (1.0 + np.sum(by_chance >= found)) / (1.0 + len(by_chance))
    return Unevenness(float(found / by_chance.mean()), float(chance), int(np.argmax(energy)), float(energy.max() / PARTS))


class Level(NamedTuple):
    """White noise of one part of a record: first and last sample, N over that of the whole record, and its relative standard error."""

    start: int
    stop: int
    ratio: float
    error: float


def levels_of_white(y, share, density, dt: float) -> list[Level]:
    """Parts of a gap-free record (n,) whose white noise differs in strength, in order of time; one part where it does not.

    The energy that speaks for N is summed in blocks. The record is cut where two levels describe the blocks better than one does, by a
    likelihood ratio in units of the scatter of neighbouring blocks, and each part again.
    """
    u = _white_part(y, share, density, dt)
    size = max(len(u) // _CUTS, _SHORTEST)
    energy = np.mean(u[: len(u) // size * size].reshape(-1, size) ** 2, axis=1)
    if len(energy) < 4 or not np.all(energy > 0.0):
        return [Level(0, len(y), 1.0, 0.0)]
    freedom = size * np.sum(share) ** 2 / (len(u) * np.sum(share**2))
    seen = 1.4826 * np.median(np.abs(np.diff(np.log(energy))))  # of a difference of logarithms, whose variance is 4 over the freedom
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
        return [Level(0, len(y), 1.0, 0.0)]
    ratios = np.sqrt(means / energy.mean())
    ends = [edge * size for edge in edges[:-1]] + [len(y)]
    return [
        Level(start, stop, float(ratio), float(np.sqrt(0.5 / (freedom * (b - a)))))
        for start, stop, ratio, (a, b) in zip(ends, ends[1:], ratios, itertools.pairwise(edges), strict=False)
    ]


def _white_part(y, share, density, dt: float):
    """The signal whose energy speaks for N. `share` is that of N in the fitted density at the first ordinates, 0 where one is left out."""
    ordinates = np.asarray(scipy.fft.dct(y - y.mean(), norm="ortho"))[1 : len(density) + 1]
    return np.asarray(scipy.fft.idct(np.concatenate([[0.0], ordinates * np.sqrt(dt * share / density)]), norm="ortho"))


def unevenness_of_level(y, share, density, dt: float) -> Unevenness:
    """The same for N, for which nearly every ordinate speaks: so many that the law of its parts is the normal one."""
    energy = _energies(_white_part(y, share, density, dt))
    stationary = 2.0 * PARTS * np.sum(share**2) / np.sum(share) ** 2  # variance of one part
    total = np.sum((energy - 1.0) ** 2) / stationary
    chance = float(scipy.special.chdtrc(PARTS - 1, total))
    return Unevenness(total / (PARTS - 1), chance, int(np.argmax(energy)), float(energy.max() / PARTS))
