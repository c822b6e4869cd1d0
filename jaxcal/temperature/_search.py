"""Lag and play from the record: the values that leave the least, kept only where held-out data agree."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np
from scipy.optimize import minimize, minimize_scalar

from .._types import AnyArray
from ._bins import binned
from ._hysteresis import lagged, played
from ._linear import table_bins
from ._record import Record

_LAGS, _PLAYS = np.arange(0.0, 121.0, 5.0), np.arange(0.0, 1.21, 0.1)  # s, degC
_GAIN = 0.95  # part of the held-out error that a mechanism must get below; what chance gives a table of 100 nodes is 1 to 2 %
_GAIN_OF_BOTH = 0.7  # likewise of the second mechanism, which can also mend what a table does to a jump
_CLOSE = 0.7  # ratio of held-out errors above which lag and play are not told apart


class Hysteresis(eqx.Module):
    """Lag (s) and play (degC), 0 for none, and whether the other mechanism would do nearly as well."""

    lag: float
    play: float
    unsure: bool


def effective(record: Record, lag: float, play: float) -> AnyArray:
    """Temperature that the sensor feels."""
    t = record.t
    if lag > 0:
        assert record.time is not None
        steps = np.diff(record.time)
        t = np.asarray(lagged(t, np.concatenate([steps[:1], steps]), lag))
    return np.asarray(played(t, play)) if play > 0 else t


def search(record: Record, lag: Any, play: Any) -> Hysteresis:
    """Lag and play; a number is kept as it is, "auto" is searched where the record holds both heating and cooling."""
    seen = len(np.unique(record.ramp)) > 1
    try_lag = lag == "auto" and seen and record.time is not None
    try_play = play == "auto" and seen
    first = 0.0 if lag == "auto" else float(lag)
    second = 0.0 if play == "auto" else float(play)
    if not (try_lag or try_play):
        return Hysteresis(first, second, False)
    found: dict[tuple[float, float], float] = {(first, second): _held_out(record, first, second)}
    alone = {}
    if try_lag:
        tau = _least(lambda x: _left(record, x, second), _LAGS)
        alone["lag"] = (tau, second)
    if try_play:
        alone["play"] = (first, _least(lambda x: _left(record, first, x), _PLAYS))
    for pair in alone.values():
        found[pair] = _held_out(record, *pair)
    best = (first, second)
    for pair in sorted(alone.values(), key=found.__getitem__):
        if found[pair] < _GAIN * found[best]:
            best = pair
    unsure = best != (first, second) and len(alone) == 2 and _both(found, alone) > _CLOSE
    if try_lag and try_play and best != (first, second):
        pair = _least_of_both(record)
        if min(pair) > 0 and _held_out(record, *pair) < _GAIN_OF_BOTH * found[best]:
            best, unsure = pair, False
    return Hysteresis(best[0], best[1], unsure)


def _both(found: dict[tuple[float, float], float], alone: dict[str, tuple[float, float]]) -> float:
    errors = sorted(found[pair] for pair in alone.values())
    return errors[0] / max(errors[1], 1e-300)


def _left(record: Record, lag: float, play: float) -> float:
    """Mean square that a table of 0.25 degC leaves."""
    t = effective(record, lag, play)
    nodes = table_bins(t, record.b)
    return float(np.mean((record.b - np.interp(t, nodes.t, nodes.b)) ** 2))


def _least(left: Callable[[float], float], grid: AnyArray) -> float:
    """Value that leaves the least: on a grid, then by Brent's search between the neighbours of its best."""
    values = [left(float(x)) for x in grid]
    best = int(np.argmin(values))
    if best == 0:
        return 0.0
    around = float(grid[best - 1]), float(grid[min(best + 1, len(grid) - 1)])
    refined = minimize_scalar(left, bounds=around, method="bounded", options={"xatol": 0.02 * (grid[1] - grid[0])})
    return float(refined.x) if refined.fun < values[best] else float(grid[best])


def _least_of_both(record: Record) -> tuple[float, float]:
    """Lag and play together: the best of a coarse grid, then the simplex of Nelder and Mead."""
    pairs = [(float(tau), float(h)) for tau in _LAGS[::4] for h in _PLAYS[::2]]
    start = min(pairs, key=lambda pair: _left(record, *pair))
    size = np.array([_LAGS[-1], _PLAYS[-1]])
    simplex = np.clip(np.array(start) / size + np.array([[0, 0], [0.1, 0], [0, 0.1]]), 0, 1.2)
    found = minimize(
        lambda x: _left(record, *np.abs(x * size)), simplex[0], method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 2e-3, "fatol": 0.0, "maxfev": 80},
    )  # fmt: skip
    tau, h = np.abs(found.x * size)
    return float(tau), float(h)


def _held_out(record: Record, lag: float, play: float) -> float:
    """Mean squared error of a table on one ramp after the other, made from the other ramps.

    Blocks of temperature will not do here: heating and cooling cancel in their means, and where the block with a jump is missing a table
    guesses.
    """
    t = effective(record, lag, play)
    total = weight = 0.0
    for k in np.unique(record.ramp):
        test = record.ramp == k
        nodes = table_bins(t[~test], record.b[~test])
        seen = test & (t >= nodes.t[0]) & (t <= nodes.t[-1])
        if seen.any():
            held = binned(t[seen], record.b[seen], low=float(t.min()))
            total += float(np.sum(held.count * (held.b - np.interp(held.t, nodes.t, nodes.b)) ** 2))
            weight += float(np.sum(held.count))
    return total / weight if weight else np.inf
