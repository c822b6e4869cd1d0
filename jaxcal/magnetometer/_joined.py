"""Fit of the magnitudes together with the sensor of an aid, and with the fields of currents."""

import dataclasses
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import CAUTION, FATAL, NOTE, Quantity
from .._errors import DataError
from ..fitting._serial import BLOCKS
from ._aided import Attitudes, Known, Solution, attitudes_in_segments, averaged, north_of, poses, solved
from ._aids import NAMES, Accelerometer, Alignment, Attitude, Gyroscope, Headings, Plane, vector_from
from ._axes import FEWEST, Axes, axes_by_headings, axes_by_rates, axes_of, by_axes, down_by, down_of, like, verticals
from ._checked import Asked
from ._field import INCLINATION
from ._findings import FINDINGS
from ._heading_error import heading_errors
from ._judge import judged
from ._model import MagModel
from ._quadric import NEAR_PLANAR, Frame, extents, sphere_centre, unit
from ._result import MagFit, estimated
from ._surface import iron_slopes

#: rad between verticals of one pose, ten times the scatter of an accelerometer by hand; usual steps between its readings: 1 in 10,000 of
#: those with normal noise is farther off
_POSE, _STEPS = np.deg2rad(3.0), 3.0
_DIP, _ANY_DIP, _FIELD = np.deg2rad(0.5), 0.5, 0.02  # rad, prior spread of a given dip, and of one that is not; share of a given field
#: findings of the fit of magnitudes that hold for the joint fit too
_KEPT = ("clipped", "averaged", "bent")
#: findings about the axes by an accelerometer that gives the dip only
_OF_AXES = ("axes_open", "axes_turned", "mirrored", "remounted", "reversed", "unseen_axes")


def without_currents(found: MagFit, m: np.ndarray, currents: dict[str, Any]) -> np.ndarray:
    """Readings (n, 3) without the fields of the currents that a fit has found."""
    for name, values in currents.items():
        terms = np.array([found.estimate[f"currents.{name}[{i}]"].value for i in range(3)])
        m = m - np.asarray(values, dtype=float)[:, None] * terms
    return m


def plain(model: MagModel, m: np.ndarray, there: np.ndarray, conditions: dict[str, Any]) -> np.ndarray:
    """Readings without what a model object adds to its iron, as far as the magnitudes show it."""
    h = np.asarray(model.correct(m[there], **conditions))
    m = m.copy()
    m[there] -= np.asarray(model.measure(h, **conditions)) - MagModel(model.soft_iron, model.hard_iron).measure(h)
    return m


