"""Algebraic fits of a quadric to readings: those of a linear constraint, traced or not; Li-Griffiths, constrained and ellipse (NumPy).

A quadric is theta = [a..f | p, r, s, k] over the monomials [x^2, xy, y^2, xz, yz, z^2 | x, y, z, 1]. Every fit works on readings
that are centred and scaled, and eliminates the linear part exactly.
"""

from typing import Any

import equinox as eqx
import numpy as np
import scipy.linalg

from ..._errors import FitError
from ..._precision import array_module
from ..._types import AnyArray

NOT_ELLIPSOID = "the data do not determine an ellipsoid: the quadric nearest to the readings is a {}"


class NotEllipsoid(FitError):
    """The quadric that fits is not an ellipsoid."""


class Frame(eqx.Module):
    """Centring and scaling u = (m - centre) / scale of readings."""

    centre: AnyArray
    scale: Any

    @staticmethod
    def of(m: AnyArray) -> "Frame":
        centre = m.mean(axis=0)
        return Frame(centre, ((m - centre[None, :]) ** 2).sum(axis=1).mean() ** 0.5)

    def scaled(self, m: Any) -> Any:
        return (m - self.centre[None, :]) / self.scale


def monomials(u: Any) -> tuple[Any, Any]:
    """Quadratic (n, 6) and linear (n, 4) columns."""
    xp, (x, y, z) = array_module(u), u.T
    return xp.stack([x * x, x * y, y * y, x * z, y * z, z * z], axis=1), xp.stack([x, y, z, xp.ones_like(x)], axis=1)


#: entries of a symmetric matrix from a..f; the paper's printed one belongs to another order of the monomials
_ENTRY = np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]])
_HALF = np.array([[1, 0.5, 0.5], [0.5, 1, 0.5], [0.5, 0.5, 1]])


def matrix_of(q: Any) -> Any:
    """Quadratic part as a symmetric matrix."""
    return q[_ENTRY] * _HALF.astype(q.dtype)


_BLOCK = 128


def triangle(columns: np.ndarray) -> np.ndarray:
    """R of the QR factors of many rows, by blocks: on a tall matrix BLAS starts threads, and waits for them longer than it works."""
    whole = len(columns) // _BLOCK * _BLOCK
    if whole > _BLOCK:
        width = columns.shape[1]
        blocks = np.asarray(np.linalg.qr(columns[:whole].reshape(-1, _BLOCK, width), mode="r"))
        columns = np.concatenate([blocks.reshape(-1, width), columns[whole:]])
    return np.asarray(np.linalg.qr(columns, mode="r"))


def extents(u: np.ndarray) -> np.ndarray:
    """Root mean squares along the principal axes of readings, the largest first; those of a plane are zero to 1e-8."""
    return np.sqrt(np.maximum(np.linalg.eigvalsh(u.T @ u / len(u))[::-1], 0.0))


def shape_of(theta: Any) -> tuple[Any, Any]:
    """Shape matrix A and centre of the quadric theta, scaled so that (u - x0)'A(u - x0) = 1, whatever quadric it is."""
    quadratic = matrix_of(theta[:6])
    x0 = array_module(theta).linalg.solve(quadratic, -theta[6:9] / 2)
    return quadratic / (x0 @ quadratic @ x0 - theta[9]), x0


