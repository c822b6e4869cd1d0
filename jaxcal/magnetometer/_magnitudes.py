"""Fit of the magnitudes of the field alone: the surface, its error, and what to know about both."""

from typing import Any

import numpy as np

from .._answer import Quantity
from .._frozen import made
from ..fitting._serial import BLOCKS
from ._aids import down_by, verticals
from ._axes import Axes, axes_of, by_axes
from ._design._coverage import covered
from ._design._heading_error import down_of, heading_error, information
from ._diagnosis import chosen_rows, departure, from_causes, from_field, from_structure
from ._ellipsoid._algebraic import NotEllipsoid
from ._ellipsoid._causes import examined
from ._ellipsoid._kinds import COUNT, PLANAR
from ._ellipsoid._select import all_distances
from ._ellipsoid._shape import covariance_of, directions_of, model_of, radius_of, unit
from ._findings import FINDINGS
from ._iron import by_surface, estimated
from ._judge import by_readings, few_left, judged, outliers
from ._result import MagFit, unfitted
from ._surface import surface_of

_AGREE = np.deg2rad(5.0)  # scatter of the dip of readings at rest, above which an accelerometer does not show it


def by_magnitudes(
    m: np.ndarray, aid: Any, recorded: dict[str, np.ndarray], *, method: str, model: str, norm: Any, dip: float,
    limits: tuple[float, float], penalty: float, known: bool,
) -> tuple[MagFit, np.ndarray]:  # fmt: skip
    """The fit of readings (n, 3), and the rows that were fitted; `known` says whether the dip was given."""
    used, full = chosen_rows(m)
    try:
        surface = surface_of(m[used], method, model, penalty, (dip, limits[0]))
    except NotEllipsoid as error:
        return unfitted(method, dip, FINDINGS("no_ellipsoid", quadric=error.quadric)), used
    if surface.refused is not None:
        return unfitted(method, dip, surface.refused), used
    found, frame, plane = surface.found, surface.frame, surface.plane
    planar, log = plane is not None, surface.scaled(m)
    size = radius_of(found.shape, planar) if norm is None else norm / frame.scale
    iron, field = model_of(found.shape, found.centre, frame, size, plane), float(size * frame.scale)
    corrected, directions = np.asarray(iron.correct(m)), directions_of(found, surface.u)

    # the dip, and the axis that points down
    axes, seen, down = _seen(aid, corrected)
    said = list(by_axes(axes, np.sign(dip) if known else 0.0, turns=False)) if not planar else []
    if axes is None:
        said.append(FINDINGS("unseen_axes"))
    if seen is not None and not planar and not known:
        dip = seen
    down = down_of(directions, dip) if down is None else down

    # the error: by parts of the log, at least that of white residuals, with what the fit cannot see by itself
    told = examined(found, surface.u, log, used, recorded)

    def spread(own: Any, steps: Any = None) -> np.ndarray:
        return np.asarray(by_surface(iron.soft_iron, field, covariance_of(found, frame, steps, own), norm is not None, plane))

    def error_of(matrix: np.ndarray) -> np.ndarray:
        return np.asarray(heading_error(iron, field, matrix[:12, :12], dip, down, plane))

    matrix, nothing = spread(told.white), np.zeros_like(told.white)
    if told.parts is not None:
        white, matrix = matrix, spread(told.parts)
        matrix = matrix * max(error_of(white)[0] / error_of(matrix)[0], 1.0) ** 2
    steps = [spread(nothing, cause.step[None]) for cause in told.causes]
    matrix = matrix + spread(nothing, surface.unseen) + sum(steps)
    error = error_of(matrix)
    if method == "constrained":
        error = np.hypot(error, departure(found, surface.u, dip))

    # what to know
    bits = information(directions, found.kind, found.noise / radius_of(found.shape, planar))
    distance = found.distance if len(used) == len(m) else all_distances(found, log)
    said += [*from_structure(found, surface.u, bits), *surface.said, *from_field(found, norm, frame.scale, planar)]
    said += by_readings(found.noise / radius_of(found.shape), len(outliers(distance)), len(m))
    said += few_left(len(used), COUNT[found.kind])
    said += from_causes(found, told, int(full.sum()), [float(error_of(step)[0]) for step in steps])
    if not known and (seen is None or planar):
        said.append(FINDINGS("dip_assumed", dip=Quantity(dip, "angle")))
    freedom = BLOCKS - 1 if told.parts is not None else max(len(used) - COUNT[found.kind], 1)
    estimate = estimated(iron, field, matrix, freedom, held=norm is not None, plane=plane)
    result = made(
        MagFit, model=iron, estimate=estimate, heading_error=error, field=field, noise=float(found.noise * frame.scale),
        residual=distance * frame.scale, inclination=dip, method=method, kind=found.kind, coverage=covered(corrected), down=down,
        plane=plane,
        _about={"used": len(used), "condition": bits.condition, "penalty": float(found.penalty)},
    )  # fmt: skip
    wanted = result.needed if not error[0] <= limits[0] and found.kind not in PLANAR else np.zeros((0, 3))
    object.__setattr__(result, "findings", judged(said, float(error[0]), limits, bits.weakest, wanted))
    return result, used


def _seen(aid: Any, corrected: np.ndarray) -> tuple[Axes | None, float | None, np.ndarray | None]:
    """The axes by an accelerometer, the dip if the axes agree with it, and the axis that points down."""
    if not hasattr(aid, "turns"):
        return None, None, None
    up, field = verticals(aid.accel, len(corrected)), unit(corrected)
    axes, there = axes_of(field, up), np.isfinite(up).all(axis=1)
    if axes is None or not axes.same:
        return axes, None, None
    dips = -np.arcsin(np.clip(np.sum(field * up, axis=1)[there], -1, 1))
    return (axes, axes.dip, down_by(up)) if np.std(dips) < _AGREE else (axes, None, None)
