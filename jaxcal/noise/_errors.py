r"""How much wider intervals must be than the likelihood says, because a real record is neither stationary nor of the model.

Two measures are taken for each coefficient, and the larger one is used, as a factor on its variance.

*Octaves.* The influence of one octave of frequencies on a coefficient is F^-1 g, with g its part of the score and F the information. Under
the model its variance is (F^-1 F_o F^-1)_jj. The factor is the mean ratio of the squares to these variances, each averaged over three
octaves (a sandwich, P. J. Huber, Proc. 5th Berkeley Symp. 1, 1967).

*Blocks of time.* The score of a coefficient is, up to a constant, half the energy

.. math:: \sum_k \frac{X_{jk}}{S_k^2} P_k = \sum_t u_t^2,\qquad u = \mathrm{DCT}^{-1}\Big(y_k \sqrt{dt\,X_{jk}}\,/\,S_k\Big)

whose sum over time shows how it is distributed. The influences F^-1 g of 10, 5 and 2 blocks scatter about their mean, and their variance is
that of the coefficient, as in a jackknife. A draught, or a level that wanders, makes it larger than the likelihood says.

A factor counts in full where chance does not explain it.
"""

from typing import NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._types import AnyArray
from ..evidence._uneven import BLOCKS, beyond_chance, is_named
from ..spectrum._average import log_groups
from ._likelihood import density, information, inverse
from ._ordinates import Bins

#: share of the information on a coefficient that the ordinates used must hold; ordinates that are used at least; independent energies that
#: a block must hold; with fewer, its energy follows no known law
_ENOUGH, _FEWEST, _INDEPENDENT = 0.95, 64, 1.0


class Widening(NamedTuple):
    """Factors (p,) on the variances of the coefficients; the part of the record (0 to 1) with the most evidence of each, or None."""

    factor: AnyArray
    loudest: list[tuple[float, float] | None]


def widening(bins: Bins, unit: float, theta: AnyArray, names: tuple[str, ...], spectrum: AnyArray) -> Widening:
    """Factors for a fit of `bins` in a `unit` of squares of the `spectrum`, (n - 1,), the orthonormal DCT-II of the record."""
    factor = _of_octaves(bins, theta)
    model = density(bins.columns, theta)
    loudest: list[tuple[float, float] | None] = [None] * len(names)
    count = log_groups(len(spectrum), keep_tail=True)[1]
    # single precision is enough for energies, and takes half the time; of a step alone nothing is left as noise, which exceeds its range
    largest = max(float(np.max(spectrum)), -float(np.min(spectrum))) or 1.0
    single = np.divide(spectrum, largest, dtype=np.float32, casting="same_kind")
    there = np.flatnonzero(theta != 0.0)
    energies, worth = np.zeros((len(there), BLOCKS[0])), np.zeros(len(there))
    for row, j in enumerate(there):
        evidence = np.where(bins.weight > 0, np.abs(bins.columns[:, j]) / model, 0.0)[: len(count)]
        if np.any(evidence > 0.0):
            energies[row], worth[row] = _energies(single, evidence, model, count)
            energies[row] *= np.sign(bins.columns[-1, j]) * (largest / np.sqrt(unit)) ** 2
    back = inverse(information(bins._replace(columns=bins.columns[:, there]), theta[there]))
    own = np.maximum(np.diagonal(back), np.finfo(float).tiny)
    for blocks in BLOCKS:
        influence = back @ energies.reshape(len(there), blocks, -1).sum(axis=2) / 2.0
        influence -= influence.mean(axis=1, keepdims=True)
        spread = np.sum(influence**2, axis=1) * blocks / (blocks - 1.0) / own
        # energies of few chi-squares have long tails, which make their scatter less certain
        known = worth >= _INDEPENDENT * blocks
        freedom = (blocks - 1.0) / (1.0 + 6.0 * blocks / np.where(known, worth, 1.0))
        found, named = np.where(known, beyond_chance(spread, freedom), 1.0), known & is_named(spread, freedom)
        # the level wanders, and the variance of few blocks is itself uncertain
        found *= np.where(named, (scipy.special.stdtrit(np.maximum(freedom, 4.0), 0.975) / scipy.special.ndtri(0.975)) ** 2, 1.0)
        for row, j in enumerate(there):
            if found[row] > factor[j]:
                part = int(np.argmax(influence[row]))
                factor[j], loudest[j] = found[row], (part / blocks, (part + 1) / blocks) if named[row] else None
    return Widening(factor, loudest)


