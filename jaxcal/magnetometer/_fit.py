"""`fit`: hard and soft iron from readings in a field of constant magnitude."""

import dataclasses
import functools
from typing import Any

import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._frozen import made
from .._log import field_readings
from .._precision import host_float64, is_traced
from ..fitting import AbstractLoss
from ._design._coverage import covered, sphere_grid
from ._design._heading_error import heading_departure, heading_error, heading_range, information, needed
from ._diagnosis import CLIPPED, assumptions, at_end, checked_conditions, cost_of, costs_of, error_with_terms, sentences
from ._ellipsoid._algebraic import NotEllipsoid, algebraic, axes, consistent, constrained, extents, li_griffiths, minmax
from ._ellipsoid._causes import examined, step_by
from ._ellipsoid._kinds import COUNT, NAMES, PLANAR, PLANAR_NAMES, SOLID, parameters_of
from ._ellipsoid._orthogonal import described, estimate, geometric, left_out, loss_of, refined
from ._ellipsoid._residuals import Size
from ._ellipsoid._select import LONG, all_distances, by_bic, by_held_out, candidates, thinned
from ._ellipsoid._shape import Found, Frame, covariance_of, directions_of, in_plane, model_of, radius_of
from ._field import INCLINATION
from ._model import MagModel
from ._own_model import fit_model, one_by_one
from ._result import LIMITS, NEAR_PLANAR, NEAR_PLANAR_SENTENCE, NOT_JUDGED, MagFit, judge, outliers, refusal
from ._rotation._align import Accelerometer, align, vertical
from ._rotation._joint import checked_joint, jointly, with_rotation

_LINE = 0.01  # second singular value of the centred readings; it is 0.58 for a full sphere
_FEW = 64
_EXACT = ("ml", "consistent")
_EXTREMES = ("minmax", "axes")
#: method -> model -> algebraic fit
_DIRECT: dict[str, dict[str, Any]] = {
    "minmax": {"diagonal": minmax},
    "axes": {"symmetric": axes},
    "constrained": {"symmetric": constrained},
    "li_griffiths": {"symmetric": li_griffiths},
    "algebraic": {kind: functools.partial(algebraic, kind=kind) for kind in reversed(SOLID)},
    "consistent": {"symmetric": lambda u: consistent(u)[:2]},
}
_METHODS = ("ml", "consistent", "algebraic", "li_griffiths", "constrained", "radial", "axes", "minmax")
_MODELS = ("auto", *SOLID, "planar")


