"""What sensors beside the magnetometer tell: its axes, the dip, which axis points down, and the fit of the magnitudes together with them.

Of the 48 signed permutations P of the axes, two explain a log: +P with the dip d and -P with the dip -d. One of the two is a rotation,
the other mirrors, and only the sign of the dip tells which: a mirrored axis is half a turn with a dip of the other sign.
"""

import math
from collections import namedtuple
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import CAUTION, FATAL, NOTE, Finding, Quantity
from .._arrays import axis_fault, axis_turns, axis_words, skew
from .._errors import DataError
from ._aided import Known, Solution, attitudes_in_segments, north_of, solved
from ._aids import NAMES, Alignment, Asked, Attitudes
from ._field import INCLINATION
from ._findings import AGREE, FINDINGS
from ._model import MagModel
from ._quadric import NEAR_PLANAR, Frame, rows_of, unit
from ._surface import Surface

#: rad between verticals of one pose, ten times the scatter of an accelerometer by hand; usual steps between its readings: 1 in 10,000 of
#: those with normal noise is farther off
_POSE, _STEPS = np.deg2rad(3.0), 3.0
_DIP, _ANY_DIP, _FIELD = np.deg2rad(0.5), 0.5, 0.02  # rad, prior spread of a given dip, and of one that is not; share of a given field
_CLEARER = 2.0  # times less scatter than that of equal axes, to be believed; one mirrored axis had 3 at least in 25 real logs, 18 usually
FEWEST = 5  # poses: three angles and the dip need four
TURNED = 0.5  # length of the mean unit field: sin(dip) for turns about the vertical, zero for a sensor turned through all attitudes
_LOOSE = 0.2  # scatter of the sine of the dip, or error of corrected readings over the field, above which no axes explain the log


class Axes(NamedTuple):
    """Signed permutation P (3, 3), from the axes of the accelerometer to those of the magnetometer, with the dip in rad.

    The dip is NaN beside rates. sure : whether the other reading, -P, is excluded.
    """

    turn: np.ndarray
    dip: float
    sure: bool = False

    @property
    def same(self) -> bool:
        """Whether both sensors have the same axes, or axes that are reversed together."""
        return bool(np.array_equal(self.turn, np.eye(3)))

    @property
    def mirrored(self) -> bool:
        """Whether the permutation mirrors; -P then does not."""
        return bool(np.linalg.det(self.turn) < 0)

    @property
    def words(self) -> dict[str, str]:
        """The axes and those of the other reading, what is wrong with the one that mirrors, and what to type for it."""
        wrong = self.turn if self.mirrored else -self.turn
        both = {"first": axis_words(self.turn), "second": axis_words(-self.turn)}
        return both | {"axes": axis_words(wrong), "what": axis_fault(wrong), "typed": axis_words(wrong.T)}


def clearest(scatter: np.ndarray, alone: bool = False) -> int:
    """Number of the axes with the least scatter; they must be clearly better than the first, the same ones, and if `alone` than all."""
    best = int(np.argmin(scatter))
    # than the others by a factor of 1.2: logs that turn about one axis have 1.0 to 1.1, halves of one with uneven stamps 1.4, others 4
    rival = np.delete(scatter, best).min() * _CLEARER**0.75 if alone else np.inf
    return best if _CLEARER * scatter[best] < min(scatter[0], rival) else 0


def axes_of(field: np.ndarray, up: np.ndarray) -> Axes | None:
    """The axes in which corrected unit fields (n, 3) and unit specific forces at rest keep their angle; None if in none."""
    there = np.isfinite(field).all(axis=1) & np.isfinite(up).all(axis=1)
    if there.sum() < FEWEST:
        return None
    known = axis_turns()
    products = np.einsum("ni,kij,nj->kn", field[there], known, up[there])
    scatter = np.std(products, axis=1)
    best = clearest(scatter)
    if not scatter[best] < _LOOSE:
        return None
    return Axes(known[best], -float(np.arcsin(np.clip(np.mean(products[best]), -1, 1))))


def axes_by_rates(field: np.ndarray, attitude: np.ndarray, member: np.ndarray) -> Axes:
    """The axes in which corrected unit fields stand still where the rates turn them back, in each segment; mirrored ones look turned."""
    known, scatter = axis_turns(), []
    count = np.maximum(np.bincount(member), 1)[:, None]
    for turn in known:
        back = np.einsum("nij,nj->ni", attitude, field @ turn)
        total = np.zeros((len(count), 3))
        np.add.at(total, member, back)
        scatter.append(float(np.sqrt(np.mean(np.sum((back - (total / count)[member]) ** 2, axis=1)))))
    return Axes(known[clearest(np.array(scatter))], np.nan)


