"""Attitude from sampled angular rate for many segments at once, with exact derivatives at little extra cost."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from .._rotation import conjugate, matrix as rotation_matrix, normalised, product, skew
from .._types import Any, Array


class Step(eqx.Module):
    """Rotation (..., 3, 3) from the axes after a step to those before it, and its derivative.

    before, after : (..., 3, 3) derivative of the rotation by the rate at the two ends of the step, as a small rotation in the axes after
        the step, rad per rad/s.
    width : (..., 3) derivative of the rotation by the length of the step, rad/s.
    """

    rotation: Array
    before: Any
    after: Any
    width: Any


def closed_form(first: Array, second: Array, dt: Array) -> Step:
    """Step (rates in rad/s, dt (..., 1) in s) with the mean rate times dt as rotation vector, plus the coning term of a linear rate.

    P. G. Savage, J. Guid. Control Dyn. 21 (1998) 19; the error of a step is of fifth order in dt.
    """
    a, b, h = skew(first), skew(second), dt[..., None]
    one = jnp.broadcast_to(jnp.eye(3, dtype=first.dtype), a.shape)
    coning = (a @ second[..., None])[..., 0]
    v = (first + second) * (dt / 2) + coning * (dt**2 / 12)
    square = jnp.sum(v**2, axis=-1)[..., None, None]
    # double `where`, because sqrt has no derivative at zero; below the switch the series are exact to rounding
    small = square < 1e-3
    angle = jnp.sqrt(jnp.where(small, 1, square))
    sine = jnp.where(small, 1 - square / 6 + square**2 / 120 - square**3 / 5040 + square**4 / 362880, jnp.sin(angle) / angle)
    cosine = jnp.where(
        small, 1 / 2 - square / 24 + square**2 / 720 - square**3 / 40320 + square**4 / 3628800, (1 - jnp.cos(angle)) / angle**2
    )
    third = jnp.where(small, 1 / 6 - square / 120 + square**2 / 5040 - square**3 / 362880, (1 - sine) / jnp.where(small, 1, square))
    k = skew(v)
    k2 = k @ k
    rate = (first + second) / 2 + coning * (dt / 6)
    right = one - cosine * k + third * k2  # derivative by the rotation vector, in the axes after the step
    return Step(
        one + sine * k + cosine * k2,
        right @ (one * (h / 2) - b * (h**2 / 12)),
        right @ (one * (h / 2) + a * (h**2 / 12)),
        (right @ rate[..., None])[..., 0],
    )


def _fourth_order(first: Array, second: Array, dt: Array) -> Array:
    def tail(w: Array) -> Array:
        return jnp.concatenate([jnp.zeros_like(w[..., :1]), w], axis=-1)

    middle, first, last = tail((first + second) / 2), tail(first), tail(second)
    one = jnp.zeros_like(first).at[..., 0].set(1)
    k1 = first / 2
    k2 = product(one + dt / 2 * k1, middle) / 2
    k3 = product(one + dt / 2 * k2, middle) / 2
    k4 = product(one + dt * k3, last) / 2
    return normalised(one + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4))


def runge_kutta(first: Array, second: Array, dt: Array) -> Step:
    """Step by the fourth-order Runge-Kutta formula for q' = q w / 2, normalised, as in imu_tk.

    The equation is linear in q, so a step multiplies every q by the same quaternion.
    """
    q = _fourth_order(first, second, dt)

    def turned(along: Array) -> Array:
        tangents = tuple(jnp.broadcast_to(part, x.shape) for part, x in zip(jnp.split(along, [3, 6]), (first, second, dt), strict=True))
        return 2 * product(conjugate(q), jax.jvp(_fourth_order, (first, second, dt), tangents)[1])[..., 1:]

    slope = jax.vmap(turned, out_axes=-1)(jnp.eye(7, dtype=first.dtype))
    return Step(rotation_matrix(q), slope[..., :3], slope[..., 3:6], slope[..., 6])


INTEGRATORS = {"closed_form": closed_form, "runge_kutta": runge_kutta}


def _steps(matrix: Array, column: Array, dt: Array, integrator: str) -> Step:
    rate = column @ matrix.T
    return INTEGRATORS[integrator](rate[:, :-1], rate[:, 1:], dt[..., None])


@functools.partial(jax.custom_jvp, nondiff_argnums=(3,))
def attitude(matrix: Array, column: Array, dt: Array, integrator: str = "closed_form") -> Array:
    """Integrate the rate `matrix` @ `column` over segments: the rotation from the last to the first body axes of each segment.

    Every gyroscope model that is linear in the readings has this form. A fit needs only the derivative with respect to the matrix, which
    is one sum over the samples:

        d theta = sum_j R(q_j..end)' (A_j dW z_j + B_j dW z_j+1),

    where A and B are the derivatives of the small rotation of a step with respect to the rates at its two ends.

    Parameters
    ----------
    matrix : (3, c). column : (s, n + 1, c). dt : (s, n) s, zero for padding.
    integrator : a key of `INTEGRATORS`.

    Returns
    -------
    (s, 3, 3)
    """
    steps = jnp.moveaxis(_steps(matrix, column, dt, integrator).rotation, 1, 0)
    # backwards from the last step, like the derivative below, so that both round alike
    return jax.lax.scan(lambda later, step: (step @ later, None), steps[-1], steps[:-1], reverse=True)[0]


def _attitude_jvp(integrator, primals, tangents):
    matrix, column, dt = primals
    slope, moved, shifted = tangents
    step = _steps(matrix, column, dt, integrator)
    ordered = jnp.moveaxis(step.rotation, 1, 0)
    identity = jnp.broadcast_to(jnp.eye(3, dtype=matrix.dtype), ordered[0].shape)
    end, later = jax.lax.scan(lambda later, step: (step @ later, later), identity, ordered, reverse=True)
    later = jnp.moveaxis(later, 0, 1)
    before, after = jnp.swapaxes(later, -1, -2) @ step.before, jnp.swapaxes(later, -1, -2) @ step.after
    turn = jnp.zeros_like(end[:, 0])
    if not isinstance(slope, SymbolicZero):
        share = jnp.einsum("snab,snc->sabc", before, column[:, :-1]) + jnp.einsum("snab,snc->sabc", after, column[:, 1:])
        turn = turn + jnp.einsum("sabc,bc->sa", share, slope)
    if not isinstance(moved, SymbolicZero):
        change = moved @ matrix.T
        turn = turn + jnp.einsum("snab,snb->sa", before, change[:, :-1]) + jnp.einsum("snab,snb->sa", after, change[:, 1:])
    if not isinstance(shifted, SymbolicZero):
        turn = turn + jnp.einsum("snba,snb,sn->sa", later, step.width, shifted)
    return end, end @ skew(turn)


attitude.defjvp(_attitude_jvp, symbolic_zeros=True)