@host_float64
def fit(
    m: Any,
    *,
    method: str = "ml",
    model: str | MagModel = "auto",
    field: Any = None,
    field_error: float | None = None,
    loss: str | AbstractLoss | None = None,
    inclination: float | None = None,
    choose: str = "bic",
    limits: tuple[float, float] = LIMITS,
    per_direction: int | None = 32,
    penalty: float = 0.5,
    aid: Any = None,
    joint: bool = False,
    conditions: dict[str, Any] | None = None,
) -> MagFit:
    r"""Hard and soft iron from readings in many attitudes, in a field of constant magnitude.

    The default is the maximum-likelihood fit. It assumes white noise of one unknown variance in all axes, and any attitudes:

    .. math:: \min_{A, b} \sum_i d_i^2,\qquad d_i = \text{distance of } m_i \text{ to } (x - b)^T A (x - b) = 1,\quad A = U^T U,

    and starts from the consistent algebraic fit. Where the noise exceeds 2 % of the field, the fit corrects the distances for the mean
    offset that noise causes at a curved surface. The soft iron found is symmetric, C = H A^{-1/2}. A rotation of all corrected readings,
    from an unsymmetric soft iron or a rotated sensor, leaves every magnitude unchanged, so magnitudes alone cannot show it. With an
    `aid`, `align` finds this rotation after the fit, and the soft iron includes it.

    Parameters
    ----------
    m : (n, 3) readings in any unit, without NaN. Or a `Log`, or a path, data frame or dataset of one; rows without a reading are then
        left out.
    method : "ml", or "consistent" (adjusted least squares: no noise bias, no iteration). For comparison: "algebraic" (trace
        constraint), "li_griffiths", "constrained" (the magnetometer paper), "radial" (magnitude error of the corrected field), "axes" and
        "minmax" (from the extreme readings, as in the thesis).
    model : "sphere" (4 parameters), "diagonal" (6), "symmetric" (9), or "planar" (circle or ellipse, for turns about one axis). With
        "auto", "ml" chooses a model and the other methods use their largest one. Or a model object: a `MagModel`, or a subclass with
        fields of its own. "ml" then fits its floating leaves, from their values or from the algebraic fit.
    field : magnitude of the true field, or the field vector (north, east, down), in the unit of the readings. The vector also gives the
        dip. Without `field`, the corrected readings keep the unit and mean size of the readings.
    field_error : relative standard deviation of `field` in the unit of the readings. It covers the sensor's sensitivity and the mean
        stretch of its soft iron as well as the field model. The fit then uses `field`, which helps most with part of a sphere.
    loss : None, "huber", "cauchy", "tukey" or a loss of `jaxcal.fitting`, for readings with outliers; "ml" and "radial" only.
    inclination : dip of the field in rad, used for `heading_error`. By default it comes from `field` or from an `Accelerometer`; without
        either, 57 degrees are assumed and `heading_range` gives the error for other dips.
    choose : "bic" or "held_out": how "auto" compares models.
    limits : rms heading errors in rad above which the verdict is "weak" and "refused".
    per_direction : number of readings to keep in each of 500 directions, for logs of more than 20,000 readings: neighbouring readings
        repeat one another. None fits all readings, which takes 15 s for 100,000.
    penalty : weight of the penalty log det M / 2, where M is the information of the corrected directions. It keeps "ml" fits from diverging
        when there are few readings, or readings from a corner of the sphere only. It is omitted where it would change a fit by less than
        a tenth of a standard error. 1 is Jeffreys' prior (Firth), 0 plain maximum likelihood; 0.5 has the smallest Monte Carlo errors.
    aid : `Accelerometer`, `Gyroscope` or `Headings` that shows the rotation, as in `align`. Without an aid, the accelerometer of a `Log`
        shows the dip.
    joint : fit the magnitudes together with the accelerometer or the gyroscope, each residual divided by its own standard deviation.
        One fit then gives full soft iron, hard iron and rotation. This is far better than two fits where magnitudes leave the hard iron
        open but rates show it, as in a vehicle that tilts by 20 degrees. Needs model "auto" or "symmetric", method "ml" and no loss. A
        long log is thinned to the same readings as without `joint`; rates are integrated first.
    conditions : name -> array with one number per reading, such as a motor current or the temperature. The fit checks whether the
        residuals follow it (see `MagFit.causes`). With a model object: further arguments of its `measure` and `correct`.

    Under `jit`, `vmap` and `grad` the fit uses method "ml" and model "sphere", "diagonal", "symmetric" or "planar"; "planar" then fits an
    ellipse. A traced condition selects the curvature term, there is no penalty and no thinning, and `verdict` is "not judged".

    Returns
    -------
    MagFit
        The fit with its verdict. Readings that determine nothing give a "refused" fit whose `model` is None. The model of a refused fit
        is for inspection only; do not use it.

    Raises
    ------
    DataError
        If the readings are not (n, 3) finite numbers, or an option is unknown or does not suit the method.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from jaxcal.magnetometer import MagModel, body_field, scenario
    >>> true = MagModel(np.array([[1.1, 0.1, 0.0], [0.1, 0.9, 0.0], [0.0, 0.0, 1.0]]), np.array([10.0, -5.0, 20.0]))
    >>> m = true.measure(body_field(scenario("all"), 47.0)) + np.random.default_rng(0).normal(size=(360, 3)) * 0.1
    >>> found = jaxcal.magnetometer.fit(m, field=47.0)
    >>> print(found.verdict, found.kind, found.model.hard_iron.round(1))
    good symmetric [10. -5. 20.]

    References
    ----------
    J. F. Vasconcelos et al., IEEE Trans. Aerosp. Electron. Syst. 47 (2011) 1293 (maximum likelihood); I. Markovsky et al., Numer.
    Math. 98 (2004) 177 (consistent); the magnetometer paper's equations 6 to 16 (constrained); the thesis, chapter 6.
    """
    m, force = field_readings(m)
    if isinstance(model, MagModel):
        if method != "ml" or loss is not None or field_error is not None or aid is not None:
            raise DataError("A model object is fitted by method='ml', without `loss`, `field_error` and `aid`.")
        if traced := is_traced(m, model, field, conditions):
            norm, dip = _norm_and_dip(field, inclination)
        else:
            m, norm, dip = _checked(m, method, "auto", field, loss, inclination, choose, penalty, field_error)
        return fit_model(m, model, norm, dip, conditions or {}, limits, traced)
    if is_traced(m, field):
        given = {"method": method != "ml", "loss": loss is not None, "field_error": field_error is not None, "aid": aid is not None}
        given["conditions"] = bool(conditions)
        return _traced(m, model, field, inclination, [name for name, there in given.items() if there])
    m, norm, dip = _checked(m, method, model, field, loss, inclination, choose, penalty, field_error)
    if aid is None and force is not None:
        aid = Accelerometer(force, turns=False)
    loss, recorded = loss_of(loss), checked_conditions(conditions or {}, len(m))
    if joint:
        checked_joint(method, model, aid, loss, field_error)
    whole, assumed = m, inclination is None and np.ndim(field) == 0
    full = np.zeros(len(m), dtype=bool) if method in _EXTREMES else at_end(m)
    used = np.flatnonzero(~full)
    if per_direction is not None and len(used) > LONG and method not in _EXTREMES:
        used = used[thinned(Frame.of(m[used]).scaled(m[used]), per_direction, loss)]
    m = whole[used]
    distinct = _distinct(m)
    frame = Frame.of(m)
    if distinct < 2 or frame.scale < 1e-12 * np.abs(m).max():
        return refusal(method, dip, f"There are {distinct} distinct readings; a sphere needs at least 5, and soft iron 10.")
    u = frame.scaled(m)
    prior = None if field_error is None or norm is None else Size(float(np.log(norm / frame.scale)), float(field_error))
    spread = extents(u)
    if spread[1] < _LINE:
        return refusal(method, dip, "The readings lie on a line: turn the sensor through all attitudes.")
    flat = spread[2] < NEAR_PLANAR
    planar = "asked" if model == "planar" else "chosen" if flat and model == "auto" and method == "ml" else None
    kind = None if model == "auto" or planar else model
    if kind is None and method != "ml":
        kind = "symmetric" if method == "radial" else next(iter(_DIRECT[method]))
    least = kind or ("circle" if planar else "sphere")
    if distinct <= COUNT[least]:
        name = "planar" if planar else least
        return refusal(method, dip, f"There are {distinct} distinct readings; model {name!r} needs at least {COUNT[least] + 1}.")
    plane, notes, unseen = None, [], np.zeros((0, 9))
    try:
        if planar:
            plane = np.linalg.svd(u, full_matrices=False)[2]
            plane[2] *= np.sign(np.linalg.det(plane))
            u = in_plane(u, plane)
        if kind is None:
            fits, occupied = candidates(u, PLANAR if planar else SOLID, loss, distinct)
            chosen = fits[by_held_out(fits, u, loss) if choose == "held_out" and not planar else by_bic(fits, occupied)]
            notes = _unseen(fits, chosen, distinct, frame, dip, limits[0])
            unseen = left_out(fits, chosen, u, loss, penalty)[None]
            found = refined(chosen, u, loss, penalty, prior)
        elif method in ("ml", "radial"):
            found = geometric(u, kind, loss, "orthogonal" if method == "ml" else "radial", penalty, prior)
        else:
            found = described(parameters_of(kind, *_DIRECT[method][kind](u)), u, kind)
    except NotEllipsoid as error:
        return refusal(method, dip, (f"{NEAR_PLANAR_SENTENCE} " if flat else "") + f"{str(error)[0].upper()}{str(error)[1:]}.")
    if planar == "chosen":
        notes = ["The readings are near-planar, and were fitted in their plane.", *notes]
    log = frame.scaled(whole) if plane is None else in_plane(frame.scaled(whole), plane)
    said = examined(found, u, log, used, recorded, prior)
    told = _told(dataclasses.replace(found, covariance=said.covariance), frame, norm, dip, plane, [unseen, *(c.steps for c in said.causes)])
    if method not in _EXACT:
        try:
            best = geometric(u, "symmetric" if _distinct(u) > COUNT["symmetric"] else found.kind, loss, penalty=penalty)
            told["heading_error"] = np.hypot(told["heading_error"], heading_departure(found, best, dip))
        except NotEllipsoid:
            told["heading_error"] = np.full(2, np.inf)
    turn = align(whole, told["model"], aid) if getattr(aid, "turns", aid is not None) else None
    seen, down = vertical(aid, turn, _corrected(told["model"], whole))
    shape, matrix = found.shape / frame.scale**2, told["covariance"]
    if seen is not None and plane is None and method in _EXACT:
        dip = float(seen) if assumed else dip
        told["heading_error"] = heading_error(shape, matrix, dip, down)
    known = information(directions_of(found, u), found.kind, found.noise / radius_of(found.shape, plane is not None))
    verdict, reason = judge(found, u, told["heading_error"], known, limits, loss, notes, said, cost_of(found, said.swing, dip))
    dips = None if assumed and seen is None else dip
    span = np.full(2, np.nan) if plane is not None else heading_range(shape, matrix, dips, down)
    reason += assumptions(dip, dips is None, down is None, span, assumed and seen is not None)
    costs, warnings = costs_of(said, found, told["heading_error"], dip), []
    if full.any():
        costs = {CLIPPED: cost_of(found, step_by(found, u, log[full], all_distances(found, log[full]))[None], dip), **costs}
        warnings.append(
            f"{full.sum()} readings stand at the end of the range of an axis, where the sensor is saturated. They are left out; with them "
            f"headings would turn by {np.rad2deg(costs[CLIPPED]):.2g} degrees rms. Use a larger range of the sensor."
        )
    if len(used) + full.sum() < len(whole):
        warnings.append(f"{len(used)} of {len(whole)} readings were fitted, evenly from all directions; residuals and outliers are of all.")
    warnings += sentences(said, costs, limits[0], error_with_terms(said, found, dip))
    result = made(
        MagFit, verdict=verdict, reason=reason, method=method, inclination=dip, condition=known.condition, kind=found.kind,
        penalty=found.penalty, field_error=field_error, names=NAMES if plane is None else PLANAR_NAMES, causes=costs, blocks=said.blocks,
        down=np.array([0.0, 0.0, 1.0]) if down is None else down, heading_range=span, **told,
        **_of_all(found, frame, whole, told, norm, warnings),
    )  # fmt: skip
    if turn is None:
        return result
    after = with_rotation(result, turn, field, limits)
    return after if aid is None or not joint else jointly(after, whole, aid, limits=limits, rows=used)


