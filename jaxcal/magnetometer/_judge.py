"""What a fit says: the error of headings that follows from the covariance of the iron, what to know about it, and the verdict."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .._answer import Finding, Quantity
from .._errors import DataError
from .._frozen import made
from .._precision import host_float64
from .._types import AnyArray, Samples
from ..fitting import Estimate
from ..fitting._information import information as of_jacobian
from ._aids import Asked
from ._field import HEADINGS, INCLINATION, axes_at, sphere_grid
from ._findings import FINDINGS
from ._model import HARD, SOFT, MagModel, changes_of, quantity_of
from ._quadric import OUTLIER, SYMMETRIC, UPPER, inverse_of, quantile, rows_of, spread_of, unit
from ._surface import BENT, FAST, Surface, between

#: findings beside which a heading error means nothing
_OPEN = ("not_judged", "undetermined", "near_planar", "no_ellipsoid", "not_converged")
TILT = np.deg2rad(20.0)  # of a vehicle that brakes or banks

_GOOD = FINDINGS["heading"].limits[0]
Change = Callable[[Any, Any], Any]
#: parameters of a symmetric ellipsoid, and their changes over those of its quadric
_NAMES, _BY_QUADRIC = (*(SOFT[3 * i + j] for i, j in zip(*UPPER, strict=True)), *HARD), np.repeat([0.5, 1.0], [6, 3])[:, None]


def judged(asked: Asked, surface: Surface) -> dict[str, Any]:
    """Fields of the fit: its parameters with their covariance, the heading error, and the findings. In a trace nothing is judged."""
    model, field, host = surface.model, surface.field, not asked.traced
    if model is None:
        none = Estimate((), np.zeros(0), np.zeros((0, 0)))
        return {"estimate": none, "heading_error": np.full(2, np.inf), "findings": surface.said}
    said, held = list(surface.said), asked.norm is not None or surface.usual is not None
    matrices = [surface.matrix, *(np.outer(step, step) for _, step, _ in surface.causes)]
    matrices = [_of_iron(model, field, held, one) for one in matrices]
    spread = matrices[0] if surface.spread is None else _of_iron(model, field, held, surface.spread)
    error, *costs = heading_errors(change_of(model, field, surface.usual), surface.dip, surface.down, matrices)
    # a field that the readings leave open may be of any size, the readings not
    quantity = quantity_of(quantile(np.abs(rows_of(asked.m, asked.there)).ravel("K"), 0.5) if host else field)
    estimate = _estimated(model, field, quantity, spread, surface.freedom, surface.further or {}, held)
    about = {"used": len(surface.rows if surface.joint else surface.m)} | ({} if surface.usual is None else {"usual": surface.usual})
    if host and not surface.joint:
        condition, weakest = _weakest(surface)
        said += _of_magnitudes(asked, surface, condition, weakest, float(error[0]))
        about["condition"] = condition
    if host:
        about["corrected"] = surface.corrected
        size = field if surface.joint else surface.radius * surface.scale
        said += _causes(surface, costs)
        said += _about_residuals(surface.residual / size, float(surface.noise / size), surface.parts)
    if not any(one.code in _OPEN for one in said):
        said += _about_heading(surface, spread, float(error[0]))
    return {"estimate": estimate, "heading_error": error, "findings": tuple(said), "_about": about}


def _of_iron(model: MagModel, field: Any, given: bool, covariance: Any) -> Any:
    """Covariance of hard iron, soft iron C, field H and further values by that of M = C H, hard iron, these; H^3 = det M unless given."""
    whole, more = model.soft_iron * field, len(covariance) - 12
    xp = whole.__array_namespace__()
    own, by_field = xp.eye(12 + more, dtype=whole.dtype), xp.zeros(12 + more, dtype=whole.dtype)
    if not given:
        by_field = xp.concatenate([field / 3 * xp.linalg.inv(whole).T.ravel(), by_field[9:]])
    by_soft = own[:9] / field - whole.ravel()[:, None] * by_field[None] / field**2
    return between(xp.concatenate([own[9:12], by_soft, by_field[None], own[12:]]), covariance)


def _estimated(model: MagModel, field: Any, quantity: str, covariance: Any, freedom: Any, further: dict[str, Any], held: bool) -> Estimate:
    """Hard iron, soft iron, the field and `further` parameters (name -> value), in this order, with their covariance."""
    xp = covariance.__array_namespace__()
    values = [xp.ravel(xp.asarray(part)) for part in (model.hard_iron, model.soft_iron, field, *further.values())]
    names, states = (*HARD, *SOFT, "field", *further), {"field": "held"} if held else {}
    quantities = {"hard_iron": quantity, "field": quantity}
    quantities |= {name.partition("[")[0]: quantity for name in further if name.startswith("currents.")}
    return made(Estimate, names=names, values=xp.concatenate(values), matrix=covariance, freedom=np.full(len(names), freedom),
                states=states, quantities=quantities)  # fmt: skip


def sphere_rows(directions: Any, xp: Any = np) -> Any:
    """Derivative (n, 9) of the distance of unit vectors to the unit sphere by the upper entries of S and the centre, but for its sign."""
    i, j = UPPER
    return xp.concatenate([directions.T[i] * directions.T[j] * SYMMETRIC.sum(axis=0)[:, None], directions.T]).T


def _weakest(surface: Surface) -> tuple[float, str]:
    """Condition number of the fit, and the parameters that it determines least; for an ellipsoid on the unit sphere.

    Columns keep their natural scale, because with columns of unit length a thin band of directions would look well conditioned. A row is
    u'Su + c'u for the changes S and c, with 2 S, the change of the quadric, as parameter.
    """
    if surface.usual is not None:
        known = of_jacobian(surface.found.near.slopes, names=(*_NAMES, *surface.further))
        return float(known.condition), ", ".join(known.weakest)
    part = _BY_QUADRIC * (inverse_of("symmetric") @ surface.found.basis)
    rows = sphere_rows(rows_of(surface.along, surface.rows))
    squares, vectors = np.linalg.eigh(part.T @ (rows.T @ rows) @ part)
    values, vectors = np.sqrt(np.maximum(squares[::-1], 0.0)), vectors.T[::-1]
    if not values[-1] > 1e-3 * values[0]:  # squares lose the digits of a small one
        values, vectors = np.linalg.svd(np.linalg.qr(rows @ part, mode="r"))[1:]
    condition, weak = (float(values[0] / values[-1]) if values[-1] > 0 else np.inf), np.abs(part @ vectors[-1])
    return condition, ", ".join(_NAMES[i] for i in np.flatnonzero(weak > 0.5 * weak.max()))


def _causes(surface: Surface, costs: Sequence[Any]) -> list[Finding]:
    """What the residuals follow; beside another sensor or currents only what acts alike in all attitudes."""
    said = []
    for (name, _, size), cost in zip(surface.causes, costs, strict=True):
        code = {FAST: "averaged", BENT: "bent"}.get(name, "follows")
        if code != "follows" or not surface.joint:
            what: dict[str, Any] = {"what": name} if code == "follows" else {}
            said.append(FINDINGS(code, cost=float(cost[0]), size=100 * size, **what))
    return said


def _of_magnitudes(asked: Asked, surface: Surface, condition: float, weakest: str, error: float) -> list[Finding]:
    """What to know about a surface of magnitudes: structure, size, and how certain its noise is."""
    larger, found, size, norm = surface.larger, surface.found, float(surface.radius * surface.scale), asked.norm
    said: list[Finding] = []
    # where the model is chosen, readings in a plane have one of their own
    if (asked.parts or (asked.method, asked.model) != ("ml", "auto")) and surface.flat:
        said.append(FINDINGS("near_planar"))
    elif not np.isfinite(found.covariance).all() or FINDINGS.over("undetermined", condition, what=weakest):
        said.append(FINDINGS("undetermined", what=weakest))
    elif not found.converged:
        said.append(FINDINGS("not_converged", what=weakest))
    known = larger and _of_iron(larger.model, larger.field, False, larger.matrix)
    if larger and not heading_errors(by_iron(larger.model, larger.field), surface.dip, None, [known])[0][0] <= _GOOD:
        said.append(FINDINGS("small_model", what="a full soft iron matrix", model=found.kind))
    said += FINDINGS.over("field_differs", abs(np.log(size / norm)), found=size, given=norm) if norm else []
    # the noise of few white readings is uncertain itself: Student's distribution has the wider error
    freedom = found.freedom
    wider = error * (1.0 if surface.parts else np.sqrt(freedom / (freedom - 2)) if freedom > 2 else np.inf)
    if error <= _GOOD < wider:
        said.append(FINDINGS("few_left", count=len(surface.rows), angle=Quantity(min(wider, np.pi), "angle")))
    return said


def outliers(distance: AnyArray) -> np.ndarray:
    """Indices of readings more than four robust standard deviations off; distances in scaled units."""
    size = np.abs(distance)
    return np.flatnonzero(size > OUTLIER * spread_of(size))


def _about_residuals(distance: np.ndarray, scatter: float, parts: bool) -> list[Finding]:
    """Findings about residuals and noise over the field."""
    far, total = len(outliers(distance)), len(distance)
    # two outliers are no matter
    said = FINDINGS.over("scatter", scatter, share=100 * scatter)
    said += FINDINGS.over("outliers", far / total if far > 2 else 0.0, count=far, total=total)
    return said + ([FINDINGS("correlated", size=100 * scatter)] if parts else [])


def _about_heading(surface: Surface, spread: np.ndarray, level: float) -> list[Finding]:
    """A finding with the reading that helps most, if the heading error is above a limit."""
    above = [limit for limit in FINDINGS["heading"].limits if level > limit]
    if not above:
        return []
    wanted = needed(surface.model, float(surface.field), surface.joint, spread)
    way = attitude_in_words(wanted[0], float(surface.dip), surface.down) if len(wanted) else "an attitude not yet seen"
    return FINDINGS.over("heading", level, limit=Quantity(max(above), "angle"), attitude=way)


def levelled(down: Any) -> np.ndarray:
    """Rotations (k, 3, 3) for rows of vectors: from axes whose z points down at level to axes whose `down` points down at level.

    Without `down` there are six, for each axis either way: a number that is averaged over them does not depend on the names of the axes.
    """
    axes = np.concatenate([np.eye(3), -np.eye(3)]) if down is None else unit(np.reshape(np.asarray(down), (1, 3)))
    both = axes + np.array([0.0, 0.0, 1.0])
    # half a turn about the bisector of z and the axis, or about x where they are opposite
    both = unit(np.where(np.sum(both**2, axis=1, keepdims=True) > 1e-12, both, [1.0, 0.0, 0.0]))
    return 2 * both[:, :, None] * both[:, None, :] - np.eye(3)


def heading_slopes(change: Change, dip: float, down: Any = None, tilt: float = 0.0, headings: AnyArray = HEADINGS) -> Any:
    """Derivative (m, p) of headings by parameters: for each `down`, each direction of tilt, and each heading, which is the last in m.

    change : takes vectors (n, 3) and unit fields in body axes (n, 3) to the change of the corrected fields along these vectors with the
    parameters, (n, p). down : the axis that points down at level; None for all six. A heading turns with the field's part to the east.
    """
    return change(*_swept(float(dip), None if down is None else tuple(np.ravel(down).tolist()), tilt, tuple(headings.tolist())))


@functools.lru_cache(maxsize=64)
def _swept(dip: float, down: tuple[float, ...] | None, tilt: float, headings: tuple[float, ...]) -> tuple[np.ndarray, ...]:
    """Vectors to the west over the field's horizontal part, and unit fields, (m, 3) each, with contiguous columns."""
    (north, east, below), turns = axes_at(headings, tilt), levelled(down)
    both = (-east / np.cos(dip), np.cos(dip) * north + np.sin(dip) * below)
    return tuple(np.asfortranarray((part @ turns).reshape(-1, 3)) for part in both)


