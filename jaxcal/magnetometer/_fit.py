"""`fit`: hard and soft iron from readings in a field of constant magnitude."""

from typing import Any

import numpy as np

from .._answer import Quantity
from .._frozen import made
from .._precision import host_float64, is_traced
from ._checked import checked, checked_conditions
from ._design._heading_error import down_of, heading_error, information
from ._diagnosis import chosen_rows, departure, from_causes, from_field, from_structure
from ._ellipsoid._algebraic import NotEllipsoid
from ._ellipsoid._causes import examined
from ._ellipsoid._kinds import COUNT
from ._ellipsoid._select import of_all
from ._ellipsoid._shape import covariance_of, directions_of, model_of, radius_of
from ._findings import FINDINGS
from ._judge import LIMITS, by_readings, few_left
from ._model import MagModel
from ._own_model import fit_model
from ._result import NO_ESTIMATE, Facts, MagFit, finished, unfitted
from ._rotation._align import Accelerometer, align, vertical
from ._rotation._joint import checked_joint, jointly, with_rotation
from ._source import field_readings
from ._surface import surface_of
from ._traced import fit_traced


@host_float64
def fit(
    m: Any,
    *,
    method: str = "ml",
    model: str | MagModel = "auto",
    field: Any = None,
    field_error: float | None = None,
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

    and starts from the consistent algebraic fit. Readings that are none of the field (spikes, zeros, repeats) are left out before. Where
    the noise exceeds 2 % of the field, the fit corrects the distances for the mean
    offset that noise causes at a curved surface. The soft iron found is symmetric, C = H A^{-1/2}. A rotation of all corrected readings,
    from an unsymmetric soft iron or a rotated sensor, leaves every magnitude unchanged, so magnitudes alone cannot show it. With an
    `aid`, `align` finds this rotation after the fit, and the soft iron includes it.

    Parameters
    ----------
    m : (n, 3) readings in any unit, without NaN. Or a `Log`, or a path, data frame or dataset of one; rows without a reading are then
        left out.
    method : "ml"; "consistent" (adjusted least squares: no noise bias, no iteration); or "constrained" (the magnetometer paper).
    model : "sphere" (4 parameters), "diagonal" (6), "symmetric" (9), or "planar" (circle or ellipse, for turns about one axis). With
        "auto", "ml" chooses a model. Or a model object: a `MagModel`, or a subclass with
        fields of its own. "ml" then fits its floating leaves, from their values or from the algebraic fit.
    field : magnitude of the true field, or the field vector (north, east, down), in the unit of the readings. The vector also gives the
        dip. Without `field`, the corrected readings keep the unit and mean size of the readings.
    field_error : relative standard deviation of `field` in the unit of the readings. It covers the sensor's sensitivity and the mean
        stretch of its soft iron as well as the field model. The fit then uses `field`, which helps most with part of a sphere.
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
        open but rates show it, as in a vehicle that tilts by 20 degrees. Needs model "auto" or "symmetric", and method "ml". A
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
    if isinstance(model, MagModel) or is_traced(m, field):
        others = {"method": method != "ml", "field_error": field_error is not None, "aid": aid is not None}
        refused = [name for name, there in others.items() if there]
        if isinstance(model, MagModel):
            return fit_model(m, model, field, inclination, conditions or {}, limits, refused)
        return fit_traced(m, model, field, inclination, [*refused, *(["conditions"] if conditions else [])])
    m, norm, dip = checked(m, method, model, field, inclination, penalty, field_error)
    if aid is None and force is not None:
        aid = Accelerometer(force, turns=False)
    recorded = checked_conditions(conditions or {}, len(m))
    if joint:
        checked_joint(method, model, aid, field_error)
    used, full = chosen_rows(m, per_direction)
    try:
        surface = surface_of(m[used], method, model, penalty, norm, field_error, (dip, limits[0]))
    except NotEllipsoid as error:
        return unfitted(method, dip, FINDINGS("no_ellipsoid", quadric=error.quadric))
    if surface.refused is not None:
        return unfitted(method, dip, surface.refused)

    found, frame, plane = surface.found, surface.frame, surface.plane
    log = surface.scaled(m)
    size = radius_of(found.shape, plane is not None) if norm is None else norm / frame.scale
    iron = model_of(found.shape, found.centre, frame, size, plane)
    corrected = (m - iron.hard_iron) @ np.linalg.inv(iron.soft_iron).T
    directions = directions_of(found, surface.u)

    # the dip, and the axis that points down
    turn = align(m, iron, aid) if getattr(aid, "turns", aid is not None) else None
    seen, down = vertical(aid, turn, corrected)
    given = inclination is not None or np.ndim(field) == 1
    if seen is not None and plane is None and not given:
        dip = float(seen)
    down = down_of(directions, dip) if down is None else down

    # the error: by parts of the log, at least that of white residuals, with what the fit cannot see by itself
    said = examined(found, surface.u, log, used, recorded, surface.size)
    shape, steps = found.shape / frame.scale**2, np.concatenate([surface.unseen, *(cause.step[None] for cause in said.causes)])
    matrix = covariance_of(found, frame, None, said.white)
    if said.parts is not None:
        white, matrix = matrix, covariance_of(found, frame, None, said.parts)
        least, by_parts = (heading_error(shape, one, dip, down)[0] for one in (white, matrix))
        matrix = matrix * max(least / by_parts, 1.0) ** 2
    matrix = matrix + covariance_of(found, frame, steps, np.zeros_like(said.white))
    error = heading_error(shape, matrix, dip, down)
    if method == "constrained":
        error = np.hypot(error, departure(found, surface.u, dip))

    # everything else, and the findings
    told = information(directions, found.kind, found.noise / radius_of(found.shape, plane is not None))
    distance, far, wanted, seen_directions = of_all(found, frame, log, corrected, matrix, len(used))
    known = [*from_structure(found, surface.u, told), *surface.said, *from_field(found, norm, frame.scale, plane is not None)]
    known += by_readings(found.noise / radius_of(found.shape), len(far), len(m))
    known += few_left(len(used), COUNT[found.kind])
    known += from_causes(found, said, int(full.sum()), dip, down)
    if seen is None and not given:
        known.append(FINDINGS("dip_assumed", dip=Quantity(dip, "angle")))
    facts = Facts(
        matrix, len(used), norm is not None, tuple(known), limits, told.weakest, said.parts is not None, penalty=found.penalty,
        field_error=field_error, condition=told.condition,
    )  # fmt: skip
    result = made(
        MagFit, model=iron, estimate=NO_ESTIMATE, heading_error=error, field=size * frame.scale, noise=found.noise * frame.scale,
        residual=distance * frame.scale, inclination=dip, method=method, kind=found.kind, _facts=facts, coverage=seen_directions,
        outliers=far, needed=wanted, down=down, plane=plane,
    )  # fmt: skip
    result = finished(result) if turn is None else with_rotation(result, turn, field)
    return jointly(result, m, aid, rows=used) if joint and aid is not None else result