def _distinct(m: np.ndarray) -> int:
    """Number of distinct readings; only the first few are counted where these suffice for any model."""
    few = len({row.tobytes() for row in m[:_FEW] + 0.0})  # adding zero turns -0.0 into 0.0
    return few if few > COUNT["symmetric"] else len(np.unique(m, axis=0))


def _corrected(model: MagModel, m: np.ndarray) -> np.ndarray:
    """Corrected readings, computed by NumPy, because JAX would compile a program for each length of log."""
    return (m - model.hard_iron) @ np.linalg.inv(model.soft_iron).T


def _of_all(found: Found, frame: Frame, m: np.ndarray, told: dict[str, Any], norm: float | None, warnings: list[str]) -> dict[str, Any]:
    """The results that cover all readings, even if only some were fitted."""
    model, plane, used = told["model"], told["plane"], len(found.distance)
    mean = frame.scale * radius_of(found.shape, plane is not None)
    if norm is not None and not 0.8 <= mean / norm <= 1.25:
        warnings.append(
            f"The readings have a mean field of {mean:.4g}, the given one is {norm:.4g}: the units differ, the sensitivity is off, or the "
            "readings cover too little of the sphere."
        )
    distance, far, wanted = found.distance, outliers(found.distance, found.weight), np.zeros((0, 3))
    if used < len(m):
        u = frame.scaled(m)
        distance = all_distances(found, u if plane is None else in_plane(u, plane))
        far = outliers(distance)
    if plane is None and np.isfinite(told["covariance"]).all():
        wanted = needed(found.shape / frame.scale**2, told["covariance"], sphere_grid())
    return {
        "residual": distance * frame.scale, "outliers": far, "coverage": covered(_corrected(model, m)), "needed": wanted, "used": used,
        "warnings": tuple(warnings),
    }  # fmt: skip


