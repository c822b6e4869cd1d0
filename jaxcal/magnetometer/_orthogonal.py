"""Maximum likelihood of the readings of a surface: nearest points with all derivatives, the curvature that noise sees, and a prior.

A surface has one ellipsoid for all readings, or one for each. The steps of the fit are the same for every surface, on the host and in a
trace. Between rounds of them the noise gives the mean offset that it causes at the curved surface, and the weight of the prior: the entries
of a soft iron depart from a multiple of the identity by 40 %. The prior's error is in the covariance. It matters where readings are so few
and noisy that the fit would run off.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..fitting._implicit import implicit
from ._quadric import basis_of

_FOOT = 20  # most steps to a foot, which takes three near the surface
CURVED = 0.02  # noise over radius above which the curvature term matters
_STEPS = 128  # most of a fit
SETTLED = 1e-7  # step in standard errors, and relative change of the noise, or of the degrees of freedom, that end the steps
SOFT = 0.4  # spread of the entries of a soft iron about a multiple of the identity: the paper's sensor, the strongest known, has 0.3


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


def inverted(matrix: Any) -> Any:
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
    _, t, _ = repeated(again, begin, lambda carry: (carry[0] >= _FOOT) | carry[2])
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
    inverse = inverted(push)
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


class Weights(NamedTuple):
    """What a round knows of the noise.

    noise2 : variance for the curvature term. ridge : weight of the prior's squares. noise : standard deviation. scaled : (p, p) normal
    equations with columns of unit length. inverse : (p, p) covariance over the variance of the noise. freedom : readings less the
    parameters that they, not the prior, determine.
    """

    noise2: Any
    ridge: Any
    noise: Any
    scaled: Any
    inverse: Any
    freedom: Any


class Found(NamedTuple):
    """A fitted surface: parameters (p,), their covariance, noise and its degrees of freedom, distances (n,), and its readings.

    soft, centre : S and the centre of an ellipsoid in scaled readings. basis : from the parameters to their entries. noise2 : for the
    curvature term, in the distances.
    """

    parameters: Any
    soft: Any
    centre: Any
    covariance: Any
    noise: Any
    freedom: Any
    distance: Any
    near: Near
    converged: Any
    kind: str
    basis: Any
    noise2: Any


def penalties(basis: np.ndarray) -> np.ndarray:
    """Departure (9, p) of S from a multiple of the identity by its parameters; its squares sum over the entries."""
    return basis[:9] - np.outer(np.eye(3, dtype=basis.dtype), basis[[0, 4, 8]].mean(axis=0))


def terms(x: Any, variance: Any, basis: np.ndarray, size: Any) -> tuple[Any, Any]:
    """Variance for the curvature term, and weight of the prior, for a variance of the noise."""
    xp, mean = x.__array_namespace__(), basis[[0, 4, 8]].mean(axis=0) @ x
    # a noise too small matters not, and with one too large there is no surface
    radius2 = (size * mean) ** 2
    curved = (0.25 * radius2 > variance) & (variance > CURVED**2 * radius2)
    return xp.where(curved, variance, 0.0), variance / (SOFT * mean) ** 2


def weighed(x: Any, near: Near, last: Sequence[Any], basis: np.ndarray, size: Any) -> Weights:
    """The noise by these distances, and the weights that it gives.

    last : variance for the curvature term, and weight of the prior. size : the field in the unit of the readings over that of S.
    """
    xp, rows, p = x.__array_namespace__(), near.slopes, x.size
    out = penalties(basis)
    normal = rows.T @ rows + last[1] * (out.T @ out)
    column = xp.sqrt(xp.diagonal(normal))
    column = xp.where(column > 0, column, 1.0)
    scaled = normal / column[:, None] / column[None]
    inverse = xp.linalg.inv(scaled + rounding_of(x) * np.eye(p, dtype=x.dtype)) / column[:, None] / column[None]
    held = ((out @ inverse) * out).sum()
    freedom = xp.maximum(len(rows) - p + last[1] * held, 1.0)
    left = near.distance - last[0] * near.curvature
    noise2 = (left**2).sum() / freedom
    return Weights(*terms(x, noise2, basis, size), xp.sqrt(noise2), scaled, inverse, freedom)


class _Point(NamedTuple):
    """Parameters, readings beside their surface, the weights before and there, the next step, the share of it to try, and whether done."""

    x: Any
    near: Near
    last: Sequence[Any]
    weights: Weights
    step: Any
    share: Any
    count: Any
    converged: Any
    done: Any


def rounds(near_at: Callable[[Any, Near], Near], x: Any, near: Near, basis: np.ndarray, size: Any) -> tuple[Any, Near, Weights, Any]:
    """The end x of the steps with the readings beside the surface there, its weights, and whether it has converged.

    Gauss-Newton steps, each with the noise that the distances before it show; a step that raises the cost is shortened.
    near_at : takes parameters, and the readings beside a surface not far from theirs, to the readings beside theirs.
    """
    xp, out, rounding = x.__array_namespace__(), penalties(basis), rounding_of(x)

    def cost(x: Any, near: Near, here: Near, last: Sequence[Any]) -> Any:
        # with the offset of the point from which a step begins, whose slopes leave that of the curvature out
        return ((near.distance - last[0] * here.curvature) ** 2).sum() + last[1] * ((out @ x) ** 2).sum()

    def point(x: Any, near: Near, last: Sequence[Any], count: Any) -> _Point:
        weights = weighed(x, near, last, basis, size)
        gradient = near.slopes.T @ (near.distance - last[0] * near.curvature) + last[1] * (out.T @ (out @ x))
        step, total = -(weights.inverse @ gradient), cost(x, near, near, last)
        off = -(gradient @ step) / xp.where(total > 0, total, 1.0)  # square of the step in standard errors, over the readings
        short = xp.linalg.norm(step) <= rounding * xp.linalg.norm(x)
        alike = SETTLED + rounding
        settled = (abs(weights.noise2 - last[0]) <= alike * weights.noise2) & (abs(weights.freedom - last[2]) <= alike * weights.freedom)
        flat = ((off <= SETTLED**2) | short) & xp.isfinite(total)
        done = flat & settled | ~xp.isfinite(weights.noise) | (count >= _STEPS)
        return _Point(x, near, last, weights, step, 0.0 * off + 1.0, count, flat, done)

    def advance(here: _Point) -> _Point:
        x = here.x + here.share * here.step
        near = near_at(x, here.near)
        # so near the solution that the cost only changes by rounding it cannot judge a step
        better = cost(x, near, here.near, here.last) <= (1 + rounding) * cost(here.x, here.near, here.near, here.last)
        shorter = here._replace(share=here.share / 4, count=here.count + 1, done=here.count >= _STEPS)
        if xp is np and not better:
            return shorter
        weights = here.weights
        there = point(x, near, (weights.noise2, weights.ridge, weights.freedom), here.count + 1)
        return there if xp is np else jax.tree.map(lambda new, old: xp.where(better, new, old), there, shorter)

    near = near_at(x, near)  # which also gives the start its shapes
    first, none = weighed(x, near, (0.0, 0.0), basis, size), xp.zeros((), dtype=x.dtype)
    begin = point(x, near, (first.noise2 + none, first.ridge, first.freedom), xp.asarray(0))
    end = repeated(advance, begin, lambda here: here.done)
    # the last step is so short that the distances follow it by their slopes
    step = xp.where(end.converged, end.step, 0.0)
    return end.x + step, end.near._replace(distance=end.near.distance + end.near.slopes @ step), end.weights, end.converged


def rounding_of(x: Any) -> float:
    """Smallest eigenvalue of normal equations of p parameters, with columns of unit length, that is no rounding."""
    return 10 * x.size * float(np.finfo(x.dtype).eps)


def found_of(x: Any, near: Near, weights: Weights, basis: np.ndarray, converged: Any, kind: str) -> Found:
    """A fitted surface by its distances and their slopes, and by the prior."""
    iron, xp, scaled = basis @ x, x.__array_namespace__(), weights.scaled
    # a combination that is lost in the rounding of the normal equations
    determined = xp.linalg.eigvalsh(scaled if xp is np else jax.lax.stop_gradient(scaled))[0] > 100 * rounding_of(x)
    covariance = xp.where(determined, weights.noise**2 * weights.inverse, np.inf)
    left = near.distance - weights.noise2 * near.curvature
    soft, centre = iron[:9].reshape(3, 3), iron[9:]
    return Found(x, soft, centre, covariance, weights.noise, weights.freedom, left, near, converged, kind, basis, weights.noise2)


def maximised(surface: Any, begin: Any, h: Any, still: bool = False) -> Found:
    """The fit of a surface (see `Ellipsoids`) by `rounds` from parameters, and unit fields (n, 3) near which to begin.

    still : keep the parameters, with the smallest covariance that the readings allow there (Cramer-Rao bound). In a trace the fit has a
    derivative: that of the root of the slope of the cost, with the variance of the noise as one more unknown.
    """
    basis, kind, none = surface.basis, surface.kind, 0.0 * h[:, 0]
    near = Near(none, h, h, none, none, h, h)
    if still:
        near = surface.near(begin, near, *surface.data)
        weights = weighed(begin, near, (0.0, 0.0), basis, surface.size)._replace(noise2=0.0, ridge=0.0)
        return found_of(begin, near, weights, basis, True, kind)
    if isinstance(begin, np.ndarray):
        x, near, weights, converged = rounds(lambda x, near: surface.near(x, near, *surface.data), begin, near, basis, surface.size)
        return found_of(x, near, weights, basis, converged, kind)

    def solver(begin: Any, near: Near, size: Any, *data: Any) -> tuple:
        x, near, weights, converged = rounds(lambda x, near: surface.near(x, near, *data), begin, near, basis, size)
        return jnp.append(x, weights.noise**2), (near, converged.astype(x.dtype))

    def score(root: Any, further: tuple, _: Any, __: Near, size: Any, *data: Any) -> Any:
        x, near, out = root[:-1], surface.settled(root[:-1], further[0], *data), penalties(basis)
        noise2, ridge = terms(x, root[-1], basis, size)
        after = weighed(x, near, (noise2, ridge), basis, size)
        slope = near.slopes.T @ (near.distance - noise2 * near.curvature) + ridge * (out.T @ out @ x)
        return jnp.append(slope, after.noise**2 - root[-1])

    begin, near = jax.lax.stop_gradient((begin, near))
    root, (near, converged) = implicit(solver, score, begin, near, jnp.asarray(surface.size, h.dtype), *surface.data)
    x, near = root[:-1], surface.settled(root[:-1], near, *surface.data)
    noise2, ridge = terms(x, root[-1], basis, surface.size)
    return found_of(x, near, weighed(x, near, (noise2, ridge), basis, surface.size), basis, converged > 0, kind)
