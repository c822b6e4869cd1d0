"""The vertical, and which axes: a magnetometer beside an accelerometer, whose axes may be exchanged, reversed or mirrored.

Of the 48 signed permutations P of the axes, two explain a log: +P with the dip d and -P with the dip -d. One of the two is a rotation,
the other mirrors, and only the sign of the dip tells which: a mirrored axis is half a turn with a dip of the other sign.
"""

from typing import Any, NamedTuple

import numpy as np

from .._answer import CAUTION, FATAL, Finding, Quantity
from .._arrays import axis_fault, axis_turns, axis_words
from .._errors import DataError
from ._checked import Asked
from ._findings import AGREE, FINDINGS
from ._quadric import unit

_CLEARER = 2.0  # times less scatter than that of equal axes, to be believed; one mirrored axis had 3 at least in 25 real logs, 18 usually
FEWEST = 5  # poses: three angles and the dip need four
_STILL = 0.03  # relative departure of the specific force from its median above which a pose is not at rest
TURNED = 0.5  # length of the mean unit field: sin(dip) for turns about the vertical, zero for a sensor turned through all attitudes
_LOOSE = 0.2  # scatter of the sine of the dip above which no axes explain the log


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
    grave, dip, mirror = FATAL if turns else CAUTION, abs(found.dip), np.linalg.det(found.turn) < 0
    first, second, wrong = axis_words(found.turn), axis_words(-found.turn), found.turn if mirror else -found.turn
    fault, typed = axis_fault(wrong), axis_words(wrong.T)
    known = sign * found.dip if sign and dip > AGREE else float(found.sure)
    if mirror or (known < 0 and not found.same):
        return [FINDINGS("mirrored", severity=grave, what=fault, axes=first if mirror else second, typed=typed)]
    if found.same:
        return [FINDINGS("reversed", dip=Quantity(found.dip, "angle"))] if known < 0 else []
    if known > 0:
        return [FINDINGS("remounted", axes=first)]
    if not np.isfinite(found.dip):
        return [FINDINGS("axes_turned", severity=grave, first=first, second=second)]
    open_ = Quantity(found.dip, "angle"), Quantity(-found.dip, "angle")
    return [FINDINGS("axes_open", severity=grave, dip=open_[0], other=open_[1], first=first, second=second)]


def array(values: Any, name: str) -> np.ndarray:
    """Vectors (n, 3), checked."""
    values = np.asarray(values, dtype=float)
    if values.ndim != 2 or values.shape[1] != 3:
        raise DataError(f"The {name} have shape {values.shape}; expected (n, 3), one row per reading.", code="bad_shape")
    return values


def like(values: Any, count: int, name: str) -> np.ndarray:
    """Vectors (n, 3), one for each reading."""
    values = array(values, name)
    if len(values) != count:
        raise DataError(f"There are {count} readings and {len(values)} rows of {name}; give one for each reading.", code="rows_differ")
    return values


def still(accel: np.ndarray) -> np.ndarray:
    """Readings whose specific force is close to gravity; its size is taken from the median, so that any unit will do."""
    size = np.linalg.norm(accel, axis=1)
    there = np.isfinite(size) & (size > 0)
    usual = np.median(size[there]) if there.any() else np.inf
    return there & (np.abs(size / usual - 1) < _STILL)


def verticals(accel: Any, count: int) -> np.ndarray:
    """Unit vectors that point up, (n, 3), NaN where the sensor is not at rest."""
    force = like(accel, count, "specific force")
    return np.where(still(force)[:, None], unit(force), np.nan)


def down_by(up: Any) -> np.ndarray | None:
    """The axis that points down at level: the mean vertical of a sensor that tilts little; None for one turned through all attitudes."""
    if up is None or not np.isfinite(up).all(axis=1).any():
        return None
    mean = np.nanmean(up, axis=0)
    size = float(np.linalg.norm(mean))
    return -mean / size if size > TURNED else None


def down_of(directions: np.ndarray, dip: float) -> np.ndarray | None:
    """The axis about which a sensor turned, from unit fields (n, 3), or None if it was turned through all attitudes."""
    mean = directions.mean(axis=0)
    size = float(np.linalg.norm(mean))
    return np.copysign(1.0, dip) * mean / size if size > TURNED else None


def orientation(asked: Asked, corrected: np.ndarray, rows: np.ndarray) -> tuple[list[Finding], float, np.ndarray | None]:
    """Findings about the axes, the dip, and the axis that points down, by an accelerometer beside, or else by corrected readings (n, 3).

    The accelerometer has a say only if its axes agree with those of the readings; `rows` are those that were fitted.
    """
    field, axes, dip, down = unit(corrected), None, asked.dip if asked.known else None, None
    if hasattr(asked.aid, "turns"):
        up = verticals(asked.aid.accel, len(corrected))
        axes, there = axes_of(field, up), np.isfinite(up).all(axis=1)
        dips = -np.arcsin(np.clip(np.sum(field * up, axis=1)[there], -1, 1))
        if axes is not None and axes.same and np.std(dips) < AGREE:
            dip, down = axes.dip if dip is None else dip, down_by(up)
    known, dip = dip is not None, asked.dip if dip is None else dip
    down = down_of(field[rows], dip) if down is None else down
    said = by_axes(axes, asked.sign, turns=False) if axes else [FINDINGS("unseen_axes")]
    return said + ([] if known else [FINDINGS("dip_assumed", dip=Quantity(dip, "angle"))]), dip, down