def _unseen(fits: dict[str, Found], chosen: Found, distinct: int, frame: Frame, dip: float, limit: float) -> list[str]:
    """A warning that a smaller model was fitted because the readings cannot show the largest one, or no sentence."""
    largest = "ellipse" if chosen.kind in PLANAR else "symmetric"
    full = fits.get(largest)
    if chosen.kind == largest or (full is not None and full.converged and _told(full, frame, None, dip)["heading_error"][0] <= limit):
        return []
    few = f"{distinct} distinct readings" if distinct <= COUNT[largest] else "The readings"
    what = "an ellipse" if chosen.kind in PLANAR else "a full soft iron matrix"
    return [f"{few} cannot show {what}; model {chosen.kind!r} was fitted, and what it leaves out was not seen to be absent."]


def _traced(m: Any, model: str, field: Any, inclination: Any, refused: list[str]) -> MagFit:
    """The fit under `jit`, `vmap` and `grad`: maximum likelihood with a given model, without a verdict."""
    if model not in (*SOLID, "planar") or refused:
        said = ", ".join(f"`{name}`" for name in refused) or f"model={model!r}"
        raise DataError(
            "A traced fit has its structure fixed by model='sphere', 'diagonal', 'symmetric' or 'planar' and method='ml'; "
            f"{said} is decided on the host. Leave it out, or call `fit` outside of jit, vmap and grad."
        )
    kind = "ellipse" if model == "planar" else model
    if m.ndim != 2 or m.shape[1] != 3 or len(m) <= COUNT[kind]:
        raise DataError(f"The readings have shape {m.shape}; model {model!r} needs (n, 3) with at least {COUNT[kind] + 1} rows.")
    norm, dip = _norm_and_dip(field, inclination, model)
    told = one_by_one(functools.partial(_pure, kind), dip, m, norm)
    names = PLANAR_NAMES if model == "planar" else NAMES
    return dataclasses.replace(refusal("ml", dip, NOT_JUDGED), verdict="not judged", kind=kind, names=names, used=len(m), **told)