def axes_by_headings(field: np.ndarray, point: np.ndarray) -> Axes:
    """The axes in which corrected unit fields are those of known attitudes, (n, 3) each: headings show mirrored axes."""
    known = np.concatenate([axis_turns(), -axis_turns()])
    scatter = np.array([np.sqrt(np.mean(np.sum((field - point @ turn.T) ** 2, axis=1))) for turn in known])
    return Axes(known[clearest(scatter)], np.nan, True)


def by_axes(found: Axes | None, sign: float, turns: bool = True) -> list[Finding]:
    """Findings about the axes; `sign` of the dip at the place, zero if unknown. Only a fit that turns its axes is refused for them."""
    if found is None:
        return []
    grave, dip, words = FATAL if turns else CAUTION, abs(found.dip), found.words
    known = sign * found.dip if sign and dip > AGREE else float(found.sure)
    if found.mirrored or (known < 0 and not found.same):
        return [FINDINGS("mirrored", severity=grave, what=words["what"], axes=words["axes"], typed=words["typed"])]
    if found.same:
        return [FINDINGS("reversed", dip=Quantity(found.dip, "angle"))] if known < 0 else []
    if known > 0:
        return [FINDINGS("remounted", axes=words["first"])]
    both: dict[str, Any] = {"first": words["first"], "second": words["second"]}
    if not np.isfinite(found.dip):
        return [FINDINGS("axes_turned", severity=grave, **both)]
    return [FINDINGS("axes_open", severity=grave, dip=Quantity(found.dip, "angle"), other=Quantity(-found.dip, "angle"), **both)]


def down_of(directions: Any, sign: float) -> np.ndarray | None:
    """The axis about which a sensor turned, from unit fields (n, 3) or, with the sign -1, verticals; None if it turned through all."""
    known = np.zeros((0, 3)) if directions is None else directions[np.isfinite(directions).all(axis=1)]
    if not len(known):
        return None
    mean = known.sum(axis=0) / len(known)
    size = float(np.linalg.norm(mean))
    return np.copysign(1.0, sign) * mean / size if size > TURNED else None


def _orientation(asked: Asked, surface: Surface) -> tuple[list[Finding], float, bool, np.ndarray | None]:
    """Findings about the axes, the dip, whether it is known, and the axis that points down, by an accelerometer or corrected readings.

    The accelerometer has a say only if its axes agree with those of the readings.
    """
    field, axes, dip, down = surface.along, None, asked.dip if asked.known else None, None
    if asked.at.source in ("accel", "attitude"):
        up = asked.at.up
        axes, there = axes_of(field, up), np.isfinite(up).all(axis=1)
        dips = -np.arcsin(np.clip(np.sum(field * up, axis=1)[there], -1, 1))
        if axes is not None and axes.same and np.std(dips) < AGREE:
            dip, down = axes.dip if dip is None else dip, down_of(up, -1.0)
    known, dip = dip is not None, asked.dip if dip is None else dip
    down = down_of(rows_of(field, surface.rows), dip) if down is None else down
    return by_axes(axes, asked.sign, turns=False) if axes else [FINDINGS("unseen_axes")], dip, known, down


def beside(asked: Asked, surface: Surface) -> Surface:
    """The surface with the attitudes; fitted together with what tells more than magnitudes: an aid that turns axes, currents, a field."""
    if asked.traced:
        return surface._replace(said=(FINDINGS("not_judged"),), dip=asked.dip)
    faults, said, dip, down = [], surface.said, asked.dip, None
    if surface.found is not None:
        faults, dip, known, down = _orientation(asked, surface)
        said = (*([] if known else [FINDINGS("dip_assumed", dip=Quantity(dip, "angle"))]), *said)
    at = asked.at if asked.turns else Attitudes(rotated=False)
    if surface.plane is not None and not asked.turns:
        at = Attitudes("plane", np.tile(-surface.plane, (len(asked.m), 1)), rotated=False)
    if not (at.source or asked.currents or asked.field_error is not None):
        return surface._replace(said=(*faults, *said), dip=dip, down=down)
    log = _prepared(asked, surface)
    axes, found = _together(asked, surface._replace(dip=dip, down=down), at, log)
    faults = by_axes(axes, asked.sign) if axes else [FINDINGS("unseen_axes")]
    if found is None:
        if not any(one.severity == FATAL for one in faults):
            faults.append(FINDINGS("not_converged", what="the soft iron beside the other sensor"))
        return surface._replace(said=(*said, *faults), dip=dip, down=down)
    return _joint(asked, surface._replace(dip=dip), at, log, found, faults)


