"""Which frame a calibration without reference attitudes speaks of: three conventions of one map, exact in both directions."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from .._errors import DataError
from .._precision import host_float64
from .._types import Array
from ._model import Imu
from ._triad import inverse

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


@host_float64
def in_convention(imu: Imu, convention: str) -> Imu:
    """The same device in the frame of a convention: matrices M Q', sensitivities G Q', biases as they are.

    Parameters
    ----------
    imu : accelerometer, and gyroscope where there is one; both plain `Triad`s.
    convention : "upper", "lower" or "full", see `turned_to`.

    Returns
    -------
    Imu

    Raises
    ------
    DataError
        For a subclass of `Triad`, whose own parameters jaxcal cannot turn.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Imu, Triad, in_convention
    >>> lower = in_convention(Imu(Triad(np.array([[1.0, 0.1, 0], [0, 1, 0], [0, 0, 1]]), np.zeros(3))), "lower")
    >>> print(lower.accel.matrix.round(3))
    [[1.005 0.    0.   ]
     [0.1   0.995 0.   ]
     [0.    0.    1.   ]]
    """
    if not imu.plain:
        raise DataError(f"A sensor has parameters of its own, which cannot be turned into the frame {convention!r}; fit it in that frame.")
    accel = jnp.asarray(imu.accel.matrix)
    new = turned_to(inverse(accel), convention)
    turn = (new @ accel).T
    turned = eqx.tree_at(lambda m: m.accel.matrix, imu, inverse(new))
    if imu.gyro is None:
        return turned
    gyro = (jnp.asarray(imu.gyro.matrix) @ turn, jnp.asarray(imu.gyro.g_sensitivity) @ turn)
    return eqx.tree_at(lambda m: (m.gyro.matrix, m.gyro.g_sensitivity), turned, gyro)


def lower_times_rotation(matrix: Array) -> tuple[Array, Array]:
    """L lower triangular with a positive diagonal and Q orthogonal, matrix = L Q."""
    lower = jnp.linalg.cholesky(matrix @ matrix.T)
    return lower, jnp.linalg.solve(lower, matrix)