def _pure(kind: str, dip: float, m: Any, norm: Any) -> dict[str, Any]:
    """The results of a traced fit, from the readings and the magnitude of the field."""
    frame = Frame.of(m)
    u = frame.scaled(m)
    plane = _plane(u) if kind in PLANAR else None
    found = estimate(u if plane is None else in_plane(u, plane), kind)
    return {**_told(found, frame, norm, dip, plane), "residual": found.distance * frame.scale}


def _told(found: Found, frame: Frame, norm: Any, dip: float, plane: Any = None, biases: Any = None) -> dict[str, Any]:
    """The fields of a `MagFit` that follow from an ellipsoid, traced or not."""
    size = radius_of(found.shape, plane is not None) if norm is None else norm / frame.scale
    covariance = covariance_of(found, frame, None if biases is None else np.concatenate(biases))
    return {
        "model": model_of(found.shape, found.centre, frame, size, plane), "covariance": covariance, "field": size * frame.scale,
        "heading_error": heading_error(found.shape / frame.scale**2, covariance, dip), "noise": found.noise * frame.scale, "plane": plane,
    }  # fmt: skip


def _plane(u: Any) -> Any:
    """Axes of the plane nearest to the readings, and its normal, (3, 3), with the derivative of the normal.

    A rotation about the normal changes nothing, so it has no derivative.
    """
    scatter = u.T @ u
    values, axes = jax.lax.stop_gradient(jnp.linalg.eigh(scatter))
    normal, inside = axes[:, 0], axes[:, :0:-1].T
    tilt = inside @ scatter @ normal / (values[:0:-1] - values[0])  # its value is zero, only its derivative matters
    return jnp.concatenate([inside + tilt[:, None] * normal[None, :], (normal - tilt @ inside)[None, :]])


