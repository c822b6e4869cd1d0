"""The accelerometer and gyroscope of a fit, as a calibration stores them."""

from typing import Any

import numpy as np

from .._errors import DataError
from .._units import si_unit
from ..imu import ImuFit


def imu_section(fit: ImuFit) -> dict[str, Any]:
    """Sections accel and gyro, with their covariances.

    Raises
    ------
    DataError
        If the fit was refused.
    """
    if fit.verdict == "refused" or fit.accel is None:
        raise DataError(f"the calibration was refused and cannot be stored: {fit.reason}")
    found: dict[str, Any] = {}
    for sensor, triad, part in (("accel", fit.accel, slice(0, 12)), ("gyro", fit.gyro, slice(12, 33))):
        if triad is not None:
            names = [name.removeprefix(f"{sensor}.") for name in fit.names[part]]
            values = np.asarray(fit.covariance)[part, part]
            found[sensor] = {
                "unit": si_unit(sensor), "matrix": triad.matrix, "bias": triad.bias,
                "covariance": {"parameters": names, "values": values} if np.isfinite(values).all() else None,
                "interval": {"low": np.asarray(fit.interval)[part, 0], "high": np.asarray(fit.interval)[part, 1]},
            }  # fmt: skip
    if "gyro" in found and fit.gyro is not None:
        found["gyro"]["g_sensitivity"] = fit.gyro.g_sensitivity
    return found | {"verdict": fit.verdict, "verdict_reason": fit.reason}
