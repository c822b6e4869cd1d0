"""How much each kind of motion in a recording contributed to the parameters."""

import numpy as np

from ._normal import logarithm
from ._solve import Rests, Solution

#: smallest share of the windows for a kind to be reported
_LEAST = 0.01


def kinds_of(found: Solution, rests: Rests) -> dict[str, np.ndarray]:
    """Kind of motion -> (K,) its windows: rests, and the slower and the faster half of the windows in motion."""
    turned = np.linalg.norm(logarithm(np.swapaxes(found.way.rotation[:-1], 1, 2) @ found.way.rotation[1:]), axis=1)
    moving = ~rests.windows
    middle = np.median(turned[moving]) if moving.any() else 0.0
    kinds = {"rests": rests.windows, "slow turns": moving & (turned <= middle), "fast turns": moving & (turned > middle)}
    return {name: which for name, which in kinds.items() if which.mean() > _LEAST}


def terms_of(normal: np.ndarray, kinds: dict[str, np.ndarray], prior: np.ndarray) -> dict[str, np.ndarray]:
    """Part of each kind of motion in the covariance.

    The total information is the sum of the information I_c of each kind and of the prior. With its inverse S, the covariance is the sum
    of all S I_c S.

    Parameters
    ----------
    normal : (K, p, p) information of every window, with the trajectory eliminated.
    kinds : kind -> (K,) its windows; the kinds do not overlap.
    prior : (p, p) information of the prior.

    Returns
    -------
    Kind -> (p, p) its term of this sum.
    """
    inverse = np.linalg.inv(normal.sum(axis=0) + prior)
    return {name: inverse @ normal[which].sum(axis=0) @ inverse for name, which in kinds.items()}


def shares(terms: dict[str, np.ndarray], slope: np.ndarray) -> dict[str, np.ndarray]:
    """Kind -> (q,) its share in the information on each parameter; the shares add up to one.

    `slope` (q, p) is the derivative of the reported parameters by the fitted ones.
    """
    parts = {name: np.einsum("qa,ab,qb->q", slope, term, slope) for name, term in terms.items()}
    whole = sum(parts.values())
    return {name: part / whole for name, part in parts.items()}
