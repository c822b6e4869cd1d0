"""`chances`: how often a usual device would be as far from the middle of the population as each device is."""

import numpy as np
import scipy  # loads its parts when they are first used

from ..fitting._hierarchy import Hierarchy, log_density

_NODES = 15  # of the quadrature over a device's own error
_AT_ONCE = 200  # devices
_MOST, _FEWEST = 400_000, 100  # devices times draws of the population that are looked at, and draws at least


def combined(
    away: np.ndarray, variance: np.ndarray, member: np.ndarray, groups: int, parts: list[tuple[np.ndarray, np.ndarray]]
) -> tuple[np.ndarray, np.ndarray]:
    """Distance of each device from its middle and the variance of that, (g, p), from those of its recordings, (n, p).

    `parts` are the group of each recording and the variance between groups of every level within the device.
    """
    inverse = 1.0 / variance
    total, mean = np.zeros((groups, away.shape[1])), np.zeros((groups, away.shape[1]))
    np.add.at(total, member, inverse)
    np.add.at(mean, member, inverse * away)
    error = 1.0 / total
    for group, between in parts:
        share = np.zeros((group.max() + 1, away.shape[1]))
        np.add.at(share, group, inverse / total[member])
        owner = np.zeros(len(share), dtype=int)
        owner[group] = member
        extra = np.zeros_like(total)
        np.add.at(extra, owner, share**2 * between)
        error = error + extra
    return mean / total, error


def chances(away: np.ndarray, error: np.ndarray, usual: np.ndarray, drawn: Hierarchy) -> np.ndarray:
    """Two-sided probability of each distance, (g, p), under a normal population that the other devices describe.

    Parameters
    ----------
    away, error : (g, p) distance from the middle and its variance.
    usual : (p,) mean of the population that the distances are from.
    drawn : posterior of all devices. Each draw is weighted with the inverse of the density that it gives the device, which takes the
        device out of the posterior: otherwise an odd unit widens the law that it is held against.
    """
    draws = (np.asarray(drawn.coefficients)[:, 0] - usual, drawn.deviations[:, 0], drawn.scale, drawn.freedom)
    every = max(len(draws[0]) // max(_FEWEST, _MOST // len(away)), 1)
    shift, deviation, scale, freedom = (np.asarray(values)[::every, None] for values in draws)
    node, weight = np.polynomial.hermite_e.hermegauss(_NODES)
    found = np.empty_like(away)
    for first in range(0, len(away), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        z = away[part] - shift
        apart = z[..., None] + np.sqrt(error[part])[..., None] * node
        log = np.asarray(log_density(apart, scale[..., None], freedom[..., None]))
        share = 1.0 / np.maximum(np.exp(log) @ weight, 1e-300)
        far = 2.0 * scipy.stats.norm.sf(np.abs(z) / np.sqrt(deviation**2 + error[part]))
        found[part] = np.sum(share * far, axis=0) / np.sum(share, axis=0)
    return found
