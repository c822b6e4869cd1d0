r"""One fit of readings with whatever is known of the attitudes, for any sensor beside the magnetometer, and of the fields of currents.

A reading is :math:`m = C h + b + K c`, where h is the unit field in the axes of the other sensor, whose magnitude is in C. What is known
of an attitude leaves h on a set: the sphere (nothing), a cone about the vertical (an accelerometer), a point (a known heading), or a point
that turns with the rates through a segment (a gyroscope). In turn, h becomes the point of its set nearest to the reading, and C, b, K,
the dip, the bias and the delay of the rates take a Gauss-Newton step with the residuals at right angles to the set. So one parameter more
or less, and one sensor or another, are columns and rows of one least-squares problem. Residuals across the surface :math:`|h| = 1` have the
noise of the readings; those along it also the errors of the attitudes, and the fit finds the standard deviations of both.

Priors keep open what the attitudes cannot show: C is near a multiple of a rotation that exchanges axes, to a spread that is learnt from the
entries that are seen. A vehicle at level shows two columns of C; the third, and the hard iron along it, then follow from the prior alone,
but level headings do not depend on them.
"""

from collections import namedtuple
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import skew
from ..fitting._serial import BLOCKS, by_parts
from ._aids import Attitudes
from ._field import level_axes
from ._quadric import EXACT, unit

_SOFT, _WEIGHT = 0.05, 4.0  # prior spread of the entries of C, and how many entries it counts as
#: spread of its antisymmetric part where nothing shows a rotation; for sensors on one board 0.2 degrees, and learnt where tilts show it
_SYMMETRIC, _TURNED = 1e-4, 0.003
_DELAY = 0.05  # s, prior standard deviation of the delay of the readings after the rates
ROUNDS, SETTLED = 100, 0.02  # most rounds, and step in standard errors that ends them
#: rad and s in one segment: the error of rates with a slightly wrong scale grows with the angle, and their bias enters to first order only
_SEGMENT, _LONGEST = 2.0, 10.0
_C, _B, _GAIN, _DIP, _LAG = slice(0, 9), slice(9, 12), 12, 13, slice(14, 18)
_OFF = 14  # of known headings: no rates, whose bias stands there, are beside them


class Known(namedtuple("Known", "field field_error stretch dip dip_error off")):
    """Prior knowledge: logarithm of the magnitude of the field and its standard deviation, and the dip and its own, rad.

    stretch : whether the standard deviation covers the mean stretch of C too, and not only the gain about which its entries scatter.
    off : standard deviation of what all known headings are off by, rad; infinite where they are off by nothing.
    """


class Solution(namedtuple("Solution", "matrix centre parameters covariance parts freedom along converged spread")):
    """C times the field, b, and all parameters with their covariance: C by rows, b, logarithm of the gain, dip, bias and delay of the
    rates, K by currents.

    parts : whether the covariance is that of fits without parts of the log. freedom : of the noise, or of these parts. along : (n,)
    whether a reading has a residual along the surface. spread : standard deviation of these over the field.
    """


def north_of(up: np.ndarray, heading: np.ndarray, dip: float) -> np.ndarray:
    """Unit fields (n, 3) in body axes, for known attitudes."""
    return np.cos(dip) * _north(level_axes(up), heading) - np.sin(dip) * up


def _north(axes: tuple[np.ndarray, np.ndarray], heading: np.ndarray) -> np.ndarray:
    """Unit vectors to the north, at level, from those forward and to the right."""
    return np.cos(heading)[:, None] * axes[0] - np.sin(heading)[:, None] * axes[1]


def delayed(gyro: np.ndarray, samples: float) -> np.ndarray:
    """Rates `samples` samples earlier, with linear interpolation; at the edge of a gap the rate of the sample itself."""
    if samples == 0:
        return gyro
    at = np.arange(len(gyro))
    earlier = np.stack([np.interp(at - samples, at, axis) for axis in gyro.T], axis=1)
    return np.where(np.isfinite(earlier), earlier, gyro)


