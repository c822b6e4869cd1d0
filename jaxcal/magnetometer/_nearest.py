"""Readings beside their surface: the nearest points of an ellipsoid, or of one ellipsoid for each reading, with all derivatives."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ._quadric import basis_of

_ROUNDS = 20  # most steps to a foot, which takes three near the surface


class Near(NamedTuple):
    """Readings beside their surface.

    distance : (n,). normal, field : (n, 3) unit normal, and unit field, at the nearest point. curvature : (n,) mean curvature. multiplier :
    (n,) t of `foot`. corrected : (n, 3) the field of the reading itself over its magnitude. slopes : (n, p) of the distances by the
    parameters.
    """

    distance: Any
    normal: Any
    field: Any
    curvature: Any
    multiplier: Any
    corrected: Any
    slopes: Any = None


def times(v: Any, matrix: Any) -> Any:
    """Rows (n, 3) times one matrix, or each times its own."""
    return v @ matrix if matrix.ndim == 2 else v.__array_namespace__().einsum("ni,nij->nj", v, matrix)


def inverse_of(matrix: Any) -> Any:
    """Inverse of matrices (..., 3, 3) from cofactors, because LAPACK is slow on a batch of small matrices."""
    cofactors, determinant = _cofactors(matrix)
    return cofactors.swapaxes(-1, -2) / determinant[..., None, None]


def _cofactors(matrix: Any) -> tuple[Any, Any]:
    """Cofactors (..., 3, 3) and determinant, by cross products of the rows."""
    join, (x, y, z) = matrix.__array_namespace__().concatenate, (matrix[..., :1], matrix[..., 1:2], matrix[..., 2:])
    # slices, because what is looked up by numbers compiles slowly, and its derivative more slowly
    one, two = (join([part[..., 1:, :], part[..., :1, :]], axis=-2) for part in (join([y, z, x], axis=-1), join([z, x, y], axis=-1)))
    later = [join([part[..., 1:, :], part[..., :1, :]], axis=-2) for part in (one, two)]
    cofactors = one * later[1] - two * later[0]
    return cofactors, (matrix[..., 0, :] * cofactors[..., 0, :]).sum(axis=-1)


def _eye(matrix: Any) -> Any:
    """Identity matrices in the shape of others."""
    return matrix.__array_namespace__().broadcast_to(np.eye(3, dtype=matrix.dtype), matrix.shape)


def _pencil(shape: Any, z: Any) -> Any:
    """y(t) = (I + t A)^-1 z as a function of t, for all rows of z: along the principal axes of one A, and without these for many."""
    if isinstance(z, np.ndarray) and shape.ndim == 2:
        values, vectors = np.linalg.eigh(shape)
        return lambda t, vector: (vector @ vectors / (1 + t[:, None] * values)) @ vectors.T
    # by the Cayley-Hamilton theorem, whose derivatives hold for equal eigenvalues too
    square, trace = shape @ shape, shape.trace(axis1=-2, axis2=-1)
    second = (trace**2 - square.trace(axis1=-2, axis2=-1)) / 2
    adjugate = square - trace[..., None, None] * shape + second[..., None, None] * _eye(shape)
    det = (shape[..., 0, :] * adjugate[..., :, 0]).sum(axis=-1)
    trace, second, det = (x.reshape(-1, 1) for x in (trace, second, det))

    def apply(t: Any, vector: Any) -> Any:
        t = t[:, None]
        numerator = vector + t * (trace * vector - times(vector, shape)) + t**2 * times(vector, adjugate)
        return numerator / (1 + t * (trace + t * (second + t * det)))

    return apply


def _newton(apply: Any, shape: Any, z: Any, t: Any) -> Any:
    """One Newton step in t on 1/sqrt(y'Ay) = 1, which is nearly linear in t, where y = y(t)."""
    xp, y = z.__array_namespace__(), apply(t, z)
    normal = times(y, shape)
    g = (y * normal).sum(axis=1)
    q = (normal * apply(t, normal)).sum(axis=1)
    # Replace the inputs as well: at the centre of the ellipsoid all of these vanish.
    g, q = xp.where(q > 0, g, 1.0), xp.where(q > 0, q, 1.0)
    return t + g * (xp.sqrt(g) - 1) / q


def _largest_eigenvalue(shape: Any) -> Any:
    """Largest eigenvalue in closed form (O. K. Smith, Commun. ACM 4 (1961) 168), because a LAPACK call would cost more than a step."""
    xp = shape.__array_namespace__()
    mean = shape.trace(axis1=-2, axis2=-1) / 3
    rest = shape - mean[..., None, None] * _eye(shape)
    size = xp.sqrt((rest**2).sum(axis=(-2, -1)) / 6)
    rest = rest / xp.where(size > 0, size, 1.0)[..., None, None]
    cosine = xp.clip(_cofactors(rest)[1] / 2, -1, 1)
    return mean + 2 * size * xp.cos(xp.arccos(cosine) / 3)


def repeated(step: Callable[[Any], Any], state: Any, done: Callable[[Any], Any]) -> Any:
    """`step` until `done`: a loop of Python for arrays of NumPy, and one of JAX in a trace."""
    if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(state)):
        return jax.lax.while_loop(lambda now: ~done(now), step, state)
    while not done(state):
        state = step(state)
    return state


