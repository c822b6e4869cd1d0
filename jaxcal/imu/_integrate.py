"""Attitude from sampled angular rate for many segments at once, with exact derivatives at little extra cost."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from .._arrays import skew
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


def _steps(matrix: Array, column: Array, dt: Array) -> Step:
    rate = column @ matrix.T
    return closed_form(rate[:, :-1], rate[:, 1:], dt[..., None])


@jax.custom_jvp
def attitude(matrix: Array, column: Array, dt: Array) -> Array:
    """Integrate the rate `matrix` @ `column` over segments: the rotation from the last to the first body axes of each segment.

    Every gyroscope model that is linear in the readings has this form. A fit needs only the derivative with respect to the matrix, which
    is one sum over the samples:

        d theta = sum_j R(q_j..end)' (A_j dW z_j + B_j dW z_j+1),

    where A and B are the derivatives of the small rotation of a step with respect to the rates at its two ends.

    Parameters
    ----------
    matrix : (3, c). column : (s, n + 1, c). dt : (s, n) s, zero for padding.

    Returns
    -------
    (s, 3, 3)
    """
    steps = jnp.moveaxis(_steps(matrix, column, dt).rotation, 1, 0)
    # backwards from the last step, like the derivative below, so that both round alike
    return jax.lax.scan(lambda later, step: (step @ later, None), steps[-1], steps[:-1], reverse=True)[0]


def _attitude_jvp(primals, tangents):
    matrix, column, dt = primals
    slope, moved, shifted = tangents
    step = _steps(matrix, column, dt)
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
