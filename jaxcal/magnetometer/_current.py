"""Fields of the vehicle's own currents, and fits of readings whose attitudes are known: all linear, or nearly."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import host_float64
from .._solve import covariance, solve
from .._types import AnyArray, Array
from ._align import array
from ._distance import signed_distance
from ._fit import fit
from ._model import MagModel
from ._orthogonal import padded
from ._quadric import Frame
from ._residuals import shape_and_centre
from ._result import MagFit
from ._start import basis_of, parameters_of

_CORRELATED = 0.5


class CurrentTerms(eqx.Module):
    """Field per ampere of each current.

    Attributes
    ----------
    terms : (3, currents) k, in the unit of the readings per unit of current: m = C h + b + k I.
    error : (3, currents) standard deviations.
    correlation : (currents,) largest correlation of a current with the readings' directions; above 0.5 it is told apart badly.
    noise : standard deviation of a reading.
    fit : `MagFit` of the readings with the currents' fields taken off; None where the attitude was held.
    """

    terms: AnyArray
    error: AnyArray
    correlation: AnyArray
    noise: float
    fit: MagFit | None

    @host_float64
    def correct(self, m: Any, current: Any) -> AnyArray:
        """Readings (n, 3) without the fields of the currents (n,) or (n, currents)."""
        return np.asarray(m) - _columns(current, len(m)) @ np.asarray(self.terms).T


def _columns(current: Any, count: int) -> np.ndarray:
    current = np.asarray(current, dtype=float)
    current = current[:, None] if current.ndim == 1 else current
    if current.ndim != 2 or len(current) != count or not np.isfinite(current).all():
        raise DataError(f"The current has shape {current.shape}; give finite numbers, (n,) or (n, currents), for {count} readings.")
    return current


@host_float64
def motor_terms(m: Any, current: Any) -> CurrentTerms:
    r"""Field per ampere from readings of a vehicle that stands still while its currents vary.

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
        If shapes differ, or a current does not vary by itself.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import motor_terms
    >>> current = np.linspace(0, 20, 50)
    >>> print(motor_terms([20.0, 5.0, 40.0] + np.outer(current, [0.3, 0.0, -0.1]), current).terms.T.round(6) + 0.0)
    [[ 0.3  0.  -0.1]]
    """
    m = array(m, "readings")
    columns = _columns(current, len(m))
    centred = columns - columns.mean(axis=0)
    if len(m) <= columns.shape[1] + 1 or np.linalg.cond(centred) > 1e6 or not centred.any():
        raise DataError("A current does not vary by itself in these readings; change the currents one after the other.")
    terms = np.linalg.lstsq(centred, m - m.mean(axis=0), rcond=None)[0]
    off = m - m.mean(axis=0) - centred @ terms
    variance = np.sum(off**2, axis=0) / (len(m) - columns.shape[1] - 1)
    error = np.sqrt(np.outer(variance, np.diag(np.linalg.inv(centred.T @ centred))))
    return CurrentTerms(terms.T, error, np.zeros(columns.shape[1]), float(np.sqrt(variance.mean())), None)


class Powered(eqx.Module):
    """Scaled readings u (n, 3), currents (n, c), weight (n,), and the basis of `shape_and_centre`."""

    u: Any
    current: Any
    weight: Any
    basis: Any


def powered(parameters: dict[str, Array], data: Powered) -> Array:
    """Weighted orthogonal distances of the readings less the fields of the currents."""
    shape, centre = shape_and_centre(parameters["p"], data.basis)
    return data.weight * signed_distance(shape, data.u - data.current @ parameters["k"].T - centre[None, :])


@host_float64
def fit_current(m: Any, current: Any, **options: Any) -> CurrentTerms:
    """Hard iron, soft iron and the fields of currents together, from readings in all attitudes while the currents vary.

    Parameters
    ----------
    m : (n, 3) readings.
    current : (n,) or (n, currents) current or throttle at the readings' times.
    options : those of `fit`, for the calibration of what remains; its `model` is symmetric here unless given.

    Returns
    -------
    CurrentTerms, with `fit`. The currents' terms are counted in its covariance only where they are not correlated with attitude.

    Raises
    ------
    DataError
        If shapes differ, a current does not vary, or the readings determine no ellipsoid.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import body_field, fit_current, scenario
    >>> rng = np.random.default_rng(0)
    >>> current = rng.uniform(0, 20, 360)
    >>> m = body_field(scenario("all"), 50.0) + np.outer(current, [0.5, 0.0, -0.2]) + 0.1 * rng.normal(size=(360, 3))
    >>> print(np.abs(fit_current(m, current).terms.T - [0.5, 0.0, -0.2]).max() < 0.01)
    True
    """
    m = array(m, "readings")
    columns = _columns(current, len(m))
    options = {"model": "symmetric", **options}
    size, middle = np.ptp(columns, axis=0), columns.mean(axis=0)
    if not size.all():
        raise DataError("A current is constant: its field cannot be told from hard iron.")
    first = fit(m, **{**options, "loss": options.get("loss") or "huber"} if options.get("method", "ml") == "ml" else options)
    if first.model is None:
        raise DataError(f"The readings determine no ellipsoid to begin with. {first.reason}")
    frame = Frame.of(m)
    u = frame.scaled(m)
    inverse = np.linalg.inv(np.asarray(first.model.soft_iron)) / first.field * frame.scale
    begin = parameters_of("symmetric", inverse.T @ inverse, (np.asarray(first.model.hard_iron) - frame.centre) / frame.scale)
    data = padded(u, "symmetric")
    relative = np.zeros((len(data.u), columns.shape[1]))
    relative[: len(m)] = (columns - middle) / size
    start = {"k": np.zeros((3, columns.shape[1])), "p": begin}
    found = solve(powered, start, Powered(data.u, relative, data.weight, basis_of("symmetric")))
    spread = np.sqrt(np.diag(np.asarray(covariance(found, scaled=True))))
    where = [i for i, name in enumerate(found.names) if "k" in name]
    scale = frame.scale / size
    terms = np.asarray(found.model["k"]) * scale
    error = spread[where].reshape(3, -1) * scale
    rest = m - columns @ terms.T
    calibrated = fit(rest, **options)
    units = u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-12)
    table = np.corrcoef(np.concatenate([units, columns], axis=1).T)
    correlation = np.abs(table[3:, :3]).max(axis=1)
    return CurrentTerms(terms, error, correlation, calibrated.noise, calibrated)


class AttitudeFit(eqx.Module):
    """Full calibration from known attitudes: `model` with any soft iron, `currents` (3, c), the (12 + 3c,) errors row by row of
    (C | b | k), and the noise of a reading.
    """

    model: MagModel
    currents: AnyArray
    error: AnyArray
    noise: float


@host_float64
def fit_attitudes(m: Any, field: Any, *, current: Any = None) -> AttitudeFit:
    r"""Hard iron and the whole soft iron, rotation included, from readings in known fields: linear least squares.

    .. math:: m_i = C h_i + b + \sum_j k_j I_{ij}

    Parameters
    ----------
    m : (n, 3) readings.
    field : (n, 3) true field in body axes at each, from the attitude and a field model, as `body_field` gives it.
    current : (n,) or (n, currents), for the vehicle's own fields.

    Returns
    -------
    AttitudeFit

    Raises
    ------
    DataError
        If shapes differ, or the attitudes do not determine twelve numbers.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import MagModel, body_field, fit_attitudes, scenario
    >>> h = body_field(scenario("twelve_points"), 50.0)
    >>> true = MagModel(np.array([[1.0, 0.1, 0.0], [-0.1, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.array([1.0, 2.0, 3.0]))
    >>> print(fit_attitudes(true.measure(h), h).model.soft_iron.round(6)[0] + 0.0)
    [1.  0.1 0. ]
    """
    m = array(m, "readings")
    field = array(field, "fields")
    if len(field) != len(m):
        raise DataError(f"There are {len(m)} readings and {len(field)} fields; give one for each reading.")
    extra = np.zeros((len(m), 0)) if current is None else _columns(current, len(m))
    size = np.sqrt(np.mean(field**2)) or 1.0
    columns = np.concatenate([field / size, np.ones((len(m), 1)), extra / (np.abs(extra).max(axis=0) if extra.size else 1.0)], axis=1)
    if len(m) <= columns.shape[1] or np.linalg.cond(columns) > 1e6:
        raise DataError("The attitudes (or currents) do not determine soft iron and hard iron; take readings in more attitudes.")
    scale = np.concatenate([np.full(3, size), [1.0], np.abs(extra).max(axis=0) if extra.size else []])
    found = np.linalg.lstsq(columns, m, rcond=None)[0]
    variance = np.sum((m - columns @ found) ** 2, axis=0) / (len(m) - columns.shape[1])
    error = np.sqrt(np.outer(variance, np.diag(np.linalg.inv(columns.T @ columns)))) / scale
    found = (found / scale[:, None]).T
    return AttitudeFit(MagModel(found[:, :3], found[:, 3]), found[:, 4:], error, float(np.sqrt(variance.mean())))


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


def fit_several(readings: dict[str, Any], **options: Any) -> dict[str, MagFit]:
    """Several magnetometers on one body, read at the same times: each calibrated, and all turned into the axes of the first.

    Parameters
    ----------
    readings : name -> (n, 3), rows at the same times.
    options : those of `fit`. A rotation of the first sensor (`accel`, `gyro`, `headings`) is found once, and holds for all.

    Returns
    -------
    name -> `MagFit`; the models of all but the first give fields in the axes of the first, as far as their own shape tells.

    Raises
    ------
    DataError
        If lengths differ, or a sensor has no model.

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
    # not a host driver itself: those hand dictionaries on in alphabetical order, and the first sensor matters
    arrays = {name: array(m, f"readings of {name}") for name, m in readings.items()}
    if not arrays or len({len(m) for m in arrays.values()}) > 1:
        raise DataError(f"The sensors have {[len(m) for m in arrays.values()]} readings; give rows at the same times for all.")
    aided = {name: options.pop(name) for name in ("accel", "gyro", "rate", "headings") if name in options}
    found: dict[str, MagFit] = {}
    reference = None
    for name, m in arrays.items():
        one = fit(m, **options, **(aided if reference is None else {}))
        if one.model is None:
            raise DataError(f"{name}: {one.reason}")
        y = np.asarray(one.model.correct(m)) / one.field
        if reference is None:
            reference = y
        else:
            left, _, right = np.linalg.svd(y.T @ reference)
            rotation = left @ np.diag([1, 1, np.sign(np.linalg.det(left @ right))]) @ right
            model = MagModel(np.asarray(one.model.soft_iron) @ rotation, one.model.hard_iron)
            one = eqx.tree_at(lambda f: f.model, one, model)
        found[name] = one
    return found
