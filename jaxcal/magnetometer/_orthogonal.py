"""Maximum likelihood of the readings of a surface: nearest points with all derivatives, the curvature that noise sees, and a prior.

A surface has one ellipsoid for all readings, or one for each. The steps of the fit are the same for every surface, on the host and in a
trace. Between rounds of them the noise gives the mean offset that it causes at the curved surface, and the weight of the prior: the entries
of a soft iron depart from a multiple of the identity by 40 %. The prior's error is in the covariance. It matters where readings are so few
and noisy that the fit would run off.
"""

from collections import namedtuple
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..fitting._implicit import implicit
from ._quadric import CURVED, basis_of

_FOOT = 20  # most steps to a foot, which takes three near the surface
_STEPS = 128  # most of a fit
SETTLED = 1e-6  # standard errors that more steps, or newer weights, would move the parameters by; relative change of degrees of freedom
SOFT = 0.4  # spread of the entries of a soft iron about a multiple of the identity: the paper's sensor, the strongest known, has 0.3


class Near(namedtuple("Near", "distance normal field curvature multiplier corrected slopes", defaults=(None,))):
    """Readings beside their surface.

    distance : (n,). normal, field : (n, 3) unit normal, and unit field, at the nearest point. curvature : (n,) mean curvature. multiplier :
    (n,) t of `foot`. corrected : (n, 3) the field of the reading itself over its magnitude. slopes : (n, p) of the distances by the
    parameters.
    """


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


def _pencil(shape: Any) -> Any:
    """y(t) = (I + t A)^-1 z as a function of t and all rows of z, by the Cayley-Hamilton theorem, whose derivatives hold everywhere."""
    square, trace, eye = shape @ shape, shape.trace(axis1=-2, axis2=-1), np.broadcast_to(np.eye(3, dtype=shape.dtype), shape.shape)
    second = (trace**2 - square.trace(axis1=-2, axis2=-1)) / 2
    adjugate = square - trace[..., None, None] * shape + second[..., None, None] * eye
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
    rest = shape - mean[..., None, None] * np.broadcast_to(np.eye(3, dtype=shape.dtype), shape.shape)
    size = xp.sqrt((rest**2).sum(axis=(-2, -1)) / 6)
    rest = rest / xp.where(size > 0, size, 1.0)[..., None, None]
    cosine = xp.clip(_cofactors(rest)[1] / 2, -1, 1)
    return mean + 2 * size * xp.cos(xp.arccos(cosine) / 3)


def repeated(step: Callable[[Any], Any], state: Any, done: Callable[[Any], Any]) -> Any:
    """`step` until `done`: a loop of Python for arrays of NumPy, and one of JAX in a trace."""
    if isinstance(state[0], jax.Array):
        return jax.lax.while_loop(lambda now: ~done(now), step, state)
    while not done(state):
        state = step(state)
    return state


def foot(shape: Any, z: Any, near: Any) -> tuple[Any, Any]:
    """Multiplier t, z - y = t A y, of the nearest point y of x'Ax = 1 to each row of z, and y. near : t to start from."""
    apply = _pencil(shape)
    t = _ended(lambda t: _newton(apply, shape, z, t), -1 / _largest_eigenvalue(shape), near)
    return t, apply(t, z)


def _ended(newton: Callable[[Any], Any], lowest: Any, near: Any) -> Any:
    """The end of Newton steps from t near it, which lies above `lowest`."""
    xp = near.__array_namespace__()
    # Each Newton step doubles the digits: a step of a quarter of them leaves half, and the step after the loop gives the rest.
    quarter = float(np.finfo(near.dtype).eps) ** 0.25

    def again(carry: tuple) -> tuple:
        t, i, _ = carry
        new = xp.maximum(newton(t), (t + lowest) / 2)
        return new, i + 1, (abs(new - t) <= quarter * (new - lowest)).all()

    begin = (xp.where(near > lowest, near, 0.0), 0, False)
    return newton(repeated(again, begin, lambda carry: (carry[1] >= _FOOT) | carry[2])[0])


_differentiable = jax.custom_jvp(foot)


@_differentiable.defjvp
def _(values: tuple, changes: tuple) -> Any:
    """From (I + t A) y = z and y'Ay = 1, for the change a of A: y'A dy = -y'a y / 2 and (I + t A) dy = dz - t a y - dt A y."""
    (shape, z, near), (by_shape, by_z, _) = values, changes
    t, y = _differentiable(shape, z, near)
    normal, turned, apply = times(y, shape), times(y, by_shape), _pencil(shape)
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
    near, host = 0.0 * z[:, 0] if near is None else near, isinstance(z, np.ndarray)
    if host and push.ndim == 2:
        return _nearest_one(push, z.T, near)
    inverse = inverted(push)
    back = inverse.swapaxes(-1, -2)
    shape = back @ inverse
    t, y = foot(shape, z, near) if host else _differentiable(shape, z, jax.lax.stop_gradient(near))
    normal = times(y, shape)
    length = (normal**2).sum(axis=1) ** 0.5
    return Near(t * length, normal / length[:, None], times(y, back), curvature(shape, z), t, times(z, back))


