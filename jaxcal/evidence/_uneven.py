r"""Whether noise is uneven in time: its energy in blocks of the record scatters more than chance explains.

The scatter of m blocks, over what stationary noise has, is chi-square over its degrees of freedom. Chance is told from wandering by the
energies of short neighbours, which hardly differ in level, so that tails and correlation of the noise matter to both alike.
"""

from typing import NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import CAUTION, Kind
from .._types import AnyArray

#: blocks of the record; fewer ones see slower changes of the level
BLOCKS = (10, 5, 2)
_CHANCES = (0.1, 0.02)  # chances of a larger scatter of stationary noise between which a factor grows from one to its full size
_NAMED = 1e-3  # chance of a larger scatter below which a part of the record is named; at 0.02, one of six stationary records named one
#: short neighbours, a multiple of all numbers of blocks: at most, and at least, where 0.9 % of records were named; samples in each
_NEIGHBOURS, _FEWEST, _SHORT = 240, 40, 256
UNEVEN = Kind(
    CAUTION, "The noise is uneven in time, largest between {start:.6g} and {stop:.6g} s; intervals are up to {factor:.2g} times as wide "
    "for it.", "Look there for a knock or a draught.", limits=(2.0,),
)  # fmt: skip


def quantile(freedom: AnyArray, chance: float) -> AnyArray:
    """What chi-square over its degrees of freedom exceeds by chance."""
    return 2.0 * scipy.special.gammainccinv(freedom / 2.0, chance) / freedom


def beyond_chance(factor: AnyArray, freedom: AnyArray) -> AnyArray:
    """The factor, as far as chance does not explain it of a chi-square over its degrees of freedom; 1 at least."""
    none, full = (quantile(freedom, one) for one in _CHANCES)
    return 1.0 + np.clip((factor - none) / (full - none), 0.0, 1.0) * np.maximum(factor - 1.0, 0.0)


def is_named(factor: AnyArray, freedom: AnyArray) -> AnyArray:
    """Whether a part of the record is to be named for such a factor."""
    return factor > quantile(freedom, _NAMED)


class Unevenness(NamedTuple):
    """Variance of the mean square of noise that its wandering level adds, relative to its square; the loudest part (0 to 1), or None."""

    variance: float
    loudest: tuple[float, float] | None

    def widened(self, freedom: AnyArray) -> AnyArray:
        """Degrees of freedom of a mean square of the record, with what the wandering level adds to its variance."""
        return 2.0 / (2.0 / freedom + self.variance)


def unevenness(noise: np.ndarray) -> Unevenness:
    """How uneven a record (n,) of noise without slow parts is, such as differences of readings; NaN where missing.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.evidence._uneven import unevenness
    >>> y = np.random.default_rng(0).normal(size=50_000)
    >>> unevenness(y).loudest
    >>> y[40_000:] *= 1.5
    >>> unevenness(y).loudest
    (0.8, 1.0)
    """
    found = Unevenness(0.0, None)
    noise = noise if np.isfinite(noise.sum()) else noise[np.isfinite(noise)]
    count = min(len(noise) // _SHORT // BLOCKS[0] * BLOCKS[0], _NEIGHBOURS)
    if count < _FEWEST:
        return found
    parts = noise[: len(noise) // count * count].reshape(count, -1)
    energy = np.einsum("ij,ij->i", parts, parts)
    if not (mean := energy.mean()) > 0.0:
        return found
    energy /= mean
    own = float(np.mean(np.diff(energy) ** 2)) / 2.0  # variance of a short part
    for blocks in BLOCKS:
        level = energy.reshape(blocks, -1).mean(axis=1)
        factor = float(np.var(level, ddof=1)) / max(own * blocks / count, np.finfo(float).tiny)
        freedom = 1.0 / (1.0 / (blocks - 1.0) + 1.5 / count)  # half of the differences of neighbours are independent, and a half more
        added = (float(beyond_chance(factor, freedom)) - 1.0) * own / count
        if added > found.variance:
            loudest = int(np.argmax(level))
            found = Unevenness(added, (loudest / blocks, (loudest + 1) / blocks) if is_named(factor, freedom) else None)
    return found
