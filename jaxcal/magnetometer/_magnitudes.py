"""Fit of the magnitudes of the field alone: the surface through the readings, its kind and error, and what to know about both.

The covariance comes from fits without parts of the log, on the raw residuals. On real logs nothing else predicts the difference between
halves: what looks like a drift or a current there does not go on after the log, and taking it out of the residuals makes the error too
small. Only what acts alike in every part of the log is looked for beside: the response of an axis, the rate of turn, recorded conditions.
The step of the fit that such a cause explains is a part of its error.
"""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from .._answer import Finding, Quantity
from .._errors import DataError
from .._special import chi_square_tail
from ..fitting._information import information as of_jacobian, symmetric_inverse
from ..fitting._serial import BLOCKS, CHANCE, correlation_time, span_of, tamed
from ._aids import down_by, verticals
from ._axes import Axes, axes_of, by_axes
from ._checked import Asked
from ._design._coverage import bins
from ._design._heading_error import TILT, both_tilts, by_iron, down_of, heading_change, information, rms_heading
from ._ellipsoid import _algebraic as quadric
from ._ellipsoid._algebraic import COUNT, NEAR_PLANAR, Frame, NotEllipsoid, basis_of, between, radius_of, unit
from ._ellipsoid._orthogonal import Found, by_ellipsoid, directions_of, distances, fitted, left_out, of_parameters
from ._ellipsoid._robust import chosen_rows
from ._findings import AGREE, FINDINGS
from ._model import MagModel
from ._own_model import changes_of, fit_leaves, further_names
from ._result import EXACT, MagFit, by_parts, by_readings, estimated, judged_fit, outliers, unfitted

FAST, BENT = "rate of turn", "nonlinearity"
_FEWEST = 80  # readings for which the correlation time is known well enough


class Surface(NamedTuple):
    """A fitted surface, the finding why there is none, or the normal of the plane of the readings.

    model, field : what it says of the iron. slopes : (13 + q, p) derivative of hard iron, soft iron, field and further leaves by the
    parameters. change : derivative of corrected unit fields by these. corrected : readings. u : scaled readings of an ellipsoid. scale,
    radius : unit of its distances, and size of the field in that unit. unseen : (13,) bias by terms that a smaller model leaves out.
    """

    refused: Finding | None = None
    plane: Any = None
    found: Any = None
    model: Any = None
    field: Any = None
    slopes: Any = None
    change: Any = None
    corrected: Any = None
    u: Any = None
    scale: Any = 1.0
    radius: Any = 1.0
    unseen: Any = np.zeros(13)
    said: tuple[Finding, ...] = ()
    further: Any = None
    usual: Any = None


def surface_of(m: np.ndarray, method: str, model: str, norm: Any, limit: tuple[float, float]) -> Surface:
    """The surface through readings (n, 3); `limit`: a dip, and the heading error that a good fit may have there.

    Raises
    ------
    NotEllipsoid
        If the readings lie on another quadric.
    """
    count, frame = _distinct(m), Frame.of(m)
    least = "sphere" if model in ("auto", "planar") and method == "ml" else "symmetric" if model == "auto" else model
    if count <= COUNT[least] or frame.scale < EXACT * np.abs(m).max():
        return Surface(FINDINGS("few", count=count, model=least, least=COUNT[least] + 1))
    u = frame.scaled(m)
    spread = quadric.extents(u)
    if spread[1] < NEAR_PLANAR:
        return Surface(FINDINGS("line"))
    if model == "planar" or (spread[2] < NEAR_PLANAR and model == "auto" and method == "ml"):
        normal = np.linalg.svd(u, full_matrices=False)[2][2]
        return Surface(plane=normal * np.sign(normal[np.argmax(np.abs(normal))]))
    if method != "ml":
        shape, centre = quadric.constrained(u) if method == "constrained" else quadric.consistent(u)
        return ellipsoid(of_parameters(u, least, quadric.parameters_of(least, quadric.soft_of(shape), centre)), frame, norm, u)
    if model != "auto":
        return ellipsoid(fitted(u, model), frame, norm, u)
    fits, occupied = candidates(u, count)
    chosen = min(fits.values(), key=lambda found: score(found.distance, found.kind, occupied))
    return ellipsoid(chosen, frame, norm, u, left_out(fits, chosen), _unseen(fits, chosen, frame, *limit))