def ellipsoid_of(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape matrix and centre of an ellipsoid; any other quadric is named."""
    with np.errstate(all="ignore"):
        try:
            shape, x0 = shape_of(theta)
        except np.linalg.LinAlgError:
            raise NotEllipsoid(NOT_ELLIPSOID.format("paraboloid or a cylinder")) from None
    if not (np.isfinite(shape).all() and np.isfinite(x0).all()):
        raise NotEllipsoid(NOT_ELLIPSOID.format("cone or a cylinder"))
    values = np.linalg.eigvalsh(shape)
    if values[0] <= 0:
        raise NotEllipsoid(NOT_ELLIPSOID.format("hyperboloid" if values[-1] > 0 else "quadric without real points"))
    # a centre hundreds of data radii away is a paraboloid to rounding
    if values[-1] > 1e12 * values[0] or np.linalg.norm(x0) > 1e6:
        raise NotEllipsoid(NOT_ELLIPSOID.format("paraboloid or a cylinder"))
    return shape, x0


def _eliminated(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Scatter of the first columns after the best combination of the second is taken off, and that combination."""
    q2, r2 = np.linalg.qr(second, mode="reduced")
    rest = first - q2 @ (q2.T @ first)
    return rest.T @ rest, -np.linalg.lstsq(r2, q2.T @ first, rcond=None)[0]


def _admissible(scatter: np.ndarray, constraint: np.ndarray) -> np.ndarray:
    """Eigenvector of S q = lambda C q with q'Cq > 0: there is one, as C has one positive eigenvalue."""
    values, vectors = scipy.linalg.eig(scatter, constraint)  # type: ignore[misc]  # its type depends on flags left out
    pairs = []
    for value, vector in zip(values, vectors.T, strict=True):
        vector = np.real(vector)
        size = vector @ constraint @ vector
        # eigenvalues may be infinite where the constraint has no rank
        if np.isfinite(value) and np.all(np.isfinite(vector)) and size > 1e-12 * (vector @ vector):
            pairs.append((abs(value), vector / np.sqrt(size)))
    if not pairs:
        raise NotEllipsoid(NOT_ELLIPSOID.format("quadric that the constraint excludes"))
    return min(pairs, key=lambda pair: pair[0])[1]


#: kind -> the coefficients of theta that are free; those of the squares sum to one, or with a sphere are one each
_FREE = {
    "symmetric": (0, 1, 2, 3, 4, 6, 7, 8, 9), "diagonal": (0, 2, 6, 7, 8, 9), "sphere": (6, 7, 8, 9), "circle": (6, 7, 9),
}  # fmt: skip


def linear(u: Any, kind: str) -> Any:
    """Theta of least algebraic residual under a constraint that is linear; invariant to rotation and shift.

    a + c + f = 1 for the symmetric and the diagonal kind (Y. Petrov's ellipsoid_fit), a = c = f = 1 for a sphere, and in the plane
    z = 0 for a circle.
    """
    fixed, moves = np.zeros(10, u.dtype), np.eye(10, dtype=u.dtype)[:, list(_FREE[kind])]
    fixed[[5] if kind in ("symmetric", "diagonal") else [0, 2, 5]] = 1.0
    moves[5] = -moves[0] - moves[2]
    xp = array_module(u)
    columns = xp.concatenate(monomials(u), axis=1)
    return fixed + moves @ xp.linalg.lstsq(columns @ moves, -columns @ fixed, rcond=None)[0]


def algebraic(u: np.ndarray, kind: str = "symmetric") -> tuple[np.ndarray, np.ndarray]:
    """Shape matrix and centre of `linear`."""
    return ellipsoid_of(linear(u, kind))


def li_griffiths(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares under 4J - I^2 = 1 (Q. Li and J. G. Griffiths, GMP 2004): always an ellipsoid, biased towards spheres."""
    constraint = np.zeros((6, 6))
    constraint[np.ix_((0, 2, 5), (0, 2, 5))] = 1.0
    constraint[(0, 2, 5), (0, 2, 5)] = -1.0
    constraint[(1, 3, 4), (1, 3, 4)] = -1.0
    first, second = monomials(u)
    scatter, rest = _eliminated(first, second)
    q = _admissible(scatter, constraint)
    return ellipsoid_of(np.concatenate([q, rest @ q]))


def constrained(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares under 4ac - b^2 = 1 (the magnetometer paper, equations 11 to 16), as a problem of three unknowns.

    The condition makes the sections z = const ellipses and no more; a hyperboloid about z passes it, and is reported.
    """
    first, second = monomials(u)
    scatter, rest = _eliminated(first[:, :3], np.concatenate([first[:, 3:], second], axis=1))
    q = _admissible(scatter, np.array([[0.0, 0.0, 2.0], [0.0, -1.0, 0.0], [2.0, 0.0, 0.0]]))
    return ellipsoid_of(np.concatenate([q, rest @ q]))


def ellipse(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fitzgibbon's ellipse in the plane z = 0: here 4ac - b^2 = 1 is the right condition."""
    x, y = u[:, 0], u[:, 1]
    scatter, rest = _eliminated(np.stack([x * x, x * y, y * y], axis=1), np.stack([x, y, np.ones_like(x)], axis=1))
    a, b, c = q = _admissible(scatter, np.array([[0.0, 0.0, 2.0], [0.0, -1.0, 0.0], [2.0, 0.0, 0.0]]))
    p, r, k = rest @ q
    # any third axis does: the readings have no third coordinate
    return ellipsoid_of(np.array([a, b, c, 0.0, 0.0, a, p, r, 0.0, k]))


def sampson(theta: np.ndarray, u: np.ndarray) -> np.ndarray:
    """First-order distance of readings to any quadric."""
    first, second = monomials(u)
    gradient = 2 * u @ matrix_of(theta[:6]) + theta[6:9]
    return (first @ theta[:6] + second @ theta[6:]) / np.maximum(np.linalg.norm(gradient, axis=1), 1e-12)


def nearest_quadric(u: np.ndarray) -> np.ndarray:
    """Quadric of unit theta with the least algebraic residual, of any kind."""
    return np.linalg.svd(triangle(np.concatenate(monomials(u), axis=1)))[2][-1]
