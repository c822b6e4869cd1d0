"""What each kind of motion in a recording contributed to its parameters."""

import dataclasses

import numpy as np

from ..fitting._chain import Chain
from ._normal import Rows, chain_of

#: rad and m/s and m: what a link that no window holds any more may be, so that its equations stay regular
_LOOSE = 10.0
#: share of the windows that a kind must have, and leave
_LEAST = 0.02


def kinds_of(rate: np.ndarray, resting: np.ndarray) -> dict[str, np.ndarray]:
    """Kind -> (K,) windows of it: rests, and the slower and the faster half of the turns.

    Parameters
    ----------
    rate : (K,) root mean square rate of each window, rad/s.
    resting : (K,) whether the device rests.
    """
    moving = ~resting
    middle = np.median(rate[moving]) if moving.any() else 0.0
    found = {"rests": resting, "slow turns": moving & (rate <= middle), "fast turns": moving & (rate > middle)}
    return {name: which for name, which in found.items() if _LEAST < which.mean() < 1 - _LEAST}


def contribution(rows: Rows, prior: Chain, free: np.ndarray, kinds: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """By how much standard errors grow where the windows of one kind are left out.

    Parameters
    ----------
    rows : whitened residuals of all windows with their derivatives.
    prior : what is known of the links beside the windows, as the place that a hand keeps.
    free : (p,) indices of the free parameters.
    kinds : kind -> (K,) windows of it.

    Returns
    -------
    Kind -> (p,) factors of 1 or more; infinite for a parameter that nothing else shows.
    """
    whole = _errors(rows, prior, free, np.ones(len(rows.inertial), dtype=bool))
    return {name: np.maximum(_errors(rows, prior, free, ~which) / whole, 1.0) for name, which in kinds.items()}


def _errors(rows: Rows, prior: Chain, free: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """(p,) standard errors from some of the windows."""
    # a trace is left of the others: `chain_of` looks at the first window for the parameters that the field shows
    weight = np.where(kept, 1.0, 1e-6)
    part = Rows(
        rows.inertial * weight[:, None], rows.field * weight[:, None, None], rows.inertial_by * weight[:, None, None],
        rows.field_by * weight[:, None, None, None],
    )  # fmt: skip
    chain = chain_of(part, free)
    loose = _LOOSE**-2.0 * np.eye(prior.links.shape[1])
    chain = dataclasses.replace(chain, links=chain.links + prior.links + loose, ties=chain.ties + prior.ties)
    information = chain.eliminated().information
    scale = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information * scale[:, None] * scale)
    lost = (np.abs(vectors[:, values < 1e-11]) > 1e-3).any(axis=1)
    inverse = np.sum(vectors**2 / np.maximum(values, 1e-11), axis=1)
    return np.where(lost, np.inf, scale * np.sqrt(inverse))