def _nearest_one(push: np.ndarray, z: np.ndarray, near: np.ndarray) -> Near:
    """`nearest` for one symmetric P and z (3, n) on the host: along its principal axes, where a matrix is three numbers."""
    axes, turn = np.linalg.eigh(push)
    weight, along, ones = axes * axes, turn.T @ z, np.ones(3)  # sums over the axes are products: quicker in NumPy
    square = weight[:, None]

    def newton(t: np.ndarray) -> np.ndarray:
        steep = 1 / (square + t)
        part = along * steep
        part *= part
        g = weight @ part
        # at the centre of the ellipsoid both sums vanish
        return t + g * (np.sqrt(g) - 1) / np.maximum(weight @ (part * steep), 1e-300)

    t = _ended(newton, -weight.min(), near)
    normal, steep = along / (square + t), along / square
    length, bent = np.sqrt(ones @ (normal * normal)), steep * steep
    size = ones @ bent
    size = np.where(size > 0, size, 1.0)
    curved = ((1 / weight).sum() - 1 / weight) @ bent / (2 * size * np.sqrt(size))
    back = turn * axes
    return Near(t * length, (turn @ (normal / length)).T, (back @ normal).T, curved, t, (back @ steep).T)


def slopes_of(near: Near, basis: np.ndarray) -> Any:
    """Derivative (n, p) of the distances of readings to an ellipsoid by its parameters."""
    normal, field = near.normal.T, near.field.T
    return -(basis[:9].T @ (normal[:, None] * field[None]).reshape(9, -1) + basis[9:].T @ normal).T


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


class Weights(namedtuple("Weights", "noise2 ridge noise scaled inverse freedom")):
    """What a round knows of the noise.

    noise2 : variance for the curvature term. ridge : weight of the prior's squares. noise : standard deviation. scaled : (p, p) normal
    equations with columns of unit length. inverse : (p, p) covariance over the variance of the noise. freedom : readings less the
    parameters that they, not the prior, determine.
    """


class Found(namedtuple("Found", "parameters soft centre covariance noise freedom distance near converged kind basis noise2")):
    """A fitted surface: parameters (p,), their covariance, noise and its degrees of freedom, distances (n,), and its readings.

    soft, centre : S and the centre of an ellipsoid in scaled readings. basis : from the parameters to their entries. noise2 : for the
    curvature term, in the distances.
    """


def prior_of(basis: np.ndarray, size: Any) -> tuple[Any, ...]:
    """The prior's squares as a matrix (p, p), the mean (p,) of the diagonal of S by the parameters, `size` of the surface, and a floor.

    The squares are those of the entries of S less a multiple of the identity. The floor (p, p) keeps normal equations regular.
    """
    mean = (basis[0] + basis[4] + basis[8]) / 3
    out = basis[:9] - np.eye(3, dtype=basis.dtype).reshape(9, 1) * mean
    return out.T @ out, mean, size, rounding_of(mean) * np.eye(mean.size, dtype=basis.dtype)


def terms(x: Any, variance: Any, prior: Sequence[Any]) -> tuple[Any, Any]:
    """Variance for the curvature term, and weight of the prior, for a variance of the noise."""
    xp, mean = x.__array_namespace__(), prior[1] @ x
    # a noise too small matters not, and with one too large there is no surface
    radius2 = (prior[2] * mean) ** 2
    curved = (0.25 * radius2 > variance) & (variance > CURVED**2 * radius2)
    return xp.where(curved, variance, 0.0), variance / (SOFT * mean) ** 2


def weighed(x: Any, rows: Any, left: Any, ridge: Any, prior: Sequence[Any]) -> Weights:
    """The noise by what is left of the distances, whose slopes are `rows`, and the weights that it gives; ridge : weight of the prior."""
    xp = x.__array_namespace__()
    normal = rows.T @ rows + ridge * prior[0]
    column = xp.sqrt(normal.diagonal())
    column = xp.where(column > 0, column, 1.0)
    unit = column[:, None] * column[None]
    scaled = normal / unit
    inverse = xp.linalg.inv(scaled + prior[3]) / unit
    freedom = xp.maximum(len(rows) - x.size + ridge * (prior[0] * inverse).sum(), 1.0)
    noise2 = left @ left / freedom
    return Weights(*terms(x, noise2, prior), xp.sqrt(noise2), scaled, inverse, freedom)


class _Point(namedtuple("_Point", "x near last weights cost step off share count converged done")):
    """Parameters, readings beside their surface, the weights before and there, the cost, the next step, its size and share; if done."""