def _checked(m, method, model, field, loss, inclination, choose, penalty, field_error) -> tuple[np.ndarray, float | None, float]:
    """Readings, magnitude of the field and dip, after a check that each option is known and suits the method."""
    try:
        m = np.asarray(m, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError("The readings are not numbers; give an array of shape (n, 3).") from error
    if m.ndim != 2 or m.shape[1] != 3 or not len(m):
        raise DataError(f"The readings have shape {m.shape}; expected (n, 3), one row per reading.")
    bad = np.flatnonzero(~np.isfinite(m).all(axis=1))
    if bad.size:
        raise DataError(f"{bad.size} readings are not finite, the first in row {bad[0]}; leave them out.")
    if np.abs(m).max() > 1e100 or 0 < np.ptp(m) < 1e-100:
        raise DataError("The readings leave the range in which their fourth powers are numbers; give them in tesla or counts.")
    ways = ("bic", "held_out")
    for given, known, what in ((method, _METHODS, "method"), (model, _MODELS, "model"), (choose, ways, "way to choose")):
        if given not in known:
            raise DataError(f"There is no {what} {given!r}; known are {', '.join(map(repr, known))}.")
    allowed = {"ml": _MODELS, "radial": ("auto", *SOLID)}.get(method, ("auto", *_DIRECT.get(method, ())))
    if model not in allowed:
        raise DataError(f"Method {method!r} has no model {model!r}; it has {', '.join(map(repr, allowed))}. Method 'ml' has all.")
    if loss_of(loss) is not None and method not in ("ml", "radial"):
        raise DataError(f"Method {method!r} takes no loss; use method='ml' with loss={loss!r}.")
    if not (isinstance(penalty, (int, float)) and 0 <= penalty < np.inf):
        raise DataError(f"The penalty is {penalty!r}; give its weight: 0.5, 1 for Jeffreys' prior, or 0 for none.")
    norm, dip = _norm_and_dip(field, inclination, model)
    if field_error is not None:
        if norm is None or method != "ml":
            raise DataError("A field error needs the `field` that it is of, and method='ml'.")
        if not (isinstance(field_error, (int, float)) and 0 < field_error < 1):
            raise DataError(f"The field error is {field_error!r}; give the relative standard deviation of `field`, such as 0.02.")
    if not abs(dip) < np.pi / 2:
        raise DataError(f"The inclination is {dip:g} rad; it must lie between -pi/2 and pi/2, where there is a horizontal field.")
    return m, norm, float(dip)


def _norm_and_dip(field: Any, inclination: Any, model: str = "") -> tuple[Any, Any]:
    """Magnitude of the field, traced or not, and its dip: as given, from the field vector, or else the dip at Ankara."""
    if field is not None and model == "planar":
        raise DataError("Readings in a plane do not show the whole field: leave out `field` with model='planar'.")
    norm = dip = None
    if isinstance(field, jax.core.Tracer):
        norm = jnp.linalg.norm(jnp.atleast_1d(field))
    elif field is not None:
        vector = np.asarray(field, dtype=float)
        norm = float(np.linalg.norm(vector))
        if vector.shape not in ((), (3,)) or not 0 < norm < np.inf or (vector.ndim == 0 and vector < 0):
            raise DataError(f"The field is {field!r}; give its norm, or the vector (north, east, down), in the unit of the readings.")
        dip = float(np.arctan2(vector[2], np.hypot(vector[0], vector[1]))) if vector.ndim else None
    return norm, next(angle for angle in (inclination, dip, INCLINATION) if angle is not None)
