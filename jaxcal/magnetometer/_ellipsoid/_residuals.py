r"""Residuals of a magnetometer calibration: distances of the readings, and a penalty on ellipsoids of which they cover a corner only.

Distances are orthogonal, in the space of the readings. The information matrix of n directions u is
M, the mean of j j' with the natural rows j = (u'Qu - 2c'u)/2 of the changes Q of the shape and c of the centre. Fits of few readings
diverge to ever larger ellipsoids, on which the readings cover a spot: noise alone can make this lower the squared distances. The penalty
is a power w of Jeffreys' prior in these natural parameters,

.. math:: \frac{1}{2\sigma^2}\sum_i d_i^2 - \frac w2 \log\det M(A, b)

D. Firth, Biometrika 80 (1993) 27, has w = 1; G. Heinze and M. Schemper, Stat. Med. 21 (2002) 2409, use it where fits diverge.
"""

import dataclasses
from types import ModuleType

import jax
import jax.numpy as jnp
import numpy as np

from ..._compile import filter_jit
from ..._types import Any, Array, Float
from .._model import MagModel
from ._distance import corrected_distance
from ._kinds import COUNT, PLANAR_ROWS, shape_and_centre, upper_and_centre

#: matrices from the changes of each kind to the six entries of A and the centre
BASES = {"symmetric": np.eye(9), "diagonal": np.eye(9)[:, [0, 2, 5, 6, 7, 8]], "ellipse": np.eye(9)[:, PLANAR_ROWS]}
BASES["sphere"] = np.concatenate([np.eye(9)[:, [0, 2, 5]].sum(axis=1, keepdims=True) / np.sqrt(3), np.eye(9)[:, 6:]], axis=1)
BASES["circle"] = np.concatenate([np.eye(9)[:, [0, 2]].sum(axis=1, keepdims=True) / np.sqrt(2), np.eye(9)[:, 6:8]], axis=1)

_MOST = 17 / 12  # largest |j|^2, reached where all entries of u have equal size
_FLOOR = 1e-10  # keeps the logarithm finite for directions that determine nothing


def natural_rows(directions: Any, xp: ModuleType = np) -> Any:
    """Rows j of the information, (n, 9)."""
    x, y, z = directions.T
    return xp.stack([x * x, 2 * x * y, y * y, 2 * x * z, 2 * y * z, z * z, -2 * x, -2 * y, -2 * z], axis=1) / 2


# each fit makes one of these and one of `Readings`, and an Equinox module takes five times as long to make
@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class Penalty:
    """The penalty for one kind of model.

    basis : (9, 9) columns of `BASES`, padded with zeros; idle : (9,) one for the padding.
    top : an upper bound of log det M; strength : w times the variance of a distance.
    """

    basis: Any
    idle: Any
    top: Any
    strength: Any

    @staticmethod
    def of(kind: str, noise: float, weight: float) -> "Penalty":
        count = COUNT[kind]
        basis = np.zeros((9, 9))
        basis[:, :count] = BASES[kind]
        # the eigenvalues sum to at most |j|^2, and their product is largest if they are equal
        return Penalty(basis, (np.arange(9) >= count).astype(float), count * np.log(_MOST / count), weight * noise**2)


def penalty_residual(upper: Float[Array, "3 3"], z: Float[Array, "n 3"], weight: Float[Array, " n"], penalty: Penalty) -> Float[Array, ""]:
    """Residual whose square is strength (top - log det M), for the directions U z."""
    return jnp.sqrt(penalty.strength) * jnp.sqrt(penalty.top - 2 * _half_log_det(upper, z, weight, penalty.basis, penalty.idle))


@jax.custom_jvp
def _half_log_det(upper, z, weight, basis, idle):
    return half_log_det(upper, z, weight, basis, idle, xp=jnp)[0]


@_half_log_det.defjvp
def _(primals, tangents):
    # weights, basis and idle columns are data, so they have no derivative
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


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class Readings:
    """Scaled readings (n, 3), weight (n,), zero for padding, noise variance for the curvature term, `basis_of`."""

    u: Any
    weight: Any
    noise2: Any
    basis: Any
    penalty: Any = None


