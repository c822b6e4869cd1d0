"""Residuals of a magnetometer calibration: radial, in the calibrated space, and orthogonal, in the space of the readings."""

import equinox as eqx
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


def radial_residuals(model: MagModel, data: Any) -> Array:
    r"""Relative error of the corrected field's norm.

    .. math:: r_i = |C^{-1}(m_i - b)|/H - 1

    Parameters
    ----------
    model : soft and hard iron.
    data : (m, H), readings (n, 3) and the norm of the field, in one unit and dtype.

    Returns
    -------
    (n,) pure numbers; traced as it is, under `jit`, `grad` and `vmap`.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.magnetometer import MagModel, radial_residuals
    >>> model = MagModel(jnp.eye(3), jnp.zeros(3))
    >>> print(radial_residuals(model, (jnp.array([[3.0, 4.0, 0.0], [0.0, 6.0, 0.0]]), 5.0)).round(3))
    [0.  0.2]

    References
    ----------
    The cost of the calibrations on board of ArduPilot and PX4: |W (m - b)| less one.
    """
    m, field = data
    m = jnp.asarray(m)
    z = jnp.linalg.solve(jnp.asarray(model.soft_iron, dtype=m.dtype), (m - jnp.asarray(model.hard_iron, dtype=m.dtype)[None, :]).T)
    return jnp.linalg.norm(z, axis=0) / field - 1


def distance_residuals(model: MagModel, data: Any) -> Array:
    r"""Signed orthogonal distance of the readings to the ellipsoid on which a field of norm H would put them.

    For white noise of one variance in all axes this is the residual of maximum likelihood, whatever the unknown attitudes.

    Parameters
    ----------
    model : soft and hard iron.
    data : (m, H), readings (n, 3) and the norm of the field, in one unit and dtype.

    Returns
    -------
    (n,) in the unit of the readings, positive outside; traced as it is, under `jit`, `grad` and `vmap`.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> from jaxcal.magnetometer import MagModel, distance_residuals
    >>> model = MagModel(jnp.diag(jnp.array([1.0, 2.0, 1.0])), jnp.zeros(3))
    >>> print(distance_residuals(model, (jnp.array([[0.0, 11.0, 0.0], [4.0, 0.0, 0.0]]), 5.0)).round(3))
    [ 1. -1.]

    References
    ----------
    N. I. Chernov and H. Ma, Least squares fitting of quadratic curves and surfaces, 2011, section 5 (the nearest point).
    """
    m, field = data
    m = jnp.asarray(m)
    inverse = jnp.linalg.inv(jnp.asarray(model.soft_iron, dtype=m.dtype)) / field
    return signed_distance(inverse.T @ inverse, m - jnp.asarray(model.hard_iron, dtype=m.dtype)[None, :])