class _Readings(namedtuple("_Readings", "m rows currents nearest size norm frame")):
    """Readings (n, 3) of a log, and the rows to fit; currents (n, k), those nearest to zero, and their sizes; the field, and the frame."""


def _prepared(asked: Asked, surface: Surface) -> _Readings:
    """The readings, without what a model object adds to its iron, as far as the magnitudes show it."""
    m, norm, rows = asked.m, asked.norm, asked.there[surface.rows]
    if surface.usual is not None:
        m, norm = m.copy(), float(surface.field)
        m[asked.there] = surface.corrected @ surface.model.soft_iron.T + surface.model.hard_iron
    currents = np.array([*asked.currents.values()]).reshape(len(asked.currents), len(m)).T
    # the hard iron of the fit is that at the recorded current nearest to zero, where the heading error holds
    nearest = np.clip(0.0, currents.min(axis=0), currents.max(axis=0))
    return _Readings(m, rows, currents, nearest, np.abs(currents - nearest).max(axis=0), norm, Frame.of(m[rows]))


def _together(asked: Asked, surface: Surface, at: Attitudes, log: _Readings) -> tuple[Axes | None, Solution | None]:
    """The axes, and the fit of readings with attitudes and currents; no fit with wrong axes."""
    x, currents, rows = log.m[log.rows], (log.currents - log.nearest)[log.rows] / log.size, log.rows
    up, heading = (None if part is None else part[rows] for part in (at.up, at.heading))
    if up is not None and at.source != "plane":
        number = _poses(x, up, heading, _POSE, _STEPS)
        x, up, currents = _averaged(x, number), unit(_averaged(up, number)), _averaged(currents, number)
        heading = None if heading is None else _averaged(heading, number)
    count = len(x) if up is None else int(np.isfinite(up).all(axis=1).sum())
    if count < FEWEST:
        raise DataError(f"{count} readings with the {NAMES[at.source]} are left; at least {FEWEST} are needed.", code="few_readings")
    u, at = log.frame.in_frame(x), at._replace(up=up, heading=heading, rows=rows)
    dip = asked.dip if asked.known else None
    aim, usable, scale = INCLINATION if dip is None else dip, _usable(surface, log.norm is not None), log.frame.scale
    model = surface.model
    begin = (model.soft_iron * surface.field / scale, (model.hard_iron - log.frame.centre) / scale) if usable else _round(u, aim)
    axes = _axes(unit((u - begin[1]) @ np.linalg.inv(begin[0]).T), at, aim, usable)
    if any(one.severity == FATAL for one in by_axes(axes, 0.0 if dip is None else float(np.sign(dip)))):
        return axes, None
    base, held = np.eye(3) if axes is None else axes.turn, np.eye(3)
    if at.source == "headings":
        # they show a rotation about the vertical; nothing shows one about a level axis if there is no accelerometer
        down = down_of(up, -1.0) if at.rotated else None
        held = np.zeros((0, 3)) if down is None else np.eye(3) - np.outer(base @ down, base @ down)
    # the accelerometer's own dip is the start, and against it a given one would pull the fit apart
    seen = axes.dip if axes is not None and np.isfinite(axes.dip) else None
    agrees = dip is not None and (seen is None or np.sign(seen) == np.sign(dip))
    field, error = (0.0, np.inf) if log.norm is None else (float(np.log(log.norm / scale)), asked.field_error or _FIELD)
    way = (float(aim), _DIP) if agrees else (float(aim) if seen is None else seen, _ANY_DIP)
    known = Known(field, error, asked.field_error is not None, *way, at.off)
    noise = surface.noise / scale if np.isfinite(surface.noise) else 0.01
    return axes, solved(u, at, (begin[0] @ base, begin[1]), base, held, known, currents, noise)


def _usable(surface: Surface, given: bool) -> bool:
    """Whether the readings that the surface corrects are so well known that they show axes, and a fit begins with them."""
    if surface.found is None or not surface.found.converged or not np.isfinite(surface.matrix).all():
        return False
    # a change db + dM u of the reading of a unit field u, with M = C H, changes the corrected one by its product with M^-1; H turns nothing
    inverse, u = np.linalg.inv(surface.model.soft_iron * surface.field), surface.along[surface.rows]
    by_whole = (inverse[None, :, :, None] * u[:, None, None, :]).reshape(-1, 9) - (not given) * u.reshape(-1, 1) * inverse.T.ravel() / 3
    rows = np.concatenate([by_whole, np.tile(inverse, (len(u), 1))], axis=1)
    return bool(3 * np.mean(np.sum((rows @ surface.matrix[:12, :12]) * rows, axis=1)) <= _LOOSE**2)