def joined(first: MagFit, asked: Asked, rows: np.ndarray) -> MagFit:
    """The fit of the given rows together with the aid and the currents, from the fit `first` of magnitudes."""
    there, currents, own = asked.there, asked.currents, first.model if isinstance(asked.model, MagModel) else None
    m, norm = (asked.m, asked.norm) if own is None else (plain(own, asked.m, there, asked.conditions), float(first.field))
    field_error, dip = asked.field_error, asked.dip if asked.known else None
    aid: Any = asked.aid if getattr(asked.aid, "turns", True) else None
    at, source = told(aid, len(m))
    columns = np.array([*currents.values()]).reshape(len(currents), len(m)).T
    # the hard iron of the fit is that at the recorded current nearest to zero, where the heading error holds
    nearest = np.clip(0.0, columns.min(axis=0), columns.max(axis=0))
    size = np.abs(columns - nearest).max(axis=0)
    scaled = (columns - nearest)[rows] / size
    found, frame, axes = _solved_with(m, rows, at, source, first, (norm, field_error, dip, getattr(aid, "dip", None)), scaled)
    faults = by_axes(axes, asked.sign)
    about = [*faults, *([FINDINGS("unseen_axes")] if axes is None else [])]
    if found is None or not np.isfinite(found.covariance).all():
        about += [] if found is None else [FINDINGS("not_converged", what="the soft iron beside the other sensor")]
        return dataclasses.replace(first, findings=(*(one for one in first.findings if one.code not in _OF_AXES), *about))

    whole = found.matrix * frame.scale
    field = float(np.cbrt(np.linalg.det(whole))) if norm is None else float(norm)
    terms = found.parameters[18:].reshape(-1, 3) * (frame.scale / size)[:, None]
    hard = frame.centre + frame.scale * found.centre
    model = MagModel(whole / field, hard - nearest @ terms)
    spread = _spread(found, frame.scale, whole, field, norm is not None, size)
    dip_seen = dip if dip is not None else float(found.parameters[13]) if source in ("accel", "attitude", "headings") else first.inclination
    corrected = np.asarray(model.correct(m[there] - columns[there] @ terms))
    level = np.array([0.0, 0.0, 1.0]) if source == "headings" and aid.accel is None else down_by(at.up)
    down = down_of(unit(corrected), dip_seen) if level is None else level
    move, seen = np.eye(len(spread)), spread[:13, :13]
    move[:3, 13:] = -np.kron(nearest, np.eye(3))
    spread, usual = move @ spread @ move.T, None
    further = {f"currents.{name}[{i}]": terms[j, i] for j, name in enumerate(currents) for i in range(3)}
    if own is not None:
        names, usual = first.estimate.names[13:], first._about["usual"]
        known = first.estimate.select(*names)
        model = eqx.tree_at(lambda m: (m.soft_iron, m.hard_iron), own, (model.soft_iron, model.hard_iron))
        seen = scipy.linalg.block_diag(seen, known.matrix)
        order = np.r_[0:13, len(spread) : len(spread) + len(names), 13 : len(spread)]
        spread = scipy.linalg.block_diag(spread, known.matrix)[np.ix_(order, order)]
        further = dict(zip(names, known.values, strict=True)) | further
    (error,) = heading_errors(model, field, usual, dip_seen, down, [seen])

    turn = alignment_of(found, source) if source and source != "plane" else None
    said = [*about, *(one for one in first.findings if one.code in _KEPT)]
    if source == "plane":
        said.append(FINDINGS("plane", severity=NOTE if aid.asked else CAUTION))
    if turn is not None:
        said += turn.findings
        said += FINDINGS.over("aid_off", found.spread, angle=Quantity(found.spread, "angle"), source=NAMES[source])
        if dip is not None and source in ("accel", "attitude") and not faults:
            other = float(found.parameters[13])
            said += FINDINGS.over("dip_differs", abs(other - dip), found=Quantity(other, "angle"), given=Quantity(dip, "angle"))
    mean = float(np.cbrt(np.linalg.det(first.model.soft_iron)) * first.field) if first.model is not None and norm is not None else field
    if norm is not None and field_error is not None:
        doubt = np.hypot(field_error, first.estimate["soft_iron[0,0]"].half / 2)
        said += FINDINGS.over("contradicts", abs(np.log(mean / norm)) / doubt, found=mean, given=norm)
    if not found.converged:
        said.append(FINDINGS("not_converged", what="the soft iron"))
    if dip is None and source not in ("accel", "attitude", "headings"):
        said.append(FINDINGS("dip_assumed", dip=Quantity(INCLINATION, "angle")))
    # distances to first order: the magnitude of the field over the length of its slope
    slope = np.linalg.norm(unit(corrected) @ np.linalg.inv(model.soft_iron), axis=1)
    residual = (np.linalg.norm(corrected, axis=1) - field) / slope
    noise = float(np.sqrt(np.sum(residual[np.isin(there, rows)] ** 2) / max(len(rows) - 13, 1)))
    freedom = BLOCKS - 1 if found.parts else max(len(found.across) - 13, 1)
    kind = {"": "symmetric", "plane": "planar"}.get(source, "full") if own is None else first.kind
    return judged(
        asked, said, corrected=corrected, size=field, parts=found.parts, weakest="the soft iron", about={"used": len(rows)}, usual=usual,
        model=model, estimate=estimated(model, field, spread, freedom, further, norm is not None), heading_error=np.asarray(error),
        field=field, noise=noise, residual=residual, inclination=dip_seen, method="joint", kind=kind, down=down, alignment=turn,
    )  # fmt: skip


