"""Which model: sphere, diagonal or symmetric, by the Bayesian information criterion or by held-out error."""

import numpy as np

from ...fitting import AbstractLoss
from .._design._coverage import bins
from ._algebraic import NotEllipsoid
from ._orthogonal import Found, described, flat
from ._residuals import shape_and_centre
from ._shape import root
from ._start import COUNT, away, basis_of

_TIE = 2.0
_HOPELESS = 4.0  # times what would decide
_SECTORS = 10


def _units(found: Found, u: np.ndarray) -> np.ndarray:
    y = (u - found.centre) @ root(found.shape)
    return y / np.maximum(np.linalg.norm(y, axis=1, keepdims=True), 1e-300)


def candidates(u: np.ndarray, kinds: tuple[str, ...], loss: AbstractLoss | None, distinct: int) -> dict[str, Found]:
    """Fits of every kind for which there are enough readings, the largest first, without the curvature term.

    Left out are those that are no ellipsoid, and those that the largest excludes by far.
    """
    fits, failure, count = {}, None, 0
    for kind in sorted(kinds, key=lambda kind: -COUNT[kind]):
        if distinct <= COUNT[kind]:
            continue
        try:
            begin = _nearest(fits["symmetric"], kind) if loss is None and "symmetric" in fits else None
            if begin is not None:
                count = count or _occupied(fits["symmetric"], u)
                if _hopeless(fits["symmetric"], begin, kind, u, count):
                    continue
            fits[kind] = flat(u, kind, loss, begin=begin)
        except NotEllipsoid as error:
            failure = error
    if not fits:
        raise failure or NotEllipsoid("the data do not determine an ellipsoid: there are too few readings for any model")
    return fits


def _nearest(full: Found, kind: str) -> np.ndarray | None:
    """Parameters of a smaller kind that are nearest to the symmetric fit by its own covariance: where both hold, nearly its fit."""
    if not (full.converged and np.isfinite(full.covariance).all() and (full.parameters[[0, 3, 5]] > 0).all()):
        return None
    free = COUNT[kind]
    whiten = np.linalg.pinv(full.covariance, hermitian=True)
    basis = np.delete(basis_of(kind), (3, 6, 7), axis=0)[:, :free]
    begin = np.zeros(9)
    begin[:free] = np.linalg.lstsq(basis.T @ whiten @ basis, basis.T @ whiten @ full.parameters, rcond=None)[0]
    return begin if (begin[: COUNT[kind] - 3] > 0).all() else None


def _score(count: int, squares: float, kind: str) -> float:
    return count * np.log(max(squares, 1e-28)) + COUNT[kind] * np.log(count)


def _occupied(found: Found, u: np.ndarray) -> int:
    return len(np.unique(bins(_units(found, u))))


def _hopeless(full: Found, begin: np.ndarray, kind: str, u: np.ndarray, count: int) -> bool:
    """Whether a smaller model, from nearly its best parameters, is worse by several times the margin that decides."""
    squares = float(np.mean(away(shape_and_centre(begin, basis_of(kind)), u) ** 2)), float(np.mean(full.distance**2))
    penalty = (COUNT[full.kind] - COUNT[kind]) * np.log(count)
    fit = _score(count, squares[0], kind) - _score(count, squares[1], full.kind) + penalty
    return bool(fit > _HOPELESS * (penalty + _TIE))


def by_bic(fits: dict[str, Found], u: np.ndarray) -> str:
    """Kind of least n ln(mean d^2) + k ln n; n is the number of occupied bins of 500, because neighbours repeat one another."""
    largest = fits[max(fits, key=lambda kind: COUNT[kind])]
    count, weight = _occupied(largest, u), largest.weight
    score = {kind: _score(count, np.sum(weight * found.distance**2) / np.sum(weight), kind) for kind, found in fits.items()}
    return _smallest(score, _TIE)


def by_held_out(fits: dict[str, Found], u: np.ndarray, loss: AbstractLoss | None) -> str:
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
                found = flat(kept, kind, loss) if len(kept) > COUNT[kind] else None
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
