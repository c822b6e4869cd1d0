"""Cross-validation that neighbouring samples, which share their drift, cannot deceive."""

from collections.abc import Callable

import equinox as eqx
import numpy as np

from .._types import AnyArray
from ._bins import BLOCK, binned, number
from ._curves import AbstractCurve

#: what a candidate does: (t, b, low, high) -> curve
Fitter = Callable[[AnyArray, AnyArray, float, float], AbstractCurve]
_FOLDS = 10


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
