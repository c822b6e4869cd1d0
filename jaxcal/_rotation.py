"""Rotations: unit quaternions (scalar first) and rotation vectors, with derivatives that hold at the identity.

A quaternion q stands for the matrix R(q) that `rotate` applies; the product of quaternions is that of the matrices.
Leading axes are batch axes.
"""

import jax.numpy as jnp

from ._types import AnyArray, Array, Float

Quaternion = Float[AnyArray, "*batch 4"]
Vector = Float[AnyArray, "*batch 3"]


def product(a: Quaternion, b: Quaternion) -> Array:
    """Hamilton product a b: first b turns, then a.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal._rotation import product
    >>> i, j = jnp.array([0.0, 1.0, 0.0, 0.0]), jnp.array([0.0, 0.0, 1.0, 0.0])
    >>> print(product(i, j))
    [0. 0. 0. 1.]
    """
    a0, a1, a2, a3 = jnp.moveaxis(jnp.asarray(a), -1, 0)
    b0, b1, b2, b3 = jnp.moveaxis(jnp.asarray(b), -1, 0)
    return jnp.stack(
        [
            a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
            a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
            a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
            a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
        ],
        axis=-1,
    )


def conjugate(q: Quaternion) -> Array:
    """The inverse rotation."""
    q = jnp.asarray(q)
    return jnp.concatenate([q[..., :1], -q[..., 1:]], axis=-1)


def normalised(q: Quaternion) -> Array:
    """Unit quaternion along q, which is not zero."""
    q = jnp.asarray(q)
    return q / jnp.sqrt(jnp.sum(q * q, axis=-1, keepdims=True))


def exponential(v: Vector) -> Array:
    """Quaternion of the rotation vector v (rad): cos(|v|/2), v/|v| sin(|v|/2).

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal._rotation import exponential
    >>> print(exponential(jnp.zeros(3)))
    [1. 0. 0. 0.]
    """
    v = jnp.asarray(v)
    square = jnp.sum(v * v, axis=-1, keepdims=True)
    # Double where: sqrt has no derivative at zero; the series is exact to rounding below the switch.
    small = square < jnp.finfo(v.dtype).eps ** 0.5
    angle = jnp.sqrt(jnp.where(small, 1, square))
    cosine = jnp.where(small, 1 - square / 8 + square**2 / 384, jnp.cos(angle / 2))
    ratio = jnp.where(small, 0.5 - square / 48 + square**2 / 3840, jnp.sin(angle / 2) / angle)
    return jnp.concatenate([cosine, ratio * v], axis=-1)


def logarithm(q: Quaternion) -> Array:
    """Rotation vector (rad), of at most pi, of the unit quaternion q.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal._rotation import exponential, logarithm
    >>> print(logarithm(exponential(jnp.array([0.0, 0.5, 0.0]))).round(4))
    [0.  0.5 0. ]
    """
    q = jnp.asarray(q)
    q = jnp.where(q[..., :1] < 0, -q, q)
    square = jnp.sum(q[..., 1:] ** 2, axis=-1, keepdims=True)
    small = square < jnp.finfo(q.dtype).eps ** 0.5
    sine = jnp.sqrt(jnp.where(small, 1, square))
    ratio = jnp.where(small, 2 + square / 3 + 3 * square**2 / 20, 2 * jnp.arctan2(sine, q[..., :1]) / sine)
    return ratio * q[..., 1:]


def rotate(q: Quaternion, v: Vector) -> Array:
    """R(q) v.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal._rotation import exponential, rotate
    >>> print(rotate(exponential(jnp.array([0.0, 0.0, jnp.pi / 2])), jnp.array([1.0, 0.0, 0.0])).round(6))
    [0. 1. 0.]
    """
    q, v = jnp.asarray(q), jnp.asarray(v)
    twice = 2 * jnp.cross(q[..., 1:], v)
    return v + q[..., :1] * twice + jnp.cross(q[..., 1:], twice)


def matrix(q: Quaternion) -> Array:
    """R(q), (..., 3, 3)."""
    q = jnp.asarray(q)
    columns = [rotate(q, jnp.broadcast_to(axis, (*q.shape[:-1], 3))) for axis in jnp.eye(3, dtype=q.dtype)]
    return jnp.stack(columns, axis=-1)