def ellipsoid(found: Found, frame: Frame, norm: Any, u: Any = None, unseen: Any = None, said: tuple[Finding, ...] = ()) -> Surface:
    """The surface of an ellipsoid in scaled readings, traced or not; `norm`: magnitude of the field if it is given."""
    radius = radius_of(found.soft)
    field = frame.scale * radius if norm is None else norm
    slopes = quadric.iron_slopes(found.soft * frame.scale, field, norm is not None) * frame.scale
    model = MagModel(found.soft * frame.scale / field, frame.centre + frame.scale * found.centre)
    bias = np.zeros(13) if unseen is None else slopes @ unseen
    return Surface(
        None, None, found, model, field, slopes @ basis_of(found.kind).astype(slopes.dtype), by_iron(model, field), None, u, frame.scale,
        radius, bias, said,
    )  # fmt: skip


def _of_object(asked: Asked, m: np.ndarray) -> Surface:
    """The surface of a model object through all readings."""
    model = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float), asked.model)
    names, kind = further_names(model), type(model).__name__
    if len(m) <= 9 + len(names):
        raise DataError(f"There are {len(m)} readings; this model with {9 + len(names)} parameters needs {10 + len(names)}.",
                        code="few_readings")  # fmt: skip
    found, fitted, field, slopes, corrected, inverse = fit_leaves(model, m, asked.norm, asked.conditions)
    if not inverse:
        raise DataError(f"`measure` and `correct` of {kind} do not undo one another; `correct` must be its inverse.", code="no_inverse")
    usual = {name: np.median(value, axis=0) for name, value in asked.conditions.items()}
    values = np.concatenate([np.zeros(0), *map(np.ravel, jax.tree.leaves(fitted)[2:])])
    change = functools.partial(changes_of, fitted, field, usual)
    return Surface(None, None, found, fitted, field, slopes, change, corrected, None, 1.0, field, np.zeros(len(slopes)), (),
                   dict(zip(names, values, strict=True)), usual)  # fmt: skip


def _distinct(m: np.ndarray) -> int:
    """Number of distinct readings; only the first few are counted where these suffice for any model."""
    few = len(np.unique(m[: 2**6], axis=0))
    return few if few > COUNT["symmetric"] else len(np.unique(m, axis=0))


def _unseen(fits: dict[str, Found], chosen: Found, frame: Frame, dip: float, limit: float) -> tuple[Finding, ...]:
    """A finding if a smaller model was fitted because the readings cannot show the largest one."""
    full = fits.get("symmetric")
    if chosen is full:
        return ()
    if full is not None and full.converged:
        whole = ellipsoid(full, frame, None)
        if rms_heading(both_tilts(whole.change, dip), between(whole.slopes, full.covariance))[0] <= limit:
            return ()
    return (FINDINGS("small_model", what="a full soft iron matrix", model=chosen.kind),)


def candidates(u: np.ndarray, distinct: int) -> tuple[dict[str, Found], int]:
    """Fits of all kinds that have enough readings and are not clearly excluded, the largest first.

    Also the number of bins, of 500, that contain a reading.
    """
    fits, failure, full = {}, None, None
    for kind in reversed(COUNT):
        if distinct <= COUNT[kind]:
            continue
        begin = None if full is None else _nearest(full, kind)
        if full is not None and begin is not None:
            margin = (COUNT[full.kind] - COUNT[kind]) * np.log(count)
            near, centre = quadric.soft_and_centre(begin, basis_of(kind))
            if score(quadric.away((quadric.shape_of_soft(near), centre), u), kind, count) > score(full.distance, full.kind, count) + margin:
                continue
        try:
            fits[kind] = fitted(u, kind, begin)
        except NotEllipsoid as error:
            failure = error
            continue
        if len(fits) == 1:
            count = int(np.count_nonzero(np.bincount(bins(directions_of(fits[kind], u)))))
            full = fits[kind] if fits[kind].converged and np.isfinite(fits[kind].covariance).all() else None
    if not fits:
        raise failure or NotEllipsoid("quadric with more parameters than readings")
    return fits, count