def attitudes_in_segments(gyro: np.ndarray, rate: float, lag: Any = (0.0, 0.0, 0.0, 0.0)) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Attitude of each reading relative to the first of its segment, from rates (n, 3) at the times of the samples.

    lag : bias (3,) in rad/s, and delay in s: a reading shows the field so long before the sample of the rates beside it.

    A segment ends when the angle travelled, bias and delay left in, reaches 2 rad, after 10 s, or at a NaN sample without one. Returns the
    segment number (n,), -1 for none; the attitude (n, 3, 3), from the body axes of the sample to those of the segment's first sample; and
    the derivative (n, 3, 4) of the rotation vector, in the axes of the sample, with respect to a bias of the rates and the delay.
    """
    n, good = len(gyro), np.asarray(np.isfinite(gyro).all(axis=1))
    both = good[1:, None] & good[:-1, None]
    moved = np.where(both, (gyro[1:] + gyro[:-1]) / 2 / rate, 0.0)
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(moved, axis=1))])
    gyro = delayed(gyro - np.asarray(lag[:3]), lag[3] * rate)
    step = np.where(both, (gyro[1:] + gyro[:-1]) / 2 / rate, 0.0)
    broken = np.concatenate([[0], np.cumsum(~(good[1:] & good[:-1]))])
    label = broken * (int(travelled[-1] / _SEGMENT) + 1) + (travelled / _SEGMENT).astype(int)
    long = np.arange(1, n) % max(int(_LONGEST * rate), 2) == 0
    start = np.flatnonzero(np.concatenate([[True], (np.diff(label) != 0) | long]))
    segment = np.repeat(np.arange(len(start)), np.diff(np.append(start, n)))
    place = np.arange(n) - start[segment]
    small = scipy.spatial.transform.Rotation.from_rotvec(step).as_matrix() if n > 1 else np.zeros((0, 3, 3))
    attitude, slope = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3, 3))
    # take one step in all segments at a time
    order = np.argsort(place, kind="stable")
    for k in np.split(order, np.flatnonzero(np.diff(place[order])) + 1)[1:]:
        attitude[k] = attitude[k - 1] @ small[k - 1]
        back = np.swapaxes(small[k - 1], 1, 2)
        slope[k] = back @ slope[k - 1] + (np.eye(3) + back) / (2 * rate)
    return np.where(good, segment, -1), attitude, np.concatenate([slope, np.where(good[:, None], gyro, 0.0)[:, :, None]], axis=2)


class _Data:
    """Readings, currents and attitudes, with what does not change between rounds."""

    def __init__(self, u: np.ndarray, at: Attitudes, currents: np.ndarray):
        self.u, self.at, self.currents, n = u, at, currents, len(u)
        self.kind = "rates" if at.gyro is not None else "vertical" if at.up is not None else "none"
        self.paired = self.pointed = np.zeros(n, dtype=bool)
        if at.up is not None:
            self.paired = np.isfinite(at.up).all(axis=1)
            self.up = np.where(self.paired[:, None], at.up, [0.0, 0.0, -1.0])
            self.pointed = self.paired & np.isfinite(np.nan if at.heading is None else at.heading)
            self.axes = level_axes(self.up)

    def turned(self, lag: np.ndarray) -> None:
        """Attitudes by rates without this bias and delay."""
        segment, attitude, slope = attitudes_in_segments(self.at.gyro, self.at.rate, lag)
        segment, self.attitude, self.slope = (x[self.at.rows] for x in (segment, attitude, slope))
        count = np.bincount(segment[segment >= 0], minlength=1)
        # a segment of one reading has no other to compare it with
        self.paired = (segment >= 0) & (count[np.maximum(segment, 0)] > 1)
        self.member = np.zeros(len(self.u), dtype=int)
        self.member[self.paired] = np.unique(segment[self.paired], return_inverse=True)[1]

    def points(self, y: np.ndarray, dip: float, off: float) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """The point of its set nearest to each corrected reading, its change with the heading and the dip. off : of known headings."""
        h, n = unit(y), len(y)
        if self.kind == "none":
            return h, np.zeros((n, 3)), None
        if self.kind == "rates":
            ahead = np.einsum("nij,nj->ni", self.attitude, h)
            total = np.zeros((self.member.max() + 1, 3))
            np.add.at(total, self.member[self.paired], ahead[self.paired])
            point = np.einsum("nji,nj->ni", self.attitude, unit(total)[self.member])
            return np.where(self.paired[:, None], point, h), np.zeros((n, 3)), None
        north = unit(h - np.sum(h * self.up, axis=1, keepdims=True) * self.up)
        if self.pointed.any():
            north = np.where(self.pointed[:, None], _north(self.axes, np.nan_to_num(self.at.heading) + off), north)
        point, slope = np.cos(dip) * north - np.sin(dip) * self.up, -np.sin(dip) * north - np.cos(dip) * self.up
        around = np.cross(self.up, point)
        there = self.paired[:, None]
        return np.where(there, point, h), np.where(there, around, 0.0), np.where(there, slope, 0.0)


def _rows(data: _Data, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (k,), derivatives of the model (k, p), and whether a residual is along the surface, in order of time."""
    matrix, centre, terms = p[_C].reshape(3, 3), p[_B], p[18:].reshape(-1, 3)
    n, width = len(data.u), len(p)
    z = data.u - centre - data.currents @ terms
    inverse = np.linalg.inv(matrix)
    point, around, by_dip = data.points(z @ inverse.T, p[_DIP], p[_OFF])
    left = z - point @ matrix.T
    normal = unit(point @ inverse)
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)])
    free = np.where(data.pointed[:, None], 0.0, around) @ matrix.T
    loose = np.linalg.norm(free, axis=1) > 1e-9
    # along the surface but at right angles to a free heading; both directions if none is free
    first = unit(np.where(loose[:, None], np.cross(normal, free), first))
    second = np.cross(normal, first)
    slope = np.zeros((n, 3, width))
    slope[:, :, _C] = (np.eye(3)[None, :, :, None] * point[:, None, None, :]).reshape(n, 3, 9)
    slope[:, :, _B] = np.eye(3)
    if by_dip is not None:
        slope[:, :, _DIP] = by_dip @ matrix.T
        slope[:, :, _OFF] = np.where(data.pointed[:, None], around, 0.0) @ matrix.T
    if data.kind == "rates":
        turn = np.cross(np.swapaxes(data.slope, 1, 2), point[:, None, :])  # (n, 4, 3)
        slope[:, :, _LAG] = np.where(data.paired[:, None, None], np.swapaxes(turn @ matrix.T, 1, 2), 0.0)
    for j in range(data.currents.shape[1]):
        slope[:, :, 18 + 3 * j : 21 + 3 * j] = data.currents[:, j, None, None] * np.eye(3)
    ways = np.stack([normal, first, second], axis=1)
    residual, rows = np.einsum("nki,ni->nk", ways, left), ways @ slope
    kept = np.stack([np.ones(n, dtype=bool), data.paired, data.paired & ~loose], axis=1)
    if data.kind == "rates":
        _free_of_segments(data, ways[:, 1:] @ matrix, point, residual, rows)
    along = np.broadcast_to([False, True, True], (n, 3))
    return residual[kept], rows[kept], along[kept]


