"""Ellipsoids {b + S h : |h| = 1} of scaled readings, with S the soft iron times the field: their kinds, and fits without iteration.

A quadric is theta = [a..f | p, r, s, k] over the monomials [x^2, xy, xz, y^2, yz, z^2 | x, y, z, 1]. Every fit works on readings
that are centred and scaled, and eliminates the linear part exactly: with linear and quadratic constraints, and consistent. These also start
the iterative fits. Functions run in NumPy on the host unless they say "traced".
"""

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from ..._errors import FitError
from ..._types import AnyArray

#: place of each entry of a symmetric matrix among its six upper ones, the their rows and columns, and the matrix (9, 6) from them to all
PLACE = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
UPPER = np.triu_indices(len(PLACE))
SYMMETRIC = np.equal.outer(PLACE.ravel(), np.unique(PLACE)).astype(float)
#: number of parameters of each kind
COUNT = {"sphere": 4, "diagonal": 6, "symmetric": 9}


@functools.cache
def basis_of(kind: str) -> np.ndarray:
    """Matrix (12, p) from the parameters of a kind to the entries of S and the centre."""
    diagonal, free = SYMMETRIC[:, np.diag(PLACE)], COUNT[kind] - 3
    basis = np.zeros((12, COUNT[kind]))
    basis[:9, :free] = {"sphere": diagonal.sum(axis=1, keepdims=True), "diagonal": diagonal, "symmetric": SYMMETRIC}[kind]
    basis[9:, free:] = np.eye(3)
    basis.flags.writeable = False
    return basis


def soft_and_centre(parameters: Any, basis: Any) -> tuple[Any, Any]:
    """S and the centre."""
    full = basis @ parameters
    return full[:9].reshape(3, 3), full[9:]


def parameters_of(kind: str, soft: Any, centre: Any) -> Any:
    """Parameters of the given kind nearest to S and a centre."""
    xp = soft.__array_namespace__()
    return np.linalg.pinv(basis_of(kind)).astype(soft.dtype) @ xp.concatenate([soft.ravel(), centre])


#: singular value of the centred readings over their size, 0.58 for a full sphere, below which they lie near a plane
NEAR_PLANAR = 0.05


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """Centring and scaling of readings, u = (m - centre) / scale."""

    centre: AnyArray
    scale: Any

    @staticmethod
    def of(m: AnyArray) -> "Frame":
        centre = m.mean(axis=0)
        return Frame(centre, ((m - centre[None, :]) ** 2).sum(axis=1).mean() ** 0.5)

    def scaled(self, m: Any) -> Any:
        return (m - self.centre[None, :]) / self.scale


def between(slopes: Any, covariance: Any) -> Any:
    """Covariance J C J'; infinite if C is: infinity times zero is NaN."""
    xp = covariance.__array_namespace__()
    known = xp.isfinite(covariance).all()
    return xp.where(known, slopes @ xp.where(known, covariance, 0.0) @ slopes.T, xp.inf)


def unit(v: np.ndarray) -> np.ndarray:
    """Rows scaled to length one."""
    return v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-300)


def soft_of(shape: Any) -> Any:
    """S of the surface x'Ax = 1: the inverse of the symmetric root of A."""
    xp = shape.__array_namespace__()
    values, vectors = xp.linalg.eigh(shape)
    # rounding may make an eigenvalue negative if the ellipsoid diverged
    return (vectors / xp.sqrt(xp.maximum(values, xp.finfo(values.dtype).eps * xp.abs(values[-1])))[None, :]) @ vectors.T


def shape_of_soft(soft: np.ndarray) -> np.ndarray:
    """A of S (host only)."""
    inverse = np.linalg.inv(soft)
    return inverse.T @ inverse


def radius_of(soft: Any) -> Any:
    """Geometric mean of all semi-axes."""
    xp = soft.__array_namespace__()
    return xp.cbrt(xp.abs(xp.linalg.det(soft)))


def iron_slopes(whole: Any, field: Any, given: bool) -> Any:
    """Derivative (13, 12) of hard iron, soft iron and field by the whole matrix C H and the hard iron; H = det(C H)^(1/3) unless given."""
    xp = whole.__array_namespace__()
    by_field = xp.zeros(9, dtype=whole.dtype) if given else field / 3 * xp.linalg.inv(whole).T.ravel()
    by_soft = xp.concatenate([xp.eye(9, dtype=whole.dtype) / field - xp.outer(whole.ravel(), by_field) / field**2, by_field[None]])
    hard = xp.eye(3, 12, 9, dtype=whole.dtype)
    return xp.concatenate([hard, xp.concatenate([by_soft, xp.zeros((10, 3), dtype=whole.dtype)], axis=1)])