def _nearest(full: Found, kind: str) -> np.ndarray | None:
    """Parameters of a smaller kind nearest to a fit in its covariance: almost the smaller fit where both models hold."""
    whiten = symmetric_inverse(full.covariance)
    basis = np.linalg.pinv(basis_of(full.kind)) @ basis_of(kind)
    begin = symmetric_inverse(basis.T @ whiten @ basis) @ (basis.T @ whiten @ full.parameters)
    return begin if (begin[: COUNT[kind] - 3] > 0).all() else None


def score(distance: Any, kind: str, count: int) -> float:
    """The criterion n ln(mean d^2) + k ln n. n is the number of occupied bins of 500, because neighbours repeat one another."""
    return float(count * np.log(max(np.mean(distance**2), EXACT**2)) + COUNT[kind] * np.log(count))


class Cause(NamedTuple):
    """One cause: its name, the step (p,) of the parameters that it explains, and its largest effect on a reading over the field."""

    name: str
    step: np.ndarray
    size: float


def _columns(found, normals, z, whole, rows, conditions) -> dict[str, np.ndarray]:
    """Columns of each cause, for the readings in the given rows of the whole log."""
    radius, support = radius_of(found.soft), np.sum(normals * z, axis=1)
    columns = {}
    for name, values in conditions.items():
        # the hard iron stays that of the mean condition
        off = values[rows] - values[rows].mean()
        if off.any():
            columns[name] = normals * (off / np.abs(off).max())[:, None]
    # averaging over a short time shortens a turning vector in proportion to the square of its rate
    turn = np.gradient(directions_of(found, whole), axis=0)[rows]
    columns[FAST] = (support * np.sum(turn**2, axis=1))[:, None]
    columns[BENT] = np.concatenate([normals * (z / radius) ** 2, normals * (z / radius) ** 3], axis=1)
    return columns


def _cause(name: str, jacobian: np.ndarray, span: np.ndarray, part: np.ndarray, left: np.ndarray) -> tuple[Cause, float] | None:
    """The cause with the step of the parameters, and its gain over that of chance; None if chance explains it."""
    free = part - span @ (span.T @ part)
    size = np.linalg.norm(free, axis=0)
    if not (size > 1e-6 * np.linalg.norm(part, axis=0)).all():
        return None
    calm = tamed(span, left)
    coefficients = np.linalg.lstsq(free / size, calm, rcond=1e-9)[0] / size
    rest = calm - free @ coefficients
    gain = len(left) / correlation_time(rest) * np.log(np.sum(calm**2) / np.sum(rest**2))
    chance = float(chi_square_tail(float(gain), part.shape[1]))
    if not chance < CHANCE:
        return None
    length = np.linalg.norm(jacobian, axis=0)
    step = np.linalg.lstsq(jacobian / length, part @ coefficients, rcond=1e-9)[0] / length
    return Cause(name, step, float(np.max(np.abs(part @ coefficients)))), chance