def _free_of_segments(data: _Data, ways: np.ndarray, point: np.ndarray, residual: np.ndarray, rows: np.ndarray) -> None:
    """Project the field of each segment out of the residuals along the surface, and out of their derivatives."""
    # the field of a segment changes by a vector g: its readings see A'g
    there, member = data.paired, data.member
    change = ways @ np.swapaxes(data.attitude, 1, 2)  # (n, 2, 3)
    both = np.concatenate([rows[:, 1:], residual[:, 1:, None]], axis=2)
    count = member.max() + 1
    normal, right = np.zeros((count, 3, 3)), np.zeros((count, 3, both.shape[2]))
    np.add.at(normal, member[there], np.einsum("nki,nkj->nij", change, change)[there])
    np.add.at(right, member[there], np.einsum("nki,nkp->nip", change, both)[there])
    moved = np.linalg.pinv(normal, rcond=1e-9, hermitian=True) @ right
    both = both - change @ moved[member]
    rows[:, 1:], residual[:, 1:] = both[:, :, :-1], both[:, :, -1]


def _prior(p: np.ndarray, free: np.ndarray, base: np.ndarray, spread: float, known: Known, odd: np.ndarray, turned: float, lag: float):
    """Residuals of the priors, and their derivatives; `odd` (k, 9): rotations that C contains, of the given spread."""
    gain, width = np.exp(p[_GAIN]), len(p)
    rows, left = np.zeros((9, width)), (gain * base.ravel() - p[_C]) / (spread * gain)
    rows[range(9), range(9)] = 1 / (spread * gain)
    rows[:, _GAIN] = -p[_C] / (spread * gain)
    found = [(left, rows)]
    scalars = ((_GAIN, known.field, known.field_error), (_DIP, known.dip, known.dip_error), (_OFF, 0.0, known.off), (17, lag, _DELAY))
    for place, value, error in scalars:
        if free[place] and np.isfinite(error):
            row, now, matrix = np.zeros((1, width)), p[place], p[_C].reshape(3, 3)
            row[0, place] = 1 / error
            if place == _GAIN and known.stretch:
                row[0, place], row[0, _C] = 0.0, np.linalg.inv(matrix).T.ravel() / (3 * error)
                now = np.log(np.abs(np.linalg.det(matrix))) / 3
            found.append((np.array([(value - now) / error]), row))
    row = np.zeros((len(odd), width))
    row[:, _C] = odd / (turned * gain)
    found.append((-odd @ p[_C] / (turned * gain), row))
    return (np.concatenate(parts) for parts in zip(*found, strict=True))


