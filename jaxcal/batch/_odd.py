"""`chances`: the probability that a usual device is as far from the middle of the population as each device is."""

import itertools

import numpy as np
import scipy  # loads its parts when they are first used

from ..fitting._hierarchy import Hierarchy, log_density

_NODES = 15  # nodes of the quadrature over a device's own error
#: number of devices that are processed together, largest number of devices times draws of the population, and smallest number of draws
_AT_ONCE, _MOST, _FEWEST = 200, 400_000, 100


def chances(
    away: np.ndarray, variance: np.ndarray, member: np.ndarray, parts: list[np.ndarray], usual: np.ndarray, drawn: Hierarchy
) -> np.ndarray:
    """Two-sided probability of the distance of each device from the middle, (g, p), for the normal population of the other devices.

    Each draw of the population is weighted with the inverse of its density for the device, which removes the device from the posterior.
    Otherwise an odd unit would widen the distribution with which it is compared.

    Parameters
    ----------
    away, variance : (n, p) distance of each recording from its middle, and the variance of its own error.
    member : (n,) device of each recording. parts : groups of the recordings for each level within devices.
    usual : (p,) mean of the population from which the distances are measured.
    drawn : posterior of all devices.
    """
    groups = int(member.max()) + 1
    draws = (np.asarray(drawn.coefficients)[:, 0] - usual, drawn.deviations, drawn.scale, drawn.freedom)
    every = max(len(draws[0]) // max(_FEWEST, _MOST // groups), 1)
    shift, deviations, scale, freedom = (np.asarray(values)[::every] for values in draws)
    order = np.argsort(member, kind="stable")
    edges = np.searchsorted(member[order], np.arange(0, groups + _AT_ONCE, _AT_ONCE))
    found = np.empty((groups, away.shape[1]))
    for first, last in itertools.pairwise(edges):
        here = order[first:last]
        if len(here):
            start = int(member[here[0]])
            own = member[here] - start
            z, error = _combined(away[here], variance[here], own, [part[here] for part in parts], deviations)
            found[start : start + z.shape[1]] = _tails(z - shift[:, None], error, deviations[:, :1], scale[:, None], freedom[:, None])
    return found


def _combined(away: np.ndarray, variance: np.ndarray, own: np.ndarray, parts: list[np.ndarray], deviations: np.ndarray):
    """Distance of each device and its variance, (draws, g, p); recordings are weighted by their errors in each draw."""
    groups = int(own.max()) + 1
    if deviations.shape[1] == 1:  # each recording is a device
        return np.broadcast_to(away, (len(deviations), *away.shape)), np.broadcast_to(variance, (len(deviations), *variance.shape))
    inverse = 1.0 / (variance + deviations[:, -1:] ** 2)

    def summed(values: np.ndarray, group: np.ndarray, number: int) -> np.ndarray:
        total = np.zeros((number, *values.shape[::2]))
        np.add.at(total, group, np.moveaxis(values, 1, 0))
        return np.moveaxis(total, 0, 1)

    total = summed(inverse, own, groups)
    error = 1.0 / total
    for k, part in enumerate(parts, 1):
        _, group = np.unique(part, return_inverse=True)
        owner = np.zeros(group.max() + 1, dtype=int)
        owner[group] = own
        share = summed(inverse / total[:, own], group, len(owner))
        error = error + summed(share**2 * deviations[:, k, None] ** 2, owner, groups)
    return summed(inverse * away, own, groups) / total, error


def _tails(z: np.ndarray, error: np.ndarray, deviation: np.ndarray, scale: np.ndarray, freedom: np.ndarray) -> np.ndarray:
    """Mean over the draws of the probability of |z| or more, each draw weighted with the inverse of its density at z."""
    node, weight = np.polynomial.hermite_e.hermegauss(_NODES)
    apart = z[..., None] + np.sqrt(error)[..., None] * node
    share = 1.0 / np.maximum(np.exp(np.asarray(log_density(apart, scale[..., None], freedom[..., None]))) @ weight, 1e-300)
    # limit the weights, so that a few draws cannot decide alone
    share = np.minimum(share, np.mean(share, axis=0) * len(share) ** 0.5)
    far = 2.0 * scipy.stats.norm.sf(np.abs(z) / np.sqrt(deviation**2 + error))
    return np.sum(share * far, axis=0) / np.sum(share, axis=0)