class NotEllipsoid(FitError):
    """The fitted quadric is not an ellipsoid, but the one that is named."""

    def __init__(self, quadric: str):
        super().__init__(f"the data do not determine an ellipsoid: the quadric nearest to the readings is a {quadric}", "no_ellipsoid")
        self.quadric = quadric


def monomials(u: Any) -> Any:
    """The monomials of each reading, (n, 10)."""
    xp, (x, y, z) = u.__array_namespace__(), u.T
    return xp.stack([x * x, x * y, x * z, y * y, y * z, z * z, x, y, z, xp.ones_like(x)], axis=1)


def matrix_of(q: Any) -> Any:
    """Quadratic part as a symmetric matrix; the matrix printed in the paper belongs to another order of the monomials."""
    return q[PLACE] * ((1 + np.eye(3)) / 2).astype(q.dtype)


def extents(u: np.ndarray) -> np.ndarray:
    """Root mean squares along the principal axes of readings, the largest first; readings in a plane give a zero to within 1e-8."""
    return np.sqrt(np.maximum(np.linalg.eigvalsh(u.T @ u / len(u))[::-1], 0.0))


def shape_of(theta: Any) -> tuple[Any, Any]:
    """Shape matrix A and centre of any quadric theta, scaled so that (u - x0)'A(u - x0) = 1."""
    quadratic = matrix_of(theta[:6])
    x0 = theta.__array_namespace__().linalg.solve(quadratic, -theta[6:9] / 2)
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


def sphere_centre(m: np.ndarray) -> np.ndarray:
    """Centre of the sphere through readings; if they do not determine one, the solution nearest to their mean."""
    middle = m.mean(axis=0)
    square = np.sum((m - middle) ** 2, axis=1)
    return middle + np.linalg.lstsq(2.0 * (m - middle), square - square.mean(), rcond=3e-2)[0]


def linear(u: Any, kind: str) -> Any:
    """Theta of smallest algebraic residual under a + d + f = 3 (Y. Petrov, ellipsoid_fit), which is invariant to rotation and shift."""
    # the quadratic part is that of a sphere, plus changes within the kind that keep the trace
    part = np.linalg.pinv(SYMMETRIC) @ basis_of(kind)[:9, : COUNT[kind] - 3]
    keeping = np.linalg.svd(part[np.diag(PLACE)].sum(axis=0, keepdims=True))[2][1:].T
    moves = scipy.linalg.block_diag(part @ keeping, np.eye(4)).astype(u.dtype)
    fixed = np.isin(np.arange(10), np.diag(PLACE)).astype(u.dtype)
    columns = monomials(u)
    return fixed + moves @ u.__array_namespace__().linalg.lstsq(columns @ moves, -columns @ fixed, rcond=None)[0]


def algebraic(u: np.ndarray, kind: str = "symmetric") -> tuple[np.ndarray, np.ndarray]:
    """Shape matrix and centre of the algebraic fit of the given kind."""
    return ellipsoid_of(linear(u, kind))


