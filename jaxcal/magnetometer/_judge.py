"""What a fit says: its error, what to know about it, and the verdict.

The error comes from the fit, which looks at its own residuals. Only what acts alike in every part of the log is looked for beside: the
response of an axis, the rate of turn, recorded conditions. The step of the fit that such a cause explains is a part of its error.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from .._answer import CAUTION, FATAL, Finding, Quantity
from .._frozen import made
from ..fitting import Estimate
from ..fitting._serial import BLOCKS, CHANCE, followed, span_of
from ._axes import orientation
from ._checked import Asked
from ._coverage import covered
from ._findings import FINDINGS
from ._heading_error import TILT, between, errors_in_trace, heading_change, heading_errors, needed
from ._quadric import EXACT, NEAR_PLANAR, Frame, extents, outliers, unit
from ._result import MagFit, estimated
from ._surface import Surface

FAST, BENT = "rate of turn", "nonlinearity"
_FEWEST = 80  # readings for which the correlation time is known well enough
#: findings beside which a heading error means nothing
_OPEN = ("not_judged", "undetermined", "near_planar", "no_ellipsoid", "not_converged")


class Cause(NamedTuple):
    """One cause: its name, the step (p,) of the parameters that it explains, its largest effect on a reading over the field, its chance."""

    name: str
    step: np.ndarray
    size: float
    chance: float


def _columns(surface: Surface, conditions: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns of each cause, for the fitted readings in order of time."""
    near, rows, radius = surface.found.near, surface.rows, surface.radius
    z, columns = near.field @ surface.found.soft, {}
    for name, values in conditions.items():
        # the hard iron stays that of the mean condition
        off = values[rows] - values[rows].mean()
        if off.any():
            columns[name] = near.normal * (off / np.abs(off).max())[:, None]
    # averaging over a short time shortens a turning vector in proportion to the square of its rate
    turn = np.gradient(unit(surface.corrected), axis=0)[rows]
    columns[FAST] = (np.sum(near.normal * z, axis=1) * np.sum(turn**2, axis=1))[:, None]
    columns[BENT] = np.concatenate([near.normal * (z / radius) ** 2, near.normal * (z / radius) ** 3], axis=1)
    return columns


def examined(surface: Surface, conditions: dict[str, np.ndarray]) -> list[Cause]:
    """The causes that the residuals beside an ellipsoid show, the surest first."""
    found, causes = surface.found, []
    left, jacobian = found.distance, found.near.slopes
    if surface.widest is None or len(left) < _FEWEST or not np.isfinite(found.covariance).all():
        return []
    if not found.noise > EXACT * surface.radius or not found.converged:
        return []
    # a soft iron that the model leaves out is told by another step: a cause is what the largest model does not explain
    span, length = span_of(surface.widest), np.linalg.norm(jacobian, axis=0)
    for name, part in _columns(surface, conditions).items():
        part = part[:, np.abs(part).max(axis=0) > 1e-12 * surface.radius]
        coefficients, chance = followed(span, part, left)
        if chance < CHANCE:
            effect = part @ coefficients
            step = np.linalg.lstsq(jacobian / length, effect, rcond=1e-9)[0] / length
            causes.append(Cause(name, step, float(np.max(np.abs(effect))) / surface.radius, chance))
    return sorted(causes, key=lambda cause: cause.chance)


def _from_structure(surface: Surface) -> list[Finding]:
    """Findings that lie in the geometry of the readings, and those about the convergence of the fit."""
    found, weakest = surface.found, surface.weakest
    if extents(Frame.of(surface.m).scaled(surface.m))[-1] < NEAR_PLANAR:
        return [FINDINGS("near_planar")]
    if not np.isfinite(found.covariance).all() or FINDINGS.over("undetermined", surface.condition, what=weakest):
        return [FINDINGS("undetermined", what=weakest)]
    return [] if found.converged else [FINDINGS("not_converged", what=weakest)]


def _known(asked: Asked, surface: Surface, causes: Sequence[Cause], costs: Sequence[Any], small: bool, error: float) -> list[Finding]:
    """What to know about a surface: its structure, its size, the causes with their costs, and how certain its noise is."""
    found, size, norm = surface.found, float(surface.radius * surface.scale), asked.norm
    said = [*surface.said, *_from_structure(surface)]
    said += [FINDINGS("small_model", what="a full soft iron matrix", model=found.kind)] if small else []
    said += FINDINGS.over("field_differs", abs(np.log(size / norm)), found=size, given=norm) if norm else []
    for cause, cost in zip(causes, costs, strict=True):
        code = {FAST: "averaged", BENT: "bent"}.get(cause.name, "follows")
        what: dict[str, Any] = {"what": cause.name} if code == "follows" else {}
        said.append(FINDINGS(code, cost=float(cost[0]), size=100 * cause.size, **what))
    # the noise of few white readings is uncertain itself: Student's distribution has the wider error
    wider = error * (1.0 if found.parts else np.sqrt(found.freedom / (found.freedom - 2)) if found.freedom > 2 else np.inf)
    if error <= asked.limits[0] < wider:
        said.append(FINDINGS("few_left", count=len(surface.rows), angle=Quantity(min(wider, np.pi), "angle")))
    return said


