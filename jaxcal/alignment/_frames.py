"""Frames: north-east-down N, table T, body B; the Earth's rate and the vertical in table axes."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from .._precision import array_module
from .._types import AnyArray, Array

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


def wrap(angle: Any) -> Any:
    """The angle in (-pi, pi]."""
    return angle - 2 * np.pi * array_module(angle).ceil((angle - np.pi) / (2 * np.pi))


def distance(first: Any, second: Any) -> Any:
    """Size of the angle between two azimuths."""
    return abs(wrap(first - second))


def table_from_nav(phi: Any, theta: Any, psi: Any) -> AnyArray:
    """C_TN = Rx(phi) Ry(theta) Rz(psi), (3, 3)."""
    xp = array_module(phi, theta, psi)
    sf, cf, st, ct, sp, cp = (f(a) for a in (phi, theta, psi) for f in (xp.sin, xp.cos))
    return xp.stack(
        [
            xp.stack([ct * cp, ct * sp, -st]),
            xp.stack([sf * st * cp - cf * sp, sf * st * sp + cf * cp, sf * ct]),
            xp.stack([cf * st * cp + sf * sp, cf * st * sp - sf * cp, cf * ct]),
        ]
    )


def angles_of(matrix: Array) -> Array:
    """(phi, theta, psi) of C_TN."""
    level = jnp.hypot(matrix[1, 2], matrix[2, 2])
    return jnp.stack([jnp.arctan2(matrix[1, 2], matrix[2, 2]), jnp.arctan2(-matrix[0, 2], level), jnp.arctan2(matrix[0, 1], matrix[0, 0])])
