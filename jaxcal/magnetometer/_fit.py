"""`fit`: hard and soft iron from readings in a field of constant norm."""

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import host_float64, is_traced
from ..fitting import AbstractLoss
from ._aligned import with_rotation
from ._checks import DIRECT, checked, norm_and_dip
from ._design._coverage import Coverage, covered, sphere_grid
from ._design._heading_error import heading_departure, heading_error, information, needed
from ._ellipsoid._algebraic import NotEllipsoid, extents
from ._ellipsoid._kinds import COUNT, NAMES, PLANAR, PLANAR_NAMES, SOLID, parameters_of
from ._ellipsoid._orthogonal import described, estimate, geometric, left_out, loss_of, refined
from ._ellipsoid._residuals import Size
from ._ellipsoid._select import LONG, all_distances, by_bic, by_held_out, candidates, thinned
from ._ellipsoid._shape import Found, Frame, covariance_of, directions_of, in_plane, model_of, radius_of
from ._model import MagModel
from ._own_model import fit_model, one_by_one
from ._result import LIMITS, NEAR_PLANAR, NEAR_PLANAR_SENTENCE, NOT_JUDGED, OUTLIER, MagFit, judge, outliers, refusal
from ._rotation._align import align
from ._rotation._joint import checked_joint, jointly

