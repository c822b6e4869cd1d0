"""The magnetometer's part of a calibration: from a fit."""

from typing import Any

import numpy as np

from .._errors import DataError
from .._units import si_unit
from ..magnetometer import MagFit


def magnetometer_section(found: MagFit) -> dict[str, Any]:
    """What a calibration holds of a fit of readings in tesla."""
    if found.model is None or found.verdict == "refused":
        raise DataError(f"the magnetometer fit is refused, and is no calibration: {found.reason}")
    if not 1e-6 < found.field < 1e-3:
        raise DataError(
            f"the magnetometer fit has a field of {found.field:.4g}; a calibration holds tesla, in which Earth's is 2e-5 to 7e-5"
        )
    return {
        "unit": si_unit("mag"),
        "soft_iron": np.asarray(found.model.soft_iron),
        "hard_iron": np.asarray(found.model.hard_iron),
        "field": found.field,
        "covariance": {"parameters": found.names, "values": np.asarray(found.covariance)},
        "verdict": found.verdict,
        "verdict_reason": found.reason,
    }
