"""Which attitudes to read: `predict` and `plan` before any reading is taken, `guide` from one reading to the next."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._precision import array_module, host_float64, real_numbers
from .._types import Any, AnyArray, Array, Samples
from ._beside import sphere_centre
from ._field import INCLINATION, sphere_grid, unit_field
from ._fit import fit
from ._judge import TILT, attitude_in_words, by_iron, distance_slopes, heading_slopes, sphere_rows
from ._model import MagModel
from ._quadric import COUNT, basis_of, unit
from ._result import MagFit

_STARTS, _LEAST = 4, COUNT["symmetric"] + 1  # random plans, of which the best is kept; readings
_FEWEST = 12  # number of readings from which the fit gives the advice; before, the largest gap between directions does


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
    change, down = by_iron(MagModel(np.eye(3), np.zeros(3)), 1.0), np.array([0.0, 0.0, 1.0])
    both = [heading_slopes(change, inclination, down, tilt) for tilt in (0.0, TILT)]
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
    if poses.ndim != 2 or poses.shape[1] != 3 or len(poses) < _LEAST:
        raise DataError(f"The attitudes have shape {poses.shape}; expected (n, 3) with at least {_LEAST} rows.", code="bad_shape")
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
    if count < _LEAST or not noise > 0 or not abs(inclination) < np.pi / 2 or not (limit is None or limit > 0):
        raise DataError(f"A plan needs {_LEAST} attitudes or more, a positive noise, and an inclination within 90 degrees; got {count}.",
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


class Guide(eqx.Module):
    """Advice on the next reading.

    Attributes
    ----------
    stop : whether 19 of 20 calibrations from such readings have a heading error below the limit.
    direction : (3,) unit vector in the sensor's axes along which the field should point at the next reading; None after the last.
    heading_error : expected rms heading error in rad of the readings so far; infinite with fewer than twelve readings.
    bound : heading error in rad that 19 of 20 calibrations stay below.
    reason : the advice as a sentence.
    fit : the fit of the readings so far; None with fewer than twelve.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import body_field, guide, scenario
    >>> m = body_field(scenario("all"), 50e-6) + 50e-9 * np.random.default_rng(0).normal(size=(len(scenario("all")), 3))
    >>> found = guide(m[:5])
    >>> found.stop, found.reason[:40]
    (False, '5 readings; from 12 on an error can be s')
    """

    stop: bool
    direction: AnyArray | None
    heading_error: float
    bound: float
    reason: str
    fit: MagFit | None


@host_float64
def guide(m: Samples, *, limit: float = np.deg2rad(1.0), inclination: float | None = None) -> Guide:
    r"""Which reading would lower the heading error most, and whether the readings so far are enough.

    A reading whose distance to the ellipsoid has the slope r lowers the mean square heading error tr(W C) by

    .. math:: \frac{r C W C r^T}{\sigma^2 + r C r^T},

    where C is the covariance of the nine parameters, W the mean outer product of the heading's slopes, and :math:`\sigma` the noise of a
    reading. With fewer than twelve readings, the next direction is the one farthest from those seen. The readings are enough when 19 of 20
    calibrations are below the limit (`MagFit.heading_limit`).

    Parameters
    ----------
    m : (n, 3) readings so far, in tesla or in counts.
    limit : wanted rms heading error in rad, at level.
    inclination : dip of the field in rad, as in `fit`.

    Returns
    -------
    Guide

    Raises
    ------
    DataError
        If the readings are not (n, 3) finite numbers, or the limit is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import body_field, guide, scenario
    >>> m = body_field(scenario("all"), 50e-6) + 50e-9 * np.random.default_rng(0).normal(size=(len(scenario("all")), 3))
    >>> few, many = guide(m[:5]), guide(m)
    >>> few.stop, many.stop
    (False, True)

    References
    ----------
    V. Fedorov, Theory of Optimal Experiments, 1972 (sequential L-optimal design).
    """
    m = real_numbers(m, "the readings")
    if m.ndim != 2 or m.shape[1] != 3 or not np.isfinite(m).all():
        raise DataError(f"The readings must be (n, 3) finite numbers; got the shape {m.shape}.")
    if not limit > 0:
        raise DataError(f"The limit must be positive, in rad; got {limit:g}.")
    grid, few = sphere_grid(), len(m) < _FEWEST
    found = None if few else fit(m, model="symmetric", inclination=inclination)
    error = bound = np.inf
    if found is None or found.model is None or not np.isfinite(np.asarray(found.estimate.matrix)).all():
        # the direction farthest from those seen
        centre = sphere_centre(m)[0] if len(m) else np.zeros(3)
        gain = -(grid @ unit(m - centre).T).max(axis=1, initial=-1.0)
        told = f"{len(m)} readings; from {_FEWEST} on an error can be stated" if few else "the readings leave the calibration open"
    else:
        slopes = heading_slopes(by_iron(found.model, found.field), float(found.inclination), found.down)
        covariance, weight = np.asarray(found.estimate.matrix), slopes.T @ slopes / len(slopes)
        rows = distance_slopes(found.model, float(found.field), grid)
        variance = found.noise**2 + np.sum((rows @ covariance) * rows, axis=1)
        gain = np.sum((rows @ (covariance @ weight @ covariance)) * rows, axis=1) / variance
        error, bound = float(found.heading_error[0]), found.heading_limit
        told = f"heading error {np.rad2deg(error):.2g} deg expected, below {np.rad2deg(bound):.2g} deg in 19 of 20 logs"
    if found is not None and bound <= limit and found.verdict != "refused":
        return Guide(True, None, error, bound, f"Stop: {told}.", found)
    best = grid[np.argmax(gain)]
    dip = inclination if inclination is not None else INCLINATION if found is None else float(found.inclination)
    return Guide(False, best, error, bound, f"{told}. Next: {attitude_in_words(best, dip)}.", found)
