"""Signed orthogonal distance to an ellipsoid, with exact derivatives of every order that a fit needs."""

import jax
import jax.numpy as jnp

from ..._types import Array, Float

#: enough for readings deep inside; readings near the surface need three
_ITERATIONS = 12


def _pencil(shape: Array, z: Array):
    """y(t) = (I + t A)^-1 z as a function of t, for all rows of z, by the Cayley-Hamilton theorem without a decomposition."""
    square = shape @ shape
    trace = jnp.trace(shape)
    second = (trace**2 - jnp.trace(square)) / 2
    adjugate = square - trace * shape + second * jnp.eye(3, dtype=shape.dtype)
    det = jnp.sum(shape[0] * adjugate[:, 0])

    def apply(t, vector):
        t = t[:, None]
        numerator = vector + t * (trace * vector - vector @ shape) + t**2 * (vector @ adjugate)
        return numerator / (1 + t * (trace + t * (second + t * det)))

    return apply


def _newton(apply, shape, z, t):
    """One Newton step in t on 1/sqrt(y'Ay) = 1, which is nearly linear in t, where y = y(t)."""
    y = apply(t, z)
    normal = y @ shape
    g = jnp.sum(y * normal, axis=1)
    q = jnp.sum(normal * apply(t, normal), axis=1)
    # Replace the inputs as well: at the centre of the ellipsoid all of these vanish.
    g, q = jnp.where(q > 0, g, 1), jnp.where(q > 0, q, 1)
    return t + g * (jnp.sqrt(g) - 1) / q


def _largest_eigenvalue(shape: Array) -> Array:
    """Largest eigenvalue in closed form (O. K. Smith, Commun. ACM 4 (1961) 168), because a LAPACK call would cost more than a step."""
    mean = jnp.trace(shape) / 3
    rest = shape - mean * jnp.eye(3, dtype=shape.dtype)
    size = jnp.sqrt(jnp.sum(rest**2) / 6)
    rest = rest / jnp.where(size > 0, size, 1)
    cosine = jnp.clip(jnp.sum(rest[0] * jnp.cross(rest[1], rest[2])) / 2, -1, 1)
    return mean + 2 * size * jnp.cos(jnp.arccos(cosine) / 3)


def foot(shape: Float[Array, "3 3"], z: Float[Array, "n 3"]) -> tuple[Float[Array, " n"], Float[Array, "n 3"]]:
    """Nearest point y of x'Ax = 1 to each row of z, and t with z - y = t A y; both can be differentiated once."""
    fixed, far = jax.lax.stop_gradient(shape), jax.lax.stop_gradient(z)
    apply = _pencil(fixed, far)
    lowest = -1 / _largest_eigenvalue(fixed)
    # Each Newton step doubles the digits: half of them here, and the step after the loop gives the rest.
    half = jnp.finfo(far.dtype).eps ** 0.5

    def again(carry):
        i, t, _ = carry
        new = _newton(apply, fixed, far, t)
        new = jnp.where(new > lowest, new, (t + lowest) / 2)
        return i + 1, new, jnp.all(jnp.abs(new - t) <= half * (new - lowest))

    begin = (0, jnp.zeros_like(far[:, 0]), jnp.asarray(False))
    _, t, _ = jax.lax.while_loop(lambda carry: (carry[0] < _ITERATIONS) & ~carry[2], again, begin)
    # A step taken at the root has the derivative of the root (implicit function theorem).
    apply = _pencil(shape, z)
    t = _newton(apply, shape, z, jax.lax.stop_gradient(t))
    return t, apply(t, z)


@jax.jit
def distance_slopes(shape, z):
    r"""Signed distance, positive outside, and its derivatives with respect to the nine entries of A and to z.

    With the nearest point y and the normal g = A y, the distance is t|g|, and its differential is

    .. math:: \mathrm d d = \frac{y^T\,\mathrm dA\,y}{2|g|} + \frac{g^T \mathrm dz}{|g|}.
    """
    t, y = foot(shape, z)
    normal = y @ shape
    length = jnp.linalg.norm(normal, axis=1)
    return t * length, _outer(y, y) / (2 * length)[:, None], normal / length[:, None]


def _outer(a: Array, b: Array) -> Array:
    """The nine products of the entries of each pair of rows."""
    return (a[:, :, None] * b[:, None, :]).reshape(-1, 9)


@jax.jit
def curvature_slopes(shape, z):
    r"""Mean curvature of the level set of x'Ax through each row of z, and its derivatives with respect to the entries of A and to z.

    It is half the sum of the principal curvatures, 1/R on a sphere of radius R. With the normal g = A z and T = tr A it is

    .. math:: \kappa = \frac{T\,g^Tg - g^TAg}{2|g|^3}.
    """
    normal = z @ shape
    bent = jnp.trace(shape) * normal - normal @ shape
    square = jnp.sum(normal**2, axis=1)
    square = jnp.where(square > 0, square, 1)  # the centre has no direction
    cube = square * jnp.sqrt(square)
    curvature = jnp.sum(normal * bent, axis=1) / (2 * cube)
    by_normal = bent / cube[:, None] - (3 * curvature / square)[:, None] * normal
    trace = jnp.eye(3, dtype=shape.dtype).reshape(1, 9) * square[:, None]
    return curvature, _outer(z, by_normal) + (trace - _outer(normal, normal)) / (2 * cube)[:, None], by_normal @ shape


@jax.custom_jvp
def corrected_distance(shape: Float[Array, "3 3"], z: Float[Array, "n 3"], noise2: Float[Array, ""]) -> Float[Array, " n"]:
    """Signed distance minus sigma^2 times the mean curvature, differentiated together."""
    return distance_slopes(shape, z)[0] - noise2 * curvature_slopes(shape, z)[0]


@corrected_distance.defjvp
def _(primals, tangents):
    (shape, z, noise2), (d_shape, d_z, d_noise2) = primals, tangents
    distance, curvature = distance_slopes(shape, z), curvature_slopes(shape, z)
    value, by_shape, by_z = (a - noise2 * b for a, b in zip(distance, curvature, strict=True))
    # keeping the derivatives separate from the tangents lets all parameters share them
    return value, by_shape @ d_shape.reshape(9) + jnp.sum(by_z * d_z, axis=1) - d_noise2 * curvature[0]
