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

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._types import AnyArray
from ..evidence._uneven import BLOCKS, beyond_chance, is_named
from ..spectrum._average import log_groups
from ._likelihood import information, inverse
from ._solve import Solved

#: share of the information on a coefficient that the ordinates used must hold; ordinates that are used at least; independent energies that
#: a block must hold; with fewer, its energy follows no known law
_ENOUGH, _FEWEST, _INDEPENDENT = 0.95, 64, 1.0


class Widening(NamedTuple):
    """Factors (channels, p) on the variances of the coefficients; of each the part of the record (first, last; 0 to 1) with the most
    evidence, (channels, p, 2), NaN where none stands out.
    """

    factor: AnyArray
    loudest: AnyArray


def widening(solved: Solved, dt: float, spectra: Iterable[AnyArray]) -> Widening:
    """Factors for fits, from the `spectra` of the records, (n - 1,) each, the orthonormal DCT-II."""
    bins, theta, weight, model = solved.bins, solved.theta, solved.weight, solved.level
    factor, there = _of_octaves(solved, model), theta != 0.0
    loudest, scale = np.full((*theta.shape, 2), np.nan), np.sign(bins.columns[-1]) * (dt / bins.unit)[:, None]
    evidence = np.where(weight[:, None] > 0, np.abs(bins.columns.T) / model[:, None], 0.0) * there[..., None]
    energies, worth = np.zeros((*theta.shape, BLOCKS[0])), np.zeros(theta.shape)
    for i, spectrum in enumerate(spectra):
        energies[i], worth[i] = _energies(spectrum, evidence[i], model[i])
    energies *= scale[..., None]
    back = inverse(information(bins.columns, weight, theta, there))
    own = np.maximum(np.diagonal(back, axis1=1, axis2=2), np.finfo(float).tiny)
    for blocks in BLOCKS:
        influence = back @ energies.reshape(*theta.shape, blocks, -1).sum(axis=-1) / 2.0
        influence -= influence.mean(axis=-1, keepdims=True)
        spread = np.vecdot(influence, influence) * blocks / (blocks - 1.0) / own
        # energies of few chi-squares have long tails, which make their scatter less certain
        known = there & (worth >= _INDEPENDENT * blocks)
        freedom = (blocks - 1.0) / (1.0 + 6.0 * blocks / np.where(known, worth, 1.0))
        found, named = np.where(known, beyond_chance(spread, freedom), 1.0), known & is_named(spread, freedom)
        # the level wanders, and the variance of few blocks is itself uncertain
        found *= np.where(named, (scipy.special.stdtrit(np.maximum(freedom, 4.0), 0.975) / scipy.special.ndtri(0.975)) ** 2, 1.0)
        more = found > factor
        part = np.argmax(influence, axis=-1)[more]
        factor[more] = found[more]
        loudest[more] = np.where(named[more, None], np.stack([part, part + 1], axis=-1) / blocks, np.nan)
    return Widening(factor, loudest)


def doubted(solved: Solved, doubts: AnyArray) -> AnyArray:
    """Variances of the coefficients of a fit, over those of the likelihood, for densities with independent standard deviations, (doubts,
    bins).
    """
    columns, weight = solved.bins.columns, solved.weight
    back = inverse(information(columns, weight, solved.theta, solved.among))[0]
    moved = (doubts * 0.5 * weight / solved.level**2) @ (columns * solved.among) @ back
    return np.sum(moved**2, axis=0) / np.maximum(np.diagonal(back), np.finfo(float).tiny)


def _of_octaves(solved: Solved, model: AnyArray) -> AnyArray:
    bins, used, p = solved.bins, solved.weight > 0, solved.theta.shape[1]
    lowest = np.min(np.where(used, bins.frequency, np.inf), axis=1, keepdims=True)
    octave = np.maximum(np.floor(np.log2(bins.frequency / lowest) + 1e-9).astype(int), 0)
    member = ((octave[:, None, :] == np.arange(octave.max() + 1)[:, None]) & used[:, None, :]).astype(float)
    rows = bins.columns * solved.among[:, None, :] / model[..., None]
    half = 0.5 * solved.weight
    score = member @ (rows * (half * (bins.density / model - 1.0))[..., None])
    products = (rows * half[..., None])[..., :, None] * rows[..., None, :]
    each = (member @ products.reshape(*rows.shape[:2], -1)).reshape(*score.shape, p)
    back = inverse(each.sum(axis=1))[:, None]
    squares, variances = (score[..., None, :] @ back)[..., 0, :] ** 2, np.diagonal(back @ each @ back, axis1=-2, axis2=-1)
    near = (np.abs(np.subtract.outer(*(np.arange(squares.shape[1]),) * 2)) <= 1).astype(float)
    whole = np.maximum(near @ variances, np.finfo(float).tiny)
    share = near @ (variances / whole)  # weight of the square of each octave in the mean of smoothed ratios
    total = np.maximum(variances.sum(axis=1, keepdims=True), np.finfo(float).tiny)
    expected = share * variances / total
    freedom = expected.sum(axis=1) ** 2 / np.maximum(np.sum(expected**2, axis=1), np.finfo(float).tiny)
    return beyond_chance(np.sum(share * squares, axis=1) / total[:, 0], np.maximum(freedom, 1.0))


def _energies(spectrum: AnyArray, evidence: AnyArray, model: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Energies of the scores of coefficients in each of ten blocks, (p, blocks), and the numbers of chi-squares that they are worth, (p,).

    `evidence` are the columns over the `model` in the bins of a record, (p, bins), zero of coefficients that are not looked at.
    """
    count, n = log_groups(len(spectrum), keep_tail=True)[1], len(spectrum)
    # single precision is enough for energies, and takes half the time; of a step alone nothing is left as noise, which exceeds its range
    largest = max(float(np.max(spectrum)), -float(np.min(spectrum))) or 1.0
    single = np.divide(spectrum, largest, dtype=np.float32, casting="same_kind")
    energies, worth = np.zeros((len(evidence), BLOCKS[0])), np.zeros(len(evidence))
    for row in np.flatnonzero(evidence.any(axis=1)):
        own = evidence[row]
        # ordinates that hold nearly all information, in a number with a fast transform
        total = np.cumsum(count * own**2)
        wanted = max(int(np.sum(count[: np.searchsorted(total, _ENOUGH * total[-1]) + 1])), _FEWEST)
        needed = n if wanted > n // 4 else min(int(scipy.fft.next_fast_len(wanted, real=True)), n)
        held, root = np.diff(np.minimum(np.cumsum(count), needed), prepend=0), np.sqrt(own / model)  # ordinates of each bin
        level, share = float(root.max()), own / own.max()
        # u^2 has twice the bandwidth of u
        ordinates = np.zeros(n + 1 if needed == n else 2 * needed, dtype=np.float32)
        np.multiply(np.repeat((root / level).astype(np.float32), held), single[:needed], out=ordinates[1 : needed + 1])
        u = np.asarray(scipy.fft.idct(ordinates, norm="ortho", overwrite_x=True))
        blocks = np.split(u, np.rint(np.arange(1, BLOCKS[0]) * len(u) / BLOCKS[0]).astype(int))
        energies[row] = (level * largest) ** 2 * np.array([np.vdot(one, one) for one in blocks], dtype=float)
        worth[row] = float((held @ share) ** 2 / (held @ share**2))
    return energies, worth
