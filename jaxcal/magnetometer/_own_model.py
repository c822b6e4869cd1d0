"""Model objects: what a `MagModel`, or a subclass of it with fields of its own, says of readings, with all derivatives."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._precision import host_float64
from .._types import Array, PyTree
from ..fitting._problem import names_of
from ._model import MagModel
from ._orthogonal import distance_to, inverse_of, leaves_of, looked, times


@host_float64
def changes_of(model: MagModel, field: Any, usual: dict[str, Any], across: Any, directions: Any) -> Any:
    """Change (n, p) of corrected unit fields, along vectors, by hard iron, soft iron, the field (zero) and further leaves.

    In usual conditions.
    """
    xp = model.soft_iron.__array_namespace__()
    directions = xp.asarray(directions, dtype=model.soft_iron.dtype)
    there = {name: xp.broadcast_to(value, (len(directions), *np.shape(value))) for name, value in usual.items()}
    _, _, _, push, slopes = looked(model, leaves_of(model), directions, directions, field, there)
    change = -xp.einsum("ni,nij,njp->np", across, inverse_of(push), slopes)
    return xp.concatenate([change[:, 9:12], change[:, :9], 0.0 * change[:, :1], change[:, 12:]], axis=1)


def further_names(model: MagModel) -> list[str]:
    """Names of the fields of its own."""
    return names_of(model)[12:]


def residuals(model: MagModel, data: PyTree) -> Array:
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
    h = jnp.asarray(model.correct(m, **conditions)) / field
    measured, slope = jax.linearize(lambda h: model.measure(field * h, **conditions), h)
    push = jnp.stack([slope(jnp.broadcast_to(axis, h.shape)) for axis in jnp.eye(3, dtype=h.dtype)], axis=-1)
    inverse = inverse_of(push)
    return distance_to(inverse.swapaxes(1, 2) @ inverse, m - measured + times(h, push.swapaxes(1, 2)))