def _poses(m: np.ndarray, up: np.ndarray, heading: np.ndarray | None, most: float, steps: float) -> np.ndarray:
    """Number (n,) of the pose of each reading: successive readings with verticals within an angle, at one heading.

    Where it is not known, readings of a pose are no farther apart than so many usual steps from one reading to the next, or angles.
    """
    number, pose, cosine, first = np.zeros(len(m), dtype=int), 0, float(np.cos(most)), 0
    angle = np.full(len(m), np.inf) if heading is None else np.nan_to_num(heading, nan=np.inf)
    size = np.sqrt(np.mean(np.sum((m - np.median(m, axis=0)) ** 2, axis=1)))
    reach = steps * min(float(np.median(np.linalg.norm(np.diff(m, axis=0), axis=1))), most * float(size))
    rows = np.concatenate([np.nan_to_num(up), angle[:, None], m], axis=1).tolist()
    for i in range(1, len(m)):
        (a, b, c, now, *one), (d, e, f, then, *other) = rows[first], rows[i]
        if now != then or a * d + b * e + c * f <= cosine or (now == np.inf and math.dist(one, other) > reach):
            pose, first = pose + 1, i
        number[i] = pose
    return number


def _averaged(x: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Mean of the rows of each pose that are no NaN."""
    there = np.isfinite(x).reshape(len(x), -1).all(axis=1)
    total, count = np.zeros((number.max() + 1, *x.shape[1:])), np.bincount(number[there], minlength=number.max() + 1)
    np.add.at(total, number[there], x[there])
    with np.errstate(invalid="ignore", divide="ignore"):
        return total / count.reshape(-1, *[1] * (x.ndim - 1))


def _axes(y: np.ndarray, at: Attitudes, dip: float, usable: bool) -> Axes | None:
    """The axes of the other sensor by what it tells of the attitudes of corrected unit fields, if these are usable."""
    if at.gyro is not None:
        segment, attitude, _ = (x[at.rows] for x in attitudes_in_segments(at.gyro, at.rate))
        there = segment >= 0
        return axes_by_rates(y[there], attitude[there], np.unique(segment[there], return_inverse=True)[1])
    there = np.zeros(0, dtype=bool) if at.heading is None else np.isfinite(at.heading) & np.isfinite(at.up).all(axis=1)
    if at.heading is not None and there.sum() >= FEWEST:
        return axes_by_headings(y[there], north_of(at.up[there], at.heading[there], dip))
    return axes_of(y, at.up) if at.up is not None and usable and at.rotated else None


def sphere_centre(m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre of the sphere through readings, if they do not determine one, the solution nearest to their mean; their extents, in ratio."""
    middle = m.mean(axis=0)
    square = np.sum((m - middle) ** 2, axis=1)
    found, _, _, extent = np.linalg.lstsq(2.0 * (m - middle), square - square.mean(), rcond=3e-2)
    return middle + found, extent


def _round(u: np.ndarray, dip: float) -> tuple[np.ndarray, np.ndarray]:
    """Start from a sphere through scaled readings; a circle has the size of the field's horizontal part."""
    centre, extent = sphere_centre(u)
    size = float(np.sqrt(np.mean(np.sum((u - centre) ** 2, axis=1))))
    size = size / np.cos(dip) if extent[-1] < 4 * NEAR_PLANAR * extent[0] else size
    return size * np.eye(3), centre


def _joint(asked: Asked, surface: Surface, at: Attitudes, log: _Readings, found: Solution, faults: list[Finding]) -> Surface:
    """The surface of a solution, with its findings."""
    frame, source, there, dip, own = log.frame, at.source, asked.there, asked.dip if asked.known else None, surface.usual is not None
    whole, norm = found.matrix * frame.scale, log.norm
    field = float(np.cbrt(np.linalg.det(whole))) if norm is None else float(norm)
    terms = found.parameters[18:].reshape(-1, 3) * (frame.scale / log.size)[:, None]
    hard = frame.centre + frame.scale * found.centre
    model = MagModel(whole / field, hard - log.nearest @ terms)
    corrected = (log.m[there] - log.currents[there] @ terms - model.hard_iron) @ np.linalg.inv(model.soft_iron).T
    other = float(found.parameters[13])
    seen = dip if dip is not None else other if source in ("accel", "attitude", "headings") else surface.dip
    flat = source == "headings" and not at.rotated
    down = np.array([0.0, 0.0, 1.0]) if flat else down_of(at.up, -1.0)
    down = down_of(unit(corrected), seen) if down is None else down
    # distances to first order: the magnitude of the field over the length of its slope
    slope = np.linalg.norm(unit(corrected) @ np.linalg.inv(model.soft_iron), axis=1)
    residual = (np.linalg.norm(corrected, axis=1) - field) / slope
    said = [*faults, *surface.said]
    if source == "plane":
        said.append(FINDINGS("plane", severity=NOTE if asked.model == "planar" else CAUTION))
    turn = _alignment(found, source) if source not in ("", "plane") else None
    if turn is not None:
        said += FINDINGS.over("delay_open", turn.delay_error)
        said += FINDINGS.over("aid_off", found.spread, angle=Quantity(found.spread, "angle"), source=NAMES[source])
        if dip is not None and source in ("accel", "attitude") and {one.code for one in faults} <= {"unseen_axes"}:
            said += FINDINGS.over("dip_differs", abs(other - dip), found=Quantity(other, "angle"), given=Quantity(dip, "angle"))
    if norm is not None and asked.field_error is not None and surface.model is not None:
        mean = float(np.cbrt(np.linalg.det(surface.model.soft_iron)) * surface.field)
        doubt = np.hypot(asked.field_error, np.sqrt(surface.matrix[0, 0]) / norm)
        said += FINDINGS.over("contradicts", abs(np.log(mean / norm)) / doubt, found=mean, given=norm)
    if not found.converged:
        said.append(FINDINGS("not_converged", what="the soft iron"))
    if dip is None and source not in ("accel", "attitude", "headings"):
        said.append(FINDINGS("dip_assumed", dip=Quantity(INCLINATION, "angle")))
    kind = {"": "symmetric", "plane": "planar"}.get(source, "full")
    kept, size = np.r_[0:12, 18 : len(found.parameters)], np.append(np.ones(12), 1 / np.repeat(log.size, 3))  # C, b, K
    matrix = found.covariance[np.ix_(kept, kept)] * frame.scale**2 * np.outer(size, size)
    # where the currents are none, the hard iron has the error of their fields
    move = np.eye(len(matrix))
    move[9:12, 12:] = -np.kron(log.nearest, np.eye(3))
    spread, matrix = move @ matrix @ move.T, matrix[:12, :12]
    if own:
        model = eqx.tree_at(lambda m: (m.soft_iron, m.hard_iron), surface.model, (model.soft_iron, model.hard_iron))
        known, count = surface.matrix[12:, 12:], len(spread)
        order = np.r_[0:12, count : count + len(known), 12:count]
        spread = scipy.linalg.block_diag(spread, known)[np.ix_(order, order)]
        matrix = scipy.linalg.block_diag(matrix, known)
    return surface._replace(
        joint=surface.found.kind if own else kind, said=tuple(said), model=model, field=field, corrected=corrected, residual=residual,
        noise=float(np.sqrt(np.sum(residual[surface.rows] ** 2) / max(len(log.rows) - 13, 1))), matrix=matrix, spread=spread,
        freedom=found.freedom, parts=found.parts, dip=seen,
        down=down, alignment=turn,
        further=(surface.further or {}) | {f"currents.{name}[{i}]": terms[j, i] for j, name in enumerate(asked.currents) for i in range(3)},
    )  # fmt: skip


def _alignment(found: Solution, source: str) -> Alignment:
    """The rotation in a solution: C = S Q with a symmetric S."""
    left, values, right = np.linalg.svd(found.matrix)
    rotation, whole = left @ right, (right.T * values) @ right
    # rotation vector w that a change Q'dC = [w]x P + dP contains, for the symmetric P = (C'C)^(1/2): (tr P - P) w = its odd part
    turns = np.linalg.solve(np.trace(whole) * np.eye(3) - whole, (rotation @ skew(np.eye(3))).reshape(3, 9))
    covariance = turns @ found.covariance[:9, :9] @ turns.T
    rates = source == "gyro"
    late = float(np.sqrt(found.covariance[17, 17])) if rates else float("nan")
    return Alignment(
        rotation, covariance, float("nan") if rates else float(found.parameters[13]), found.spread,
        found.parameters[14:17] if rates else np.zeros(3), int(np.sum(found.along)), source,
        float(found.parameters[17]) if rates else float("nan"), late,
    )  # fmt: skip
