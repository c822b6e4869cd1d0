r"""How much wider intervals must be than the likelihood says, because a real record is neither stationary nor of the model.

Two measures are taken for each coefficient, and the larger one is used, as a factor on its variance.

*Octaves.* The influence of one octave of frequencies on a coefficient is F^-1 g, with g its part of the score and F the information. Under
the model its variance is (F^-1 F_o F^-1)_jj. The factor is the mean ratio of the squares to these variances, each averaged over three
octaves (a sandwich, P. J. Huber, Proc. 5th Berkeley Symp. 1, 1967).

*Blocks of time.* The evidence for a coefficient is, up to a constant, the energy

.. math:: \sum_k \frac{X_{jk}}{S_k^2} P_k = \sum_t u_t^2,\qquad u = \mathrm{DCT}^{-1}\Big(y_k \sqrt{dt\,X_{jk}}\,/\,S_k\Big)

whose sum over time shows how it is distributed. The energies of 10, 5 and 2 blocks scatter about their mean with a known variance if the
record is stationary. A draught, or a level that wanders, makes them scatter more, and the error of the coefficient by the same factor.

A factor counts only as far as chance does not explain it.
"""

import functools
from typing import NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._types import AnyArray
from ._lanes import inverse
from ._likelihood import density
from ._limits import chance
from ._ordinates import Bins

_BLOCKS = (10, 5, 2)  # blocks of the record; fewer ones see slower changes of the level
_CHANCES = (0.1, 0.02)  # chances of a larger factor between which it grows from one to its full size
_ENOUGH = 0.95  # share of the information on a coefficient that the ordinates used must hold
_FEWEST = 64  # ordinates that are used at least
_INDEPENDENT = 1.0  # independent energies that a block must hold; with fewer, its energy follows no known law


class Widening(NamedTuple):
    """Factors (p,) on the variances of the coefficients, and the part of the record (0 to 1) with the most evidence for each, or None."""

    factor: AnyArray
    loudest: list[tuple[float, float] | None]


def widening(bins: Bins, unit: float, theta: AnyArray, names: tuple[str, ...], spectrum: AnyArray) -> Widening:
    """Factors for a fit of `bins`; `spectrum`, (n - 1,), are the ordinates of the record by the orthonormal DCT-II times sqrt(dt)."""
    factor = _of_octaves(bins, theta)
    model = density(bins.columns, theta)
    loudest: list[tuple[float, float] | None] = [None] * len(names)
    count = _counts(len(spectrum))
    known: dict[int, tuple[float, tuple[float, float] | None]] = {}
    for j in np.flatnonzero(theta > 0.0):
        evidence = np.where(bins.weight > 0, bins.columns[:, j] / model, 0.0)[: len(count)]
        if not np.all(evidence >= 0.0) or not np.any(evidence > 0.0):
            continue
        needed = _needed(evidence, count)
        if needed not in known or needed < len(spectrum) // 4:  # what needs most ordinates rests on the same ones
            known[needed] = _of_blocks(spectrum, evidence, model * unit, count, needed)
        several, part = known[needed]
        if several > factor[j]:
            factor[j], loudest[j] = several, part
    return Widening(factor, loudest)


def _counts(ordinates: int) -> AnyArray:
    from ..spectrum._average import log_groups

    return log_groups(ordinates, keep_tail=True)[1]


def _beyond_chance(factor: AnyArray, freedom: AnyArray) -> AnyArray:
    """The factor, as far as a chi-square over its degrees of freedom does not explain it; 1 at least."""
    likely = np.log(np.maximum(chance(factor * freedom, freedom), np.finfo(float).tiny))
    none, full = np.log(_CHANCES)
    return 1.0 + np.clip((likely - none) / (full - none), 0.0, 1.0) * np.maximum(factor - 1.0, 0.0)