def _spread(found: Any, scale: float, whole: np.ndarray, field: float, given: bool, size: np.ndarray) -> np.ndarray:
    """Covariance of hard iron, soft iron, field and the fields of currents from that of the scaled solution."""
    count = len(found.parameters) - 18
    kept = np.r_[0:12, 18 : 18 + count]  # C, b, K
    matrix = found.covariance[np.ix_(kept, kept)] * scale**2
    slopes = np.zeros((13 + count, 12 + count))
    slopes[:13, :12] = iron_slopes(whole, field, given)
    slopes[13:, 12:] = np.diag(1 / np.repeat(size, 3))
    return slopes @ matrix @ slopes.T


def told(aid: Any, count: int) -> tuple[Attitudes, str]:
    """What an aid tells of the attitudes of all readings of a log, and its name."""
    if aid is None:
        return Attitudes(rotated=False), ""
    if isinstance(aid, Gyroscope):
        return Attitudes(gyro=like(aid.gyro, count, "rates"), rate=float(aid.rate), rows=np.arange(count)), "gyro"
    if isinstance(aid, Accelerometer | Attitude):
        return Attitudes(up=verticals(aid.accel, count)), "accel" if isinstance(aid, Accelerometer) else "attitude"
    if isinstance(aid, Plane):
        return Attitudes(up=np.tile(-aid.down, (count, 1)), rotated=False), "plane"
    if not isinstance(aid, Headings):
        raise DataError(
            f"The aid is {type(aid).__name__}; give Accelerometer(f), Attitude(q), Gyroscope(w, rate) or Headings(h).", code="no_such_aid"
        )
    heading = np.asarray(aid.headings, dtype=float) - aid.declination
    if heading.shape != (count,):
        raise DataError(f"The headings have shape {heading.shape}; give one for each of {count} readings, NaN where none is known.",
                        code="heading_shape")  # fmt: skip
    level = np.where(np.isfinite(heading)[:, None], [0.0, 0.0, -1.0], np.nan)
    return Attitudes(level if aid.accel is None else verticals(aid.accel, count), heading, rotated=aid.accel is not None), "headings"


def _solved_with(
    m: np.ndarray, rows: np.ndarray, at: Attitudes, source: str, first: Any, known: tuple[Any, Any, Any, Any], currents: np.ndarray | None
) -> tuple[Solution | None, Frame, Axes | None]:
    """Fit readings (n, 3) in the given rows together with an aid, from the fit `first` of magnitudes; no solution with wrong axes.

    known : field in the unit of the readings and its relative error, dip in rad, or None; and the dip of the aid.
    """
    field, field_error, dip, own = known
    dip = own if own is not None else dip
    x, frame = m[rows], Frame.of(m[rows])
    up, heading = (None if part is None else part[rows] for part in (at.up, at.heading))
    if up is not None and source != "plane":
        number = poses(x, up, heading, _POSE, _STEPS)
        x, up, currents = averaged(x, number), averaged(up, number), None if currents is None else averaged(currents, number)
        up = unit(up)
        heading = None if heading is None else averaged(heading, number)
    count = len(x) if source == "" else int(np.isfinite(up).all(axis=1).sum()) if up is not None else len(rows)
    if count < FEWEST:
        raise DataError(f"{count} readings with the {NAMES[source]} are left; at least {FEWEST} are needed.", code="few_readings")
    u = frame.scaled(x)
    at = at._replace(up=up, heading=heading, rows=rows if at.gyro is not None else None)
    model = first.model if first.verdict != "refused" else None
    if model is not None:
        matrix = np.asarray(model.soft_iron) * first.field / frame.scale
        centre = (np.asarray(model.hard_iron) - frame.centre) / frame.scale
    else:
        matrix, centre = _round(u, INCLINATION if dip is None else dip)
    y = unit((u - centre) @ np.linalg.inv(matrix).T)
    axes = _axes(y, at, INCLINATION if dip is None else dip, model is not None)
    if any(one.severity == FATAL for one in by_axes(axes, 0.0 if dip is None else float(np.sign(dip)))):
        return None, frame, axes
    base = np.eye(3) if axes is None else axes.turn
    if source == "headings":
        # they show a rotation about the vertical; nothing shows one about a level axis if there is no accelerometer
        down = down_by(up) if at.rotated else None
        at = at._replace(held=np.zeros((0, 3)) if down is None else np.eye(3) - np.outer(base @ down, base @ down))
    # the accelerometer's own dip is the start, and against it a given one would pull the fit apart
    seen = axes.dip if axes is not None and np.isfinite(axes.dip) else None
    agrees = seen is None or (dip is not None and np.sign(seen) == np.sign(dip))
    prior = Known(
        0.0 if field is None else float(np.log(field / frame.scale)),
        np.inf if field is None else _FIELD if field_error is None else float(field_error), field_error is not None,
        float(dip) if dip is not None and agrees else INCLINATION if seen is None else seen,
        _DIP if dip is not None and agrees else _ANY_DIP,
    )  # fmt: skip
    noise = first.noise / frame.scale if np.isfinite(first.noise) else 0.01
    return solved(u, at, (matrix @ base, centre), base, prior, currents, noise), frame, axes


