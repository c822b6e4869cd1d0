"""Fit of the magnitudes together with the sensor of an aid, and with the fields of currents."""

import functools
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import CAUTION, NOTE, Quantity
from .._frozen import replaced
from ..fitting._serial import BLOCKS
from ._aids import NAMES, alignment_of, down_by, fitted, told
from ._axes import by_axes
from ._checked import Asked
from ._design._heading_error import both_tilts, by_iron, down_of, rms_heading
from ._ellipsoid._algebraic import iron_slopes, unit
from ._field import INCLINATION
from ._findings import FINDINGS
from ._model import MagModel
from ._own_model import changes_of
from ._result import MagFit, by_readings, dip_differs, estimated, judged_fit, outliers

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
    found, frame, axes = fitted(m, rows, at, source, first, (norm, field_error, dip, getattr(aid, "dip", None)), scaled)
    faults = by_axes(axes, asked.sign)
    about = [*faults, *([FINDINGS("unseen_axes")] if axes is None else [])]
    if found is None or not np.isfinite(found.covariance).all():
        about += [] if found is None else [FINDINGS("not_converged", what="the soft iron beside the other sensor")]
        return replaced(first, findings=(*(one for one in first.findings if one.code not in _OF_AXES), *about))

    whole = found.matrix * frame.scale
    field = float(np.cbrt(np.linalg.det(whole))) if norm is None else float(norm)
    terms = found.parameters[18:].reshape(-1, 3) * (frame.scale / size)[:, None]
    hard = frame.centre + frame.scale * found.centre
    model, at_nearest = MagModel(whole / field, hard - nearest @ terms), MagModel(whole / field, hard)
    spread = _spread(found, frame.scale, whole, field, norm is not None, size)
    dip_seen = dip if dip is not None else float(found.parameters[13]) if source in ("accel", "attitude", "headings") else first.inclination
    corrected = np.asarray(at_nearest.correct(m[there] - (columns - nearest)[there] @ terms))
    level = np.array([0.0, 0.0, 1.0]) if source == "headings" and aid.accel is None else down_by(at.up)
    down = down_of(unit(corrected), dip_seen) if level is None else level
    move, seen, change = np.eye(len(spread)), spread[:13, :13], by_iron(at_nearest, field)
    move[:3, 13:] = -np.kron(nearest, np.eye(3))
    spread, about_fit = move @ spread @ move.T, {"used": len(rows)}
    further = {f"currents.{name}[{i}]": terms[j, i] for j, name in enumerate(currents) for i in range(3)}
    if own is not None:
        names = first.estimate.names[13:]
        known, about_fit["usual"] = first.estimate.select(*names), first._about["usual"]
        model = eqx.tree_at(lambda m: (m.soft_iron, m.hard_iron), own, (model.soft_iron, model.hard_iron))
        change, seen = functools.partial(changes_of, model, field, first._about["usual"]), scipy.linalg.block_diag(seen, known.matrix)
        order = np.r_[0:13, len(spread) : len(spread) + len(names), 13 : len(spread)]
        spread = scipy.linalg.block_diag(spread, known.matrix)[np.ix_(order, order)]
        further = dict(zip(names, known.values, strict=True)) | further
    error = np.asarray(rms_heading(both_tilts(change, dip_seen, down), seen))

    turn = alignment_of(found, source) if source and source != "plane" else None
    said = [*about, *(one for one in first.findings if one.code in _KEPT)]
    if source == "plane":
        said.append(FINDINGS("plane", severity=NOTE if aid.asked else CAUTION))
    if turn is not None:
        said += turn.findings
        said += FINDINGS.over("aid_off", found.spread, angle=Quantity(found.spread, "angle"), source=NAMES[source])
        if dip is not None and source in ("accel", "attitude") and not faults:
            said += dip_differs(float(found.parameters[13]), dip)
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
    said += by_readings(noise / field, len(outliers(residual / field)), len(residual))
    said += [FINDINGS("correlated", size=100 * noise / field)] if found.parts else []
    freedom = BLOCKS - 1 if found.parts else max(len(found.across) - 13, 1)
    kind = {"": "symmetric", "plane": "planar"}.get(source, "full") if own is None else first.kind
    estimate = estimated(model, field, spread, freedom, further, norm is not None)
    return judged_fit(
        said, asked.limits, "the soft iron", corrected, model=model, estimate=estimate,
        heading_error=error, field=field, noise=noise, residual=residual, inclination=dip_seen, method="joint", kind=kind, down=down,
        alignment=turn, _about=about_fit,
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