def _of_octaves(bins: Bins, theta: AnyArray) -> AnyArray:
    used = bins.weight > 0
    model, columns, weight = density(bins.columns, theta)[used], bins.columns[used], bins.weight[used]
    frequency = bins.frequency[used]
    octave = np.floor(np.log2(frequency / frequency.min()) + 1e-9).astype(int)
    member = (octave[None, :] == np.arange(octave.max() + 1)[:, None]).astype(float)
    rows = columns / model[:, None]
    score = member @ (rows * (0.5 * weight * (bins.density[used] / model - 1.0))[:, None])
    each = np.einsum("ob,bi,bj->oij", member, rows * (0.5 * weight)[:, None], rows)
    back = inverse(each.sum(axis=0))
    squares, variances = (score @ back) ** 2, np.einsum("ij,ojk,ki->oi", back, each, back)
    near = np.abs(np.subtract.outer(*(np.arange(len(squares)),) * 2)) <= 1
    whole = np.maximum(near @ variances, np.finfo(float).tiny)
    share = near @ (variances / whole)  # weight of the square of each octave in the mean of smoothed ratios
    total = np.maximum(variances.sum(axis=0), np.finfo(float).tiny)
    expected = share * variances / total
    freedom = expected.sum(axis=0) ** 2 / np.maximum(np.sum(expected**2, axis=0), np.finfo(float).tiny)
    return _beyond_chance(np.sum(share * squares, axis=0) / total, np.maximum(freedom, 1.0))


def _needed(evidence: AnyArray, count: AnyArray) -> int:
    """Number of ordinates that hold nearly all information, a length with a fast transform."""
    total = np.cumsum(count * evidence**2)
    last = int(np.searchsorted(total, _ENOUGH * total[-1]))
    ordinates = int(np.sum(count))
    wanted = max(int(np.sum(count[: last + 1])), _FEWEST)
    return ordinates if wanted > ordinates // 4 else min(_fast(wanted), ordinates)


@functools.lru_cache(maxsize=256)
def _fast(length: int) -> int:
    return int(scipy.fft.next_fast_len(length, real=True))


def _of_blocks(spectrum, evidence, model, count, needed) -> tuple[float, tuple[float, float] | None]:
    bins = int(np.searchsorted(np.cumsum(count), needed)) + 1
    root, level = (np.repeat(values[:bins].astype(np.float32), count[:bins])[:needed] for values in (evidence, model))
    white = np.sqrt(root / level) * spectrum[:needed].astype(np.float32)
    # u^2 has twice the bandwidth of u
    whole = needed == len(spectrum)
    u = np.asarray(scipy.fft.idct(np.pad(white, (1, 0 if whole else needed - 1)), norm="ortho", overwrite_x=True))
    energy = np.add.reduceat(u * u, np.arange(_BLOCKS[0]) * len(u) // _BLOCKS[0], dtype=float)
    total = np.sum(root, dtype=float) ** 2 / np.sum(root * root, dtype=float)  # chi-squares that the energy is worth
    best: tuple[float, tuple[float, float] | None] = 1.0, None
    for blocks in _BLOCKS:
        freedom = total / blocks
        if freedom < _INDEPENDENT:
            continue
        parts = energy.reshape(blocks, -1).sum(axis=1)
        parts = parts / parts.mean()
        spread = np.sum((parts - 1.0) ** 2) / (blocks - 1) * freedom / 2.0
        # the cube root of a chi-square is nearly normal
        normal = np.cbrt(parts) / np.sqrt(2.0 / (9.0 * freedom))
        scatter = np.sum((normal - normal.mean()) ** 2) / (blocks - 1)
        beyond = float(_beyond_chance(scatter, blocks - 1.0))
        found = 1.0 + (beyond - 1.0) / max(scatter - 1.0, np.finfo(float).tiny) * max(spread - 1.0, 0.0) if beyond > 1.0 else 1.0
        if found > best[0]:
            loudest = int(np.argmax(parts))
            best = float(found), (loudest / blocks, (loudest + 1) / blocks)
    return best