def orthogonal(parameters: Array, data: Readings) -> Array:
    """Weighted orthogonal distances, without the mean offset that noise causes along the curved surface: sigma^2 times the curvature."""
    shape, centre = shape_and_centre(parameters, data.basis)
    return data.weight * corrected_distance(shape, data.u - centre[None, :], data.noise2)


def penalised(parameters: Array, data: Readings) -> Array:
    """The residuals of `orthogonal`, and one whose square is the penalty on directions in a corner."""
    upper, centre = upper_and_centre(parameters, data.basis)
    last = penalty_residual(upper, data.u - centre[None, :], data.weight, data.penalty)
    return jnp.concatenate([orthogonal(parameters, data), last[None]])


def surface_distances(model: MagModel, m: Any, field: Any, conditions: Any, noise2: Any) -> Array:
    """Signed, curvature corrected distance of each reading to the surface for a field of this magnitude under the reading's conditions."""
    m = jnp.asarray(m)
    # near the corrected reading the model is C_i h + b_i, and its surface there is an ellipsoid
    h = jnp.asarray(model.correct(m, **conditions))
    measured, push = jax.linearize(lambda h: model.measure(h, **conditions), h)
    first, second, third = (push(jnp.broadcast_to(axis, h.shape)) for axis in jnp.eye(3, dtype=h.dtype))
    # form the inverse from cross products, because LAPACK is slow on a batch of small matrices
    rows = jnp.stack([jnp.cross(second, third), jnp.cross(third, first), jnp.cross(first, second)], axis=1)
    inverse = rows / jnp.sum(rows[:, 0] * first, axis=1)[:, None, None]
    z = m - measured + h[:, :1] * first + h[:, 1:2] * second + h[:, 2:] * third
    shape = jnp.einsum("nki,nkj->nij", inverse, inverse)
    square = jnp.asarray(noise2, dtype=m.dtype) / field**2
    return field * jax.vmap(lambda a, x: corrected_distance(a, x[None], square)[0])(shape, z / field)


def residuals(model: MagModel, data: Any) -> Array:
    r"""Signed orthogonal distance of each reading to the surface of all readings that a field of magnitude H can give.

    .. math:: d_i = \pm\min_h |m_i - \mathrm{measure}(h)|,\qquad |h| = H

    These are the residuals of maximum likelihood for white noise of one variance in all axes, for any unknown attitudes.

    Parameters
    ----------
    model : a `MagModel`, or a subclass with `measure(h, **conditions)` and `correct(m, **conditions)`.
    data : (m, H) or (m, H, conditions): readings (n, 3), the magnitude of the field in their unit, and a dictionary of arrays with one row
        per reading, such as the temperature.

    Returns
    -------
    (n,) in the unit of the readings, positive outside. Works under `jit`, `grad` and `vmap`.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.magnetometer import MagModel, residuals
    >>> model = MagModel(jnp.diag(jnp.array([1.0, 2.0, 1.0])), jnp.zeros(3))
    >>> print(residuals(model, (jnp.array([[0.0, 11.0, 0.0], [4.0, 0.0, 0.0]]), 5.0)).round(3))
    [ 1. -1.]

    References
    ----------
    N. I. Chernov and H. Ma, Least squares fitting of quadratic curves and surfaces, 2011, section 5 (the nearest point).
    """
    m, field, *conditions = data
    return _residuals(*jax.tree.map(_as_array, (model, m, field, conditions[0] if conditions else {})))


def _as_array(leaf: Any) -> Any:
    return jnp.asarray(leaf) if isinstance(leaf, np.ndarray | float | int) else leaf


@filter_jit
def _residuals(model: MagModel, m: Any, field: Any, conditions: Any) -> Array:
    # one program: called by themselves, its two hundred operations would be compiled one by one
    return surface_distances(model, m, field, conditions, 0.0)
