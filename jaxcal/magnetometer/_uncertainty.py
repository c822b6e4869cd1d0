"""Uncertainty of a calibration: `heading_uncertainty` after a fit; `predict` and `plan` before readings are taken."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._precision import array_module, host_float64
from .._types import Any, AnyArray, Array, Samples
from ._directions import both_tilts, by_iron, heading_at
from ._field import INCLINATION, unit_field
from ._judge import sphere_rows
from ._model import MagModel
from ._quadric import basis_of
from ._result import MagFit

_STARTS, _FEWEST = 4, 10  # random plans, of which the best is kept; readings: one more than parameters


@host_float64
def heading_uncertainty(found: MagFit, headings: Samples, *, tilt: float | int = 0.0) -> AnyArray:
    r"""Standard deviation of the heading due to the errors of a fit, for readings without noise and a true vertical.

    .. math:: \sigma_\psi^2 = j\,\mathrm{Cov}\,j^T,\qquad j = \partial\psi/\partial(A, b)

    Parameters
    ----------
    found : a fit with a model. The result excludes the error of an aligned rotation; `found.heading_error` includes it.
    headings : (n,) headings in rad.
    tilt : angle of the sensor from level, rad; the result is the rms over eight directions of tilt. Ignored for a planar fit.

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
        raise DataError(f"The fit has no model: {found.reason}", code="no_model")
    return heading_at(found, np.atleast_1d(np.asarray(headings, dtype=float)), float(tilt))


class Plan(eqx.Module):
    """Attitudes to hold, and the heading error that they will give.

    Attributes
    ----------
    attitudes : (n, 3) azimuth, elevation and bank in rad.
    heading_error : (2,) predicted rms heading error in rad, at level and at 20 degrees of tilt.
    repeats : number of readings to take at each attitude so that both errors are below the limit; 1 without a limit.

    Examples
    --------
    >>> from jaxcal.magnetometer import plan
    >>> found = plan(12, 0.2 / 47)
    >>> found.attitudes.shape, found.heading_error.shape
    ((12, 3), (2,))
    """

    attitudes: AnyArray
    heading_error: AnyArray
    repeats: int


def _variance(attitudes: Array, inclination: Array, weight: Array) -> Array:
    """Mean square heading error per noise variance (relative to the field) for sensors near C = I: trace of the bound times `weight`."""
    rows = sphere_rows(unit_field(attitudes, inclination, jnp), jnp)
    # a ridge, far below the information of a usable plan, keeps the derivative finite at singular plans
    information = rows.T @ rows + 1e-9 * len(rows) * jnp.eye(9, dtype=rows.dtype)
    return jnp.trace(jnp.linalg.solve(information, weight))


@functools.cache
def _weights(inclination: float) -> np.ndarray:
    """Mean of the outer products of the heading's slopes by S and centre about C = I, at level and tilted, (2, 9, 9)."""
    both = both_tilts(by_iron(MagModel(np.eye(3), np.zeros(3)), 1.0), inclination, np.array([0.0, 0.0, 1.0]))
    slopes = [np.concatenate([rows[:, 3:12], rows[:, :3]], axis=1) @ basis_of("symmetric") for rows in both]
    return np.array([rows.T @ rows / len(rows) for rows in slopes])


_slope = jax.jit(jax.value_and_grad(lambda a, i, w: jnp.log(_variance(a, i, w))))
_value = jax.jit(_variance)