def rounds(near_at: Callable[[Any, Near], Near], x: Any, near: Near, prior: Sequence[Any]) -> tuple[Any, Near, Weights, Any]:
    """The end x of the steps with the readings beside the surface there, its weights, and whether it has converged.

    Gauss-Newton steps, each with the noise that the distances before it show; a step that raises the cost is shortened.
    near_at : takes parameters, and the readings beside a surface not far from theirs, to the readings beside theirs.
    """
    xp, rounding, eps = x.__array_namespace__(), rounding_of(x), float(np.finfo(x.dtype).eps)

    def cost(x: Any, left: Any, ridge: Any) -> Any:
        return left @ left + ridge * (x @ prior[0] @ x)

    def point(x: Any, near: Near, last: Sequence[Any], before: Any, count: Any) -> _Point:
        left = near.distance - last[0] * near.curvature
        weights = weighed(x, near.slopes, left, last[1], prior)
        gradient = near.slopes.T @ left + last[1] * (prior[0] @ x)
        step, total = -(weights.inverse @ gradient), cost(x, left, last[1])
        # squares of the step, and of what newer weights add to it, in standard errors
        one, newer = xp.where(total > 0, total / len(left), 1.0), (weights.ridge - last[1]) * (prior[0] @ x)
        newer = newer - (weights.noise2 - last[0]) * (near.slopes.T @ near.curvature)
        off, late = -(gradient @ step) / one, newer @ weights.inverse @ newer / one
        # more steps shrink as this one has, or by the noise over the radius: the slopes leave out how the surface bends
        rate = xp.minimum(xp.maximum(off / xp.maximum(before, eps**4), (weights.noise * near.curvature.max()) ** 2), 1.0)
        short = step @ step <= rounding**2 * (x @ x)
        settled = (late <= SETTLED**2) & (abs(weights.freedom - last[2]) <= (SETTLED + rounding) * weights.freedom)
        flat = ((off * rate <= SETTLED**2) | short) & xp.isfinite(total)
        done = flat & settled | ~xp.isfinite(weights.noise) | (count >= _STEPS)
        return _Point(x, near, last, weights, total, step, off, 0.0 * off + 1.0, count, flat, done)

    def advance(here: _Point) -> _Point:
        x = here.x + here.share * here.step
        near = near_at(x, here.near)
        # the offset is that of the point from which a step begins, whose slopes leave the curvature's out
        left = near.distance - here.last[0] * here.near.curvature
        # So near the solution that the cost only changes by rounding it cannot judge a step. Distances have the rounding of the field.
        off = eps * prior[2] * abs(prior[1] @ here.x) * xp.sqrt(len(left) * here.cost)
        better = cost(x, left, here.last[1]) <= (1 + rounding) * here.cost + 2 * off
        shorter = here._replace(share=here.share / 4, count=here.count + 1, done=here.count >= _STEPS)
        if xp is np and not better:
            return shorter
        weights = here.weights
        there = point(x, near, (weights.noise2, weights.ridge, weights.freedom), here.off, here.count + 1)
        return there if xp is np else jax.tree.map(lambda new, old: xp.where(better, new, old), there, shorter)

    near = near_at(x, near)  # which also gives the start its shapes
    freedom = xp.asarray(max(len(near.distance) - x.size, 1.0), dtype=x.dtype)
    begin = point(x, near, (*terms(x, near.distance @ near.distance / freedom, prior), freedom), 0.0 * freedom, xp.asarray(0))
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
    basis, kind, none, prior = surface.basis, surface.kind, 0.0 * h[:, 0], prior_of(surface.basis, surface.size)
    near = Near(none, h, h, none, none, h, h)
    if still:
        near = surface.near(begin, near, *surface.data)
        weights = weighed(begin, near.slopes, near.distance, 0.0, prior)._replace(noise2=0.0, ridge=0.0)
        return found_of(begin, near, weights, basis, True, kind)
    if isinstance(begin, np.ndarray):
        x, near, weights, converged = rounds(lambda x, near: surface.near(x, near, *surface.data), begin, near, prior)
        return found_of(x, near, weights, basis, converged, kind)

    def solver(begin: Any, near: Near, size: Any, *data: Any) -> tuple:
        x, near, weights, converged = rounds(lambda x, near: surface.near(x, near, *data), begin, near, prior_of(basis, size))
        return jnp.append(x, weights.noise**2), (near, converged.astype(x.dtype))

    def score(root: Any, further: tuple, _: Any, __: Near, size: Any, *data: Any) -> Any:
        x, near, known = root[:-1], surface.settled(root[:-1], further[0], *data), prior_of(basis, size)
        noise2, ridge = terms(x, root[-1], known)
        left = near.distance - noise2 * near.curvature
        after = weighed(x, near.slopes, left, ridge, known)
        slope = near.slopes.T @ left + ridge * (prior[0] @ x)
        return jnp.append(slope, after.noise**2 - root[-1])

    begin, near = jax.lax.stop_gradient((begin, near))
    root, (near, converged) = implicit(solver, score, begin, near, jnp.asarray(surface.size, h.dtype), *surface.data)
    x, near = root[:-1], surface.settled(root[:-1], near, *surface.data)
    noise2, ridge = terms(x, root[-1], prior)
    left = near.distance - noise2 * near.curvature
    return found_of(x, near, weighed(x, near.slopes, left, ridge, prior), basis, converged > 0, kind)
