"""Magnetometers on a vehicle: fields of its currents, known attitudes, a new hard iron with the old soft iron, several sensors."""

import dataclasses
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import host_float64
from .._types import AnyArray, Array
from ..fitting import Fit, information, solve
from ._diagnosis import at_end
from ._ellipsoid._distance import signed_distance
from ._ellipsoid._shape import Frame, ellipsoid_of_model, filled
from ._fit import fit
from ._model import MagModel
from ._result import LIMITS, MagFit
from ._rotation._align import spread_of
from ._rotation._joint import aligned, checked_joint
from ._rotation._turning import array
from ._term_errors import jointly_with_terms, widened_by_terms


class CurrentTerms(eqx.Module):
    """Field per ampere of each current, as `fit_current` and `motor_terms` find it.

    Attributes
    ----------
    terms : (3, currents) k, in the unit of the readings per unit of current: m = C h + b + k I.
    error : (3, currents) standard deviations.
    correlation : (currents,) largest correlation of a current with the readings' directions; above 0.5 its field is hard to separate.
    noise : standard deviation of a reading.
    fit : `MagFit` of the readings after the fields of the currents were subtracted; its errors include the errors of the terms. None if the
        attitude was held.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import motor_terms
    >>> current = np.linspace(0, 20, 50)
    >>> m = [20.0, 5.0, 40.0] + np.outer(current, [0.3, 0.0, -0.1])
    >>> found = motor_terms(m, current)
    >>> print(found.correct(m, current)[[0, -1]].round(6))
    [[20.  5. 40.]
     [20.  5. 40.]]
    """

    terms: AnyArray
    error: AnyArray
    correlation: AnyArray
    noise: float
    fit: MagFit | None

    @host_float64
    def correct(self, m: Any, current: Any) -> AnyArray:
        """Readings (n, 3) without the fields of the currents (n,) or (n, currents)."""
        return np.asarray(m) - _columns_of(current, len(m)) @ np.asarray(self.terms).T


def _columns_of(current: Any, count: int) -> np.ndarray:
    current = np.asarray(current, dtype=float)
    current = current[:, None] if current.ndim == 1 else current
    if current.ndim != 2 or len(current) != count or not np.isfinite(current).all():
        raise DataError(f"The current has shape {current.shape}; give finite numbers, (n,) or (n, currents), for {count} readings.")
    return current


