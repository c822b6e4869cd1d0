"""Which axes: a magnetometer beside an accelerometer, whose axes may be exchanged, reversed or mirrored.

Of the 48 signed permutations P of the axes, two explain a log: +P with the dip d and -P with the dip -d. One of the two is a rotation,
the other mirrors, and only the sign of the dip tells which: a mirrored axis is half a turn with a dip of the other sign.
"""

from typing import NamedTuple

import numpy as np

from .._answer import CAUTION, FATAL, Finding, Quantity, Severity
from .._arrays import axis_fault, axis_turns, axis_words
from ._findings import AGREE, FINDINGS

_CLEARER = 2.0  # times less scatter than that of equal axes, to be believed; one mirrored axis had 3 at least in 25 real logs, 18 usually
FEWEST = 5  # poses: three angles and the dip need four
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
    first, second = axis_words(found.turn), axis_words(-found.turn)
    if mirror:
        return [_mirrored(found.turn, grave)]
    known = sign * found.dip if sign and dip > AGREE else float(found.sure)
    if found.same:
        return [FINDINGS("reversed", dip=Quantity(found.dip, "angle"))] if known < 0 else []
    if known > 0:
        return [FINDINGS("remounted", axes=first)]
    if known < 0:
        return [_mirrored(-found.turn, grave)]
    if not np.isfinite(found.dip):
        return [FINDINGS("axes_turned", severity=grave, first=first, second=second)]
    open_ = Quantity(found.dip, "angle"), Quantity(-found.dip, "angle")
    return [FINDINGS("axes_open", severity=grave, dip=open_[0], other=open_[1], first=first, second=second)]


def _mirrored(turn: np.ndarray, severity: Severity) -> Finding:
    """The finding about axes that mirror."""
    return FINDINGS("mirrored", severity=severity, what=axis_fault(turn), axes=axis_words(turn), typed=axis_words(turn.T))
