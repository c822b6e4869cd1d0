"""Residuals of a magnetometer calibration: radial, in the calibrated space, and orthogonal, in the space of the readings."""

import equinox as eqx
import jax.numpy as jnp

from .._types import Any, Array
from ._distance import mean_curvature, signed_distance
from ._model import MagModel


class Ellipsoid(eqx.Module):
    """Parameters of {x : |U (x - centre)| = 1}, of which the number says the kind; A = U'U is positive whatever they are.

    upper : (1,) sphere or circle, (3,) axes of a diagonal U, or those of a planar ellipse, (6,) the upper triangle by rows.
    centre : (3,), or (2,) in a plane; the third coordinate of planar readings is zero.
    """

    upper: Any
    centre: Any

    def shape(self) -> Array:
        """Shape matrix A, (3, 3)."""
        p = jnp.asarray(self.upper)
        zero = jnp.zeros_like(p[0])
        if p.size == 1:
            rows = ((p[0], zero, zero), (zero, p[0], zero), (zero, zero, p[0]))
        elif p.size == 6:
            rows = ((p[0], p[1], p[2]), (zero, p[3], p[4]), (zero, zero, p[5]))
        elif self.centre.shape[-1] == 3:
            rows = ((p[0], zero, zero), (zero, p[1], zero), (zero, zero, p[2]))
        else:
            rows = ((p[0], p[1], zero), (zero, p[2], zero), (zero, zero, p[0]))
        upper = jnp.stack([jnp.stack(row) for row in rows])
        return upper.T @ upper

    def middle(self) -> Array:
        """Centre, (3,)."""
        centre = jnp.asarray(self.centre)
        return centre if centre.shape[-1] == 3 else jnp.concatenate([centre, jnp.zeros_like(centre[:1])])


class Readings(eqx.Module):
    """Scaled readings u (n, 3), weights (n,), zero for padding, the scale of a residual, and the noise variance of the curvature term."""

    u: Any
    weight: Any
    scale: Any
    noise2: Any


def orthogonal(ellipsoid: Ellipsoid, data: Readings) -> Array:
    """Weighted orthogonal distances over the scale."""
    distance = signed_distance(ellipsoid.shape(), data.u - ellipsoid.middle()[None, :])
    return data.weight * distance / data.scale


def orthogonal_curved(ellipsoid: Ellipsoid, data: Readings) -> Array:
    """The same less sigma^2 times the mean curvature: noise along the surface makes the mean distance positive."""
    shape, z = ellipsoid.shape(), data.u - ellipsoid.middle()[None, :]
    return data.weight * (signed_distance(shape, z) - data.noise2 * mean_curvature(shape, z)) / data.scale


def radial(ellipsoid: Ellipsoid, data: Readings) -> Array:
    """Weighted |W (m - b)| - 1 over the scale; W need not be formed."""
    z = data.u - ellipsoid.middle()[None, :]
    return data.weight * (jnp.sqrt(jnp.sum(z * (z @ ellipsoid.shape()), axis=1)) - 1) / data.scale


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
