"""Which frame a calibration without reference attitudes speaks of: three conventions of one map, exact in both directions."""

import equinox as eqx
import jax.numpy as jnp

from .._types import Any, Array

CONVENTIONS = ("upper", "lower", "full")


def _upper(gram: Array) -> Array:
    """Upper triangular factor with a positive diagonal, D'D = gram."""
    return jnp.linalg.cholesky(gram).T


def turned_to(correction: Any, convention: str) -> Array:
    """The matrix D' with D'^T D' = D^T D of a convention.

    Parameters
    ----------
    correction : (3, 3) D = T K, from readings to m/s^2.
    convention : "upper": sensor axis z lies along frame axis z, sensor y in the plane of y and z; "lower": x along x, y in the plane
        of x and y; "full": symmetric, the frame nearest to the sensor's axes.

    Returns
    -------
    (3, 3); the frame is turned by D' D^-1.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> correction = np.array([[1.01, 0.02, 0.0], [0.0, 0.99, 0.0], [0.03, 0.0, 1.0]])
    >>> turned = np.asarray(jaxcal.imu.turned_to(correction, "upper"))
    >>> bool(np.allclose(turned.T @ turned, correction.T @ correction, atol=1e-6)), bool(turned[1, 0] == 0)
    (True, True)

    References
    ----------
    Cholesky's factor of D'D, and for "full" the polar factor by Newton's iteration: N. J. Higham, SIAM J. Sci. Stat. Comput. 7, 1986,
    equation (3.3).
    """
    correction = jnp.asarray(correction)
    gram = correction.T @ correction
    if convention == "upper":
        return _upper(gram)
    if convention == "lower":
        return _upper(gram[::-1, ::-1])[::-1, ::-1]
    # the polar factor by Newton's iteration, whose derivative needs no distinct singular values
    rotation = correction / jnp.cbrt(jnp.linalg.det(correction))
    for _ in range(12):
        rotation = (rotation + jnp.linalg.inv(rotation).T) / 2
    half = rotation.T @ correction
    return (half + half.T) / 2


class Turned(eqx.Module):
    """Matrices of both triads (reading per SI unit) and the g-sensitivity, in another frame: M Q', G Q'."""

    accel: Any
    gyro: Any
    g_sensitivity: Any


def in_convention(accel: Array, gyro: Array, g_sensitivity: Array, convention: str) -> Turned:
    """Both triads in the frame that makes the accelerometer's correction triangular or symmetric; biases stay."""
    correction = jnp.linalg.inv(accel)
    new = turned_to(correction, convention)
    turn = new @ accel
    return Turned(jnp.linalg.inv(new), gyro @ turn.T, g_sensitivity @ turn.T)


def lower_times_rotation(matrix: Array) -> tuple[Array, Array]:
    """L lower triangular with a positive diagonal and Q orthogonal, matrix = L Q."""
    lower = jnp.linalg.cholesky(matrix @ matrix.T)
    return lower, jnp.linalg.solve(lower, matrix)
