"""`bootstrap`: the scatter of the calibration over resampled readings."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import host_float64
from .._types import AnyArray
from ..fitting import solve_many
from ._ellipsoid._algebraic import Frame
from ._ellipsoid._orthogonal import CURVED, bounds_of, padded
from ._ellipsoid._penalty import Penalty, Size
from ._ellipsoid._residuals import Readings, distances, orthogonal, penalised, shape_and_centre
from ._ellipsoid._start import PLANAR, basis_of, parameters_of
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
    matrix = np.linalg.inv(np.asarray(found.model.soft_iron)) / found.field * frame.scale
    begin = parameters_of(found.kind, matrix.T @ matrix, (np.asarray(found.model.hard_iron) - frame.centre) / frame.scale)
    data = padded(frame.scaled(m), found.kind)
    counts = np.random.default_rng(seed).multinomial(len(m), np.full(len(m), 1 / len(m)), size=replicas)
    weight = np.zeros((replicas, len(data.u)))
    weight[:, : len(m)] = np.sqrt(counts)
    basis = basis_of(found.kind)
    curved = found.noise * np.linalg.det(matrix) ** (1 / 3) > CURVED * frame.scale
    noise = found.noise / frame.scale
    size = None if found.field_error is None else Size(float(np.log(found.field / frame.scale)), found.field_error)
    penalty = Penalty.of(found.kind, noise, found.penalty, size) if found.penalty or size else None
    fits = solve_many(
        penalised if penalty else orthogonal if curved else distances, begin,
        Readings(data.u, weight, 1.0, noise**2 if curved else 0.0, basis, penalty),
        batched=(False, Readings(False, True, False, False, False, False)), bounds=bounds_of(found.kind), max_steps=64, rtol=_PRECISE,
    )  # fmt: skip
    shapes, centres = jax.vmap(shape_and_centre, (0, None))(jnp.asarray(fits.parameters), jnp.asarray(basis))
    shapes, centres = np.asarray(shapes) / frame.scale**2, frame.centre + frame.scale * np.asarray(centres)
    if not bool(jnp.all(fits.usable)):
        bad = int(np.sum(~np.asarray(fits.usable)))
        raise DataError(f"{bad} of {replicas} refits did not converge: the readings do not determine the model; see the fit's verdict.")
    return np.concatenate([shapes[:, [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]], centres], axis=1)