@host_float64
def predict(attitudes: Samples, noise: float | int, *, inclination: float | int = INCLINATION) -> AnyArray:
    r"""Smallest possible rms heading error for readings in given attitudes (Cramer-Rao bound), before any reading is taken.

    .. math:: \sigma_\psi^2 = \sigma^2\,\mathrm{tr}\big[(J^T J)^{-1}\,\overline{j^T j}\big]

    Parameters
    ----------
    attitudes : (n, 3) azimuth, elevation and bank in rad, one for each reading.
    noise : standard deviation of an axis of a reading, relative to the magnitude of the field.
    inclination : dip of the field in rad.

    Returns
    -------
    (2,) rad, at level and at 20 degrees of tilt, for a sensor with little soft iron and all nine parameters unknown. Works under `jit`,
    `vmap` and `grad`; the gradient with respect to the attitudes shows where to move each of them.

    Raises
    ------
    DataError
        If the attitudes are not (n, 3), or there are fewer than ten.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import predict, scenario
    >>> print(np.rad2deg(predict(scenario("twelve_points"), 0.2 / 47)).round(1))
    [1.6 2.1]

    References
    ----------
    The Fisher information of the orthogonal distances, whose inverse is the Cramer-Rao bound: S. M. Kay, Fundamentals of Statistical
    Signal Processing: Estimation Theory, 1993, chapter 3.
    """
    poses: Any = array_module(attitudes).asarray(attitudes, dtype=float)
    if poses.ndim != 2 or poses.shape[1] != 3 or len(poses) < _FEWEST:
        raise DataError(f"The attitudes have shape {poses.shape}; expected (n, 3) with at least {_FEWEST} rows.", code="bad_shape")
    if not noise > 0 or not abs(inclination) < np.pi / 2:
        raise DataError("The noise must be positive, relative to the field, and the inclination within 90 degrees.", code="bad_value")
    values = [_value(jnp.asarray(poses), jnp.asarray(inclination), jnp.asarray(w)) for w in _weights(float(inclination))]
    return noise * jnp.sqrt(jnp.stack(values))


@host_float64
def plan(
    count: int,
    noise: float | int,
    *,
    limit: float | int | None = None,
    elevation: tuple[float | int, float | int] = (-np.pi / 2, np.pi / 2),
    bank: tuple[float | int, float | int] = (-np.pi, np.pi),
    inclination: float | int = INCLINATION,
    seed: int = 0,
) -> Plan:
    """Attitudes to hold for a small heading error, found by the gradient of the bound.

    Parameters
    ----------
    count : number of attitudes, 10 or more.
    noise : standard deviation of an axis of a reading, relative to the magnitude of the field.
    limit : largest rms heading error in rad, at level and at 20 degrees of tilt; `repeats` then says how often to read.
    elevation, bank : lowest and highest angle that the vehicle allows, rad. All headings are allowed.
    inclination : dip of the field in rad.
    seed : seed of the attitudes to start from; the best of four starts is used.

    Returns
    -------
    Plan

    Raises
    ------
    DataError
        If there are too few attitudes, a range is not an interval, or the allowed attitudes do not determine all parameters.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import plan, predict, scenario
    >>> better = plan(12, 0.2 / 47)
    >>> bool(np.all(3 * better.heading_error < predict(scenario("twelve_points"), 0.2 / 47)))
    True

    References
    ----------
    V. Fedorov, Theory of Optimal Experiments, 1972 (the criterion is linear in the covariance: L-optimality).
    """
    for low, high, name in ((*elevation, "elevation"), (*bank, "bank")):
        if not low <= high:
            raise DataError(f"The {name} from {low:g} to {high:g} is no interval; give the lowest first.", code="no_interval")
    if count < _FEWEST or not noise > 0 or not abs(inclination) < np.pi / 2 or not (limit is None or limit > 0):
        raise DataError(f"A plan needs {_FEWEST} attitudes or more, a positive noise, and an inclination within 90 degrees; got {count}.",
                        code="bad_value")  # fmt: skip
    rng, weight = np.random.default_rng(seed), jnp.asarray(_weights(float(inclination)).mean(axis=0))
    bounds = [(None, None), elevation, bank] * count

    def cost(x):
        value, slope = _slope(jnp.asarray(x.reshape(count, 3)), jnp.asarray(inclination), weight)
        return float(value), np.asarray(slope).ravel()

    tries = []
    for _ in range(_STARTS):
        turns = np.stack([rng.uniform(0, 2 * np.pi, count), rng.uniform(*elevation, count), rng.uniform(*bank, count)], axis=1)
        tries.append(scipy.optimize.minimize(cost, turns.ravel(), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 200}))
    best = min(tries, key=lambda found: found.fun if np.isfinite(found.fun) else np.inf).x.reshape(count, 3)
    best[:, 0] %= 2 * np.pi
    error = predict(best, noise, inclination=inclination)
    if not error.max() < np.pi:
        raise DataError("The attitudes that are allowed leave the calibration open; allow more elevation or bank.", code="undetermined")
    repeats = 1 if limit is None else max(int(np.ceil((error.max() / limit) ** 2)), 1)
    return Plan(best[np.argsort(best[:, 0])], error / np.sqrt(repeats), repeats)