def constrained(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares under 4ac - b^2 = 1, for a x^2 + b xy + c y^2 (the magnetometer paper, equations 11 to 16).

    It gives an ellipsoid, or a hyperboloid about z.
    """
    columns = monomials(u)
    chosen, rest = [0, 1, 3], [2, 4, 5, 6, 7, 8, 9]
    constraint = np.array([[0.0, 0.0, 2.0], [0.0, -1.0, 0.0], [2.0, 0.0, 0.0]])
    first, (q2, r2) = columns[:, chosen], np.linalg.qr(columns[:, rest], mode="reduced")
    left = first - q2 @ (q2.T @ first)
    # S q = lambda C q has exactly one solution with q'Cq > 0, because C has one positive eigenvalue
    vectors = np.real(np.linalg.eig(np.linalg.solve(constraint, left.T @ left))[1]).T
    sizes = np.einsum("ki,ij,kj->k", vectors, constraint, vectors)
    best = int(np.argmax(sizes))
    if not sizes[best] > 0:
        raise NotEllipsoid("quadric that the constraint excludes")
    theta = np.zeros(10)
    theta[chosen] = q = vectors[best] / np.sqrt(sizes[best])
    theta[rest] = -np.linalg.lstsq(r2, q2.T @ first, rcond=None)[0] @ q
    return ellipsoid_of(theta)


#: exponents (x, y, z) of the ten monomials
_EXPONENTS = np.array([(2, 0, 0), (1, 1, 0), (1, 0, 1), (0, 2, 0), (0, 1, 1), (0, 0, 2), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0)])


@functools.cache
def _slopes() -> np.ndarray:
    """Matrices D (3, 10, 10) that differentiate the monomials: their slopes along an axis are D times themselves."""
    before = (_EXPONENTS[:, None] - _EXPONENTS == np.eye(3)[:, None, None]).all(axis=3)
    return before * _EXPONENTS.T[:, :, None]


def _laplacian(moments: np.ndarray) -> np.ndarray:
    """Mean of the Laplacian of the products of the monomials, from the mean of the products."""
    return sum(d @ d @ moments + 2 * d @ moments @ d.T + moments @ (d @ d).T for d in _slopes())  # type: ignore[return-value]


def noisy(products: np.ndarray, variance: float) -> np.ndarray:
    """Mean products of the monomials without those of a noise: exp(-s^2/2 D) of them, with the Laplacian D."""
    first = -_laplacian(products) / 2
    return products + variance * (first - variance * _laplacian(first) / 4)


def adjusted(products: np.ndarray) -> tuple[float, np.ndarray]:
    """The smallest variance of the noise that makes `noisy` singular, and the quadric that it then maps to zero."""
    first = -_laplacian(products) / 2
    second, s2 = -_laplacian(first) / 4, 0.0
    if np.linalg.eigvalsh(products)[0] > 1e-14:  # otherwise the readings are exact
        # with t = 1 / s^2, (t^2 Psi0 + t Psi1 + Psi2) q = 0 is an eigenvalue problem of twice the size, whose largest real t is wanted
        zero, one = np.zeros_like(products), np.eye(len(products))
        t = np.linalg.eigvals(np.block([[-np.linalg.solve(products, first), -np.linalg.solve(products, second)], [one, zero]]))
        s2 = 1 / max(t.real[np.abs(t.imag) <= 1e-6 * np.abs(t)].max(initial=0.0), 1e-300)
    return s2, np.linalg.eigh(products + s2 * (first + s2 * second))[1][:, 0]


def consistent(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape matrix and centre by adjusted least squares.

    I. Markovsky, A. Kukush and S. Van Huffel, Numer. Math. 98 (2004) 177; V. Renaudin, M. H. Afzal and G. Lachapelle, J. Sensors 2010,
    967245.
    """
    columns = monomials(u)
    return ellipsoid_of(adjusted(columns.T @ columns / len(u))[1])


def start(u: np.ndarray, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Shape and centre of the first algebraic fit, in order of merit, that gives an ellipsoid."""
    attempts = [lambda one=one: algebraic(u, one) for one in dict.fromkeys((kind, "sphere"))]
    attempts = [lambda: consistent(u), *attempts] if kind == "symmetric" else attempts
    reason: NotEllipsoid | None = None
    for attempt in attempts:
        try:
            return attempt()
        except NotEllipsoid as error:
            reason = reason or error
    raise reason or NotEllipsoid("quadric of another kind")


def host_start(u: np.ndarray, kind: str) -> np.ndarray:
    """Parameters of `start`."""
    shape, centre = start(u, kind)
    return parameters_of(kind, soft_of(shape), centre)


def traced_start(u: Any, kind: str) -> Any:
    """Parameters of the linear algebraic fit, or of the sphere if that fit is no ellipsoid: `start` without a choice on the host."""
    best, sphere = (shape_of(linear(u, which)) for which in (kind, "sphere"))
    values = jnp.linalg.eigvalsh(jnp.where(jnp.isfinite(best[0]), best[0], -1.0))
    good = (values[0] > 1e-6 * values[-1]) & jnp.all(jnp.isfinite(best[1]))
    # if the sphere has no real points, use one about the readings' mean
    real = sphere[0][0, 0] > 0
    round_ = (jnp.where(real, sphere[0], jnp.eye(3, dtype=u.dtype)), jnp.where(real, sphere[1], 0.0))
    shape, centre = (jnp.where(good, a, b) for a, b in zip(best, round_, strict=True))
    return parameters_of(kind, soft_of(shape), centre)


def away(found: tuple[np.ndarray, np.ndarray], u: np.ndarray) -> np.ndarray:
    """Size of the first-order distance to an ellipsoid."""
    z = u - found[1]
    normal = z @ found[0]
    r = np.sqrt(np.maximum(np.sum(z * normal, axis=1), 1e-12))
    return np.abs((r - 1) * r) / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