def examined(surface: Surface, whole: Any, rows: np.ndarray, conditions: dict[str, np.ndarray]) -> tuple[np.ndarray, bool, list[Cause]]:
    """Covariance (p, p) of the parameters, whether it is by parts of the log, and the causes that the residuals show.

    The given `rows` of the `whole` log, scaled, were fitted, in order of time. Causes are looked for beside ellipsoids.
    """
    found, radius = surface.found, surface.radius
    if not np.isfinite(found.covariance).all() or not found.noise > EXACT * radius or not found.converged:
        return found.covariance, False, []
    left, causes = found.distance, []
    if surface.u is not None and len(left) >= _FEWEST:
        near = by_ellipsoid(surface.u, basis_of("symmetric"), quadric.parameters_of("symmetric", found.soft, found.centre))
        columns = _columns(found, near.normal, near.field @ found.soft, whole, rows, conditions)
        columns = {name: part[:, np.abs(part).max(axis=0) > 1e-12 * radius] for name, part in columns.items()}
        # a soft iron that the model leaves out is told by another step: a cause is what the largest model does not explain
        span = span_of(near.slopes)
        told = [one for name, part in columns.items() if part.size and (one := _cause(name, found.rows, span, part, left)) is not None]
        causes = [Cause(one.name, one.step, one.size / radius) for one, _ in sorted(told, key=lambda pair: pair[1])]
    return *by_parts(found.covariance, found.rows, left), causes


def from_structure(found: Found, readings: np.ndarray, condition: float, weakest: str) -> list[Finding]:
    """Findings that lie in the geometry of the readings, and those about the convergence of the fit."""
    if quadric.extents(Frame.of(readings).scaled(readings))[-1] < NEAR_PLANAR:
        return [FINDINGS("near_planar")]
    if not np.isfinite(found.covariance).all() or FINDINGS.over("undetermined", condition, what=weakest):
        return [FINDINGS("undetermined", what=weakest)]
    return [] if found.converged else [FINDINGS("not_converged", what=weakest)]


def from_causes(causes: Sequence[Cause], costs: Sequence[float]) -> list[Finding]:
    """Findings about what the residuals follow; their costs are heading errors in rad at level."""
    findings = []
    for cause, cost in zip(causes, costs, strict=True):
        code = {FAST: "averaged", BENT: "bent"}.get(cause.name, "follows")
        what: dict[str, Any] = {"what": cause.name} if code == "follows" else {}
        findings.append(FINDINGS(code, cost=cost, size=100 * cause.size, **what))
    return findings