def _axes(y: np.ndarray, at: Attitudes, dip: float, usable: bool) -> Axes | None:
    """The axes of the other sensor by what it tells of the attitudes of corrected unit fields."""
    if at.gyro is not None:
        segment, attitude, _ = (x[at.rows] for x in attitudes_in_segments(at.gyro, at.rate))
        there = segment >= 0
        return axes_by_rates(y[there], attitude[there], np.unique(segment[there], return_inverse=True)[1])
    there = np.zeros(0, dtype=bool) if at.heading is None else np.isfinite(at.heading) & np.isfinite(at.up).all(axis=1)
    if at.heading is not None and there.sum() >= FEWEST:
        return axes_by_headings(y[there], north_of(at.up[there], at.heading[there], dip))
    return axes_of(y, at.up) if at.up is not None and usable and at.rotated else None


def _round(u: np.ndarray, dip: float) -> tuple[np.ndarray, np.ndarray]:
    """Start from a sphere through scaled readings; a circle has the size of the field's horizontal part."""
    centre = sphere_centre(u)
    size = float(np.sqrt(np.mean(np.sum((u - centre) ** 2, axis=1))))
    flat = extents(u - u.mean(axis=0))
    size = size / np.cos(dip) if flat[-1] < 4 * NEAR_PLANAR * flat[0] else size
    return size * np.eye(3), centre


def alignment_of(found: Solution, source: str) -> Alignment:
    """The rotation in a solution: C = S Q with a symmetric S."""
    left, values, right = np.linalg.svd(found.matrix)
    rotation, whole = left @ right, (right.T * values) @ right
    by = [rotation.T @ step.reshape(3, 3) for step in np.eye(9)]
    turns = np.array([_turn(whole, one) for one in by]).T
    covariance = turns @ found.covariance[:9, :9] @ turns.T
    rates = source == "gyro"
    late = float(np.sqrt(found.covariance[17, 17])) if rates else float("nan")
    said = tuple(FINDINGS.over("delay_open", late))
    return Alignment(
        rotation, covariance, float(np.linalg.norm(vector_from(rotation))), float("nan") if rates else float(found.parameters[13]),
        found.spread, found.parameters[14:17] if rates else np.zeros(3), int(np.sum(found.along)), source,
        float(found.parameters[17]) if rates else float("nan"), late, said,
    )  # fmt: skip


def _turn(whole: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Rotation vector w that a change Q'dC = [w]x P + dP contains, for the symmetric P = (C'C)^(1/2): (tr P - P) w = its odd part."""
    odd = np.array([change[2, 1] - change[1, 2], change[0, 2] - change[2, 0], change[1, 0] - change[0, 1]])
    return np.linalg.solve(np.trace(whole) * np.eye(3) - whole, odd)
