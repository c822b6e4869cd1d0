"""Ellipsoid fits without iteration, which also start the iterative fits: linear and quadratic constraints, consistent.

A quadric is theta = [a..f | p, r, s, k] over the monomials [x^2, xy, y^2, xz, yz, z^2 | x, y, z, 1]. Every fit works on readings
that are centred and scaled, and eliminates the linear part exactly. Functions run in NumPy on the host unless they say "traced".
"""

import itertools
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from ..._errors import FitError
from ..._precision import array_module
from ._kinds import PLANAR, parameters_of

_ENOUGH_FOR_ADJUSTED = 30  # readings, from which the noise is known to 13 %


class NotEllipsoid(FitError):
    """The fitted quadric is not an ellipsoid, but the one that is named."""

    def __init__(self, quadric: str):
        super().__init__(f"the data do not determine an ellipsoid: the quadric nearest to the readings is a {quadric}", "no_ellipsoid")
        self.quadric = quadric


def monomials(u: Any) -> Any:
    """The monomials of each reading, (n, 10)."""
    xp, (x, y, z) = array_module(u), u.T
    return xp.stack([x * x, x * y, y * y, x * z, y * z, z * z, x, y, z, xp.ones_like(x)], axis=1)


#: entries of a symmetric matrix from a..f; the matrix printed in the paper belongs to another order of the monomials
_ENTRY = np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]])


def matrix_of(q: Any) -> Any:
    """Quadratic part as a symmetric matrix."""
    return q[_ENTRY] * ((1 + np.eye(3)) / 2).astype(q.dtype)


_BLOCK = 128  # rows that stay in the cache


def triangle(columns: np.ndarray) -> np.ndarray:
    """R of the QR factors of many rows, by blocks: on a tall matrix BLAS would start threads and spend more time waiting than working."""
    whole = len(columns) // _BLOCK * _BLOCK
    if whole > _BLOCK:
        width = columns.shape[1]
        blocks = np.asarray(np.linalg.qr(columns[:whole].reshape(-1, _BLOCK, width), mode="r"))
        columns = np.concatenate([blocks.reshape(-1, width), columns[whole:]])
    return np.asarray(np.linalg.qr(columns, mode="r"))


def extents(u: np.ndarray) -> np.ndarray:
    """Root mean squares along the principal axes of readings, the largest first; readings in a plane give a zero to within 1e-8."""
    return np.sqrt(np.maximum(np.linalg.eigvalsh(u.T @ u / len(u))[::-1], 0.0))


def shape_of(theta: Any) -> tuple[Any, Any]:
    """Shape matrix A and centre of any quadric theta, scaled so that (u - x0)'A(u - x0) = 1."""
    quadratic = matrix_of(theta[:6])
    x0 = array_module(theta).linalg.solve(quadratic, -theta[6:9] / 2)
    return quadratic / (x0 @ quadratic @ x0 - theta[9]), x0


