"""`fit_offset`: hard iron anew, soft iron kept."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import host_float64
from .._types import AnyArray, Array
from ..fitting import covariance, solve
from ._ellipsoid._algebraic import Frame
from ._ellipsoid._distance import signed_distance
from ._ellipsoid._orthogonal import padded
from ._model import MagModel
from ._rotation._align import array


class Kept(eqx.Module):
    """Scaled readings, weight (n,), and the shape matrix of a unit field."""

    u: Any
    weight: Any
    shape: Any


def offset(parameters: dict[str, Array], data: Kept) -> Array:
    """Weighted distances to an ellipsoid of known form, of any size and place."""
    shape = data.shape * jnp.exp(-2 * parameters["size"])
    return data.weight * signed_distance(shape, data.u - parameters["b"][None, :])


@host_float64
def fit_offset(m: Any, model: MagModel, *, field: float | int | None = None) -> tuple[MagModel, AnyArray]:
    """Hard iron anew with the soft iron kept, as after a change of what the sensor is mounted with.

    Parameters
    ----------
    m : (n, 3) readings; a third of a sphere is enough.
    model : the earlier calibration.
    field : norm of the field in the unit of the corrected readings; None fits it too.

    Returns
    -------
    The new `MagModel`, and the (3, 3) covariance of its hard iron.

    Raises
    ------
    DataError
        If the readings do not determine an offset.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import MagModel, body_field, fit_offset, scenario
    >>> old = MagModel(np.diag([1.1, 1.0, 0.9]), np.zeros(3))
    >>> m = old.measure(body_field(scenario("three_turns"), 50.0)) + [3.0, -2.0, 1.0]
    >>> print(fit_offset(m, old)[0].hard_iron.round(6))
    [ 3. -2.  1.]

    References
    ----------
    The sphere is linear in its centre and in |b|^2 - r^2: I. Kasa, IEEE Trans. Instrum. Meas. 25, 1976; refined by orthogonal distances.
    """
    m = array(m, "readings")
    if len(np.unique(m, axis=0)) < 5:
        raise DataError("There are fewer than 5 distinct readings; an offset needs that many, out of one plane.")
    frame = Frame.of(m)
    data = padded(frame.scaled(m), "sphere")
    inverse = np.linalg.inv(np.asarray(model.soft_iron))
    norm = 1.0 if field is None else field / frame.scale
    z = (m - m.mean(axis=0)) @ inverse.T
    columns = np.concatenate([2 * z, np.ones((len(z), 1))], axis=1)
    *centre, _ = np.linalg.lstsq(columns, np.sum(z**2, axis=1), rcond=None)[0]
    radius = np.sqrt(np.mean(np.sum((z - centre) ** 2, axis=1))) / frame.scale
    start = {"b": np.asarray(model.soft_iron) @ np.array(centre) / frame.scale, "size": np.log(radius) if field is None else 0.0}
    kept = Kept(data.u, data.weight, inverse.T @ inverse / norm**2)
    found = solve(offset, start, kept, free={"b": True, "size": field is None})
    matrix = np.asarray(covariance(found, scaled=True))[:3, :3] * frame.scale**2
    if not bool(found.usable) or not np.isfinite(matrix).all():
        raise DataError(f"The readings do not determine the hard iron: {found.message}")
    return MagModel(model.soft_iron, frame.centre + frame.scale * np.asarray(found.model["b"])), matrix
