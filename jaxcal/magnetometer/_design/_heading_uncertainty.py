"""`heading_uncertainty`: the heading error to expect from a fit, heading by heading."""

from typing import Any

import numpy as np

from ..._errors import DataError
from ..._precision import host_float64
from ..._types import AnyArray
from .._attitude import body_field
from .._ellipsoid._start import PLANAR_ROWS
from .._result import MagFit
from ._heading_error import heading_slopes

_WAYS = 8


@host_float64
def heading_uncertainty(found: MagFit, headings: Any, *, tilt: float | int = 0.0) -> AnyArray:
    r"""Standard deviation of the heading that a fit leaves, for readings without noise and a true vertical.

    .. math:: \sigma_\psi^2 = j\,\mathrm{Cov}\,j^T,\qquad j = \partial\psi/\partial(A, b)

    Parameters
    ----------
    found : a fit with a model. A rotation that was aligned is not part of it: `found.heading_error` has both.
    headings : (n,) rad.
    tilt : angle of the sensor from level, rad: the rms over eight directions of tilt. In a plane there is none.

    Returns
    -------
    (n,) rad.

    Raises
    ------
    DataError
        If the fit has no model.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from jaxcal.magnetometer import body_field, heading_uncertainty, scenario
    >>> m = body_field(scenario("three_turns"), 50.0) + 0.1 * np.random.default_rng(0).normal(size=(360, 3))
    >>> found = jaxcal.magnetometer.fit(m, model="symmetric")
    >>> bool(np.all(heading_uncertainty(found, np.linspace(0, 6, 7)) < np.deg2rad(1)))
    True

    References
    ----------
    V. Renaudin, M. H. Afzal and G. Lachapelle, J. Sensors 2010, 967245, for the model; first-order propagation.
    """
    if found.model is None:
        raise DataError(f"The fit has no model: {found.reason}")
    headings = np.atleast_1d(np.asarray(headings, dtype=float))
    matrix = np.linalg.inv(np.asarray(found.model.soft_iron)) / found.field
    shape = matrix.T @ matrix
    ways = np.arange(_WAYS if tilt else 1) * 2 * np.pi / _WAYS
    variance = np.zeros(len(headings))
    for way in ways:
        elevation, bank = np.arcsin(np.sin(tilt) * np.cos(way)), np.arctan2(np.sin(tilt) * np.sin(way), np.cos(tilt))
        attitudes = np.stack([headings, np.full_like(headings, elevation), np.full_like(headings, bank)], axis=1)
        if found.plane is None:
            slopes = heading_slopes(shape, attitudes, np.asarray(body_field(attitudes, 1.0, found.inclination)))
        else:
            basis = np.asarray(found.plane)
            level = np.stack([np.cos(headings), -np.sin(headings), 0 * headings], axis=1)
            attitudes[:, 1:] = 0.0
            slopes = heading_slopes(basis @ shape @ basis.T, attitudes, level)[:, PLANAR_ROWS]
        variance += np.einsum("ni,ij,nj->n", slopes, np.asarray(found.covariance), slopes)
    return np.sqrt(variance / len(ways))
