"""Readings that are none of the field: spikes, zeros, blunders. They are found before the fit, which then is plain least squares.

A sensor that rests, or a value that a driver repeats, must not outvote the rest of a log. So every cell of space speaks with four readings
at most. An ellipsoid through the nearest part of these (least trimmed squares, P. J. Rousseeuw and K. Van Driessen, Technometrics 41,
1999, 212) says how far the readings scatter, and which of them are too far.
"""

import contextlib
from collections.abc import Callable
from typing import Any

import numpy as np

from ._algebraic import NotEllipsoid, algebraic, away, extents, start
from ._kinds import COUNT
from ._shape import NEAR_PLANAR, Frame

_CELL, _PER_CELL, _PER_LONG = 0.25, 4, 32  # side of a cell over the size of the log; readings of each that vote, and of a long log
#: quantile of the distances from the median reading that is the size, above which there may be spikes; how many sizes away they begin
_SIZE, _SPIKE = 0.8, 5.0
_TRIMMED, _INNER = 0.7, 0.97  # share of the readings that the trimmed fit keeps, and of those nearest to the median
_SUBSETS, _SUBSET, _KEPT, _ROUNDS = 100, 12, 5, 4  # random subsets, readings of each, how many are refined, and how often
#: factor by which the trimmed fit must be closer than the plain one; robust standard deviations of a reading that is left out; their share,
#: above which nothing is left out
_CLOSER, _FAR, _MOST = 2.0, 6.0, 0.1
_FEWEST = 2 * COUNT["symmetric"]  # readings that an ellipsoid needs before others can be judged by it


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


Tried = list[tuple[float, tuple[np.ndarray, np.ndarray]]]


def _tried(fitted: Callable[[], tuple[np.ndarray, np.ndarray]], u: np.ndarray) -> Tried:
    """Median distance of readings to an ellipsoid, and the ellipsoid; empty if there is none."""
    with contextlib.suppress(NotEllipsoid, np.linalg.LinAlgError):
        found = fitted()
        return [(float(np.median(away(found, u))), found)]
    return []


def _trimmed(u: np.ndarray, tries: Tried) -> Any:
    """The ellipsoid of smallest median distance, from given ones and random subsets, each refitted to the nearest readings."""
    rng, nearest = np.random.default_rng(0), int(_TRIMMED * len(u))

    def attempt(readings: np.ndarray) -> Tried:
        return _tried(lambda: algebraic(readings), u)

    def best(tries: Tried) -> Tried:
        return sorted(tries, key=lambda one: one[0])[:_KEPT]

    tries = best(tries + [one for _ in range(_SUBSETS) for one in attempt(u[rng.choice(len(u), _SUBSET, replace=False)])])
    for _ in range(_ROUNDS):
        tries = best(tries + [new for _, found in tries for new in attempt(u[np.argsort(away(found, u))[:nearest]])])
    return tries[0] if tries else None


def sound(m: np.ndarray) -> np.ndarray:
    """Flags (n,) of the readings to fit; all of them where an ellipsoid through most is not to be had, or more than a tenth stand apart."""
    (middle, size), everything = _frame(m), np.ones(len(m), dtype=bool)
    kept = np.linalg.norm(m - middle, axis=1) <= _SPIKE * size
    if not size > 0 or np.mean(~kept) > _MOST or kept.sum() < _FEWEST:
        return everything
    u = (m - middle) / size
    vote = u[kept][_voters(u[kept])]
    if len(vote) < _FEWEST or extents(Frame.of(vote).scaled(vote))[-1] < NEAR_PLANAR:
        return kept
    # a single spike draws an ellipsoid to itself, so a second one does without the outermost readings
    inner = vote[np.argsort(np.linalg.norm(vote, axis=1))[: int(_INNER * len(vote))]]
    first = [one for fitted in (lambda: start(vote, "symmetric"), lambda: algebraic(inner)) for one in _tried(fitted, vote)]
    found = min(first[1:], key=lambda one: _CLOSER * one[0], default=None)
    if first and (found is None or first[0][0] < _CLOSER * found[0]):
        found = first[0]
    # a fit without a reading that stands apart needs no other
    if found is None or away(found[1], vote).max() > _FAR * _spread(away(found[1], vote)):
        other = _trimmed(vote, first)
        if other is not None and (found is None or _CLOSER * other[0] < found[0]):
            found = other
    if found is None:
        return kept
    limit = _FAR * _spread(away(found[1], vote))
    near = kept & (away(found[1], u) <= limit)
    return near if np.mean(~near) <= _MOST else everything
