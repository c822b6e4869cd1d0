r"""What directions tell of a model, and the penalty on an ellipsoid that puts all of them into a corner of the sphere.

The information matrix of n directions u is M = mean of j j' with the natural rows j = (u'Qu - 2c'u)/2 of the changes Q of the shape
and c of the centre. Fits of few readings run off to ever larger ellipsoids, on which the readings are a spot, for a gain in the
squared distances that noise alone can give. The penalty is a power w of Jeffreys' prior in these natural parameters,

.. math:: \frac{1}{2\sigma^2}\sum_i d_i^2 - \frac w2 \log\det M(A, b)

D. Firth, Biometrika 80 (1993) 27, has w = 1; G. Heinze and M. Schemper, Stat. Med. 21 (2002) 2409, use it where fits run off.
"""

from types import ModuleType
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._types import Array, Float
from ._start import COUNT, PLANAR_ROWS

#: from the changes of a kind to the six entries of A and the centre
BASES = {"symmetric": np.eye(9), "diagonal": np.eye(9)[:, [0, 2, 5, 6, 7, 8]], "ellipse": np.eye(9)[:, PLANAR_ROWS]}
BASES["sphere"] = np.concatenate([np.eye(9)[:, [0, 2, 5]].sum(axis=1, keepdims=True) / np.sqrt(3), np.eye(9)[:, 6:]], axis=1)
BASES["circle"] = np.concatenate([np.eye(9)[:, [0, 2]].sum(axis=1, keepdims=True) / np.sqrt(2), np.eye(9)[:, 6:8]], axis=1)

_MOST = 17 / 12  # of |j|^2, where all entries of u are equal in size
_FLOOR = 1e-10  # keeps the logarithm of directions that determine nothing


def natural_rows(directions: Any, xp: ModuleType = np) -> Any:
    """Rows j of the information, (n, 9)."""
    x, y, z = directions.T
    return xp.stack([x * x, 2 * x * y, y * y, 2 * x * z, 2 * y * z, z * z, -2 * x, -2 * y, -2 * z], axis=1) / 2


class Size(eqx.Module):
    """What is known of the mean semi-axis beforehand: its logarithm, and the standard deviation of that."""

    log: float
    error: float


class Penalty(eqx.Module):
    """The penalty for one kind of model, and the prior of its size.

    basis : (9, 9) columns of `BASES`, filled up with zeros; idle : (9,) one for those.
    top : a bound of log det M; strength : w times the variance of a distance.
    size : logarithm of the mean semi-axis; strength_of_size : standard deviation of a distance over that of `size`, zero where it is open.
    """

    basis: Any
    idle: Any
    top: Any
    strength: Any
    size: Any
    strength_of_size: Any

    @staticmethod
    def of(kind: str, noise: float, weight: float, size: Size | None = None) -> "Penalty":
        count = COUNT[kind]
        basis = np.zeros((9, 9))
        basis[:, :count] = BASES[kind]
        known = (0.0, 0.0) if size is None else (size.log, noise / size.error)
        # the eigenvalues sum to |j|^2 at most: their product is largest where they are equal
        return Penalty(basis, (np.arange(9) >= count).astype(float), count * np.log(_MOST / count), weight * noise**2, *known)


def penalty_residual(upper: Float[Array, "3 3"], z: Float[Array, "n 3"], weight: Float[Array, " n"], penalty: Penalty) -> Float[Array, ""]:
    """Residual whose square is strength (top - log det M), for the directions U z."""
    return jnp.sqrt(penalty.strength) * jnp.sqrt(penalty.top - 2 * _half_log_det(upper, z, weight, penalty.basis, penalty.idle))


def size_residual(upper: Float[Array, "3 3"], penalty: Penalty) -> Float[Array, ""]:
    """Residual of the prior of the size: the mean semi-axis is the cube root of 1/det U."""
    return penalty.strength_of_size * (-jnp.sum(jnp.log(jnp.abs(jnp.diagonal(upper)))) / 3 - penalty.size)


@jax.custom_jvp
def _half_log_det(upper, z, weight, basis, idle):
    return half_log_det(upper, z, weight, basis, idle, xp=jnp)[0]


@_half_log_det.defjvp
def _(primals, tangents):
    # weights, basis and idle columns are data
    value, by_upper, by_z = half_log_det(*primals, xp=jnp)
    return value, jnp.sum(by_upper * tangents[0]) + jnp.sum(by_z * tangents[1])


def half_log_det(upper: Any, z: Any, weight: Any, basis: Any, idle: Any, xp: ModuleType = np) -> tuple[Any, Any, Any]:
    """Half of log det M for the directions U z, and its derivatives with respect to U, (3, 3), and z, (n, 3)."""
    vectors = z @ upper.T
    length = xp.sqrt(xp.sum(vectors**2, axis=1, keepdims=True))
    length = xp.where(length > 0, length, 1)
    directions = vectors / length
    rows = (natural_rows(directions, xp) * weight[:, None]) @ basis
    count = xp.sum(weight**2)
    matrix = rows.T @ rows / count + xp.diag(idle + (1 - idle) * _FLOOR)
    pulled = rows @ xp.linalg.inv(matrix) @ basis.T * (weight / count)[:, None]
    a, b, c, d, e, f, *linear = pulled.T
    x, y, w = directions.T
    slope = xp.stack([a * x + b * y + d * w, b * x + c * y + e * w, d * x + e * y + f * w], axis=1) - xp.stack(linear, axis=1)
    slope = (slope - xp.sum(slope * directions, axis=1, keepdims=True) * directions) / length
    return xp.linalg.slogdet(matrix)[1] / 2, slope.T @ z, slope @ upper
