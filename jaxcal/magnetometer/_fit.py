"""`fit`: hard and soft iron from readings in a field of constant magnitude."""

from typing import Any

import numpy as np

from .._answer import Quantity
from .._frozen import made
from .._log import field_readings
from .._precision import host_float64, is_traced
from ..fitting import AbstractLoss
from ._checked import checked, checked_conditions
from ._design._heading_error import heading_error, heading_range, information
from ._diagnosis import chosen_rows, departure, from_causes, from_field, from_structure, plausible_error
from ._ellipsoid._algebraic import NotEllipsoid
from ._ellipsoid._causes import examined
from ._ellipsoid._orthogonal import loss_of
from ._ellipsoid._select import of_all
from ._ellipsoid._shape import covariance_of, directions_of, model_of, radius_of
from ._findings import FINDINGS
from ._judge import LIMITS, by_readings
from ._model import MagModel
from ._own_model import fit_model
from ._result import NO_ESTIMATE, Facts, MagFit, finished, unfitted
from ._rotation._align import Accelerometer, align, vertical
from ._rotation._joint import checked_joint, jointly, with_rotation
from ._surface import surface_of
from ._traced import fit_traced

_EXACT = ("ml", "consistent")


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
        either, 57 degrees are assumed, and the result shows the error for other dips too.
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
        residuals follow it. With a model object: further arguments of its `measure` and `correct`.

    Under `jit`, `vmap` and `grad` the fit uses method "ml" and model "sphere", "diagonal", "symmetric" or "planar"; "planar" then fits an
    ellipse. A traced condition selects the curvature term, there is no penalty and no thinning, and `verdict` is "not judged".

    Returns
    -------
    MagFit
        The fit with its findings. Readings that determine nothing give a "refused" fit whose `model` is None. The model of a refused fit
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
    limits = (float(limits[0]), float(limits[1]))
    m, force = field_readings(m)
    if isinstance(model, MagModel):
        others = {"method": method != "ml", "loss": loss is not None, "field_error": field_error is not None, "aid": aid is not None}
        return fit_model(m, model, field, inclination, conditions or {}, limits, [name for name, there in others.items() if there])
    if is_traced(m, field):
        others = {"method": method != "ml", "loss": loss is not None, "field_error": field_error is not None, "aid": aid is not None,
                  "conditions": bool(conditions)}  # fmt: skip
        return fit_traced(m, model, field, inclination, [name for name, there in others.items() if there])
    m, norm, dip = checked(m, method, model, field, loss, inclination, penalty, field_error)
    if aid is None and force is not None:
        aid = Accelerometer(force, turns=False)
    loss, recorded = loss_of(loss), checked_conditions(conditions or {}, len(m))
    if joint:
        checked_joint(method, model, aid, loss, field_error)
    used, full = chosen_rows(m, method, per_direction, loss)
    try:
        surface = surface_of(m[used], method, model, loss, penalty, norm, field_error, (dip, limits[0]))
    except NotEllipsoid as error:
        return unfitted(method, dip, FINDINGS("no_ellipsoid", quadric=error.quadric))
    if surface.refused is not None:
        return unfitted(method, dip, surface.refused)

    # what the residuals tell about the errors
    found, frame, plane = surface.found, surface.frame, surface.plane
    log = surface.scaled(m)
    said = examined(found, surface.u, log, used, recorded, surface.size)
    biases = np.concatenate([surface.unseen, *(cause.steps for cause in said.causes)])
    matrix = covariance_of(found, frame, biases, said.covariance)
    size = radius_of(found.shape, plane is not None) if norm is None else norm / frame.scale
    iron = model_of(found.shape, found.centre, frame, size, plane)
    corrected = (m - iron.hard_iron) @ np.linalg.inv(iron.soft_iron).T

    # the dip, the axis that points down, and the heading error
    turn = align(m, iron, aid) if getattr(aid, "turns", aid is not None) else None
    seen, down = vertical(aid, turn, corrected)
    assumed = inclination is None and np.ndim(field) == 0 and (seen is None or plane is not None or method not in _EXACT)
    if seen is not None and plane is None and method in _EXACT and inclination is None and np.ndim(field) == 0:
        dip = float(seen)
    axis = down if plane is None and method in _EXACT and seen is not None else None
    shape = found.shape / frame.scale**2
    error = heading_error(shape, matrix, dip, axis)
    if method not in _EXACT:
        error = np.hypot(error, departure(found, surface.u, loss, penalty, dip))
    span = np.full(2, np.nan) if plane is not None else heading_range(shape, matrix, None if assumed else dip, down)

    # everything else, and the findings
    told = information(directions_of(found, surface.u), found.kind, found.noise / radius_of(found.shape, plane is not None))
    distance, far, wanted, seen_directions = of_all(found, frame, log, corrected, matrix, len(used))
    known = [*from_structure(found, surface.u, told), *surface.said, *from_field(found, norm, frame.scale, plane is not None)]
    known += by_readings(found.noise / radius_of(found.shape), len(far), len(m), loss is not None)
    known += from_causes(found, surface.u, said, log[full], dip, limits[0])
    if assumed:
        known.append(FINDINGS("dip_assumed", dip=Quantity(dip, "angle")))
    largest, why = plausible_error(found, said, float(error[0]), dip)
    facts = Facts(
        matrix, len(used), norm is not None, tuple(known), limits, largest, why, told.weakest, said.blocks, penalty=found.penalty,
        field_error=field_error, span=span, condition=told.condition,
    )  # fmt: skip
    result = made(
        MagFit, model=iron, estimate=NO_ESTIMATE, heading_error=error, field=size * frame.scale, noise=found.noise * frame.scale,
        residual=distance * frame.scale, inclination=dip, method=method, kind=found.kind, _facts=facts, coverage=seen_directions,
        outliers=far, needed=wanted, down=np.array([0.0, 0.0, 1.0]) if down is None else down, plane=plane,
    )  # fmt: skip
    result = finished(result) if turn is None else with_rotation(result, turn, field)
    return jointly(result, m, aid, rows=used) if joint and aid is not None else result
