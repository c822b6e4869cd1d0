"""`Estimate` of hard and soft iron, and its covariance where residuals are not white."""

from typing import Any

import numpy as np

from .._precision import array_module, is_traced
from .._units import BEYOND
from ..fitting import Estimate
from ..fitting._serial import is_white, leave_out
from ._ellipsoid._kinds import PLACE
from ._model import MagModel

EXACT = 1e-9  # share of the field below which residuals are rounding, not noise
HARD = tuple(f"hard_iron[{i}]" for i, _ in enumerate(PLACE))
SOFT = tuple(f"soft_iron[{i},{j}]" for i, j in np.ndindex(*PLACE.shape))


def quantity_of(field: Any) -> str:
    """Quantity of the readings: "mag" for a field in tesla, else "counts"; "ratio" where it is traced."""
    return "ratio" if is_traced(field) else "mag" if field < BEYOND["mag"] else "counts"


def estimated(model: MagModel, field: Any, covariance: Any, freedom: float | int, further: dict[str, Any] | None = None,
              held: bool = True) -> Estimate:  # fmt: skip
    """Hard iron, soft iron, the field and `further` parameters (name -> value), in this order, with their covariance."""
    xp, quantity, further = array_module(model, field, covariance), quantity_of(field), further or {}
    known = xp.isfinite(covariance).all()
    covariance = xp.where(known, covariance, xp.inf)
    values = [
        xp.asarray(model.hard_iron),
        xp.asarray(model.soft_iron).ravel(),
        *(xp.ravel(xp.asarray(v)) for v in (field, *further.values())),
    ]
    states = {"field": "held"} if held else {}
    quantities = {"hard_iron": quantity, "field": quantity}
    quantities |= {name.partition("[")[0]: quantity for name in further if name.startswith("currents.")}
    return Estimate((*HARD, *SOFT, "field", *further), xp.concatenate(values), covariance, freedom, states, quantities)


def by_parts(white: Any, jacobian: np.ndarray, left: np.ndarray, prior: np.ndarray | None = None) -> tuple[np.ndarray, bool]:
    """Covariance of the parameters by fits without parts of the log, and True; if its residuals look white, the given one, and False.

    No parameter is known better than by white residuals. prior : information (p, p) that no part of the log takes away.
    """
    shown = np.abs(jacobian).max(axis=0) > 0  # others are in the prior alone
    if is_white(jacobian[:, shown], left):
        return white, False
    other = leave_out(jacobian, left, prior)
    if prior is not None:
        if not np.isfinite(other).all():
            return white, False  # too few to leave any out, and the prior holds what they leave open
        other = other + white @ prior @ white
    ratio = np.sqrt(np.maximum(np.diag(white) / np.maximum(np.diag(other), 1e-300), 1.0))
    return other * np.outer(ratio, ratio), True
