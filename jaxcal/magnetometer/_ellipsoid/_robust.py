"""Readings that are none of the field: spikes, zeros, blunders. They are found before the fit, which then is plain least squares.

A sensor that rests, or a value that a driver repeats, must not outvote the rest of a log. So every cell of space speaks with four readings
at most. An ellipsoid through the nearest part of these (least trimmed squares, P. J. Rousseeuw and K. Van Driessen, Technometrics 41,
1999, 212) says how far the readings scatter, and which of them are too far. The others are pulled in where they have a heavy tail.
"""

import contextlib
from collections.abc import Callable

import numpy as np
import scipy  # loads its parts when they are first used

from ...evidence._values import clipped, held
from .._result import OUTLIER
from ._algebraic import COUNT, NEAR_PLANAR, Frame, NotEllipsoid, algebraic, away, basis_of, extents, parameters_of, soft_of, start
from ._orthogonal import by_ellipsoid

LONG = 20_000  # largest number of readings that are all fitted
_CELL, _PER_CELL, _PER_LONG = 0.25, 4, 32  # side of a cell over the size of the log; readings of each that vote, and of a long log
#: quantile of the distances from the median reading that is the size, above which there may be spikes; how many sizes away they begin
_SIZE, _SPIKE = 0.8, 5.0
#: shares of the readings, nearest to the median, from which trimmed fits start; the last is the share that they keep in all rounds
_SHARES, _ROUNDS = (0.97, 0.7), 4
#: factor by which the trimmed fit must be closer than the plain one; robust standard deviations of a reading that is left out; their share,
#: above which nothing is left out
_CLOSER, _FAR, _MOST = 2.0, 6.0, 0.1
#: constant of Tukey's biweight, 95 % efficient with normal noise; standard deviations where its tail begins, and how surely it is too heavy
_TUKEY, _TAIL, _SURE = 4.685, 2.5, 4.0


def _spread(distance: np.ndarray) -> float:
    return max(1.4826 * float(np.median(distance)), 1e-9)


def _voters(u: np.ndarray, most: int = _PER_CELL) -> np.ndarray:
    """Rows of at most so many readings of each cell, evenly over time."""
    # cells that share a number are far apart, and only few
    number = np.floor(u / _CELL).astype(np.int64) @ np.array([1, 1 << 20, 1 << 40])
    cell, count = np.unique(number, return_inverse=True, return_counts=True)[1:]
    order = np.argsort(cell, kind="stable")
    size = count[cell[order]]
    place = np.arange(len(u)) - np.repeat(np.cumsum(count) - count, count)
    return np.sort(order[(size <= most) | (place * most // size != (place - 1) * most // size)])


def _frame(m: np.ndarray) -> tuple[np.ndarray, float]:
    """Median reading and size of a log, by readings of which every cell has four at most: a dwell does not shrink them."""
    voters = m
    for _ in range(4):
        middle = np.median(voters, axis=0)
        size = float(np.quantile(np.linalg.norm(voters - middle, axis=1), _SIZE))
        if not size > 0:
            break
        voters = m[_voters((m - middle) / size)]
    return middle, size


def thinned(m: np.ndarray) -> np.ndarray:
    """Rows of a long log of which every cell of space has 32 at most: neighbouring readings repeat one another."""
    middle, size = _frame(m)
    return _voters((m - middle) / size, _PER_LONG) if size > 0 else np.arange(len(m))


def _tried(fitted: Callable[[], tuple[np.ndarray, np.ndarray]], u: np.ndarray) -> list[tuple[float, tuple[np.ndarray, np.ndarray]]]:
    """Median distance of readings to an ellipsoid, and the ellipsoid; empty if there is none."""
    with contextlib.suppress(NotEllipsoid, np.linalg.LinAlgError):
        found = fitted()
        return [(float(np.median(away(found, u))), found)]
    return []


def _trimmed(u: np.ndarray) -> list[tuple[float, tuple[np.ndarray, np.ndarray]]]:
    """Ellipsoids through the nearest part of the readings (concentration steps of least trimmed squares)."""
    order, found = np.argsort(np.linalg.norm(u, axis=1)), []
    for share in _SHARES:
        now = _tried(lambda share=share: algebraic(u[order[: int(share * len(u))]]), u)
        for _ in range(_ROUNDS):
            now = [
                new
                for _, one in now
                for new in _tried(lambda one=one: algebraic(u[np.argsort(away(one, u))[: int(_SHARES[-1] * len(u))]]), u)
            ]
            found += now
    return found


def sound(m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Flags (n,) of the readings to fit, and these readings, whose least squares fit is robust.

    All readings are kept where an ellipsoid through most is not to be had, or more than a tenth stand apart.
    """
    (middle, size), everything, least = _frame(m), np.ones(len(m), dtype=bool), 2 * COUNT["symmetric"]
    kept = np.linalg.norm(m - middle, axis=1) <= _SPIKE * size
    if not size > 0 or np.mean(~kept) > _MOST or kept.sum() < least:
        return everything, m
    u = (m - middle) / size
    vote = u[kept][_voters(u[kept])]
    if len(vote) < least or extents(Frame.of(vote).scaled(vote))[-1] < NEAR_PLANAR:
        return kept, m[kept]
    plain = _tried(lambda: start(vote, "symmetric"), vote)
    # a fit without a reading that stands apart needs no other
    far = not plain or away(plain[0][1], vote).max() > OUTLIER * _spread(away(plain[0][1], vote))
    found = min(plain + [(_CLOSER * median, one) for median, one in (_trimmed(vote) if far else [])], key=lambda one: one[0], default=None)
    if found is None:
        return kept, m[kept]
    near = kept & (away(found[1], u) <= _FAR * _spread(away(found[1], vote)))
    if np.mean(~near) > _MOST:
        return everything, m
    calm = _calmed(u[near], *found[1])
    return near, m[near] if calm is None else middle + size * calm


def _calmed(u: np.ndarray, shape: np.ndarray, centre: np.ndarray) -> np.ndarray | None:
    """Readings whose distances d are psi(d) / mean(psi'), if the distances have too heavy a tail; psi is Tukey's.

    Least squares of these pseudo-values is the redescending fit, and their scatter gives its covariance (P. J. Huber and E. M. Ronchetti,
    Robust Statistics, 2009, section 7.8). None for normal noise, which needs none of this.
    """
    ratio, usual = away((shape, centre), u), scipy.special.erfc(_TAIL / np.sqrt(2)) * len(u)
    if np.sum(ratio > _TAIL * _spread(ratio)) < usual + _SURE * np.sqrt(usual):
        return None
    basis = basis_of("symmetric")
    x, moved = parameters_of("symmetric", soft_of(shape), centre), u
    for _ in range(_ROUNDS):
        near = by_ellipsoid(u, basis, x)
        square = np.minimum((near.distance / (_TUKEY * _spread(np.abs(near.distance)))) ** 2, 1.0)
        pulled = near.distance * (1 - square) ** 2 / np.mean((1 - square) * (1 - 5 * square))
        moved = u - near.normal * (near.distance - pulled)[:, None]
        x = x + np.linalg.lstsq(-near.slopes, pulled, rcond=None)[0]
    return moved


def chosen_rows(m: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Rows of the readings to fit, without spikes, repeats and saturated ones, thinned if many; the readings; number of saturated ones."""
    full = clipped(m)
    used = np.flatnonzero(~full & ~held(m))
    near, readings = sound(m[used])
    used = used[near]
    if len(used) > LONG:
        few = thinned(readings)
        used, readings = used[few], readings[few]
    return used, readings, int(full.sum())