def heading_errors(change: Change, dip: float, down: AnyArray | None, matrices: Sequence[Any]) -> list[Any]:
    """Root mean square heading errors (2,) in rad, at level and tilted, by each covariance of the parameters; infinite if that is."""
    xp, found = matrices[0].__array_namespace__(), []
    # along the headings the squares of a linear model's slopes have four harmonics: twelve headings give their mean, too
    both = [heading_slopes(change, dip, down, tilt, HEADINGS[::2]) for tilt in (0.0, TILT)]
    for covariance in matrices:
        known = xp.isfinite(covariance).all()
        safe = xp.where(known, covariance, 0.0)
        # rounding may make a small value negative
        mean = xp.stack([(rows.T @ rows * safe).sum() / len(rows) for rows in both])
        found.append(xp.where(known, xp.sqrt(xp.maximum(mean, 0.0)), xp.inf))
    return found


def by_iron(model: Any, field: Any) -> Change:
    """Change (n, 13) of corrected unit fields, along vectors, by hard iron, soft iron and field.

    With the whole matrix H C and its inverse W, u changes by -W db - H W dC u. A change of H turns no heading.
    """
    xp = model.soft_iron.__array_namespace__()
    inverse = xp.linalg.inv(model.soft_iron * field)

    def change(across: Any, directions: Any) -> Any:
        along = -(inverse.T @ across.T)
        by_soft = field * (along[:, None] * directions.T[None]).reshape(9, -1)
        return xp.concatenate([along, by_soft, 0.0 * along[:1]]).T

    return change


