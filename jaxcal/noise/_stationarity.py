r"""Whether the slow wandering that shows B and K is as strong in every part of a record.

The likelihood takes the noise as stationary. What speaks for coefficient theta_j is, up to a constant, the energy

.. math:: \sum_k \frac{X_{jk}}{S_k^2} P_k = \sum_t u_t^2,\qquad u = \mathrm{DCT}^{-1}\Big(y_k \sqrt{dt\,X_{jk}}\,/\,S_k\Big)

and the right-hand side says when it came. Over eight equal parts its spread, divided by what a stationary Gaussian record of
the same density has on average, is 1; a warm-up, a draught or a knock makes it larger, and with it the variance of the estimate by
the same factor, for then fewer independent parts speak for the coefficient than the information counts. The law of the spread is found
by drawing, for its parts are few and far from normal. B and K share their evidence: where either is uneven, both are widened, each by
its own factor.
"""

import dataclasses
import functools

import numpy as np
import scipy.fft
import scipy.stats

ORDINATES = 512  # most that are looked at
_FEWEST = 32
_ENOUGH = 0.95  # of the information on the coefficient
PARTS = 8
_DRAWS = 999
_FIRST, _RARE = 99, 4  # of a spread that 1 % exceed, more than 4 of the first 99 do so once in 300 records
_CHANCE = 0.01
_BLOCKS = 4096


@dataclasses.dataclass(frozen=True)
class Unevenness:
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


def unevenness(y, column, density, dt: float) -> Unevenness:
    """How unevenly the energy that speaks for a coefficient is spread over eight parts of a gap-free record.

    Parameters
    ----------
    y : (n,) record.
    column, density : (ordinates,) expected first ordinates per squared coefficient, and in all, as fitted.
    dt : sampling interval in s.
    """
    size = max(len(y) // _BLOCKS, 1)  # means over blocks keep the lowest ordinates
    y = y[: len(y) // size * size].reshape(-1, size).mean(axis=1)
    count = min(len(density), len(y) - 1)
    share = column[:count] / density[:count]
    needed = int(np.searchsorted(np.cumsum(share**2), _ENOUGH * np.sum(share**2))) + 1
    count = min(max(1 << (needed - 1).bit_length(), _FEWEST), count)
    share = np.sqrt(share[:count] / share[:count].max())
    ordinates = np.asarray(scipy.fft.dct(y - y.mean(), norm="ortho"))[1 : count + 1] * np.sqrt(
        size * dt / density[:count]
    )  # unit variance each

    def spread(whitened):
        # u^2 has twice the bandwidth of u
        u = np.asarray(scipy.fft.idct(np.pad(share.astype(whitened.dtype) * whitened, [(0, 0), (1, count - 1)]), norm="ortho"))
        energy = np.sum(u[:, : 2 * count // PARTS * PARTS].reshape(len(u), PARTS, -1) ** 2, axis=2)
        energy = energy / np.maximum(energy.mean(axis=1, keepdims=True), np.finfo(energy.dtype).tiny)
        return np.sum((energy - 1.0) ** 2, axis=1), energy

    (found,), energy = spread(ordinates[None, :])
    drawn = _draws(count)
    by_chance = spread(drawn[:_FIRST])[0]
    if np.sum(by_chance >= found) <= _RARE:  # few of the first: all are needed to tell how few
        by_chance = np.concatenate([by_chance, spread(drawn[_FIRST:])[0]])
    part = int(np.argmax(energy))
    chance = (1.0 + np.sum(by_chance >= found)) / (1.0 + len(by_chance))
    return Unevenness(float(found / by_chance.mean()), float(chance), part, float(energy[0, part] / PARTS))


def unevenness_of_level(y, share, density, dt: float) -> Unevenness:
    """The same for N, for which nearly every ordinate speaks: so many that the law of its parts is the normal one.

    Parameters
    ----------
    y : (n,) gap-free record.
    share, density : (ordinates,) share of N in the fitted density, 0 where an ordinate is left out, and the density.
    dt : sampling interval in s.
    """
    ordinates = np.asarray(scipy.fft.dct(y - y.mean(), norm="ortho"))[1 : len(density) + 1]
    whitened = ordinates * np.sqrt(dt * share / density)
    u = np.asarray(scipy.fft.idct(np.concatenate([[0.0], whitened]), norm="ortho"))
    energy = np.sum(u[: len(u) // PARTS * PARTS].reshape(PARTS, -1) ** 2, axis=1)
    energy = energy / energy.mean()
    stationary = 2.0 * PARTS * np.sum(share**2) / np.sum(share) ** 2  # variance of one part
    total = np.sum((energy - 1.0) ** 2) / stationary
    part = int(np.argmax(energy))
    return Unevenness(total / (PARTS - 1), float(scipy.stats.chi2.sf(total, PARTS - 1)), part, float(energy[part] / PARTS))
