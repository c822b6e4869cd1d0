"""Errors that are correlated along a log: whether residuals are white, and a covariance from leaving out parts of the log.

A log shows its own correlation only in parts that each see most of what the fit needs, so few and long parts are left out, one at a
time. The parts overlap: windows of a sixth of the log, moved on by a quarter of their length. Each refit is a step of Gauss and Newton
from the solution, which is exact for what is linear about it, and costs no compilation.
"""

import itertools
from typing import NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

#: parts of a log; on real logs six were honest, where ten or twenty were too narrow
BLOCKS = 6
_STEPS = 4  # windows that begin in each part
_LAGS, _FEWEST = 20, 24
_FAR = 3.5  # standard deviations
_CHANCE = 0.003  # of each of the two tests of whiteness
_TURNING = 12  # lags at which products of residuals are looked at
_CLOSE = range(3, 7)
_ALONE = 4.0  # variance along one direction, over those across it


def tamed(jacobian: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    """Residuals with outliers at 3.5 robust standard deviations, at right angles to the Jacobian: single outliers prove nothing."""
    most = _FAR * 1.4826 * np.median(np.abs(residuals))
    span = np.linalg.qr(jacobian / np.linalg.norm(jacobian, axis=0))[0]
    residuals = np.clip(residuals, -most, most)
    return residuals - span @ (span.T @ residuals)


def white(jacobian: np.ndarray, residuals: np.ndarray) -> bool:
    """Whether residuals in the order of a log look independent: by their autocorrelation, and by fits of parts of the log.

    The first is the test of G. M. Ljung and G. E. P. Box, Biometrika 65 (1978) 297; the second, of G. C. Chow, Econometrica 28 (1960)
    591, asks whether parts of the log want parameters of their own.
    """
    n, free = jacobian.shape
    if n < _FEWEST:
        return True  # too few to tell
    residuals = tamed(jacobian, residuals)
    lags = np.arange(1, min(_LAGS, n // 8) + 1)
    power = np.abs(np.fft.rfft(residuals, 2 * n)) ** 2
    correlation = np.fft.irfft(power)[: len(lags) + 1]
    statistic = n * (n + 2) * np.sum((correlation[lags] / correlation[0]) ** 2 / (n - lags))
    if scipy.special.chdtrc(len(lags), statistic) < _CHANCE:
        return False
    parts = min(BLOCKS, n // (2 * free))
    if parts < 2:
        return True
    left, used = 0.0, 0
    for rows in np.array_split(np.arange(n), parts):
        vectors, values, _ = np.linalg.svd(jacobian[rows], full_matrices=False)
        seen = values > 1e-6 * values[0]
        left += np.sum(residuals[rows] ** 2) - np.sum((vectors[:, seen].T @ residuals[rows]) ** 2)
        used += int(seen.sum())
    if used <= free or used >= n:
        return True
    ratio = (np.sum(residuals**2) - left) / (used - free) / (left / (n - used))
    return bool(scipy.special.fdtrc(used - free, n - used, ratio) >= _CHANCE)


def leave_out(jacobian: np.ndarray, residuals: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Jackknife covariance (p, p) of overlapping windows; infinite where the rest of a log does not determine the parameters.

    known : (p, p) information that is not of the readings, and in every refit.
    """
    n, free = jacobian.shape
    size = np.linalg.norm(jacobian, axis=0)
    if n < 2 * free or not (size > 0).all():
        return np.full((free, free), np.inf)
    rows = jacobian / size
    edges = np.round(np.arange(BLOCKS * _STEPS + 1) * n / (BLOCKS * _STEPS)).astype(int)
    pieces = list(itertools.pairwise(edges))
    hats = np.array([rows[a:b].T @ rows[a:b] for a, b in pieces])
    scores = np.array([rows[a:b].T @ residuals[a:b] for a, b in pieces])
    whole, score = hats.sum(axis=0) + known / np.outer(size, size), scores.sum(axis=0)
    steps = []
    for first in range(len(pieces) - _STEPS + 1):
        window = slice(first, first + _STEPS)
        rest = whole - hats[window].sum(axis=0)
        if np.linalg.eigvalsh(rest)[0] < 1e-10 * free:
            return np.full((free, free), np.inf)
        steps.append(np.linalg.solve(rest, score - scores[window].sum(axis=0)))
    off = (np.array(steps) - np.mean(steps, axis=0)) / size
    return (BLOCKS - 1) / len(off) * off.T @ off


def correlation_time(residuals: np.ndarray) -> float:
    """Readings that are as good as one: the sum of the autocorrelation up to where it is lost in its own noise."""
    n = len(residuals)
    values = np.fft.irfft(np.abs(np.fft.rfft(residuals, 2 * n)) ** 2)[: max(n // 4, 2)]
    values = values / values[0]
    lost = values < 2 / np.sqrt(n)
    return float(max(1 + 2 * np.sum(values[1 : np.argmax(lost) if lost.any() else len(values)]), 1.0))


class Shared(NamedTuple):
    """What neighbouring residuals have in common.

    of_norm : whether they agree whatever their directions, as a field that varies makes them, rather than as an offset would.
    alone : (3,) standard deviation of an offset along the one direction in which it varies, as that of a current; None where there is none.
    swing : standard deviation of an offset along any direction that has what neighbours share.
    """

    of_norm: bool
    alone: np.ndarray | None
    swing: float


def shared(residuals: np.ndarray, normals: np.ndarray) -> Shared:
    """From products of residuals some lags apart: a variance of the norm, plus n'Sn of their normals with the covariance S of an offset."""
    n = len(residuals)
    lags = np.unique(np.round(np.geomspace(1, max(n // _TURNING, 2), _TURNING)).astype(int))
    first, second = (np.concatenate([part(k) for k in lags]) for part in (lambda k: normals[k:], lambda k: normals[:-k]))
    products = np.concatenate([residuals[k:] * residuals[:-k] for k in lags])
    norm, offset = np.linalg.lstsq(np.stack([np.ones(len(first)), np.sum(first * second, axis=1)], axis=1), products, rcond=None)[0]
    # of close neighbours, which share most of it, but not of the closest, which share what the log repeats
    near = np.concatenate([residuals[k:] * residuals[:-k] for k in _CLOSE])
    turned = np.concatenate([np.sum(normals[k:] * normals[:-k], axis=1) for k in _CLOSE])
    swing = float(np.sqrt(max(np.sum(turned * near) / max(np.sum(turned**2), 1e-300), 0.0)))
    if norm > offset:
        return Shared(True, None, swing)
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    columns = [first[:, i] * second[:, j] + (i != j) * first[:, j] * second[:, i] for i, j in pairs]
    entries = np.linalg.lstsq(np.stack([np.ones(len(first)), *columns], axis=1), products, rcond=None)[0][1:]
    matrix = np.zeros((3, 3))
    for (i, j), value in zip(pairs, entries, strict=True):
        matrix[i, j] = matrix[j, i] = value
    values, vectors = np.linalg.eigh(matrix)
    if not values[2] > _ALONE * np.abs(values[:2]).max():
        return Shared(False, None, swing)
    along = normals @ vectors[:, 2]
    cosines = np.concatenate([along[k:] * along[:-k] for k in _CLOSE])
    variance = np.sum(cosines * near) / max(np.sum(cosines**2), 1e-300)
    return Shared(False, vectors[:, 2] * np.sqrt(max(variance, 0.0)), swing)


def doubt(freedom: float | int) -> float:
    """Factor by which five per cent of standard deviations from so many degrees of freedom are too small, or more."""
    return float(np.sqrt(freedom / (2 * scipy.special.gammaincinv(freedom / 2, 0.05))))