_LINE = 0.01  # second singular value of the centred readings, of 0.58 for a full sphere
_FEW = 64
_EXACT = ("ml", "consistent")
_EXTREMES = ("minmax", "axes")


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
    r"""Hard and soft iron from readings in many attitudes of a field of constant norm.

    The default is the maximum-likelihood fit for white noise of one unknown variance in all axes and any attitudes,

    .. math:: \min_{A, b} \sum_i d_i^2,\qquad d_i = \text{distance of } m_i \text{ to } (x - b)^T A (x - b) = 1,\quad A = U^T U,

    from the consistent algebraic fit; where the noise exceeds 2 % of the field the distances are freed of the mean that noise
    along the curved surface gives them. The soft iron is the symmetric one, C = H A^{-1/2}; a rotation of all corrected
    readings, as from an unsymmetric soft iron or a turned sensor, leaves every norm as it is and cannot be found this way. With
    an `aid` it is found after the fit, by `align`, and is part of the soft iron.

    Parameters
    ----------
    m : (n, 3) readings, any unit; NaN is not allowed.
    method : "ml"; "consistent" (adjusted least squares: no noise bias, no iteration); and for comparison "algebraic" (trace
        constraint), "li_griffiths", "constrained" (the magnetometer paper), "radial" (norm error of the corrected field), "axes" and
        "minmax" (the thesis, from the extremes).
    model : "sphere" (4 parameters), "diagonal" (6), "symmetric" (9), "planar" (circle or ellipse, for readings of turns about
        one axis), or "auto": "ml" chooses, the other methods take the largest they have. Or a model object, a `MagModel` or a
        subclass with fields of its own: its floating leaves are fitted by "ml", from their values or from the algebraic fit.
    field : norm of the true field, or the field vector (north, east, down), whose dip is then used too; in the unit of the
        readings. Without it the corrected readings keep the unit and mean size of the readings.
    field_error : relative standard deviation with which the norm `field` is known in the unit of the readings: the sensor's sensitivity
        and the mean stretch of its soft iron, not the field model alone. The fit then uses it, which helps most with part of a sphere.
    loss : None, "huber", "cauchy", "tukey" or a loss of `jaxcal.fitting`, for readings with outliers; "ml" and "radial" only.
    inclination : dip of the field in rad for `heading_error`; that of `field`, or 57 degrees (Ankara), unless given.
    choose : "bic" or "held_out", how "auto" compares models.
    limits : rms heading error in rad above which the verdict is "weak", and above which it is "refused".
    per_direction : logs of more than 20,000 readings are thinned to this many in each of 500 directions: neighbours repeat one
        another. None fits all of them, at 15 s for 100,000.
    penalty : weight of the penalty that keeps "ml" fits of few readings, or of a corner of the sphere, from running off: log det M / 2,
        M being the information of the corrected directions. It is left out where it would move a fit by less than a tenth of a
        standard error. 1 is Jeffreys' prior (Firth), 0 plain maximum likelihood; 0.5 has the least errors in Monte Carlo.
    aid : `Accelerometer`, `Gyroscope` or `Headings`, for the rotation, as for `align`.
    joint : fit norms and the accelerometer, or the gyroscope, together, each residual over its own standard deviation: full
        soft iron, hard iron and rotation at once. Rates show the hard iron where norms leave it open, as with a vehicle that
        tilts by 20 degrees; then this is far better than one after the other. Model "auto" or "symmetric", method "ml", no loss.
        Of long logs the same readings are fitted as without; rates are integrated before any is dropped.

    conditions : name -> array of one row a reading: what `measure` and `correct` of a model object take beside the field.

    Under `jit`, `vmap` and `grad` the fit is that of method "ml" for model "sphere", "diagonal", "symmetric" or "planar", which is an
    ellipse there. An expression decides on the curvature term; there is no penalty and no thinning, and `verdict` is "not judged".

    Returns
    -------
    MagFit
        With a verdict. Readings that determine nothing give a "refused" fit whose `model` is None. A refused fit may have a model,
        to look at and not to use.

    Raises
    ------
    DataError
        If the readings are not (n, 3) finite numbers, or an option is unknown or does not go with the method.

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
    if isinstance(model, MagModel):
        if method != "ml" or loss is not None or field_error is not None or aid is not None:
            raise DataError("A model object is fitted by method='ml', without `loss`, `field_error` and `aid`.")
        return fit_model(m, model, field, inclination, conditions or {}, limits)
    if conditions:
        raise DataError("Conditions need a model object whose `measure` and `correct` take them; give it as `model`.")
    if is_traced(m, field):
        given = {"method": method != "ml", "loss": loss is not None, "field_error": field_error is not None, "aid": aid is not None}
        return _traced(m, model, field, inclination, [name for name, there in given.items() if there])
    m, norm, dip = checked(m, method, model, field, loss, inclination, choose, penalty, field_error)
    loss = loss_of(loss)
    if joint:
        checked_joint(method, model, aid, loss, field_error)
    whole, used = m, None
    if per_direction is not None and len(m) > LONG and method not in _EXTREMES:
        used = thinned(Frame.of(m).scaled(m), per_direction, loss)
        m = m[used]
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
        kind = "symmetric" if method == "radial" else next(iter(DIRECT[method]))
    least = kind or ("circle" if planar else "sphere")
    if distinct <= COUNT[least]:
        name = "planar" if planar else least
        return refusal(method, dip, f"There are {distinct} distinct readings; model {name!r} needs at least {COUNT[least] + 1}.")
    plane, notes, unseen = None, [], np.zeros(9)
    try:
        if planar:
            plane = np.linalg.svd(u, full_matrices=False)[2]
            plane[2] *= np.sign(np.linalg.det(plane))
            u = in_plane(u, plane)
        if kind is None:
            fits = candidates(u, PLANAR if planar else SOLID, loss, distinct)
            chosen = fits[by_held_out(fits, u, loss) if choose == "held_out" and not planar else by_bic(fits, u)]
            notes = _unseen(fits, chosen, distinct, frame, dip, limits[0])
            unseen = left_out(fits, chosen, u, loss, penalty)
            found = refined(chosen, u, loss, penalty, prior)
        elif method in ("ml", "radial"):
            found = geometric(u, kind, loss, "orthogonal" if method == "ml" else "radial", penalty, prior)
        else:
            found = described(parameters_of(kind, *DIRECT[method][kind](u)), u, kind)
    except NotEllipsoid as error:
        return refusal(method, dip, (f"{NEAR_PLANAR_SENTENCE} " if flat else "") + f"{str(error)[0].upper()}{str(error)[1:]}.")
    if planar == "chosen":
        notes = ["The readings are near-planar, and were fitted in their plane.", *notes]
    result = _result(m, u, frame, found, method, norm, dip, loss, limits, plane, notes, penalty, field_error, unseen)
    result = result if used is None else _of_all(result, found, frame, whole, len(used))
    if result.model is None or aid is None:
        return result
    after = with_rotation(result, align(whole, result.model, aid), field)
    return jointly(after, whole, aid, limits=limits, rows=used) if joint else after


def _distinct(m: np.ndarray) -> int:
    """Number of distinct readings, of the first few alone where those are enough for any model."""
    few = len(np.unique(m[:_FEW], axis=0))
    return few if few > COUNT["symmetric"] else len(np.unique(m, axis=0))


def _of_all(result: MagFit, found: Found, frame: Frame, m: np.ndarray, used: int) -> MagFit:
    """The fit of some readings, with the residuals, outliers and coverage of all."""
    u = frame.scaled(m)
    distance = all_distances(found, u if result.plane is None else in_plane(u, result.plane))
    far = np.flatnonzero(np.abs(distance) > OUTLIER * 1.4826 * np.median(np.abs(distance)))
    said = f"{used} of {len(m)} readings were fitted, evenly from all directions; residuals and outliers are those of all."
    return dataclasses.replace(
        result, residual=distance * frame.scale, outliers=far, coverage=_covered(result.model, m), used=used,
        warnings=(*result.warnings, said),
    )  # fmt: skip


def _covered(model: Any, m: np.ndarray) -> Coverage:
    """Coverage of the corrected readings, by NumPy: nothing to compile for each length of log."""
    return covered((m - model.hard_iron) @ np.linalg.inv(model.soft_iron).T)


def _unseen(fits: dict[str, Found], chosen: Found, distinct: int, frame: Frame, dip: float, limit: float) -> list[str]:
    """A smaller model says little where the largest could not be tried, or leaves the heading open: what is left out was not seen."""
    largest = "ellipse" if chosen.kind in PLANAR else "symmetric"
    full = fits.get(largest)
    if chosen.kind == largest:
        return []
    if full is not None and full.converged and heading_error(full.shape / frame.scale**2, covariance_of(full, frame), dip)[0] <= limit:
        return []
    few = f"{distinct} distinct readings" if distinct <= COUNT[largest] else "The readings"
    what = "an ellipse" if chosen.kind in PLANAR else "a full soft iron matrix"
    return [f"{few} cannot show {what}; model {chosen.kind!r} was fitted, and what it leaves out was not seen to be absent."]


def _result(m, u, frame, found, method, norm, dip, loss, limits, plane, notes, penalty, field_error, unseen) -> MagFit:
    planar = plane is not None
    radius = radius_of(found.shape, planar)
    covariance = covariance_of(found, frame, unseen)
    raw = found.shape / frame.scale**2
    error = heading_error(raw, covariance, dip)
    if method not in _EXACT:
        try:
            best = geometric(u, "symmetric" if _distinct(u) > COUNT["symmetric"] else found.kind, loss, penalty=penalty)
            error = np.hypot(error, heading_departure(found, best, dip))
        except NotEllipsoid:
            error = np.full(2, np.inf)
    told = information(directions_of(found, u), found.kind, found.noise / radius)
    verdict, reason = judge(found, u, error, told, limits, loss, planar, notes)
    size = radius if norm is None else norm / frame.scale
    model = model_of(found.shape, found.centre, frame, size, plane)
    mean = radius * frame.scale
    warnings = () if norm is None or 0.8 <= mean / norm <= 1.25 else (
        f"The readings have a mean field of {mean:.4g}, the given one is {norm:.4g}: the units differ, the sensitivity is off, or the "
        "readings cover too little of the sphere.",
    )  # fmt: skip
    return MagFit(
        model=model,
        covariance=covariance,
        heading_error=error,
        coverage=_covered(model, m),
        residual=found.distance * frame.scale,
        noise=float(found.noise * frame.scale),
        field=float(size * frame.scale),
        outliers=outliers(found),
        used=len(m),
        needed=np.zeros((0, 3)) if planar or not np.isfinite(covariance).all() else needed(raw, covariance, sphere_grid()),
        condition=told.condition,
        inclination=dip,
        plane=plane,
        verdict=verdict,
        reason=reason,
        warnings=warnings,
        names=PLANAR_NAMES if planar else NAMES,
        method=method,
        kind=found.kind,
        penalty=found.penalty,
        field_error=field_error,
    )


def _traced(m: Any, model: str, field: Any, inclination: Any, refused: list[str]) -> MagFit:
    """The fit under `jit`, `vmap` and `grad`: of a given kind by maximum likelihood, not judged."""
    if model not in (*SOLID, "planar") or refused:
        said = ", ".join(f"`{name}`" for name in refused) or f"model={model!r}"
        raise DataError(
            "A traced fit has its structure fixed by model='sphere', 'diagonal', 'symmetric' or 'planar' and method='ml'; "
            f"{said} is decided on the host. Leave it out, or call `fit` outside of jit, vmap and grad."
        )
    kind = "ellipse" if model == "planar" else model
    if m.ndim != 2 or m.shape[1] != 3 or len(m) <= COUNT[kind]:
        raise DataError(f"The readings have shape {m.shape}; model {model!r} needs (n, 3) with at least {COUNT[kind] + 1} rows.")
    norm, dip = norm_and_dip(field, inclination, model)
    told = one_by_one(functools.partial(_pure, kind), dip, m, norm)
    names = PLANAR_NAMES if model == "planar" else NAMES
    return dataclasses.replace(refusal("ml", dip, NOT_JUDGED), verdict="not judged", kind=kind, names=names, used=len(m), **told)


def _pure(kind: str, dip: float, m: Any, norm: Any) -> dict[str, Any]:
    """What a traced fit knows, from the readings and the norm of the field."""
    frame = Frame.of(m)
    u = frame.scaled(m)
    plane = _plane(u) if kind in PLANAR else None
    found = estimate(u if plane is None else in_plane(u, plane), kind)
    size = radius_of(found.shape, plane is not None) if norm is None else norm / frame.scale
    covariance = covariance_of(found, frame)
    return {
        "model": model_of(found.shape, found.centre, frame, size, plane), "covariance": covariance, "field": size * frame.scale,
        "heading_error": heading_error(found.shape / frame.scale**2, covariance, dip), "noise": found.noise * frame.scale,
        "residual": found.distance * frame.scale, "plane": plane,
    }  # fmt: skip


def _plane(u: Any) -> Any:
    """Axes of the plane nearest to readings and its normal, (3, 3), with the derivative of the normal; a turn about it changes nothing."""
    scatter = u.T @ u
    values, axes = jax.lax.stop_gradient(jnp.linalg.eigh(scatter))
    normal, inside = axes[:, 0], axes[:, :0:-1].T
    tilt = inside @ scatter @ normal / (values[:0:-1] - values[0])  # zero: it has the derivative alone
    return jnp.concatenate([inside + tilt[:, None] * normal[None, :], (normal - tilt @ inside)[None, :]])