def change_of(model: Any, field: Any, usual: dict[str, Any] | None) -> Change:
    """Change (n, p) of corrected unit fields, along vectors, by the first parameters of a fit; `usual`: conditions of a model object."""
    return by_iron(model, field) if usual is None else functools.partial(changes_of, model, field, usual)


@host_float64
def heading_uncertainty(found: Any, headings: Samples, *, tilt: float | int = 0.0) -> AnyArray:
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
    headings = np.atleast_1d(np.asarray(headings, dtype=float))
    change = change_of(found.model, float(found.field), found._about.get("usual"))
    rows = heading_slopes(change, found.inclination, found.down, float(tilt), headings)
    covariance = np.asarray(found.estimate.matrix)[: rows.shape[1], : rows.shape[1]]
    return np.sqrt(np.sum((rows @ covariance) * rows, axis=1).reshape(-1, len(headings)).mean(axis=0))


def heading_change(present: Any, new: Any, field: float, *, inclination: float = INCLINATION, down: Any = None) -> AnyArray:
    """By how much headings change when a new calibration replaces the present one.

    Parameters
    ----------
    present, new : the two models, for readings in the same unit.
    field : magnitude of the field that `new` gives, in its unit, as in `MagFit.field`.
    inclination : dip of the field in rad.
    down : the axis that points down at level, in the axes of the field that `new` gives; z by default.

    Returns
    -------
    (24,) rad: heading by `new` minus heading by `present`, at every 15 degrees of heading by `new`, from north.
    """
    (north, _, below), turn = axes_at(HEADINGS), levelled(np.array([0.0, 0.0, 1.0]) if down is None else down)[0]
    readings = new.measure(float(field) * (np.cos(inclination) * north + np.sin(inclination) * below) @ turn)
    by = [np.arctan2(-y[:, 1], y[:, 0]) for y in (np.asarray(model.correct(readings)) @ turn.T for model in (present, new))]
    return np.angle(np.exp(1j * (by[1] - by[0])))