def by_magnitudes(asked: Asked, surface: Surface) -> MagFit:
    """The fit of the magnitudes alone: the surface with its heading error and findings. In a trace nothing is judged."""
    found, model, field, larger, host = surface.found, surface.model, surface.field, surface.larger, not asked.traced
    if found is None:
        return made(
            MagFit, model=None, estimate=Estimate((), np.zeros(0), np.zeros((0, 0))), heading_error=np.full(2, np.inf), field=np.inf,
            noise=np.inf, residual=np.zeros(0), inclination=asked.dip, method=asked.method, kind="none",
            findings=(*surface.said, *([] if surface.refused is None else [surface.refused])),
        )  # fmt: skip
    # the error: by parts of the log, at least that of white residuals, with what the fit cannot see by itself
    causes = examined(surface, asked.conditions) if host else []
    said, dip, down = orientation(asked, surface.corrected, surface.rows) if host else ([FINDINGS("not_judged")], asked.dip, None)
    steps = [np.outer(one, one) for one in [surface.unseen, *(surface.slopes @ cause.step for cause in causes)]]
    matrix = between(surface.slopes, found.covariance) + sum(steps)
    error, *costs = (heading_errors if host else errors_in_trace)(model, field, surface.usual, dip, down, [matrix, *steps[1:]])
    if surface.best is not None:
        off = [heading_change(surface.best, model, field, inclination=dip, down=down, tilt=tilt) for tilt in (0.0, TILT)]
        error = np.hypot(error, np.sqrt([np.mean(one**2) for one in off]))
    small = surface.smaller
    if larger is not None:
        whole = between(larger.slopes, larger.found.covariance)
        small = not heading_errors(larger.model, larger.field, None, dip, None, [whole])[0][0] <= asked.limits[0]

    if host:
        said += _known(asked, surface, causes, costs, small, float(error[0]))
    held, freedom = asked.norm is not None or surface.usual is not None, float(BLOCKS - 1) if found.parts else found.freedom
    freedom = freedom if host else float(len(surface.m) - found.parameters.size)
    return judged(
        asked, said, corrected=surface.corrected, size=surface.radius * surface.scale, parts=found.parts, weakest=surface.weakest,
        about={"used": len(surface.m), "condition": surface.condition}, usual=surface.usual, model=model,
        estimate=estimated(model, field, matrix, freedom, surface.further, held), heading_error=error, field=field,
        noise=found.noise * surface.scale, residual=surface.residual, inclination=dip, method=asked.method, kind=found.kind, down=down,
    )  # fmt: skip


def judged(
    asked: Asked, said: list[Finding], *, corrected: Any, size: Any, parts: bool, weakest: str, about: dict[str, Any], usual: Any,
    **told: Any,
) -> MagFit:  # fmt: skip
    """The answer: a fit with all its findings, one of them about its heading error if that is above a limit.

    size : of the field in the unit of the readings. corrected : all readings. parts : whether the covariance is that of fits without parts
    of the log. weakest : what is least certain, in words. usual : medians of the conditions of a model object. told : fields of the fit.
    """
    if not asked.traced:
        said = [*said, *_verdict(told, size, parts, weakest, asked.limits, [one.code for one in said])]
        told |= {"coverage": covered(corrected), "_about": about | ({} if usual is None else {"usual": usual})}
    return made(MagFit, findings=tuple(said), **told)


def _verdict(
    told: dict[str, Any], size: Any, parts: bool, weakest: str, limits: tuple[float, float], codes: Sequence[str]
) -> list[Finding]:  # fmt: skip
    """Findings about the residuals, and about the heading error if that is above a limit; `codes` of those known."""
    distance, scatter, level = told["residual"] / size, float(told["noise"] / size), float(told["heading_error"][0])
    far, total = len(outliers(distance)), len(distance)
    # two outliers are no matter
    said = FINDINGS.over("scatter", scatter, share=100 * scatter)
    said += FINDINGS.over("outliers", far / total if far > 2 else 0.0, count=far, total=total)
    said += [FINDINGS("correlated", size=100 * scatter)] if parts else []
    if not level <= limits[0] and not any(code in _OPEN for code in codes):
        grave, matrix = not level <= limits[1], np.asarray(told["estimate"].matrix)
        wanted = needed(told["model"], float(told["field"]), told["kind"], matrix)
        way = "(" + ", ".join(f"{x:+.1f}" for x in wanted[0]) + ") of the sensor" if len(wanted) else "directions not yet seen"
        limit = Quantity(limits[1] if grave else limits[0], "angle")
        said.append(FINDINGS("heading", severity=FATAL if grave else CAUTION, cost=level, limit=limit, what=weakest, direction=way))
    return said