def by_magnitudes(asked: Asked) -> tuple[MagFit, np.ndarray, Any]:
    """The fit of the magnitudes, the fitted rows, and the normal of the plane of the readings if they lie in one."""
    m, method, norm, dip, known = asked.m[asked.there], asked.method, asked.norm, asked.dip, asked.known
    own = isinstance(asked.model, MagModel)
    used, readings, full = (np.arange(len(m)), m, 0) if own else chosen_rows(m)
    try:
        surface = _of_object(asked, m) if own else surface_of(readings, method, asked.model, norm, (dip, asked.limits[0]))
    except NotEllipsoid as error:
        surface = Surface(FINDINGS("no_ellipsoid", quadric=error.quadric))
    clipped = [FINDINGS("clipped", count=full)] if full else []
    if surface.found is None:
        refused = [] if surface.refused is None else [surface.refused]
        return unfitted(method, dip, *clipped, *refused), asked.there[used], surface.plane
    found, model, field, slopes = surface.found, surface.model, surface.field, surface.slopes
    corrected = surface.corrected if own else np.asarray(model.correct(m))
    directions = unit(corrected[used])

    # the dip, and the axis that points down
    axes, seen, down = _seen(asked.aid, corrected)
    said = [*by_axes(axes, asked.sign, turns=False), *([] if axes else [FINDINGS("unseen_axes")]), *clipped]
    dip = dip if known or seen is None else seen
    down = down_of(directions, dip) if down is None else down

    # the error: by parts of the log, at least that of white residuals, with what the fit cannot see by itself
    headings = both_tilts(surface.change, dip, down)
    log: Any = None if own else (m - model.hard_iron) / surface.scale + found.centre
    covariance, parts, causes = examined(surface, log, used, asked.conditions)
    steps = [np.outer(one, one) for one in [surface.unseen, *(slopes @ cause.step for cause in causes)]]
    matrix = between(slopes, covariance) + sum(steps)
    error, freedom = np.asarray(rms_heading(headings, matrix)), float(BLOCKS - 1 if parts else found.freedom)
    if method == "constrained":
        error = np.hypot(error, _departure(surface, norm, dip, down))

    # what to know
    condition, weakest = information(directions, found.kind) if not own else _weakest(found, surface.further)
    distance = found.distance if own or np.array_equal(readings, m) else distances(found, log)
    scatter, mean = found.noise / surface.radius, float(np.cbrt(np.linalg.det(model.soft_iron)) * field)
    said += [
        *from_structure(found, readings, condition, weakest),
        *surface.said,
        *(FINDINGS.over("field_differs", abs(np.log(mean / norm)), found=mean, given=norm) if norm else []),
    ]
    said += [*by_readings(scatter, len(outliers(distance / surface.radius)), len(m))]
    said += from_causes(causes, [float(rms_heading(headings, step)[0]) for step in steps[1:]])
    said += [FINDINGS("correlated", size=100 * scatter)] if parts else []
    said += [] if known or seen is not None else [FINDINGS("dip_assumed", dip=Quantity(dip, "angle"))]
    # the noise of few white readings is uncertain itself: Student's distribution has the wider error
    wider = error[0] * (1.0 if parts else np.sqrt(freedom / (freedom - 2)) if freedom > 2 else np.inf)
    if error[0] <= asked.limits[0] < wider:
        said.append(FINDINGS("few_left", count=len(used), angle=Quantity(min(wider, np.pi), "angle")))
    about = {"used": len(used), "condition": condition} | ({"usual": surface.usual} if own else {})
    estimate = estimated(model, field, matrix, freedom, surface.further, held=norm is not None or own)
    return judged_fit(
        said, asked.limits, weakest, corrected, model=model, estimate=estimate, heading_error=error, field=float(field),
        noise=float(found.noise * surface.scale), residual=distance * surface.scale, inclination=dip, method=method, kind=found.kind,
        down=down, _about=about,
    ), asked.there[used], None  # fmt: skip


def _weakest(found: Found, further: dict[str, float]) -> tuple[float, str]:
    """Condition number of the fit of a model object, and the parameters that it determines least."""
    names = [f"soft_iron[{i},{j}]" for i, j in zip(*quadric.UPPER, strict=True)] + [f"hard_iron[{i}]" for i in range(3)]
    known = of_jacobian(found.rows, names=(*names, *further))
    return float(known.condition), ", ".join(known.weakest)


def _seen(aid: Any, corrected: np.ndarray) -> tuple[Axes | None, float | None, np.ndarray | None]:
    """The axes by an accelerometer, the dip if the axes agree with it, and the axis that points down."""
    if not hasattr(aid, "turns"):
        return None, None, None
    up, field = verticals(aid.accel, len(corrected)), unit(corrected)
    axes, there = axes_of(field, up), np.isfinite(up).all(axis=1)
    if axes is None or not axes.same:
        return axes, None, None
    dips = -np.arcsin(np.clip(np.sum(field * up, axis=1)[there], -1, 1))
    return (axes, axes.dip, down_by(up)) if np.std(dips) < AGREE else (axes, None, None)


def _departure(surface: Surface, norm: Any, dip: float, down: Any) -> np.ndarray:
    """Heading difference to the maximum likelihood fit of the same readings, at level and tilted; infinite if there is none."""
    centre = np.asarray(surface.model.hard_iron) - surface.scale * surface.found.centre
    try:
        best = ellipsoid(fitted(surface.u, "symmetric"), Frame(centre, surface.scale), norm).model
    except NotEllipsoid:
        return np.full(2, np.inf)
    off = [heading_change(best, surface.model, surface.field, inclination=dip, down=down, tilt=tilt) for tilt in (0.0, TILT)]
    return np.sqrt([np.mean(one**2) for one in off])