def _regression(m: np.ndarray, columns: np.ndarray, scale: np.ndarray, failure: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Coefficients (3, c) of readings on columns of size `scale`, their standard errors, and the noise, by linear least squares."""
    scaled = columns / scale
    if len(m) <= columns.shape[1] or np.linalg.cond(scaled) > 1e6:
        raise DataError(failure)
    found = np.linalg.lstsq(scaled, m, rcond=None)[0]
    variance = np.sum((m - scaled @ found) ** 2, axis=0) / (len(m) - columns.shape[1])
    error = np.sqrt(np.outer(variance, np.diag(information(scaled).covariance)))
    return found.T / scale, error / scale, float(np.sqrt(variance.mean()))


def _largest(columns: np.ndarray) -> np.ndarray:
    size = np.abs(columns).max(axis=0, initial=0.0)
    return np.where(size > 0, size, 1.0)


@host_float64
def motor_terms(m: Any, current: Any) -> CurrentTerms:
    r"""Field per ampere, from readings of a vehicle that stands still while its currents vary.

    .. math:: m_i = m_0 + \sum_j k_j I_{ij}

    Parameters
    ----------
    m : (n, 3) readings.
    current : (n,) or (n, currents) current or throttle of each motor.

    Returns
    -------
    CurrentTerms

    Raises
    ------
    DataError
        If the shapes differ, or a current does not vary independently.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import motor_terms
    >>> current = np.linspace(0, 20, 50)
    >>> print(motor_terms([20.0, 5.0, 40.0] + np.outer(current, [0.3, 0.0, -0.1]), current).terms.T.round(6) + 0.0)
    [[ 0.3  0.  -0.1]]

    References
    ----------
    Linear least squares of the reading against the currents, per axis: the compass-motor calibration of ArduPilot, with errors.
    """
    m = array(m, "readings")
    columns = np.column_stack([_columns_of(current, len(m)), np.ones(len(m))])
    failure = "A current does not vary by itself in these readings; change the currents one after the other."
    terms, error, noise = _regression(m, columns, _largest(columns), failure)
    return CurrentTerms(terms[:, :-1], error[:, :-1], np.zeros(columns.shape[1] - 1), noise, None)


class AttitudeFit(eqx.Module):
    """A full calibration from known attitudes, as `fit_attitudes` finds it.

    Attributes
    ----------
    model : `MagModel` with a full soft iron, rotation included.
    currents : (3, c) field per unit of each current, in the unit of the readings.
    error : (3, 4 + c) standard errors of the columns of C, then of b, then of each k.
    noise : standard deviation of one axis of a reading, in its unit.

    Examples
    --------
    >>> from jaxcal.magnetometer import body_field, fit_attitudes, scenario
    >>> h = body_field(scenario("twelve_points"), 50.0)
    >>> found = fit_attitudes(h + [1.0, 2.0, 3.0], h)
    >>> print(found.model.hard_iron.round(6), found.error.shape)
    [1. 2. 3.] (3, 4)
    """

    model: MagModel
    currents: AnyArray
    error: AnyArray
    noise: float


@host_float64
def fit_attitudes(m: Any, field: Any, *, current: Any = None) -> AttitudeFit:
    r"""Hard iron and full soft iron, rotation included, by linear least squares from readings in known fields.

    .. math:: m_i = C h_i + b + \sum_j k_j I_{ij}

    Parameters
    ----------
    m : (n, 3) readings.
    field : (n, 3) true field in body axes at each reading, from the attitude and a field model, as from `body_field`.
    current : (n,) or (n, currents) currents whose fields are to be fitted too.

    Returns
    -------
    AttitudeFit

    Raises
    ------
    DataError
        If the shapes differ, or the attitudes do not determine twelve parameters.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import MagModel, body_field, fit_attitudes, scenario
    >>> h = body_field(scenario("twelve_points"), 50.0)
    >>> true = MagModel(np.array([[1.0, 0.1, 0.0], [-0.1, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.array([1.0, 2.0, 3.0]))
    >>> print(fit_attitudes(true.measure(h), h).model.soft_iron.round(6)[0] + 0.0)
    [1.  0.1 0. ]

    References
    ----------
    The magnetometer paper, equation (5), which is linear in C and b where the field in body axes is known; A. Bjorck, Numerical Methods
    for Least Squares Problems, 1996, section 1.
    """
    m = array(m, "readings")
    field = array(field, "fields")
    if len(field) != len(m):
        raise DataError(f"There are {len(m)} readings and {len(field)} fields; give one for each reading.")
    extra = np.zeros((len(m), 0)) if current is None else _columns_of(current, len(m))
    scale = np.concatenate([np.full(3, np.sqrt(np.mean(field**2)) or 1.0), [1.0], _largest(extra)])
    failure = "The attitudes (or currents) do not determine soft iron and hard iron; take readings in more attitudes."
    found, error, noise = _regression(m, np.column_stack([field, np.ones(len(m)), extra]), scale, failure)
    return AttitudeFit(MagModel(found[:, :3], found[:, 3]), found[:, 4:], error, noise)


def _distances(iron: dict[str, Array], data: tuple[Array, Array, Array]) -> Array:
    """Weighted distances to {x : |U (x - b)| = s}, after subtracting the fields of currents; `data`: readings, currents and weights."""
    u, current, weight = data
    shape = iron["upper"].T @ iron["upper"] * jnp.exp(-2 * iron["log_size"])
    return weight * signed_distance(shape, u - current @ iron["terms"].T - iron["centre"][None, :])


def _fitted(u: np.ndarray, current: np.ndarray, start: dict[str, Any], free: dict[str, Any]) -> tuple[Fit, np.ndarray]:
    """The fit, and the covariance of its free parameters, in the order centre, size, terms, U."""
    found = solve(_distances, start, (filled(u, u[:1]), filled(current), filled(np.ones(len(u)))), free=free)
    return found, spread_of(found)


@host_float64
def fit_current(m: Any, current: Any, **options: Any) -> CurrentTerms:
    """Hard iron, soft iron and the fields of currents together, from readings in all attitudes while the currents vary.

    The hard iron is the one without currents. The same fit serves anything else that shifts the hard iron in proportion, such as a
    temperature. The heading error holds at zero current, or at the recorded current nearest to zero.

    Parameters
    ----------
    m : (n, 3) readings. Rows with NaN are left out; with a `Gyroscope` its rates in these rows are still used.
    current : (n,) or (n, currents) current or throttle at the times of the readings; or a dictionary, name -> (n,).
    options : options of `fit`, for the readings after the fields of the currents are subtracted. `model` is "symmetric" by default and
        cannot be "planar". With `joint`, these readings are fitted together with the `aid`; the terms come from the magnitudes alone.

    Returns
    -------
    CurrentTerms, with `fit`. Covariance, heading error and verdict of `fit` include the errors of the terms; `fit.terms` has them by name.

    Raises
    ------
    DataError
        If the shapes differ, a current does not vary, or the readings determine no ellipsoid.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import body_field, fit_current, scenario
    >>> rng = np.random.default_rng(0)
    >>> current = rng.uniform(0, 20, 360)
    >>> m = body_field(scenario("all"), 50.0) + np.outer(current, [0.5, 0.0, -0.2]) + 0.1 * rng.normal(size=(360, 3))
    >>> print(np.abs(fit_current(m, current).terms.T - [0.5, 0.0, -0.2]).max() < 0.01)
    True

    References
    ----------
    The magnetometer paper, equation (5), with k I(t) added; distances as in `residuals`.
    """
    m = array(m, "readings")
    names = list(current) if isinstance(current, dict) else None
    columns = _columns_of(np.column_stack(list(current.values())) if isinstance(current, dict) else current, len(m))
    names = names or [f"current {i + 1}" for i in range(columns.shape[1])]
    if options.get("model") == "planar":
        raise DataError("Currents are fitted to norms in all attitudes: leave out model='planar'.")
    joint, aid, limits = options.pop("joint", False), options.pop("aid", None), options.get("limits", LIMITS)
    if joint:
        checked_joint(options.get("method", "ml"), options.get("model", "auto"), aid, options.get("loss"), options.get("field_error"))
    there = np.isfinite(m).all(axis=1)
    kept = there.copy()
    kept[there] = ~at_end(m[there])
    whole, given, m, columns = m, columns, m[kept], columns[kept]
    size = np.ptp(columns, axis=0)
    if not size.all():
        raise DataError("A current is constant: its field cannot be told from hard iron.")
    first = fit(m, method="consistent")
    if first.model is None:
        first = fit(m, model="symmetric", loss="huber")
    if first.model is None:
        raise DataError(f"The readings determine no ellipsoid to begin with. {first.reason}")
    frame = Frame.of(m)
    u, (shape, centre) = frame.scaled(m), ellipsoid_of_model(first.model, frame, first.field)
    start = {"upper": np.linalg.cholesky(shape).T, "centre": centre, "log_size": 0.0, "terms": np.zeros((3, columns.shape[1]))}
    free = {"upper": np.triu(np.ones((3, 3), dtype=bool)), "centre": True, "log_size": False, "terms": True}
    found, matrix = _fitted(u, (columns - columns.mean(axis=0)) / size, start, free)
    scale = frame.scale / size
    terms = np.asarray(found.model["terms"]) * scale
    matrix = matrix[3:-6, 3:-6] * np.outer(np.tile(scale, 3), np.tile(scale, 3))
    error = np.sqrt(np.diag(matrix)).reshape(3, -1)
    calibrated = fit(m - columns @ terms.T, **{"model": "symmetric", **options})
    units = u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-12)
    table = np.corrcoef(np.concatenate([units, columns], axis=1).T)
    if calibrated.model is not None:
        rows = np.where(kept[:, None], whole - given @ terms.T, np.nan)
        if joint:
            calibrated = jointly_with_terms(calibrated, rows, given, matrix, aid, limits)
        else:
            calibrated = widened_by_terms(calibrated, m - columns @ terms.T, columns, matrix, limits)
        by_name = {name: np.stack([terms[:, i], error[:, i]]) for i, name in enumerate(names)}
        lost = (
            ()
            if np.array_equal(kept, there)
            else (f"{np.sum(there & ~kept)} readings stand at the end of the range of an axis, and are left out.",)
        )
        calibrated = dataclasses.replace(calibrated, terms=by_name, warnings=(*calibrated.warnings, *lost))
        if aid is not None and not joint:
            calibrated = aligned(calibrated, rows, aid)
    return CurrentTerms(terms, error, np.abs(table[3:, :3]).max(axis=1), float(calibrated.noise), calibrated)


@host_float64
def fit_offset(m: Any, model: MagModel, *, field: float | int | None = None) -> tuple[MagModel, AnyArray]:
    """A new hard iron with the soft iron kept, for use after a change of the sensor's mounting.

    Parameters
    ----------
    m : (n, 3) readings; a third of a sphere is enough.
    model : the earlier calibration.
    field : magnitude of the field in the unit of the corrected readings; None fits it too.

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
    inverse = np.linalg.inv(np.asarray(model.soft_iron))
    z = (m - m.mean(axis=0)) @ inverse.T
    *centre, _ = np.linalg.lstsq(np.column_stack([2 * z, np.ones(len(z))]), np.sum(z**2, axis=1), rcond=None)[0]
    size = np.sqrt(np.mean(np.sum((z - centre) ** 2, axis=1))) if field is None else float(field)
    centre = np.asarray(model.soft_iron) @ np.array(centre) / frame.scale
    start = {"upper": inverse, "centre": centre, "log_size": np.log(size / frame.scale), "terms": np.zeros((3, 0))}
    free = {"upper": False, "centre": True, "log_size": field is None, "terms": False}
    found, matrix = _fitted(frame.scaled(m), np.zeros((len(m), 0)), start, free)
    matrix = matrix[:3, :3] * frame.scale**2
    if not bool(found.usable) or not np.isfinite(matrix).all():
        raise DataError(f"The readings do not determine the hard iron: {found.message}")
    return MagModel(model.soft_iron, frame.centre + frame.scale * np.asarray(found.model["centre"])), matrix


def fit_several(readings: dict[str, Any], **options: Any) -> dict[str, MagFit]:
    """Calibrate several magnetometers on one body, read at the same times, and rotate all of them into the axes of the first.

    Parameters
    ----------
    readings : name -> (n, 3) readings, with rows at the same times.
    options : options of `fit`. The `aid` belongs to the first sensor; its rotation is found once and used for all.

    Returns
    -------
    name -> `MagFit`. Every model gives fields in the axes of the first sensor, up to the errors of the sensor's own soft iron.

    Raises
    ------
    DataError
        If the lengths differ, or a sensor has no model.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import MagModel, body_field, fit_several, scenario
    >>> h = body_field(scenario("all"), 50.0)
    >>> turned = MagModel(np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.ones(3))
    >>> fits = fit_several({"mast": h, "board": turned.measure(h)})
    >>> print(np.abs(fits["board"].model.correct(turned.measure(h)) - h).max() < 1e-6)
    True

    References
    ----------
    G. Wahba, SIAM Review 7 (1965) 409 (the rotation, by singular values).
    """
    # not wrapped in `host_float64`: it passes dictionaries on in alphabetical order, and the first sensor matters here
    arrays = {name: array(m, f"readings of {name}") for name, m in readings.items()}
    if not arrays or len({len(m) for m in arrays.values()}) > 1:
        raise DataError(f"The sensors have {[len(m) for m in arrays.values()]} readings; give rows at the same times for all.")
    aid = options.pop("aid", None)
    found: dict[str, MagFit] = {}
    reference = None
    for name, m in arrays.items():
        one = fit(m, **options, aid=aid if reference is None else None)
        if one.model is None:
            raise DataError(f"{name}: {one.reason}")
        y = np.asarray(one.model.correct(m)) / one.field
        if reference is None:
            reference = y
        else:
            left, _, right = np.linalg.svd(y.T @ reference)
            rotation = left @ np.diag([1, 1, np.sign(np.linalg.det(left @ right))]) @ right
            model = MagModel(np.asarray(one.model.soft_iron) @ rotation, one.model.hard_iron)
            one = dataclasses.replace(one, model=model)
        found[name] = one
    return found