def ellipsoid_of(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape matrix and centre of an ellipsoid; for any other quadric, an error that names it."""
    with np.errstate(all="ignore"):
        try:
            shape, x0 = shape_of(theta)
        except np.linalg.LinAlgError:
            raise NotEllipsoid("paraboloid or a cylinder") from None
    if not (np.isfinite(shape).all() and np.isfinite(x0).all()):
        raise NotEllipsoid("cone or a cylinder")
    values = np.linalg.eigvalsh(shape)
    if values[0] <= 0:
        raise NotEllipsoid("hyperboloid" if values[-1] > 0 else "quadric without real points")
    # a centre hundreds of data radii away means a paraboloid, to within rounding
    if values[-1] > 1e12 * values[0] or np.linalg.norm(x0) > 1e6:
        raise NotEllipsoid("paraboloid or a cylinder")
    return shape, x0


def _constrained(u: np.ndarray, chosen: tuple[int, ...], rest: tuple[int, ...], constraint: np.ndarray) -> np.ndarray:
    """Theta of smallest algebraic residual under q'Cq = 1 for the `chosen` coefficients q, and the best `rest`; all others are zero."""
    columns = monomials(u)
    first, (q2, r2) = columns[:, chosen], np.linalg.qr(columns[:, rest], mode="reduced")
    left = first - q2 @ (q2.T @ first)
    # S q = lambda C q has exactly one solution with q'Cq > 0, because C has one positive eigenvalue
    values, vectors = scipy.linalg.eig(left.T @ left, constraint)  # type: ignore[misc]  # its type depends on flags left out
    pairs = []
    for value, vector in zip(values, np.real(vectors).T, strict=True):
        size = vector @ constraint @ vector
        # eigenvalues may be infinite if the constraint lacks full rank
        if np.isfinite(value) and np.all(np.isfinite(vector)) and size > 1e-12 * (vector @ vector):
            pairs.append((abs(value), vector / np.sqrt(size)))
    if not pairs:
        raise NotEllipsoid("quadric that the constraint excludes")
    theta = np.zeros(10)
    theta[list(chosen)] = q = min(pairs, key=lambda pair: pair[0])[1]
    theta[list(rest)] = -np.linalg.lstsq(r2, q2.T @ first, rcond=None)[0] @ q
    return theta


#: kind -> the free coefficients of theta, and those fixed to one (a single one: one minus the other squares)
_FREE = {
    "symmetric": ((0, 1, 2, 3, 4, 6, 7, 8, 9), (5,)), "diagonal": ((0, 2, 6, 7, 8, 9), (5,)), "sphere": ((6, 7, 8, 9), (0, 2, 5)),
    "ellipse": ((0, 1, 6, 7, 9), (2, 5)), "circle": ((6, 7, 9), (0, 2, 5)),
}  # fmt: skip


def linear(u: Any, kind: str) -> Any:
    """Theta of smallest algebraic residual under a linear constraint, traced or not; invariant to rotation and shift.

    The constraint is a + c + f = 1 for the symmetric and the diagonal kind (Y. Petrov's ellipsoid_fit), and a = c = f = 1 for a sphere.
    In the plane z = 0 it is a + c = 1 for an ellipse and a = c = 1 for a circle; f is arbitrary there.
    """
    free, one = _FREE[kind]
    fixed, moves = np.zeros(10, u.dtype), np.eye(10, dtype=u.dtype)[:, list(free)]
    fixed[list(one)] = 1.0
    moves[one[0]] -= moves[[i for i in (0, 2) if i in free]].sum(axis=0)
    columns = monomials(u)
    return fixed + moves @ array_module(u).linalg.lstsq(columns @ moves, -columns @ fixed, rcond=None)[0]


def algebraic(u: np.ndarray, kind: str = "symmetric") -> tuple[np.ndarray, np.ndarray]:
    """Shape matrix and centre of the algebraic fit of the given kind."""
    return ellipse(u) if kind == "ellipse" else ellipsoid_of(linear(u, kind))


#: matrix of the quadratic form 4ac - b^2 in a, b and c
_DISCRIMINANT = np.array([[0.0, 0.0, 2.0], [0.0, -1.0, 0.0], [2.0, 0.0, 0.0]])


def constrained(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares under 4ac - b^2 = 1 (the magnetometer paper, equations 11 to 16): gives an ellipsoid, or a hyperboloid about z."""
    return ellipsoid_of(_constrained(u, (0, 1, 2), tuple(range(3, 10)), _DISCRIMINANT))


def ellipse(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fitzgibbon's ellipse in the plane z = 0, where 4ac - b^2 = 1 is the right condition."""
    theta = _constrained(u, (0, 1, 2), (6, 7, 9), _DISCRIMINANT)
    theta[5] = theta[0]  # any third axis is correct: the readings have no third coordinate
    return ellipsoid_of(theta)


_ROUNDING = float(np.finfo(float).eps)  # of an eigenvalue of Psi: closer to zero, false position would only follow rounding
_LARGEST = 0.6  # noise, in units of the readings' rms radius, above which a fit is meaningless
#: exponents (x, y, z) of the ten monomials, of their 100 products, and of the 35 moments, which all occur among the products
_EXPONENTS = ((2, 0, 0), (1, 1, 0), (0, 2, 0), (1, 0, 1), (0, 1, 1), (0, 0, 2), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0))
_PRODUCTS = [tuple(a + b for a, b in zip(*pair, strict=True)) for pair in itertools.product(_EXPONENTS, repeat=2)]
ORDERS = [e for e in itertools.product(range(5), repeat=3) if sum(e) <= 4]
_PLACES = [_PRODUCTS.index(order) for order in ORDERS]


def _table() -> np.ndarray:
    """(3, 10, 10, 35) coefficients of Psi = Psi0 + s2 Psi1 + s2^2 Psi2 in the moments: exp(-s2/2 D) of the products, D the Laplacian."""
    laplacian = np.zeros((len(ORDERS),) * 2)
    for order, axis in itertools.product(ORDERS, range(3)):
        if (e := order[axis]) > 1:
            laplacian[ORDERS.index(order), ORDERS.index((*order[:axis], e - 2, *order[axis + 1 :]))] = e * (e - 1)
    first = np.eye(len(ORDERS))[[ORDERS.index(order) for order in _PRODUCTS]]
    return np.stack([first, -first @ laplacian / 2, first @ laplacian @ laplacian / 8]).reshape(3, 10, 10, -1)


PSI = _table()


def consistent(u: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Shape matrix, centre and noise (units of u) at the smallest noise that makes Psi singular.

    I. Markovsky, A. Kukush and S. Van Huffel, Numer. Math. 98 (2004) 177; V. Renaudin, M. H. Afzal and G. Lachapelle,
    J. Sensors 2010, 967245.
    """
    columns = monomials(u)
    return null_of(PSI @ ((columns.T @ columns).ravel()[_PLACES] / len(u)))


def null_of(psi: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """`consistent` from Psi0, Psi1 and Psi2."""

    def least(s2: float) -> float:
        return float(np.linalg.eigvalsh(psi[0] + s2 * (psi[1] + s2 * psi[2]))[0])

    s2 = 0.0
    if least(0.0) > 1e-14:  # otherwise the readings are exact
        low, high = 0.0, 0.02**2
        while least(high) > 0:
            low, high = high, 1.69 * high
            if high > _LARGEST**2:
                raise NotEllipsoid("quadric hidden in noise")
        s2 = _crossing(least, low, high)
    theta = np.linalg.eigh(psi[0] + s2 * (psi[1] + s2 * psi[2]))[1][:, 0]
    return *ellipsoid_of(theta), float(np.sqrt(s2))


def _crossing(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a function falls through zero, by the Illinois rule of false position; SciPy's root finder takes longer to load than a fit."""
    above, below, x, kept = function(low), function(high), low, 0
    for _ in range(100):
        before, x = x, low + (high - low) * above / (above - below)
        value = function(x)
        if abs(value) <= _ROUNDING or abs(x - before) <= 1e-15 * x:
            break
        # halve the height of an end that stays twice, so that the next line does not reach there again
        if value > 0:
            low, above, below, kept = x, value, below / (2 if kept > 0 else 1), 1
        else:
            high, below, above, kept = x, value, above / (2 if kept < 0 else 1), -1
    return x


def start(u: np.ndarray, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Shape and centre of the first algebraic fit, in order of merit, that gives an ellipsoid."""
    kinds = dict.fromkeys((kind, "circle" if kind in PLANAR else "sphere"))
    attempts = [lambda one=one: algebraic(u, one) for one in kinds]
    if kind == "symmetric":
        exact = [lambda: consistent(u)[:2]] if len(u) >= _ENOUGH_FOR_ADJUSTED else []
        attempts = [*exact, *attempts]
    reason: NotEllipsoid | None = None
    for attempt in attempts:
        try:
            return attempt()
        except NotEllipsoid as error:
            reason = reason or error
    raise reason or NotEllipsoid("quadric of another kind")


def traced_start(u: Any, kind: str) -> Any:
    """Parameters of the linear algebraic fit, or of the sphere if that fit is no ellipsoid: `start` without a choice on the host."""
    best, sphere = (shape_of(linear(u, which)) for which in (kind, "circle" if kind in PLANAR else "sphere"))
    values = jnp.linalg.eigvalsh(jnp.where(jnp.isfinite(best[0]), best[0], -1.0))
    good = (values[0] > 1e-6 * values[-1]) & jnp.all(jnp.isfinite(best[1]))
    # if the sphere has no real points, use one about the readings' mean
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
