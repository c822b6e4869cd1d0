"""Where the iterative fits start: the best algebraic fit that gives an ellipsoid, and one that outliers do not carry off."""

import functools
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..._precision import array_module
from ._algebraic import NOT_ELLIPSOID, NotEllipsoid, algebraic, ellipse, li_griffiths, linear, shape_of
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


#: where (U_11, U_12, U_13, U_22, U_23, U_33, b) stand among the nine entries of U and the centre
_PLACE = (0, 1, 2, 4, 5, 8, 9, 10, 11)


@functools.cache
def basis_of(kind: str) -> np.ndarray:
    """(12, 9) from the parameters of a kind, filled up with zeros, to the entries of U and the centre."""
    basis = np.zeros((12, 9))
    for column, rows in enumerate(_MOVES[kind]):
        basis[[_PLACE[row] for row in rows], column] = 1.0
    basis.flags.writeable = False
    return basis


def parameters_of(kind: str, shape: Any, centre: Any) -> Any:
    """Nearest parameters of a kind to a shape matrix and centre, filled up with zeros."""
    xp = array_module(shape)
    if kind == "diagonal":
        upper = xp.diag(xp.sqrt(xp.diag(shape)))
    elif kind == "sphere":
        upper = xp.eye(3) * xp.linalg.det(shape) ** (1 / 6)
    elif kind == "circle":
        upper = xp.eye(3) * xp.linalg.det(shape[:2, :2]) ** 0.25
    else:
        upper = xp.linalg.cholesky(shape).T
    full = xp.concatenate([upper.ravel(), centre])
    first = np.array([_PLACE[rows[0]] for rows in _MOVES[kind]])
    return xp.concatenate([full[first], xp.zeros(9 - len(first))])


def _attempts(u: np.ndarray, kind: str):
    if kind == "symmetric":
        if len(u) >= _ENOUGH_FOR_ADJUSTED:
            yield lambda: consistent(u)[:2]
        yield lambda: algebraic(u)
        yield lambda: li_griffiths(u)
    if kind == "diagonal":
        yield lambda: algebraic(u, "diagonal")
    if kind in PLANAR:
        if kind == "ellipse":
            yield lambda: ellipse(u)
        yield lambda: algebraic(u, "circle")
    else:
        yield lambda: algebraic(u, "sphere")


def start(u: np.ndarray, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Shape and centre of the first of the algebraic fits, in order of merit, that is an ellipsoid."""
    reason: NotEllipsoid | None = None
    for attempt in _attempts(u, kind):
        try:
            return attempt()
        except NotEllipsoid as error:
            reason = reason or error
    raise reason or NotEllipsoid(NOT_ELLIPSOID.format("quadric of another kind"))


def traced_start(u: Any, kind: str) -> Any:
    """Parameters of the linear algebraic fit, or where that is no ellipsoid of the sphere: `start` without a choice on the host."""
    best, sphere = (shape_of(linear(u, which)) for which in (kind, "sphere"))
    values = jnp.linalg.eigvalsh(jnp.where(jnp.isfinite(best[0]), best[0], -1.0))
    good = (values[0] > 1e-6 * values[-1]) & jnp.all(jnp.isfinite(best[1]))
    # the sphere is one about the readings' mean where it has no real points
    real = sphere[0][0, 0] > 0
    round_ = (jnp.where(real, sphere[0], jnp.eye(3, dtype=u.dtype)), jnp.where(real, sphere[1], 0.0))
    shape, centre = (jnp.where(good, a, b) for a, b in zip(best, round_, strict=True))
    return parameters_of(kind, shape, centre)


def away(found: tuple[np.ndarray, np.ndarray], u: np.ndarray) -> np.ndarray:
    """Size of the first-order distance to an ellipsoid."""
    z = u - found[1]
    normal = z @ found[0]
    r = np.sqrt(np.maximum(np.sum(z * normal, axis=1), 1e-12))
    return np.abs((r - 1) * r) / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)


def robust_start(u: np.ndarray, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Fit of least median distance: random subsets, the best of them refitted to the nearer half until it settles.

    P. J. Rousseeuw and K. Van Driessen, Technometrics 41 (1999) 212 (the concentration steps).
    """
    rng, half = np.random.default_rng(0), (len(u) + COUNT[kind] + 1) // 2

    def attempt(readings):
        try:
            found = ellipse(readings) if kind == "ellipse" else algebraic(readings, kind)
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
