"""Choices by held-out data: the error of a candidate, and lag and play from the record.

Neighbouring samples share their drift, so that ramps or blocks of temperature are held out, not samples.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._types import AnyArray
from ._curves import AbstractCurve
from ._hysteresis import felt, steps_of
from ._record import BLOCK, COARSE, Record, binned, number

_LAGS, _PLAYS = np.arange(0.0, 121.0, 5.0), np.arange(0.0, 1.21, 0.1)  # s, degC
_GAIN = 0.95  # part of the held-out error that a mechanism must get below; what chance gives a table of 100 nodes is 1 to 2 %
_GAIN_OF_BOTH = 0.7  # likewise of the second mechanism, which can also mend what a table does to a jump
_FOLDS = 10  # of blocks of temperature
_CLOSE = 0.7  # ratio of held-out errors above which lag and play are not told apart

#: what a candidate does: (t, b, low, high) -> curve
Fitter = Callable[[AnyArray, AnyArray, float, float], AbstractCurve]


class Hysteresis(eqx.Module):
    """Lag (s) and play (degC), 0 for none, and whether the other mechanism would do nearly as well."""

    lag: float
    play: float
    unsure: bool


def effective(record: Record, lag: float, play: float) -> AnyArray:
    """Temperature that the sensor feels."""
    return np.asarray(felt(record.t, lag, play, None if record.time is None else steps_of(record.time))[1])


def search(record: Record, lag: Any, play: Any) -> Hysteresis:
    """Lag and play; a number is kept as it is, "auto" is searched where the record holds both heating and cooling."""
    seen = len(np.unique(record.ramp)) > 1
    try_lag = lag == "auto" and seen and record.time is not None
    try_play = play == "auto" and seen
    first = 0.0 if lag == "auto" else float(lag)
    second = 0.0 if play == "auto" else float(play)
    if not (try_lag or try_play):
        return Hysteresis(first, second, False)
    alone = [(_least(lambda x: _left(record, x, second), _LAGS), second)] if try_lag else []
    alone += [(first, _least(lambda x: _left(record, first, x), _PLAYS))] if try_play else []
    found = {pair: _held_out(record, *pair) for pair in [(first, second), *alone]}
    best = (first, second)
    for pair in sorted(alone, key=found.__getitem__):
        if found[pair] < _GAIN * found[best]:
            best = pair
    errors = sorted(found[pair] for pair in alone)
    unsure = best != (first, second) and len(alone) == 2 and errors[0] / max(errors[1], 1e-300) > _CLOSE
    if try_lag and try_play and best != (first, second):
        pair = _least_of_both(record)
        if min(pair) > 0 and _held_out(record, *pair) < _GAIN_OF_BOTH * found[best]:
            best, unsure = pair, False
    return Hysteresis(best[0], best[1], unsure)


def _left(record: Record, lag: float, play: float) -> float:
    """Mean square that a table of 0.25 degC leaves."""
    t = effective(record, lag, play)
    nodes = binned(t, record.b, COARSE)
    return float(np.mean((record.b - np.interp(t, nodes.t, nodes.b)) ** 2))


def _least(left: Callable[[float], float], grid: AnyArray) -> float:
    """Value that leaves the least: on a grid, then by Brent's search between the neighbours of its best."""
    values = [left(float(x)) for x in grid]
    best = int(np.argmin(values))
    if best == 0:
        return 0.0
    around = float(grid[best - 1]), float(grid[min(best + 1, len(grid) - 1)])
    refined = scipy.optimize.minimize_scalar(left, bounds=around, method="bounded", options={"xatol": 0.02 * (grid[1] - grid[0])})
    return float(refined.x) if refined.fun < values[best] else float(grid[best])


def _least_of_both(record: Record) -> tuple[float, float]:
    """Lag and play together: the best of a coarse grid, then the simplex of Nelder and Mead."""
    pairs = [(float(tau), float(h)) for tau in _LAGS[::4] for h in _PLAYS[::2]]
    start = min(pairs, key=lambda pair: _left(record, *pair))
    size = np.array([_LAGS[-1], _PLAYS[-1]])
    simplex = np.clip(np.array(start) / size + np.array([[0, 0], [0.1, 0], [0, 0.1]]), 0, 1.2)
    found = scipy.optimize.minimize(
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
        nodes = binned(t[~test], record.b[~test], COARSE)
        seen = test & (t >= nodes.t[0]) & (t <= nodes.t[-1])
        if seen.any():
            held = binned(t[seen], record.b[seen], low=float(t.min()))
            total += float(np.sum(held.count * (held.b - np.interp(held.t, nodes.t, nodes.b)) ** 2))
            weight += float(np.sum(held.count))
    return total / weight if weight else np.inf


class Score(eqx.Module):
    """Mean squared error on held-out data, its standard error, and how it was held out: "blocks" or "ramps"."""

    mean: float
    error: float
    held_out: str = eqx.field(static=True)


def score(fitter: Fitter, t: AnyArray, b: AnyArray, ramp: AnyArray, whole: tuple[int, ...]) -> Score:
    """Error of a candidate on data that it was not fitted to.

    With two whole ramps or more one ramp at a time is held out, and a constant taken off (another day's turn-on bias). Otherwise
    blocks of 0.5 degC are, a tenth of them at a time; the two at the ends always stay.
    """
    low, high = float(t.min()), float(t.max())
    by_ramp = len(whole) >= 2
    if by_ramp:
        tests = [ramp == k for k in whole]
    else:
        block = number(t, BLOCK, low)
        inner = (block > 0) & (block < block.max())
        tests = [inner & (block % _FOLDS == k) for k in range(_FOLDS)]
    errors = []
    for test in tests:
        if not test.any() or test.all():
            continue
        train = t[~test]
        seen = test & (t >= train.min()) & (t <= train.max())
        if not seen.any():
            continue
        curve = fitter(train, b[~test], low, high)
        held = binned(t[seen], b[seen], low=low)
        error = held.b - np.asarray(curve.value(held.t))
        if by_ramp:
            error = error - np.average(error, weights=held.count)
        errors.append(float(np.average(error**2, weights=held.count)))
    spread = np.std(errors, ddof=1) / np.sqrt(len(errors)) if len(errors) > 1 else np.inf
    return Score(float(np.mean(errors)), float(spread), "ramps" if by_ramp else "blocks")
