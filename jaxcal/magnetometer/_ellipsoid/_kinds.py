"""The kinds of ellipsoid {x : |U (x - b)| = 1}, their parameters, and the entries of the shape matrix A = U'U."""

import functools
from typing import Any

import numpy as np

from ..._precision import array_module

#: number of parameters of each kind
COUNT = {"sphere": 4, "diagonal": 6, "symmetric": 9, "circle": 3, "ellipse": 5}
SOLID, PLANAR = ("sphere", "diagonal", "symmetric"), ("circle", "ellipse")
#: rows of (A_xx, A_xy, A_yy, A_xz, A_yz, A_zz, b) that exist in a plane
PLANAR_ROWS = [0, 1, 2, 6, 7]
#: rows and columns of the six entries of A in that order
ENTRIES = (np.array([0, 0, 1, 0, 1, 2]), np.array([0, 1, 1, 2, 2, 2]))

#: entries of (U_11, U_12, U_13, U_22, U_23, U_33, b) that each parameter changes. A planar fit has no third coordinate, so U_33 has no
#: effect; it follows U_11 to keep A regular.
_MOVES = {
    "sphere": ((0, 3, 5), (6,), (7,), (8,)),
    "diagonal": ((0,), (3,), (5,), (6,), (7,), (8,)),
    "symmetric": tuple((i,) for i in range(9)),
    "circle": ((0, 3, 5), (6,), (7,)),
    "ellipse": ((0, 5), (1,), (3,), (6,), (7,)),
}
#: positions of (U_11, U_12, U_13, U_22, U_23, U_33, b) among the nine entries of U and the centre
PLACE = np.array([0, 1, 2, 4, 5, 8, 9, 10, 11])


@functools.cache
def basis_of(kind: str) -> np.ndarray:
    """Matrix (12, 9) from the parameters of a kind, padded with zeros, to the entries of U and the centre."""
    basis = np.zeros((12, 9))
    for column, rows in enumerate(_MOVES[kind]):
        basis[[PLACE[row] for row in rows], column] = 1.0
    basis.flags.writeable = False
    return basis


def upper_and_centre(parameters: Any, basis: Any) -> tuple[Any, Any]:
    """U and the centre."""
    full = basis @ parameters
    return full[:9].reshape(3, 3), full[9:]


def shape_and_centre(parameters: Any, basis: Any) -> tuple[Any, Any]:
    """A = U'U, which is positive for any parameters, and the centre."""
    upper, centre = upper_and_centre(parameters, basis)
    return upper.T @ upper, centre


def parameters_of(kind: str, shape: Any, centre: Any) -> Any:
    """Parameters of the given kind nearest to a shape matrix and centre, padded with zeros."""
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
    first = np.array([PLACE[rows[0]] for rows in _MOVES[kind]])
    return xp.concatenate([full[first], xp.zeros(9 - len(first))])


def slopes_of(parameters: Any, basis: np.ndarray) -> Any:
    """Derivative of (A_xx, A_xy, A_yy, A_xz, A_yz, A_zz, b) with respect to the parameters: dA = dU'U + U'dU."""
    xp = array_module(parameters)
    change, upper = basis[:9].T.reshape(9, 3, 3), (basis[:9] @ parameters).reshape(3, 3)
    half = upper.T @ change
    return xp.concatenate([(half + xp.swapaxes(half, 1, 2))[:, *ENTRIES].T, xp.asarray(basis[9:])])
