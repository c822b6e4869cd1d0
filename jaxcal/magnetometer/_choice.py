"""Which model: sphere, diagonal or symmetric, by the Bayesian information criterion or by held-out error."""

import numpy as np

from ._coverage import bins
from ._orthogonal import Found, described, geometric
from ._quadric import NotEllipsoid
from ._start import COUNT
from ._uncertainty import root

_TIE = 2.0
_SECTORS = 10


def _units(found: Found, u: np.ndarray) -> np.ndarray:
    y = (u - found.centre) @ root(found.shape)
    return y / np.maximum(np.linalg.norm(y, axis=1, keepdims=True), 1e-300)


def candidates(u: np.ndarray, kinds: tuple[str, ...], loss: str | None, distinct: int) -> dict[str, Found]:
    """Fits of every kind for which there are enough readings; those that are no ellipsoid are left out."""
    fits, failure = {}, None
    for kind in kinds:
        if distinct > COUNT[kind]:
            try:
                fits[kind] = geometric(u, kind, loss)
            except NotEllipsoid as error:
                failure = error
    if not fits:
        raise failure or NotEllipsoid("the data do not determine an ellipsoid: there are too few readings for any model")
    return fits


def by_bic(fits: dict[str, Found], u: np.ndarray) -> str:
    """Kind of least n ln(mean d^2) + k ln n; n is the number of occupied bins of 500, because neighbours repeat one another."""
    largest = fits[max(fits, key=lambda kind: COUNT[kind])]
    count = len(np.unique(bins(_units(largest, u))))
    weight = largest.weight
    score = {
        kind: count * np.log(max(np.sum(weight * found.distance**2) / np.sum(weight), 1e-28)) + COUNT[kind] * np.log(count)
        for kind, found in fits.items()
    }
    return _smallest(score, _TIE)


def by_held_out(fits: dict[str, Found], u: np.ndarray, loss: str | None) -> str:
    """Kind of least error on sectors of longitude that the fit did not see."""
    largest = fits[max(fits, key=lambda kind: COUNT[kind])]
    units = _units(largest, u)
    normal = np.linalg.svd(units - units.mean(axis=0), full_matrices=False)[2]
    x, y, _ = (units @ normal.T).T
    sector = np.minimum((np.arctan2(y, x) + np.pi) * _SECTORS / (2 * np.pi), _SECTORS - 1).astype(int)
    score = {}
    for kind in fits:
        squares = []
        for out in np.unique(sector):
            kept = u[sector != out]
            try:
                found = geometric(kept, kind, loss) if len(kept) > COUNT[kind] else None
            except NotEllipsoid:
                found = None
            if found is None:
                squares.append(np.full(np.sum(sector == out), np.inf))
                continue
            squares.append(described(found.parameters, u[sector == out], kind).distance ** 2)
        errors = np.concatenate(squares)
        score[kind] = float(np.mean(errors if loss is None else np.minimum(errors, 16 * largest.noise**2)))
    return _smallest(score, 0.0)


def _smallest(score: dict[str, float], tie: float) -> str:
    least = min(score.values())
    return min((kind for kind in score if score[kind] <= least + tie), key=lambda kind: COUNT[kind])
