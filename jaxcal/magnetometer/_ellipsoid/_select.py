"""Choice of the model by the Bayesian information criterion."""

from typing import Any

import numpy as np

from ...fitting._information import symmetric_inverse
from .._design._coverage import bins
from .._iron import EXACT
from ._algebraic import NotEllipsoid, away
from ._kinds import COUNT, basis_of, soft_and_centre
from ._orthogonal import flat
from ._shape import Found, directions_of, shape_of_soft


def candidates(u: np.ndarray, distinct: int) -> tuple[dict[str, Found], int]:
    """Fits, without the curvature term, of all kinds that have enough readings and are not clearly excluded, the largest first.

    Also the number of bins, of 500, that contain a reading.
    """
    fits, failure, full = {}, None, None
    for kind in reversed(COUNT):
        if distinct <= COUNT[kind]:
            continue
        begin = None if full is None else _nearest(full, kind)
        if full is not None and begin is not None:
            margin = (COUNT[full.kind] - COUNT[kind]) * np.log(count)
            near, centre = soft_and_centre(begin, basis_of(kind))
            if score(away((shape_of_soft(near), centre), u), kind, count) > score(full.distance, full.kind, count) + margin:
                continue
        try:
            fits[kind] = flat(u, kind, begin)
        except NotEllipsoid as error:
            failure = error
            continue
        if len(fits) == 1:
            count = int(np.count_nonzero(np.bincount(bins(directions_of(fits[kind], u)))))
            full = fits[kind] if fits[kind].converged and np.isfinite(fits[kind].covariance).all() else None
    if not fits:
        raise failure or NotEllipsoid("quadric with more parameters than readings")
    return fits, count


def _nearest(full: Found, kind: str) -> np.ndarray | None:
    """Parameters of a smaller kind nearest to a fit in its covariance: almost the smaller fit where both models hold."""
    free, most = COUNT[kind], COUNT[full.kind]
    whiten = symmetric_inverse(full.covariance[:most, :most])
    basis = (np.linalg.pinv(basis_of(full.kind)) @ basis_of(kind))[:most, :free]
    begin = np.zeros(9)
    begin[:free] = symmetric_inverse(basis.T @ whiten @ basis) @ (basis.T @ whiten @ full.parameters[:most])
    return begin if (begin[: free - 3] > 0).all() else None


def score(distance: Any, kind: str, count: int) -> float:
    """The criterion n ln(mean d^2) + k ln n. n is the number of occupied bins of 500, because neighbours repeat one another."""
    return float(count * np.log(max(np.mean(distance**2), EXACT**2)) + COUNT[kind] * np.log(count))
