"""Fit of the magnitudes of the field alone: the surface, its error, and what to know about both."""

from typing import Any

import numpy as np

from .._answer import Quantity
from ..fitting._serial import BLOCKS
from ._aids import down_by, verticals
from ._axes import Axes, axes_of, by_axes
from ._checked import Asked
from ._design._heading_error import TILT, both_tilts, by_iron, down_of, heading_change, information, rms_heading
from ._diagnosis import chosen_rows, from_causes, from_structure
from ._ellipsoid._algebraic import NotEllipsoid
from ._ellipsoid._causes import examined
from ._ellipsoid._kinds import COUNT
from ._ellipsoid._orthogonal import distances, flat
from ._ellipsoid._shape import between, directions_of, radius_of, unit
from ._findings import AGREE, FINDINGS
from ._iron import estimated
from ._judge import by_readings, outliers
from ._result import MagFit, judged_fit, unfitted
from ._surface import Surface, iron_of, surface_of


def by_magnitudes(asked: Asked) -> tuple[MagFit, np.ndarray, Any]:
    """The fit of the magnitudes, the fitted rows, and the normal of the plane of the readings if they lie in one."""
    m, method, norm, dip, known = asked.m[asked.there], asked.method, asked.norm, asked.dip, asked.known
    used, readings, full = chosen_rows(m)
    try:
        surface = surface_of(readings, method, asked.model, (dip, asked.limits[0]))
    except NotEllipsoid as error:
        surface = Surface(FINDINGS("no_ellipsoid", quadric=error.quadric))
    clipped = [FINDINGS("clipped", count=full)] if full else []
    if surface.found is None:
        refused = [] if surface.refused is None else [surface.refused]
        return unfitted(method, dip, *clipped, *refused), asked.there[used], surface.plane
    found, u = surface.found, surface.u
    iron, field, slopes = iron_of(found, surface.frame, norm)
    corrected, directions, log = np.asarray(iron.correct(m)), directions_of(found, u), surface.frame.scaled(m)

    # the dip, and the axis that points down
    axes, seen, down = _seen(asked.aid, corrected)
    said = [*by_axes(axes, asked.sign, turns=False), *([] if axes else [FINDINGS("unseen_axes")]), *clipped]
    dip = dip if known or seen is None else seen
    down = down_of(directions, dip) if down is None else down

    # the error: by parts of the log, at least that of white residuals, with what the fit cannot see by itself
    headings = both_tilts(by_iron(iron, field), dip, down)
    spread, parts, causes = examined(found, u, log, used, asked.conditions)
    steps = [np.outer(one, one) for one in [slopes @ surface.unseen, *(slopes @ cause.step for cause in causes)]]
    matrix = between(slopes, spread) + sum(steps)
    error = np.asarray(rms_heading(headings, matrix))
    if method == "constrained":
        error = np.hypot(error, _departure(surface, iron, field, norm, dip, down))

    # what to know
    condition, weakest = information(directions, found.kind)
    distance = found.distance if np.array_equal(readings, m) else distances(found, log)
    scatter, mean = found.noise / radius_of(found.soft), float(surface.frame.scale * radius_of(found.soft))
    said += [
        *from_structure(found, u, condition, weakest),
        *surface.said,
        *(FINDINGS.over("field_differs", abs(np.log(mean / norm)), found=mean, given=norm) if norm else []),
    ]
    said += [*by_readings(scatter, len(outliers(distance)), len(m))]
    said += FINDINGS.over("few_left", max(len(used) - COUNT[found.kind], 1) ** -0.5, count=len(used))
    said += from_causes(causes, [float(rms_heading(headings, step)[0]) for step in steps[1:]])
    said += [FINDINGS("correlated", size=100 * scatter)] if parts else []
    said += [] if known or seen is not None else [FINDINGS("dip_assumed", dip=Quantity(dip, "angle"))]
    freedom = BLOCKS - 1 if parts else max(len(used) - COUNT[found.kind], 1)
    return judged_fit(
        said, asked.limits, weakest, corrected, model=iron, estimate=estimated(iron, field, matrix, freedom, held=norm is not None),
        heading_error=error, field=float(field), noise=float(found.noise * surface.frame.scale), residual=distance * surface.frame.scale,
        inclination=dip, method=method, kind=found.kind, down=down, _about={"used": len(used), "condition": condition},
    ), asked.there[used], None  # fmt: skip


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


def _departure(surface: Surface, iron: Any, field: Any, norm: Any, dip: float, down: Any) -> np.ndarray:
    """Heading difference to the maximum likelihood fit of the same readings, at level and tilted; infinite if there is none."""
    try:
        best, _, _ = iron_of(flat(surface.u, "symmetric"), surface.frame, norm)
    except NotEllipsoid:
        return np.full(2, np.inf)
    off = [heading_change(best, iron, field, inclination=dip, down=down, tilt=tilt) for tilt in (0.0, TILT)]
    return np.sqrt([np.mean(one**2) for one in off])
