"""Attitude from sampled angular rate, all segments at once, with exact derivatives that cost little more than the attitude itself."""

import functools

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from .._errors import DataError
from .._rotation import conjugate, exponential, normalised, product, rotate
from .._types import Array


def _tail(w: Array) -> Array:
    return jnp.concatenate([jnp.zeros_like(w[..., :1]), w], axis=-1)


def closed_form(first: Array, second: Array, dt: Array) -> Array:
    """Quaternion of a step between two samples of the rate: their mean, and the coning term of a rate linear between them.

    P. G. Savage, J. Guid. Control Dyn. 21 (1998) 19; the error of a step is of fifth order in dt.

    Parameters
    ----------
    first, second : (..., 3) rad/s. dt : (..., 1) s, zero for padding.

    Returns
    -------
    (..., 4), from the axes at the end of the step to those at its begin.
    """
    return exponential((first + second) * (dt / 2) + jnp.cross(first, second) * (dt**2 / 12))


def runge_kutta(first: Array, second: Array, dt: Array) -> Array:
    """The same by one fourth-order Runge-Kutta step of q' = q w / 2, normalised, as imu_tk does it.

    The equation is linear in q, so that a step multiplies q by a quaternion of its own, wherever q is.
    """
    middle, first, last = _tail((first + second) / 2), _tail(first), _tail(second)
    one = jnp.zeros_like(first).at[..., 0].set(1)
    k1 = first / 2
    k2 = product(one + dt / 2 * k1, middle) / 2
    k3 = product(one + dt / 2 * k2, middle) / 2
    k4 = product(one + dt * k3, last) / 2
    return normalised(one + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4))


INTEGRATORS = {"closed_form": closed_form, "runge_kutta": runge_kutta}


def _rates(matrix: Array, column: Array) -> Array:
    return jnp.einsum("ij,...j->...i", matrix, column)


@functools.partial(jax.custom_jvp, nondiff_argnums=(3,))
def attitude(matrix: Array, column: Array, dt: Array, integrator: str = "closed_form") -> Array:
    """Quaternion from the last to the first body axes of segments whose rate is `matrix` @ `column`.

    Every model of a gyroscope that is linear in the readings has this form, whatever its parameters are, and the derivative with
    respect to the matrix, which is all that a fit needs, is one sum over the samples:

        d theta = sum_j R(q_j..end)' (A_j dW z_j + B_j dW z_j+1),

    with A and B the derivatives of a step's own small turn with respect to the rates at its ends.

    Parameters
    ----------
    matrix : (3, c). column : (s, n + 1, c). dt : (s, n) s, zero for padding; a constant of the derivative.
    integrator : a key of `INTEGRATORS`.

    Returns
    -------
    (s, 4)
    """
    rate = _rates(matrix, column)
    steps = INTEGRATORS[integrator](rate[:, :-1], rate[:, 1:], dt[..., None])
    # from the last step on, as the derivative below does: the same rounding in both
    steps = jnp.moveaxis(steps, 1, 0)
    return jax.lax.scan(lambda q, step: (product(step, q), None), steps[-1], steps[:-1], reverse=True)[0]


@functools.partial(jax.jit, static_argnums=5)
def _derivative(attitudes: Array, steps: Array, first: Array, second: Array, dt: Array, integrator: str) -> tuple[Array, Array]:
    """R' A and R' B of every step, (s, n, 3, 3)."""

    def small_turn(before: Array, after: Array) -> Array:
        tangents = jnp.broadcast_to(before, first.shape), jnp.broadcast_to(after, first.shape)
        slope = jax.jvp(lambda a, b: INTEGRATORS[integrator](a, b, dt), (first, second), tangents)[1]
        return rotate(conjugate(attitudes), 2 * product(conjugate(steps), slope)[..., 1:])

    axes, none = jnp.eye(3, dtype=first.dtype), jnp.zeros((3, 3), dtype=first.dtype)
    parts = jax.vmap(small_turn, out_axes=-1)(jnp.concatenate([axes, none]), jnp.concatenate([none, axes]))
    return parts[..., :3], parts[..., 3:]


def _attitude_jvp(integrator, primals, tangents):
    matrix, column, dt = primals
    slope, moved, shifted = tangents
    if not isinstance(shifted, SymbolicZero):
        raise DataError("the attitude has no derivative with respect to the steps of time; differentiate it with these held fixed")
    rate = _rates(matrix, column)
    first, second, width = rate[:, :-1], rate[:, 1:], dt[..., None]
    steps = INTEGRATORS[integrator](first, second, width)

    def grow(q, step):
        return product(step, q), q

    ordered = jnp.moveaxis(steps, 1, 0)
    identity = jnp.zeros_like(ordered[0]).at[:, 0].set(1)
    end, later = jax.lax.scan(grow, identity, ordered, reverse=True)
    before, after = _derivative(jnp.moveaxis(later, 0, 1), steps, first, second, width, integrator)
    turn = jnp.zeros_like(end[:, 1:])
    if not isinstance(slope, SymbolicZero):
        share = jnp.einsum("snab,snc->sabc", before, column[:, :-1]) + jnp.einsum("snab,snc->sabc", after, column[:, 1:])
        turn = turn + jnp.einsum("sabc,bc->sa", share, slope)
    if not isinstance(moved, SymbolicZero):
        change = _rates(matrix, moved)
        turn = turn + jnp.einsum("snab,snb->sa", before, change[:, :-1]) + jnp.einsum("snab,snb->sa", after, change[:, 1:])
    return end, product(end, _tail(turn / 2))


attitude.defjvp(_attitude_jvp, symbolic_zeros=True)
