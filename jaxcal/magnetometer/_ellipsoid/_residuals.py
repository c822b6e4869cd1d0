"""Residuals of a magnetometer calibration: radial, in the calibrated space, and orthogonal, in the space of the readings."""

import equinox as eqx
import jax
import jax.numpy as jnp

from ..._types import Any, Array
from .._model import MagModel
from ._distance import corrected_distance, signed_distance
from ._penalty import penalty_residual, size_residual


class Readings(eqx.Module):
    """What a fit is given.

    u : (n, 3) scaled readings. weight : (n,), zero for padding. scale : of a residual.
    noise2 : noise variance that the curvature term takes off.
    basis : (12, 9) from the parameters to U by rows and the centre; columns of zeros have no meaning.
    penalty : `Penalty` of `penalised`, which alone has one.
    """

    u: Any
    weight: Any
    scale: Any
    noise2: Any
    basis: Any
    penalty: Any = None


def upper_and_centre(parameters: Any, basis: Any) -> tuple[Any, Any]:
    """U and the centre of {x : |U (x - centre)| = 1}."""
    full = basis @ parameters
    return full[:9].reshape(3, 3), full[9:]


def shape_and_centre(parameters: Any, basis: Any) -> tuple[Any, Any]:
    """A = U'U, positive whatever the parameters are, and the centre."""
    upper, centre = upper_and_centre(parameters, basis)
    return upper.T @ upper, centre


def distances(parameters: Array, data: Readings) -> Array:
    """Weighted orthogonal distances over the scale."""
    shape, centre = shape_and_centre(parameters, data.basis)
    return data.weight * signed_distance(shape, data.u - centre[None, :]) / data.scale


def orthogonal(parameters: Array, data: Readings) -> Array:
    """Weighted orthogonal distances less sigma^2 times the mean curvature, over the scale.

    Noise along the curved surface gives the distances that mean; with noise2 = 0 it stays in.
    """
    shape, centre = shape_and_centre(parameters, data.basis)
    return data.weight * corrected_distance(shape, data.u - centre[None, :], data.noise2) / data.scale


def penalised(parameters: Array, data: Readings) -> Array:
    """Those of `orthogonal`, one of the prior of the size, and one whose square is the penalty on directions in a corner."""
    upper, centre = upper_and_centre(parameters, data.basis)
    last = penalty_residual(upper, data.u - centre[None, :], data.weight, data.penalty)
    return jnp.concatenate([orthogonal(parameters, data), jnp.stack([size_residual(upper, data.penalty), last]) / data.scale])


def radial(parameters: Array, data: Readings) -> Array:
    """Weighted |W (m - b)| - 1 over the scale; W need not be formed."""
    shape, centre = shape_and_centre(parameters, data.basis)
    z = data.u - centre[None, :]
    return data.weight * (jnp.sqrt(jnp.sum(z * (z @ shape), axis=1)) - 1) / data.scale


def surface_distances(model: MagModel, m: Any, field: Any, conditions: Any, noise2: Any) -> Array:
    """Signed distance of each reading to the surface on which its conditions would put a field of this norm, curvature corrected.

    About the corrected reading the model is C_i h + b_i, and its surface there an ellipsoid.
    """
    m = jnp.asarray(m)
    h = jnp.asarray(model.correct(m, **conditions))
    measured, push = jax.linearize(lambda h: model.measure(h, **conditions), h)
    first, second, third = (push(jnp.broadcast_to(axis, h.shape)) for axis in jnp.eye(3, dtype=h.dtype))
    # the inverse from cross products: a batch of small matrices is slow in LAPACK
    rows = jnp.stack([jnp.cross(second, third), jnp.cross(third, first), jnp.cross(first, second)], axis=1)
    inverse = rows / jnp.sum(rows[:, 0] * first, axis=1)[:, None, None]
    z = m - measured + h[:, :1] * first + h[:, 1:2] * second + h[:, 2:] * third
    shape = jnp.einsum("nki,nkj->nij", inverse, inverse)
    square = jnp.asarray(noise2, dtype=m.dtype) / field**2
    return field * jax.vmap(lambda a, x: corrected_distance(a, x[None], square)[0])(shape, z / field)


def residuals(model: MagModel, data: Any) -> Array:
    r"""Signed orthogonal distance of each reading to the surface on which a field of norm H would put it.

    .. math:: d_i = \pm\min_h |m_i - \mathrm{measure}(h)|,\qquad |h| = H

    For white noise of one variance in all axes this is the residual of maximum likelihood, whatever the unknown attitudes.

    Parameters
    ----------
    model : a `MagModel`, or a subclass with `measure(h, **conditions)` and `correct(m, **conditions)`.
    data : (m, H) or (m, H, conditions): readings (n, 3), the norm of the field in their unit, and a dictionary of arrays with a row
        for each reading, such as the temperature.

    Returns
    -------
    (n,) in the unit of the readings, positive outside; traced as it is, under `jit`, `grad` and `vmap`.

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
    return surface_distances(model, m, field, conditions[0] if conditions else {}, 0.0)