def foot(shape: Any, z: Any, near: Any) -> tuple[Any, Any]:
    """Multiplier t, z - y = t A y, of the nearest point y of x'Ax = 1 to each row of z, and y. near : t to start from."""
    xp = z.__array_namespace__()
    return _foot(shape, z, near) if xp is np else _differentiable(shape, z, jax.lax.stop_gradient(near))


def _foot(shape: Any, z: Any, near: Any) -> tuple[Any, Any]:
    """`foot` by Newton steps."""
    xp, apply, lowest = z.__array_namespace__(), _pencil(shape, z), -1 / _largest_eigenvalue(shape)
    # Each Newton step doubles the digits: half of them here, and the step after the loop gives the rest.
    half = float(np.finfo(z.dtype).eps) ** 0.5

    def again(carry: tuple) -> tuple:
        i, t, _ = carry
        new = _newton(apply, shape, z, t)
        new = xp.where(new > lowest, new, (t + lowest) / 2)
        return i + 1, new, (abs(new - t) <= half * (new - lowest)).all()

    begin = (xp.asarray(0), xp.where(near > lowest, near, 0.0), xp.asarray(False))
    _, t, _ = repeated(again, begin, lambda carry: (carry[0] >= _ROUNDS) | carry[2])
    t = _newton(apply, shape, z, t)
    return t, apply(t, z)


_differentiable = jax.custom_jvp(_foot)


@_differentiable.defjvp
def _(values: tuple, changes: tuple) -> Any:
    """From (I + t A) y = z and y'Ay = 1, for the change a of A: y'A dy = -y'a y / 2 and (I + t A) dy = dz - t a y - dt A y."""
    (shape, z, near), (by_shape, by_z, _) = values, changes
    t, y = _differentiable(shape, z, near)
    normal, turned, apply = times(y, shape), times(y, by_shape), _pencil(shape, z)
    steep, right = apply(t, normal), by_z - t[:, None] * turned
    slope = (steep * normal).sum(axis=1)  # zero at the centre, where t has no derivative
    by_t = ((steep * right).sum(axis=1) + (y * turned).sum(axis=1) / 2) / jnp.where(slope > 0, slope, 1.0)
    return (t, y), (by_t, apply(t, right - by_t[:, None] * normal))


def curvature(shape: Any, z: Any) -> Any:
    r"""Mean curvature of the level set of x'Ax through each row of z: half the sum of the principal curvatures, 1/R on a sphere.

    With the normal g = A z and T = tr A it is

    .. math:: \kappa = \frac{T\,g^Tg - g^TAg}{2|g|^3}.
    """
    xp, normal = z.__array_namespace__(), times(z, shape)
    square = (normal**2).sum(axis=1)
    square = xp.where(square > 0, square, 1.0)  # the centre has no direction
    bent = shape.trace(axis1=-2, axis2=-1) * square - (normal * times(normal, shape)).sum(axis=1)
    return bent / (2 * square * xp.sqrt(square))


def nearest(push: Any, z: Any, near: Any = None) -> Near:
    """Readings z (n, 3) beside {P h : |h| = 1}, with one matrix P, or one for each reading. near : t of `foot` to start from."""
    inverse = inverse_of(push)
    back = inverse.swapaxes(-1, -2)
    shape = back @ inverse
    t, y = foot(shape, z, 0.0 * z[:, 0] if near is None else near)
    normal = times(y, shape)
    length = (normal**2).sum(axis=1) ** 0.5
    return Near(t * length, normal / length[:, None], times(y, back), curvature(shape, z), t, times(z, back))


def slopes_of(near: Near, basis: np.ndarray) -> Any:
    """Derivative (n, p) of the distances of readings to an ellipsoid by its parameters."""
    return -((near.normal[:, :, None] * near.field[:, None, :]).reshape(-1, 9) @ basis[:9] + near.normal @ basis[9:])


class Ellipsoids(NamedTuple):
    """The ellipsoids of a kind, for scaled readings (n, 3), the only `data`. basis : from the parameters to the entries of S and centre.

    A surface of any kind has these members. size : the field in the unit of the readings over that of S.
    """

    data: tuple[Any, ...]
    kind: str
    basis: Any
    size: Any = 1.0

    @staticmethod
    def of(u: Any, kind: str) -> "Ellipsoids":
        return Ellipsoids((u,), kind, basis_of(kind).astype(u.dtype))

    def near(self, x: Any, near: Near | None, u: Any) -> Near:
        """Readings beside the surface of parameters x, and the slopes of their distances by these. near : beside one not far away."""
        iron = self.basis @ x
        found = nearest(iron[:9].reshape(3, 3), u - iron[9:][None], None if near is None else near.multiplier)
        return found._replace(slopes=slopes_of(found, self.basis))

    settled = near  # with derivatives, from readings beside the same surface
