"""Frames: north-east-down N, table T, body B; the Earth's rate and the vertical in table axes."""

import jax.numpy as jnp
import numpy as np

from .._types import Array

#: rad/s, and m/s^2
EARTH_RATE = 7.292115e-5
GRAVITY = 9.80665

#: mounting -> sensitive axis and the two cross axes, in body axes
AXES: dict[str, np.ndarray] = {
    "x": np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]),
    "y": np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]]),
    "z": np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    "-z": np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),
}


def wrap(angle: Array) -> Array:
    """The angle in (-pi, pi]."""
    return angle - 2 * np.pi * jnp.ceil((angle - np.pi) / (2 * np.pi))


def table_from_nav(phi: Array, theta: Array, psi: Array) -> Array:
    """C_TN = Rx(phi) Ry(theta) Rz(psi), (3, 3)."""
    sf, cf, st, ct, sp, cp = (f(a) for a in (phi, theta, psi) for f in (jnp.sin, jnp.cos))
    return jnp.stack(
        [
            jnp.stack([ct * cp, ct * sp, -st]),
            jnp.stack([sf * st * cp - cf * sp, sf * st * sp + cf * cp, sf * ct]),
            jnp.stack([cf * st * cp + sf * sp, cf * st * sp - sf * cp, cf * ct]),
        ]
    )


def angles_of(matrix: Array) -> Array:
    """(phi, theta, psi) of C_TN."""
    level = jnp.hypot(matrix[1, 2], matrix[2, 2])
    return jnp.stack([jnp.arctan2(matrix[1, 2], matrix[2, 2]), jnp.arctan2(-matrix[0, 2], level), jnp.arctan2(matrix[0, 1], matrix[0, 0])])


def turned(matrix: Array, rotation: Array) -> Array:
    """C_TN after a small turn (rotation vector, table axes) by the Cayley formula: regular at every attitude."""
    x, y, z = rotation / 2
    zero = jnp.zeros_like(x)
    skew = jnp.stack([jnp.stack([zero, -z, y]), jnp.stack([z, zero, -x]), jnp.stack([-y, x, zero])])
    # (1 + S)^-1 (1 - S) in closed form
    return matrix - 2 * ((skew - skew @ skew) @ matrix) / (1 + x * x + y * y + z * z)


def earth_rate(matrix: Array, latitude: Array) -> Array:
    """Earth's rate in table axes over its size, W = C_TN [cos lat, 0, -sin lat]."""
    return matrix[:, 0] * jnp.cos(latitude) - matrix[:, 2] * jnp.sin(latitude)


def in_body(vector: Array, angle: Array, attenuation: Array) -> Array:
    """A vector of table axes in body axes at every table angle, (n, 3); a sector's mean attenuates the two turning components."""
    c, s = attenuation * jnp.cos(angle), attenuation * jnp.sin(angle)
    return jnp.stack([vector[0] * c + vector[1] * s, -vector[0] * s + vector[1] * c, jnp.broadcast_to(vector[2], c.shape)], axis=1)
