"""Residuals of a magnetometer calibration: orthogonal distances of the readings, in their space, to the surface that a field can give."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from ..._compile import filter_jit
from ..._types import Any, Array
from .._model import MagModel
from ._distance import corrected_distance
from ._kinds import soft_and_centre


# each fit makes one of these, and an Equinox module takes five times as long to make
@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class Readings:
    """Scaled readings (n, 3), weight (n,), zero for padding, noise variance for the curvature term, `basis_of`."""

    u: Any
    weight: Any
    noise2: Any
    basis: Any


def _inverse(first: Array, second: Array, third: Array) -> Array:
    """Inverse of matrices with these columns (..., 3) from cross products, because LAPACK is slow on a batch of small matrices."""
    rows = jnp.stack([jnp.cross(second, third), jnp.cross(third, first), jnp.cross(first, second)], axis=-2)
    return rows / jnp.sum(rows[..., 0, :] * first, axis=-1)[..., None, None]


def orthogonal(parameters: Array, data: Readings) -> Array:
    """Weighted orthogonal distances, without the mean offset that noise causes along the curved surface: sigma^2 times the curvature."""
    soft, centre = soft_and_centre(parameters, data.basis)
    inverse = _inverse(*soft.T)
    return data.weight * corrected_distance(inverse.T @ inverse, data.u - centre[None, :], data.noise2)


def surface_distances(model: MagModel, m: Any, field: Any, conditions: Any, noise2: Any) -> Array:
    """Signed, curvature corrected distance of each reading to the surface for a field of this magnitude under the reading's conditions."""
    m = jnp.asarray(m)
    # near the corrected reading the model is C_i h + b_i, and its surface there is an ellipsoid
    h = jnp.asarray(model.correct(m, **conditions))
    measured, push = jax.linearize(lambda h: model.measure(h, **conditions), h)
    first, second, third = (push(jnp.broadcast_to(axis, h.shape)) for axis in jnp.eye(3, dtype=h.dtype))
    inverse = _inverse(first, second, third)
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
