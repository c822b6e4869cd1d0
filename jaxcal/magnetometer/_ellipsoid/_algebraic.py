"""Algebraic fits of a quadric to readings (host, NumPy): trace, Li-Griffiths and constrained; sphere, diagonal and ellipse.

A quadric is theta = [a..f | p, r, s, k] over the monomials [x^2, xy, y^2, xz, yz, z^2 | x, y, z, 1]. Every fit works on readings
that are centred and scaled, and eliminates the linear part exactly.
"""

import equinox as eqx
import numpy as np
import scipy.linalg

from ..._errors import FitError

NOT_ELLIPSOID = "the data do not determine an ellipsoid: the quadric nearest to the readings is a {}"


class NotEllipsoid(FitError):
    """The quadric that fits is not an ellipsoid."""


class Frame(eqx.Module):
    """Centring and scaling u = (m - centre) / scale of readings."""

    centre: np.ndarray
    scale: float

    @staticmethod
    def of(m: np.ndarray) -> "Frame":
        centre = m.mean(axis=0)
        return Frame(centre, float(np.sqrt(np.mean(np.sum((m - centre) ** 2, axis=1)))))

    def scaled(self, m: np.ndarray) -> np.ndarray:
        return (m - self.centre) / self.scale


def monomials(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quadratic (n, 6) and linear (n, 4) columns."""
    x, y, z = u.T
    one = np.ones_like(x)
    return np.stack([x * x, x * y, y * y, x * z, y * z, z * z], axis=1), np.stack([x, y, z, one], axis=1)


def matrix_of(q: np.ndarray) -> np.ndarray:
    """Quadratic part as a symmetric matrix (the paper's printed one belongs to another order of the monomials)."""
    a, b, c, d, e, f = q
    return np.array([[a, b / 2, d / 2], [b / 2, c, e / 2], [d / 2, e / 2, f]])


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


def ellipsoid_of(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape matrix A and centre of the quadric theta, scaled so that (u - x0)'A(u - x0) = 1."""
    quadratic = matrix_of(theta[:6])
    with np.errstate(all="ignore"):
        try:
            x0 = np.linalg.solve(quadratic, -theta[6:9] / 2)
        except np.linalg.LinAlgError:
            raise NotEllipsoid(NOT_ELLIPSOID.format("paraboloid or a cylinder")) from None
        shape = quadratic / (x0 @ quadratic @ x0 - theta[9])
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


def _weighted(u, weight):
    first, second = monomials(u)
    if weight is None:
        return first, second
    root = np.sqrt(weight)[:, None]
    return root * first, root * second


def trace(u: np.ndarray, weight: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Least squares under a + c + f = 1 (Petrov's ellipsoid_fit): linear, invariant to rotation and shift."""
    first, second = _weighted(u, weight)
    columns = np.concatenate([first[:, :5], second], axis=1)
    columns[:, 0] -= first[:, 5]
    columns[:, 2] -= first[:, 5]
    a, b, c, d, e, *linear = np.linalg.lstsq(columns, -first[:, 5], rcond=None)[0]
    return ellipsoid_of(np.array([a, b, c, d, e, 1 - a - c, *linear]))


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


def sphere(u: np.ndarray, weight: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Linear least squares of |u|^2 = 2 u'x0 + kappa."""
    root = np.ones(len(u)) if weight is None else np.sqrt(weight)
    columns = np.concatenate([2 * u, np.ones((len(u), 1))], axis=1) * root[:, None]
    *x0, kappa = np.linalg.lstsq(columns, root * np.sum(u**2, axis=1), rcond=None)[0]
    x0 = np.array(x0)
    square = kappa + x0 @ x0
    if not square > 0:
        raise NotEllipsoid(NOT_ELLIPSOID.format("sphere without real points"))
    return np.eye(3) / square, x0


def diagonal(u: np.ndarray, weight: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Trace-constrained least squares without the mixed terms."""
    first, second = _weighted(u, weight)
    columns = np.concatenate([first[:, [0]] - first[:, [5]], first[:, [2]] - first[:, [5]], second], axis=1)
    a, c, *linear = np.linalg.lstsq(columns, -first[:, 5], rcond=None)[0]
    return ellipsoid_of(np.array([a, 0.0, c, 0.0, 0.0, 1 - a - c, *linear]))


def circle(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The sphere fit in the plane z = 0."""
    columns = np.concatenate([2 * u[:, :2], np.ones((len(u), 1))], axis=1)
    *x0, kappa = np.linalg.lstsq(columns, np.sum(u[:, :2] ** 2, axis=1), rcond=None)[0]
    square = kappa + np.dot(x0, x0)
    if not square > 0:
        raise NotEllipsoid(NOT_ELLIPSOID.format("circle without real points"))
    return np.eye(3) / square, np.array([*x0, 0.0])


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