def solved(
    u: np.ndarray, at: Attitudes, begin: tuple[np.ndarray, np.ndarray], base: np.ndarray, held: np.ndarray, known: Known,
    currents: np.ndarray, noise: float,
) -> Solution | None:  # fmt: skip
    """The fit of readings (n, 3), of size about one, from a start (C, b); None if there is none.

    base : rotation that exchanges axes, near which C is. held : (k, 3) axes, of the magnetometer, about which it is small.
    currents : (n, k).
    """
    data = _Data(u, at, currents)
    p = np.concatenate([begin[0].ravel(), begin[1], np.zeros(6), np.zeros(3 * currents.shape[1])])
    p[_GAIN], p[_DIP] = np.log(np.abs(np.linalg.det(begin[0]))) / 3, known.dip
    free = np.ones(len(p), dtype=bool)
    free[_LAG], free[_DIP] = data.kind == "rates", data.kind == "vertical"
    free[_OFF] |= np.isfinite(known.off)
    lag, spread, sigma, converged, turn = np.zeros(4), _SOFT, np.full(2, max(noise, EXACT)), False, 0
    # `odd` takes C to the small rotation vector in C base'
    turned, odd = _TURNED if at.rotated else _SYMMETRIC, held @ (skew(np.eye(3)) @ base).reshape(3, 9) / 2
    while True:
        if data.kind == "rates" and (turn == 0 or np.any(p[_LAG])):
            lag, p[_LAG] = lag + p[_LAG], 0.0
            data.turned(lag)
        left, rows, along = _rows(data, p)
        size = sigma[along.astype(int)]
        more, extra = _prior(p, free, base, spread, known, odd, turned, -lag[3])
        whole = np.concatenate([rows / size[:, None], extra])[:, free]
        column = np.maximum(np.linalg.norm(whole, axis=0), 1e-300)
        inverse = np.linalg.pinv((whole / column).T @ (whole / column), rcond=1e-14, hermitian=True) / np.outer(column, column)
        step = inverse @ whole.T @ np.concatenate([left / size, more])
        error = np.sqrt(np.maximum(np.diag(inverse), 1e-300))
        # far from the solution the step is no larger than C itself
        short = min(1.0, 0.5 * np.exp(p[_GAIN]) / max(float(np.linalg.norm(step[:9])), 1e-300))
        p[free] += short * step
        used = np.einsum("kp,pq,kq->k", whole[: len(left)], inverse, whole[: len(left)])
        last = sigma
        nuisance = 3 * (int(data.member.max()) + 1) if data.kind == "rates" else 0
        if turn:
            # half way in the logarithm: where a few readings share their freedom, whole steps swing from side to side
            sigma = np.sqrt(last * [_size(left, used, ~along, 0), _size(left, used, along, nuisance)])
        gain = np.exp(p[_GAIN])
        spread = _learnt(p[_C] / gain - base.ravel(), error[:9] / gain, _SOFT)
        if at.rotated:
            turned = _learnt(odd @ p[_C] / gain, np.sqrt(np.diag(odd @ inverse[:9, :9] @ odd.T)) / gain, _TURNED)
        if not np.isfinite(p).all() or not np.isfinite(sigma).all():
            return None
        converged = bool(turn > 2 and np.abs(step / error).max() < SETTLED and np.abs(sigma / last - 1).max() < 0.01)
        turn += 1
        if converged or turn == ROUNDS:
            break
    # a matrix that mirrors is no sensor: the attitudes contradict the readings
    matrix = p[_C].reshape(3, 3)
    if not np.linalg.det(matrix) > 0:
        return None
    full, parts, prior = np.zeros((len(p), len(p))), False, whole[len(left) :].T @ whole[len(left) :]
    if sigma[0] > EXACT:
        inverse, parts = by_parts(inverse, whole[: len(left)], left / size, prior)
    full[np.ix_(free, free)] = inverse
    p[_LAG] += lag
    freedom = BLOCKS - 1 if parts else max(len(left) - nuisance - used.sum(), 1.0)
    spread = float(sigma[1] / np.exp(p[_GAIN])) if along.any() else np.nan
    return Solution(matrix, p[_B], p, full, parts, float(freedom), data.paired, converged, spread)


def _learnt(off: np.ndarray, error: np.ndarray, usual: float) -> float:
    """Spread of a prior by its entries; those that the data do not show have the error of the prior, and change nothing (EM)."""
    return float(np.sqrt((_WEIGHT * usual**2 + np.sum(off**2 + error**2)) / (_WEIGHT + len(off))))


def _size(left: np.ndarray, used: np.ndarray, which: np.ndarray, nuisance: int) -> float:
    """Standard deviation of some residuals, by their degrees of freedom."""
    if not which.any():
        return 1.0
    freedom = max(float(np.sum(which) - used[which].sum()) - nuisance, 1.0)
    return max(float(np.sqrt(np.sum(left[which] ** 2) / freedom)), EXACT)
