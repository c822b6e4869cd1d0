"""What each kind of motion in a recording contributed to its parameters."""

import numpy as np

from ._normal import logarithm
from ._solve import Rests, Solution

#: share of the windows that a kind must have to be named
_LEAST = 0.01


def kinds_of(found: Solution, rests: Rests) -> dict[str, np.ndarray]:
    """Kind -> (K,) windows of it: rests, and the slower and the faster half of the windows in motion."""
    turned = np.linalg.norm(logarithm(np.swapaxes(found.way.rotation[:-1], 1, 2) @ found.way.rotation[1:]), axis=1)
    moving = ~rests.windows
    middle = np.median(turned[moving]) if moving.any() else 0.0
    kinds = {"rests": rests.windows, "slow turns": moving & (turned <= middle), "fast turns": moving & (turned > middle)}
    return {name: which for name, which in kinds.items() if which.mean() > _LEAST}


def terms_of(normal: np.ndarray, kinds: dict[str, np.ndarray], prior: np.ndarray) -> dict[str, np.ndarray]:
    """Part of every kind in the covariance.

    The information is the sum of that of all windows and of a prior. With I_c that of the kind c and S the inverse of the whole, S is the
    sum of all S I_c S.

    Parameters
    ----------
    normal : (K, p, p) information of every window, with the way eliminated.
    kinds : kind -> (K,) windows of it, which do not overlap.
    prior : (p, p) information before the recording.

    Returns
    -------
    Kind -> (p, p) its term of the sum.
    """
    inverse = np.linalg.inv(normal.sum(axis=0) + prior)
    return {name: inverse @ normal[which].sum(axis=0) @ inverse for name, which in kinds.items()}


def shares(terms: dict[str, np.ndarray], slope: np.ndarray) -> dict[str, np.ndarray]:
    """Kind -> (q,) its share in what is known of each parameter; they add up to one.

    `slope` (q, p) is the derivative of the parameters that are reported by those of the terms.
    """
    parts = {name: np.einsum("qa,ab,qb->q", slope, term, slope) for name, term in terms.items()}
    whole = sum(parts.values())
    return {name: part / whole for name, part in parts.items()}