def doubted(bins: Bins, theta: AnyArray, doubts: AnyArray) -> AnyArray:
    """Variances of the coefficients, over those of the likelihood, for densities with independent standard deviations, (doubts, bins)."""
    model, back = density(bins.columns, theta), inverse(information(bins, theta))
    moved = (doubts * 0.5 * bins.weight / model**2) @ bins.columns @ back
    return np.sum(moved**2, axis=0) / np.maximum(np.diagonal(back), np.finfo(float).tiny)


def _of_octaves(bins: Bins, theta: AnyArray) -> AnyArray:
    used = bins.weight > 0
    model, columns, weight = density(bins.columns, theta)[used], bins.columns[used], bins.weight[used]
    frequency = bins.frequency[used]
    octave = np.floor(np.log2(frequency / frequency.min()) + 1e-9).astype(int)
    member = (octave[None, :] == np.arange(octave.max() + 1)[:, None]).astype(float)
    rows = columns / model[:, None]
    score = member @ (rows * (0.5 * weight * (bins.density[used] / model - 1.0))[:, None])
    products = (rows * (0.5 * weight)[:, None])[:, :, None] * rows[:, None, :]
    each = (member @ products.reshape(len(rows), -1)).reshape(len(member), *products.shape[1:])
    back = inverse(each.sum(axis=0))
    squares, variances = (score @ back) ** 2, np.diagonal(back @ each @ back, axis1=1, axis2=2)
    near = np.abs(np.subtract.outer(*(np.arange(len(squares)),) * 2)) <= 1
    whole = np.maximum(near @ variances, np.finfo(float).tiny)
    share = near @ (variances / whole)  # weight of the square of each octave in the mean of smoothed ratios
    total = np.maximum(variances.sum(axis=0), np.finfo(float).tiny)
    expected = share * variances / total
    freedom = expected.sum(axis=0) ** 2 / np.maximum(np.sum(expected**2, axis=0), np.finfo(float).tiny)
    return beyond_chance(np.sum(share * squares, axis=0) / total, np.maximum(freedom, 1.0))


def _energies(spectrum: AnyArray, evidence: AnyArray, model: AnyArray, count: AnyArray) -> tuple[AnyArray, float]:
    """Energy of the score of a coefficient in each of ten blocks, and the number of chi-squares that it is worth."""
    # ordinates that hold nearly all information, in a number with a fast transform
    total, needed = np.cumsum(count * evidence**2), len(spectrum)
    wanted = max(int(np.sum(count[: np.searchsorted(total, _ENOUGH * total[-1]) + 1])), _FEWEST)
    needed = needed if wanted > needed // 4 else min(scipy.fft.next_fast_len(wanted, real=True), needed)
    bins = int(np.searchsorted(np.cumsum(count), needed)) + 1
    held = np.diff(np.minimum(np.cumsum(count[:bins]), needed), prepend=0)  # ordinates of each bin
    size, root = float(evidence[:bins].max()), np.sqrt(evidence[:bins] / model[:bins])
    level = float(root.max())
    # u^2 has twice the bandwidth of u
    ordinates = np.zeros(needed + 1 if needed == len(spectrum) else 2 * needed, dtype=np.float32)
    np.multiply(np.repeat((root / level).astype(np.float32), held), spectrum[:needed], out=ordinates[1 : needed + 1])
    u = np.asarray(scipy.fft.idct(ordinates, norm="ortho", overwrite_x=True))
    blocks = np.split(u, np.rint(np.arange(1, BLOCKS[0]) * len(u) / BLOCKS[0]).astype(int))
    share = evidence[:bins] / size
    return level**2 * np.array([np.vdot(one, one) for one in blocks], dtype=float), float((held @ share) ** 2 / (held @ share**2))
