"""What the causes that residuals follow cost in degrees of heading, and the sentences that name them."""

from typing import Any

import numpy as np

from .._errors import DataError
from ._design._heading_error import heading_error
from ._ellipsoid._causes import ALONE, BENT, DRIFT, FAST, PLACE, SERIAL, Examined
from ._ellipsoid._kinds import PLANAR, PLANAR_ROWS
from ._ellipsoid._shape import Found

_WORTH_SAYING = 0.1  # of the limit
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
    "Keep it constant, or record it and give it as `conditions`.",
    SERIAL: "The noise is correlated from reading to reading, {size:.2g} % of the field rms{cost}. "
    "The errors are those between fits without parts of the log. A longer log, or one farther from iron and currents, makes them smaller.",
}
_CONDITION = (
    "The readings follow {name!r}, by up to {size:.2g} % of the field about the middle of its range{cost}. "
    "Record with it constant, or fit a model that has a term for it."
)


def checked_conditions(conditions: dict[str, Any], count: int) -> dict[str, np.ndarray]:
    """Recorded conditions as arrays of one number a reading."""
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
    """The rms heading error in rad that biases (k, 9) of a fit make at level."""
    if not steps.any():
        return 0.0
    rows = np.array(PLANAR_ROWS) if found.kind in PLANAR else np.arange(9)
    return float(heading_error(found.shape, steps[:, rows].T @ steps[:, rows], dip)[0])


def costs_of(said: Examined, found: Found, whole: np.ndarray, dip: float) -> dict[str, float]:
    """That of each cause; of correlated noise, all of the error."""
    return {cause.name: cost_of(found, cause.steps, dip) if len(cause.steps) else float(whole[0]) for cause in said.causes}


def assumptions(dip: float, no_dip: bool, no_axis: bool, span: np.ndarray) -> str:
    """What the heading error takes for granted, and its range without that."""
    if not (no_dip or no_axis) or not np.isfinite(span).all():
        return ""
    taken = [f"a dip of {np.rad2deg(dip):.0f} degrees"] * no_dip + ["the z axis down"] * no_axis
    others = ["dips up to 75 degrees"] * no_dip + ["other axes down"] * no_axis
    low, high = np.rad2deg(span)
    most = f"{low:.2g} to {high:.2g} degrees" if high < 30 else f"{low:.2g} to more than 30 degrees" if low < 30 else "more than 30 degrees"
    return f" This assumes {' and '.join(taken)}; with {' and '.join(others)} the error at level is {most}."


def sentences(said: Examined, costs: dict[str, float], limit: float) -> list[str]:
    """One for each cause that costs something, the strongest first."""
    texts = []
    for name, _, size in said.causes:
        if costs[name] >= _WORTH_SAYING * limit:
            of_all = " in all" if name in (PLACE, SERIAL) else ""
            cost = f", which costs {np.rad2deg(costs[name]):.2g} degrees of heading rms{of_all}" if np.isfinite(costs[name]) else ""
            texts.append(_SENTENCES.get(name, _CONDITION).format(name=name, size=100 * size, cost=cost))
    return texts
