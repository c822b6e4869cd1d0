"""How well a fit is known: `bootstrap`, its scatter over resampled readings; `heading_uncertainty`, heading by heading."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import host_float64
from .._types import AnyArray
from ..fitting import solve_many
from ._design._heading_error import heading_slopes, planar_slopes, tilted
from ._ellipsoid._kinds import ENTRIES, PLANAR, parameters_of, shape_and_centre
from ._ellipsoid._orthogonal import CURVED, bounds_of, padded
from ._ellipsoid._residuals import Penalty, Readings, Size, distances, orthogonal, penalised
from ._ellipsoid._shape import Frame, ellipsoid_of_model, radius_of
from ._field import unit_field
from ._result import MagFit

#: step to go, relative to the statistical uncertainty, at which a refit is done
_PRECISE = 1e-4


@host_float64
def bootstrap(m: Any, found: MagFit, *, replicas: int = 1000, seed: int = 0) -> AnyArray:
    """Hard irons and shapes refitted to readings drawn with replacement: maximum likelihood, all in one compiled call.

    Parameters
    ----------
    m : (n, 3) the readings that were fitted.
    found : their fit, with a model that is not planar.
    replicas : number of refits.
    seed : of the draws.

    Returns
    -------
    (replicas, 9) parameters in the order and units of `found.covariance`; `np.cov` of them, rows as readings, is comparable to it.

    Raises
    ------
    DataError
        If the fit has no model, is planar, or is not of these readings.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from jaxcal.magnetometer import body_field, bootstrap, scenario
    >>> m = body_field(scenario("all", samples=60), 50.0) + np.random.default_rng(0).normal(size=(60, 3))
    >>> found = jaxcal.magnetometer.fit(m, model="sphere")
    >>> bootstrap(m, found, replicas=20).shape
    (20, 9)

    References
    ----------
    B. Efron and R. J. Tibshirani, An Introduction to the Bootstrap, 1993, chapter 6.
    """
    m = np.asarray(m, dtype=np.float64)
    if found.model is None or found.kind in PLANAR:
        raise DataError("The bootstrap needs a fit with a model that is not planar.")
    if m.shape != (len(found.residual), 3):
        raise DataError(f"The readings have shape {m.shape}, the fit is of ({len(found.residual)}, 3); give the readings that were fitted.")
    if replicas < 1:
        raise DataError(f"{replicas} replicas were asked for; at least one is needed.")
    frame = Frame.of(m)
    data, noise = padded(frame.scaled(m), found.kind), found.noise / frame.scale
    counts = np.random.default_rng(seed).multinomial(len(m), np.full(len(m), 1 / len(m)), size=replicas)
    weight = np.zeros((replicas, len(data.u)))
    weight[:, : len(m)] = np.sqrt(counts)
    ellipsoid = ellipsoid_of_model(found.model, frame, found.field)
    curved = noise > CURVED * radius_of(ellipsoid[0])
    size = None if found.field_error is None else Size(float(np.log(found.field / frame.scale)), found.field_error)
    penalty = Penalty.of(found.kind, noise, found.penalty, size) if found.penalty or size else None
    fits = solve_many(
        penalised if penalty else orthogonal if curved else distances, parameters_of(found.kind, *ellipsoid),
        Readings(data.u, weight, 1.0, noise**2 if curved else 0.0, data.basis, penalty),
        batched=(False, Readings(False, True, False, False, False, False)), bounds=bounds_of(found.kind), max_steps=64, rtol=_PRECISE,
    )  # fmt: skip
    if bad := int(np.sum(~np.asarray(fits.usable))):
        raise DataError(f"{bad} of {replicas} refits did not converge: the readings do not determine the model; see the fit's verdict.")
    shapes, centres = jax.vmap(shape_and_centre, (0, None))(jnp.asarray(fits.parameters), jnp.asarray(data.basis))
    shapes, centres = np.asarray(shapes) / frame.scale**2, frame.centre + frame.scale * np.asarray(centres)
    return np.concatenate([shapes[:, *ENTRIES], centres], axis=1)


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
    shape, _ = ellipsoid_of_model(found.model, Frame(np.zeros(3), 1.0), found.field)
    if found.plane is None:
        attitudes = tilted(headings, float(tilt))
        slopes = heading_slopes(shape, attitudes, unit_field(attitudes, found.inclination))
    else:
        basis = np.asarray(found.plane)
        slopes = planar_slopes(basis @ shape @ basis.T, headings)
    variance = np.sum(slopes @ np.asarray(found.covariance) * slopes, axis=1)
    return np.sqrt(variance.reshape(-1, len(headings)).mean(axis=0))
