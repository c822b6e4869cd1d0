"""Where the iterative fits start: the best algebraic fit that gives an ellipsoid, and one that outliers do not carry off."""

import functools

import numpy as np

from . import _algebraic as _quadric
from ._algebraic import NotEllipsoid
from ._consistent import consistent

_ENOUGH_FOR_ADJUSTED = 30
_SUBSETS = 200
_SUBSET = 12  # readings: three more than a symmetric fit needs, so that noise does not decide
_KEPT, _ROUNDS = 10, 4

#: parameters of each kind
COUNT = {"sphere": 4, "diagonal": 6, "symmetric": 9, "circle": 3, "ellipse": 5}
PLANAR = ("circle", "ellipse")
#: rows of (A_xx, A_xy, A_yy, A_xz, A_yz, A_zz, b) that a plane has
PLANAR_ROWS = [0, 1, 2, 6, 7]
_SMALLEST_PAD = 64

#: entries of (U_11, U_12, U_13, U_22, U_23, U_33, b) that each parameter moves. A planar fit has no third coordinate: U_33 is idle,
#: and follows U_11 so that A stays regular.
_MOVES = {
    "sphere": ((0, 3, 5), (6,), (7,), (8,)),
    "diagonal": ((0,), (3,), (5,), (6,), (7,), (8,)),
    "symmetric": tuple((i,) for i in range(9)),
    "circle": ((0, 3, 5), (6,), (7,)),
    "ellipse": ((0, 5), (1,), (3,), (6,), (7,)),
}


def padded_length(count: int) -> int:
    """Power of two to which arrays are filled up, so that logs of any length share a compiled program."""
    return max(_SMALLEST_PAD, 1 << max(count - 1, 0).bit_length())


@functools.cache
def basis_of(kind: str) -> np.ndarray:
    """(9, 9) from the parameters of a kind, filled up with zeros, to the upper triangle and the centre."""
    basis = np.zeros((9, 9))
    for column, rows in enumerate(_MOVES[kind]):
        basis[list(rows), column] = 1.0
    basis.flags.writeable = False
    return basis


def parameters_of(kind: str, shape: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Nearest parameters of a kind to a shape matrix and centre, filled up with zeros."""
    if kind == "diagonal":
        upper = np.diag(np.sqrt(np.diag(shape)))
    elif kind == "sphere":
        upper = np.eye(3) * np.linalg.det(shape) ** (1 / 6)
    elif kind == "circle":
        upper = np.eye(3) * np.linalg.det(shape[:2, :2]) ** 0.25
    else:
        upper = np.linalg.cholesky(shape).T
    full = np.concatenate([upper[np.triu_indices(3)], centre])
    found = np.zeros(9)
    found[: COUNT[kind]] = [full[rows[0]] for rows in _MOVES[kind]]
    return found


def _attempts(u: np.ndarray, kind: str):
    if kind == "symmetric":
        if len(u) >= _ENOUGH_FOR_ADJUSTED:
            yield lambda: consistent(u)[:2]
        yield lambda: _quadric.trace(u)
        yield lambda: _quadric.li_griffiths(u)
    if kind == "diagonal":
        yield lambda: _quadric.diagonal(u)
    if kind in PLANAR:
        if kind == "ellipse":
            yield lambda: _quadric.ellipse(u)
        yield lambda: _quadric.circle(u)
    else:
        yield lambda: _quadric.sphere(u)


def start(u: np.ndarray, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Shape and centre of the first of the algebraic fits, in order of merit, that is an ellipsoid."""
    reason: NotEllipsoid | None = None
    for attempt in _attempts(u, kind):
        try:
            return attempt()
        except NotEllipsoid as error:
            reason = reason or error
    raise reason or NotEllipsoid(_quadric.NOT_ELLIPSOID.format("quadric of another kind"))


def away(found: tuple[np.ndarray, np.ndarray], u: np.ndarray) -> np.ndarray:
    """Size of the first-order distance to an ellipsoid."""
    z = u - found[1]
    normal = z @ found[0]
    r = np.sqrt(np.maximum(np.sum(z * normal, axis=1), 1e-12))
    return np.abs((r - 1) * r) / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)


_PLAIN = {
    "sphere": _quadric.sphere,
    "diagonal": _quadric.diagonal,
    "symmetric": _quadric.trace,
    "circle": _quadric.circle,
    "ellipse": _quadric.ellipse,
}


def robust_start(u: np.ndarray, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Fit of least median distance: random subsets, the best of them refitted to the nearer half until it settles.

    P. J. Rousseeuw and K. Van Driessen, Technometrics 41 (1999) 212 (the concentration steps).
    """
    rng, half, fit = np.random.default_rng(0), (len(u) + COUNT[kind] + 1) // 2, _PLAIN[kind]

    def attempt(readings):
        try:
            found = fit(readings)
        except (NotEllipsoid, np.linalg.LinAlgError):
            return []
        return [(float(np.median(away(found, u))), found)]

    def best(tries):
        return sorted(tries, key=lambda one: one[0])

    tries = [one for _ in range(_SUBSETS) for one in attempt(u[rng.choice(len(u), min(len(u), _SUBSET), replace=False)])]
    tries = best(tries)[:_KEPT] + attempt(u)
    for _ in range(_ROUNDS):
        tries += [new for _, found in tries for new in attempt(u[np.argsort(away(found, u))[:half]])]
        tries = best(tries)[:_KEPT]
    if not tries:
        return start(u, kind)
    least, found = tries[0]
    near = u[away(found, u) <= 3 * 1.4826 * max(least, 1e-12)]
    try:
        return start(near, kind) if len(near) > 2 * COUNT[kind] else found
    except NotEllipsoid:
        return found
