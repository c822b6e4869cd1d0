"""Heading errors due to causes that the residuals follow, sentences that name these causes, and readings at the end of a range."""

from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from ._design._heading_error import heading_error
from ._ellipsoid._causes import ALONE, BENT, DRIFT, FAST, PLACE, SERIAL, Examined
from ._ellipsoid._kinds import PLANAR, PLANAR_ROWS, basis_of, slopes_of
from ._ellipsoid._shape import Found
from ._result import between

_WORTH_SAYING = 0.1  # share of the limit above which a cause is worth a sentence
_SENTENCES = {
    DRIFT: "The hard iron drifts along the log, by up to {size:.2g} % of the field about its mean{cost}. "
    "Let the sensor warm up, keep iron and currents as they are, and record again.",
    FAST: "The readings fall short where the sensor turns fast, by up to {size:.2g} % of the field{cost}: "
    "the sensor or the log averages over time. Turn more slowly, or record without the filter.",
    BENT: "The response of an axis is bent: the residuals follow squares and cubes of the readings, by up to {size:.2g} % of the field"
    "{cost}. Use a larger range of the sensor, or fit a model with terms for it.",
    PLACE: "The norm of the field varies along the log, by {size:.2g} % rms{cost}: iron or currents are near. "
    "Record outdoors, and turn the sensor about one place.",
    ALONE: "The hard iron changes along one direction, by up to {size:.2g} % of the field{cost}: a current, or a part that moves. "
    "Keep it constant, or record it and fit it as a term of its own (`fit_current`, or --currents).",
    SERIAL: "The noise is correlated from reading to reading, {size:.2g} % of the field rms{cost}. "
    "The errors are those between fits without parts of the log. A longer log, or one farther from iron and currents, makes them smaller.",
}
_CONDITION = (
    "The readings follow {name!r}, by up to {size:.2g} % of the field about the middle of its range{cost}. Record with it constant."
)


CLIPPED = "clipping"
_FEWEST_AT_END = 4
_NEAR = 20  # number of readings next to the end; their density tells how many may share one value by chance
_BY_CHANCE = 1e-5
_APART = 0.05  # as a share of the log's size: a sensor at rest repeats a value too


def at_end(m: np.ndarray) -> np.ndarray:
    """Find readings (n,) of a saturated sensor: the largest or smallest value of an axis occurs more often than chance allows.

    Chance follows a Poisson distribution. Its mean is the density of the readings next to the end, times the step between values.
    """
    out, distinct = np.zeros(len(m), dtype=bool), None
    for axis in range(3):
        for sign in (1.0, -1.0):
            column = sign * m[:, axis]
            if np.sum(column == column.max()) < _FEWEST_AT_END:
                continue
            if distinct is None:
                distinct, size = np.unique(m, axis=0), float(np.std(m, axis=0).max())
            values = np.sort(sign * distinct[:, axis])[::-1]
            count = int(np.sum(values == values[0]))
            if count < _FEWEST_AT_END or count + _NEAR > len(values):
                continue
            below = values[count - 1 : count + _NEAR]
            steps = -np.diff(below)
            chance = _NEAR * steps[steps > 0].min() / (below[0] - below[-1])
            pile = distinct[sign * distinct[:, axis] == values[0]]
            if scipy.special.pdtrc(count - 1, 2 * chance + 0.05) < _BY_CHANCE and np.std(pile, axis=0).max() > _APART * size:
                out |= column == values[0]
    return out


def checked_conditions(conditions: dict[str, Any], count: int) -> dict[str, np.ndarray]:
    """Recorded conditions as arrays of one number per reading."""
    found = {}
    for name, given in conditions.items():
        values = np.asarray(given, dtype=float)
        if values.shape != (count,):
            raise DataError(f"The condition {name!r} has shape {values.shape}; give one number for each of {count} readings.")
        if not np.isfinite(values).all():
            raise DataError(f"The condition {name!r} has values that are not finite; leave those readings out.")
        if name in _SENTENCES:
            raise DataError(f"A condition cannot be named {name!r}: that is the name of a cause; give another name.")
        found[name] = values
    return found


def cost_of(found: Found, steps: np.ndarray, dip: float) -> float:
    """The rms heading error in rad at level that biases (k, 9) of a fit cause."""
    if not steps.any():
        return 0.0
    rows = np.array(PLANAR_ROWS) if found.kind in PLANAR else np.arange(9)
    return float(heading_error(found.shape, steps[:, rows].T @ steps[:, rows], dip)[0])


def costs_of(said: Examined, found: Found, whole: np.ndarray, dip: float) -> dict[str, float]:
    """Heading error of each cause; for correlated noise, the whole heading error."""
    return {cause.name: cost_of(found, cause.steps, dip) if len(cause.steps) else float(whole[0]) for cause in said.causes}


def assumptions(dip: float, no_dip: bool, no_axis: bool, span: np.ndarray, seen: bool) -> str:
    """A sentence with the assumptions behind the heading error, and its range without them; `seen`: the accelerometer shows the dip."""
    if seen:
        told = f" The accelerometer shows a dip of {np.rad2deg(dip):.0f} degrees."
        return told + assumptions(dip, no_dip, no_axis, span, False)
    if not (no_dip or no_axis) or not np.isfinite(span).all():
        return ""
    taken = [f"a dip of {np.rad2deg(dip):.0f} degrees"] * no_dip + ["the z axis down"] * no_axis
    others = ["dips up to 75 degrees"] * no_dip + ["other axes down"] * no_axis
    return f" This assumes {' and '.join(taken)}; with {' and '.join(others)} the error at level is {between(span)}."


def error_with_terms(said: Examined, found: Found, dip: float) -> float:
    """Heading error in rad at level if drift and conditions were fitted as terms; the other causes remain."""
    if said.with_terms is None or found.kind in PLANAR:
        return np.inf
    slopes = slopes_of(found.parameters, basis_of(found.kind))
    steps = [np.zeros((0, 9)), *(cause.steps for cause in said.causes if cause.name in (FAST, BENT, ALONE))]
    others = np.concatenate(steps)
    return float(heading_error(found.shape, slopes @ said.with_terms @ slopes.T + others.T @ others, dip)[0])


def sentences(said: Examined, costs: dict[str, float], limit: float, modelled: float) -> list[str]:
    """One sentence for each cause of a notable heading error, the strongest first; `modelled` comes from `error_with_terms`."""
    texts = []
    for name, _, size in said.causes:
        if costs[name] >= _WORTH_SAYING * limit:
            of_all = " in all" if name in (PLACE, SERIAL) else ""
            cost = f", which costs {np.rad2deg(costs[name]):.2g} degrees of heading rms{of_all}" if np.isfinite(costs[name]) else ""
            text = _SENTENCES.get(name, _CONDITION).format(name=name, size=100 * size, cost=cost)
            if name not in (FAST, BENT, PLACE, ALONE, SERIAL) and modelled < 0.5 * costs[name]:
                of = "time" if name == DRIFT else name
                text += (
                    f" Fitted as a term of its own ({of} as the current of `fit_current`, or --currents {of}) it would leave an error of "
                    f"{np.rad2deg(modelled):.2g} degrees."
                )
            texts.append(text)
    return texts
