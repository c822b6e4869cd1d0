"""What a fit says: its error, what to know about it, and the verdict."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._answer import Finding, Quantity, joined_names
from ..fitting import Estimate
from ..fitting._information import information as of_jacobian
from . import _quadric as quadric
from ._aids import Asked
from ._directions import attitude_in_words, covered, heading_errors, needed
from ._findings import FINDINGS
from ._model import MagModel
from ._quadric import NEAR_PLANAR, SYMMETRIC, UPPER, Frame, extents, outliers, unit
from ._result import HARD, SOFT, MagFit, quantity_of
from ._surface import BENT, FAST, Surface, between

#: findings beside which a heading error means nothing
_OPEN = ("not_judged", "undetermined", "near_planar", "no_ellipsoid", "not_converged")

_GOOD = FINDINGS["heading"].limits[0]


def judged(asked: Asked, surface: Surface) -> MagFit:
    """The answer: what is known, with its heading error and findings. In a trace nothing is judged."""
    found, model, field, dip, host = surface.found, surface.model, surface.field, surface.dip, not asked.traced
    if model is None:
        return MagFit(None, Estimate((), np.zeros(0), np.zeros((0, 0))), np.full(2, np.inf), field, surface.noise, surface.residual, dip,
                      asked.method, "none", findings=surface.said)  # fmt: skip
    larger, said, kind = surface.larger, list(surface.said), surface.joint or found.kind
    held = asked.norm is not None or surface.usual is not None
    matrices = [surface.matrix, *(np.outer(cause.step, cause.step) for cause in surface.causes)]
    matrices = [_of_iron(model, field, held, one) for one in matrices]
    spread = matrices[0] if surface.spread is None else _of_iron(model, field, held, surface.spread)
    wide = None if larger is None else _of_iron(larger.model, larger.field, False, larger.matrix)
    error, *costs = heading_errors(model, field, surface.usual, dip, surface.down, matrices)
    wide = 0.0 if larger is None else heading_errors(larger.model, larger.field, None, dip, None, [wide])[0][0]
    wanted = needed(model, float(field), kind, spread) if host else np.zeros((0, 3))
    way = attitude_in_words(wanted[0], float(dip), surface.down) if len(wanted) else "attitudes not yet seen"
    cover = covered(surface.corrected) if host else None
    condition, weakest = (np.nan, "the soft iron") if surface.joint or not host else _weakest(surface)
    if host:
        said += [] if surface.joint else _of_magnitudes(asked, surface, condition, weakest, float(error[0]), float(wide))
        said += _causes(surface, costs)
    # a field that the readings leave open may be of any size, the readings not
    quantity = quantity_of(np.nanmedian(np.abs(asked.m)) if host else field)
    estimate = _estimated(model, field, quantity, spread, surface.freedom, surface.further or {}, held)
    if host:
        size = field if surface.joint else surface.radius * surface.scale
        said += _about_residuals(surface.residual / size, float(surface.noise / size), surface.parts)
        said += [] if any(one.code in _OPEN for one in said) else _about_heading(float(error[0]), weakest, way)
    about = {"used": len(surface.rows if surface.joint else surface.m), "condition": condition}
    return MagFit(
        model, estimate, error, field, surface.noise, surface.residual, dip, "joint" if surface.joint else asked.method, kind, cover,
        surface.down, surface.alignment, findings=tuple(said), _about=about | ({} if surface.usual is None else {"usual": surface.usual}),
    )  # fmt: skip


def _of_iron(model: MagModel, field: Any, given: bool, covariance: Any) -> Any:
    """Covariance of hard iron, soft iron C, field H and further values by that of M = C H, hard iron, these; H^3 = det M unless given."""
    whole, more = model.soft_iron * field, len(covariance) - 12
    xp = whole.__array_namespace__()
    by_field = xp.zeros(9, dtype=whole.dtype) if given else field / 3 * xp.linalg.inv(whole).T.ravel()
    by_soft = xp.concatenate([xp.eye(9, dtype=whole.dtype) / field - xp.outer(whole.ravel(), by_field) / field**2, by_field[None]])
    hard, further = xp.eye(3, 12 + more, 9, dtype=whole.dtype), xp.eye(more, 12 + more, 12, dtype=whole.dtype)
    slopes = xp.concatenate([hard, xp.concatenate([by_soft, xp.zeros((10, 3 + more), dtype=whole.dtype)], axis=1), further])
    return between(slopes, covariance)


def _estimated(model: MagModel, field: Any, quantity: str, covariance: Any, freedom: Any, further: dict[str, Any], held: bool) -> Estimate:
    """Hard iron, soft iron, the field and `further` parameters (name -> value), in this order, with their covariance."""
    xp = covariance.__array_namespace__()
    values = [xp.ravel(xp.asarray(part)) for part in (model.hard_iron, model.soft_iron, field, *further.values())]
    states = {"field": "held"} if held else {}
    quantities = {"hard_iron": quantity, "field": quantity}
    quantities |= {name.partition("[")[0]: quantity for name in further if name.startswith("currents.")}
    return Estimate((*HARD, *SOFT, "field", *further), xp.concatenate(values), covariance, freedom, states, quantities)


def sphere_rows(directions: Any, xp: Any = np) -> Any:
    """Derivative (n, 9) of the distance of unit vectors to the unit sphere by the upper entries of S and the centre, but for its sign."""
    i, j = UPPER
    return xp.concatenate([directions[:, i] * directions[:, j] * SYMMETRIC.sum(axis=0)[None, :], directions], axis=1)


def _weakest(surface: Surface) -> tuple[float, str]:
    """Condition number of the fit, and the parameters that it determines least, in words; for an ellipsoid on the unit sphere.

    Columns keep their natural scale, because with columns of unit length a thin band of directions would look well conditioned. A row is
    u'Su + c'u for the changes S and c, with 2 S, the change of the quadric, as parameter.
    """
    if surface.usual is not None:
        axes = [*(f"soft_iron[{i},{j}]" for i, j in zip(*UPPER, strict=True)), *HARD]
        known = of_jacobian(surface.found.near.slopes, names=(*axes, *surface.further))
        return float(known.condition), ", ".join(known.weakest)
    part = np.repeat([0.5, 1.0], [6, 3])[:, None] * (quadric.inverse_of("symmetric") @ surface.found.basis)
    values, vectors = np.linalg.svd(np.linalg.qr(sphere_rows(unit(surface.corrected[surface.rows])) @ part, mode="r"))[1:]
    condition = float(values[0] / values[-1]) if len(values) == part.shape[1] and values[-1] > 0 else np.inf
    axes = [("xyz"[i], "xyz"[j]) for i, j in zip(*UPPER, strict=True)]
    words = [f"scale_{i}" if i == j else f"coupling of {i} and {j}" for i, j in axes] + [f"hard iron_{i}" for i in "xyz"]
    weak = np.abs(part @ vectors[-1])
    return condition, joined_names(word for word, share in zip(words, weak, strict=True) if share > 0.5 * weak.max())


def _causes(surface: Surface, costs: Sequence[Any]) -> list[Finding]:
    """What the residuals follow; beside another sensor or currents only what acts alike in all attitudes."""
    said = []
    for cause, cost in zip(surface.causes, costs, strict=True):
        code = {FAST: "averaged", BENT: "bent"}.get(cause.name, "follows")
        if code != "follows" or not surface.joint:
            what: dict[str, Any] = {"what": cause.name} if code == "follows" else {}
            said.append(FINDINGS(code, cost=float(cost[0]), size=100 * cause.size, **what))
    return said


def _of_magnitudes(asked: Asked, surface: Surface, condition: float, weakest: str, error: float, wide: float) -> list[Finding]:
    """What to know about a surface of magnitudes: structure, size, and how certain its noise is. wide : error of a larger model."""
    found, size, norm = surface.found, float(surface.radius * surface.scale), asked.norm
    said: list[Finding] = []
    if extents(Frame.of(surface.m).in_frame(surface.m))[-1] < NEAR_PLANAR:
        said.append(FINDINGS("near_planar"))
    elif not np.isfinite(found.covariance).all() or FINDINGS.over("undetermined", condition, what=weakest):
        said.append(FINDINGS("undetermined", what=weakest))
    elif not found.converged:
        said.append(FINDINGS("not_converged", what=weakest))
    if not wide <= _GOOD:
        said.append(FINDINGS("small_model", what="a full soft iron matrix", model=found.kind))
    said += FINDINGS.over("field_differs", abs(np.log(size / norm)), found=size, given=norm) if norm else []
    # the noise of few white readings is uncertain itself: Student's distribution has the wider error
    freedom = found.freedom
    wider = error * (1.0 if surface.parts else np.sqrt(freedom / (freedom - 2)) if freedom > 2 else np.inf)
    if error <= _GOOD < wider:
        said.append(FINDINGS("few_left", count=len(surface.rows), angle=Quantity(min(wider, np.pi), "angle")))
    return said


def _about_residuals(distance: np.ndarray, scatter: float, parts: bool) -> list[Finding]:
    """Findings about residuals and noise over the field."""
    far, total = len(outliers(distance)), len(distance)
    # two outliers are no matter
    said = FINDINGS.over("scatter", scatter, share=100 * scatter)
    said += FINDINGS.over("outliers", far / total if far > 2 else 0.0, count=far, total=total)
    return said + ([FINDINGS("correlated", size=100 * scatter)] if parts else [])


def _about_heading(level: float, weakest: str, way: str) -> list[Finding]:
    """A finding if the heading error is above a limit."""
    limit = Quantity(max((limit for limit in FINDINGS["heading"].limits if level > limit), default=_GOOD), "angle")
    return FINDINGS.over("heading", level, limit=limit, what=weakest, attitude=way)