def distance_slopes(model: Any, field: float, directions: np.ndarray) -> np.ndarray:
    """Derivative (n, 13) of the distance of a reading to its surface by hard iron, soft iron and field, for corrected unit fields."""
    normal = directions @ np.linalg.inv(np.asarray(model.soft_iron))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    by_soft = (normal[:, :, None] * field * directions[:, None, :]).reshape(-1, 9)
    by_field = np.sum(normal * (directions @ np.asarray(model.soft_iron).T), axis=1, keepdims=True)
    return -np.concatenate([normal, by_soft, by_field], axis=1)


def needed(model: Any, field: float, kind: str, covariance: np.ndarray) -> np.ndarray:
    """The three directions, at least 45 degrees apart, in which the fit predicts readings worst: new readings there help most.

    None, (0, 3), for a plane, or where the covariance is not known.
    """
    if model is None or kind == "planar" or not np.isfinite(covariance).all():
        return np.zeros((0, 3))
    grid, chosen = sphere_grid(), []
    rows = distance_slopes(model, field, grid)
    variance = np.sum(rows @ covariance[:13, :13] * rows, axis=1)
    for _ in range(3):
        chosen.append(grid[np.argmax(variance)])
        variance = np.where(grid @ chosen[-1] < np.cos(np.pi / 4), variance, -1.0)
    return np.array(chosen)


def attitude_in_words(direction: AnyArray, inclination: float, down: AnyArray | None = None) -> str:
    """How to hold a sensor so that the field points along a direction in its axes: facing north or south, tilted, then rolled about x.

    Parameters
    ----------
    direction : (3,) unit vector in the axes of the sensor, along which the field should point.
    inclination : dip of the field in rad.
    down : (3,) axis that points down at level, where it is known; otherwise z points up.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer._judge import attitude_in_words
    >>> attitude_in_words(np.array([1.0, 0.0, 0.0]), np.deg2rad(60.0))
    'level, z up, x to magnetic north; then x down by 60 deg'
    """
    x, y, z = (float(value) for value in direction)
    up = -1.0 if down is not None and float(np.ravel(down)[2]) > 0.5 else 1.0
    ways: list[tuple[float, float, str]] = []
    for facing, horizontal in (("north", np.cos(inclination)), ("south", -np.cos(inclination))):
        elevation = np.arctan2(-np.sin(inclination), horizontal)  # of the field, in the vertical plane that x stays in
        for side in (1.0, -1.0):
            tilt = np.remainder(elevation + side * np.arccos(np.clip(x, -1.0, 1.0)) + np.pi, 2 * np.pi) - np.pi
            along = np.sign(np.round(up * np.sin(elevation - tilt), 9)) + 0.0  # of the field along z before the roll; 0 if it is along x
            roll = np.arctan2(along * y + 0.0, along * z + 0.0)  # no -0, whose angle is half a turn
            ways += [(np.rad2deg(tilt), np.rad2deg(roll), facing)] if abs(tilt) <= np.pi / 2 + 1e-9 else []
    tilt, roll, facing = min(ways, key=lambda way: abs(way[0]) + abs(way[1]))
    turns = [f"x {'up' if tilt > 0 else 'down'} by {5 * round(abs(tilt) / 5)} deg"] if abs(tilt) > 2.5 else []
    turns += [f"roll {'right' if roll > 0 else 'left'} by {5 * round(abs(roll) / 5)} deg"] if abs(roll) > 2.5 else []
    return f"level, z {'up' if up > 0 else 'down'}, x to magnetic {facing}" + "; then " * bool(turns) + ", ".join(turns)
