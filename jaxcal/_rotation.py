"""Rotations: unit quaternions (scalar first) and rotation vectors, with derivatives that are valid at the identity.

A quaternion q represents the matrix R(q); the product of quaternions represents the product of the matrices. Leading axes are batch axes.
"""

import jax.numpy as jnp

from ._types import AnyArray, Array, Float

Quaternion = Float[AnyArray, "*batch 4"]
Vector = Float[AnyArray, "*batch 3"]


def product(a: Quaternion, b: Quaternion) -> Array:
    """Hamilton product a b: rotates first by b, then by a."""
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


def normalised(q: Quaternion) -> Array:
    """Unit quaternion in the direction of q, which must not be zero."""
    q = jnp.asarray(q)
    return q / jnp.sqrt(jnp.sum(q * q, axis=-1, keepdims=True))


def matrix(q: Quaternion) -> Array:
    """R(q), (..., 3, 3)."""
    q = jnp.asarray(q)[..., None, :]
    axes = jnp.broadcast_to(jnp.eye(3, dtype=q.dtype), (*q.shape[:-2], 3, 3))
    twice = 2 * jnp.cross(q[..., 1:], axes)
    return jnp.swapaxes(axes + q[..., :1] * twice + jnp.cross(q[..., 1:], twice), -1, -2)
