"""`chances`: how often a usual device would be as far from the middle of the population as each device is."""

import numpy as np
import scipy  # loads its parts when they are first used

from ..fitting._hierarchy import FREEDOM

_NODES = 15  # of the quadrature over a device's own error
_AT_ONCE = 200  # devices
_MOST, _FEWEST = 400_000, 100  # devices times draws of the population that are looked at, and draws at least


def core() -> float:
    """Standard deviation of a normal population over the scale of the t law that fits it best: E[(nu+1) z^2 / (nu s^2 + z^2)] = 1."""

    def excess(scale):
        mean = scipy.integrate.quad(lambda z: (FREEDOM + 1) * z**2 / (FREEDOM * scale**2 + z**2) * scipy.stats.norm.pdf(z), -9, 9)[0]
        return mean - 1.0

    scale: float = scipy.optimize.brentq(excess, 0.3, 1.5)  # pyright: ignore[reportAssignmentType]
    return 1.0 / scale


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


def chances(away: np.ndarray, error: np.ndarray, shift: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Two-sided probability of each distance, (g, p), under a normal population that the other devices describe.

    Parameters
    ----------
    away, error : (g, p) distance from the middle and its variance. A device without errors has a variance of zero.
    shift, scale : (draws, p) of the middle, less the one that `away` is from, and of the t law between devices, from the posterior of
        all devices. Each draw is weighted with the inverse of the density that it gives the device, which takes the device out of the
        posterior: otherwise an odd unit widens the law that it is held against.
    """
    count = max(_FEWEST, min(len(shift), _MOST // len(away)))
    shift, scale = (draws[:: max(len(draws) // count, 1)] for draws in (shift, scale))
    node, weight = np.polynomial.hermite_e.hermegauss(_NODES)
    weight, factor = weight / weight.sum(), core()
    found = np.empty_like(away)
    for first in range(0, len(away), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        z, deviation = away[part] - shift[:, None], np.sqrt(error[part])
        apart = (z[..., None] + deviation[..., None] * node) / scale[:, None, :, None]
        density = ((1.0 + apart**2 / FREEDOM) ** (-(FREEDOM + 1.0) / 2.0) @ weight) / scale[:, None]
        share = 1.0 / np.maximum(density, 1e-300)
        usual = np.sqrt((factor * scale[:, None]) ** 2 + error[part])
        found[part] = np.sum(share / share.sum(axis=0) * 2.0 * scipy.stats.norm.sf(np.abs(z) / usual), axis=0)
    return found
