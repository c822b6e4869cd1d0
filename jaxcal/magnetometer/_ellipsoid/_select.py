"""Choice of the model by the Bayesian information criterion; choice of the readings of a long log."""

import jax
import jax.numpy as jnp
import numpy as np

from ...fitting._information import symmetric_inverse
from .._design._coverage import bins
from ._algebraic import NotEllipsoid, away
from ._kinds import COUNT, PLACE, basis_of, shape_and_centre
from ._orthogonal import flat
from ._residuals import Readings, orthogonal
from ._shape import Found, directions_of

_TIE = 2.0  # a difference of criteria that decides nothing (Kass and Raftery, J. Am. Stat. Assoc. 90, 1995)
_LEAST, _HOPELESS = 1e-28, 4.0  # mean square distance of exact readings; multiple of the deciding margin at which a model is excluded
#: largest number of readings that are all fitted
LONG = 20_000
_CHUNK = 16_384  # readings of one call, so that no length compiles anew


def candidates(u: np.ndarray, kinds: tuple[str, ...], distinct: int) -> tuple[dict[str, Found], int]:
    """Fits, without the curvature term, of all kinds that have enough readings and are not clearly excluded, the largest first.

    Also the number of bins, of 500, that contain a reading.
    """
    fits, failure, count = {}, None, 0
    for kind in sorted(kinds, key=lambda kind: -COUNT[kind]):
        if distinct <= COUNT[kind]:
            continue
        begin = None
        if "symmetric" in fits and (begin := _nearest(fits["symmetric"], kind)) is not None:
            count = count or _occupied(fits["symmetric"], u)
            if _hopeless(fits["symmetric"], begin, kind, u, count):
                continue
        try:
            fits[kind] = flat(u, kind, begin)
        except NotEllipsoid as error:
            failure = error
    if not fits:
        raise failure or NotEllipsoid("quadric with more parameters than readings")
    return fits, count or _occupied(next(iter(fits.values())), u)


def _nearest(full: Found, kind: str) -> np.ndarray | None:
    """Parameters of a smaller kind nearest to the symmetric fit in its covariance: almost the smaller fit where both models hold."""
    if not (full.converged and np.isfinite(full.covariance).all() and (full.parameters[[0, 3, 5]] > 0).all()):
        return None
    free = COUNT[kind]
    whiten = symmetric_inverse(full.covariance)
    basis = basis_of(kind)[PLACE, :free]
    begin = np.zeros(9)
    begin[:free] = symmetric_inverse(basis.T @ whiten @ basis) @ (basis.T @ whiten @ full.parameters)
    return begin if (begin[: COUNT[kind] - 3] > 0).all() else None


def _occupied(found: Found, u: np.ndarray) -> int:
    """Number of bins, of 500, that contain a reading."""
    return int(np.count_nonzero(np.bincount(bins(directions_of(found, u)))))


def _hopeless(full: Found, begin: np.ndarray, kind: str, u: np.ndarray, count: int) -> bool:
    """Whether a smaller model, at nearly its best parameters, is worse by several times the margin that decides."""
    squares = np.array([np.mean(away(shape_and_centre(begin, basis_of(kind)), u) ** 2), np.mean(full.distance**2)])
    small, large = np.log(np.maximum(squares, _LEAST))
    return bool(count * (small - large) > _HOPELESS * ((COUNT[full.kind] - COUNT[kind]) * np.log(count) + _TIE))


def by_bic(fits: dict[str, Found], count: int) -> str:
    """Kind with the smallest n ln(mean d^2) + k ln n. n is the number of occupied bins of 500, because neighbours repeat one another."""
    score = {}
    for kind, found in fits.items():
        square = np.mean(found.distance**2)
        score[kind] = float(count * np.log(max(square, _LEAST)) + COUNT[kind] * np.log(count))
    least = min(score.values())
    return min((kind for kind in score if score[kind] <= least + _TIE), key=lambda kind: COUNT[kind])


_distance = jax.jit(orthogonal)


def all_distances(found: Found, u: np.ndarray) -> np.ndarray:
    """Distance of every reading to an ellipsoid fitted to some of them, in chunks of one size, so that no length needs compiling."""
    basis, parts = jnp.asarray(basis_of(found.kind)), []
    for begin in range(0, len(u), _CHUNK):
        part = u[begin : begin + _CHUNK]
        full = np.concatenate([part, np.repeat(part[:1], _CHUNK - len(part), axis=0)])
        data = Readings(jnp.asarray(full), jnp.ones(_CHUNK), jnp.asarray(found.noise2), basis)
        parts.append(np.asarray(_distance(jnp.asarray(found.parameters), data))[: len(part)])
    return np.concatenate(parts)
