"""Calibrations as parameters of a ROS 2 node, in YAML. There is no standard for their names."""

from typing import Any

import numpy as np

from .._answer import Finding
from .._errors import ExportError
from ..calibration import Calibration
from ._findings import FINDINGS
from ._models import correction, triads, unknown_field
from ._noise import rate_of, under_motion
from ._options import Product, listed, number

#: sensor -> key of its covariance, and unit
_COVARIANCES = {
    "gyro": ("angular_velocity_covariance", "(rad/s)^2 per sample"), "accel": ("linear_acceleration_covariance", "(m/s^2)^2 per sample"),
}  # fmt: skip


def write_ros(calibration: Calibration, options: Any) -> Product:
    """Write the parameters of a ROS 2 node."""
    parts, mag = triads(calibration), calibration.magnetometer
    lines: list[str] = []
    found: list[Finding] = []
    if "accel" in parts:
        lines += [f"accel_matrix: {listed(correction(parts['accel'].matrix))}   # row-major; x = accel_matrix (y - accel_bias)"]
        lines += [f"accel_bias: {listed(parts['accel'].bias)}   # m/s^2"]
    if "gyro" in parts:
        gyro = parts["gyro"]
        lines += [f"gyro_matrix: {listed(correction(gyro.matrix))}", f"gyro_bias: {listed(gyro.bias)}   # rad/s"]
        lines += [f"gyro_g_sensitivity: {listed(gyro.g_sensitivity)}   # (rad/s)/(m/s^2)"]
    if mag is not None:
        unknown_field(calibration, found)
        lines += [f"mag_matrix: {listed(correction(mag.model.soft_iron))}", f"mag_bias: {listed(mag.model.hard_iron)}   # T"]
    lines += _covariances(calibration, options, found)
    if not lines:
        raise ExportError("the calibration holds no imu, magnetometer or noise, of which parameters could be made", code="no_part")
    return Product("\n".join(("/**:", "  ros__parameters:", *(f"    {line}" for line in lines))) + "\n", found)


def _covariances(calibration: Calibration, options: Any, found: list[Finding]) -> list[str]:
    noise, lines = calibration.noise, []
    if noise is None:
        return []
    rate, said = rate_of(noise, calibration, options, "the covariances are per sample at this rate")
    moved = under_motion(calibration, options)
    for sensor, (name, unit) in _COVARIANCES.items():
        if (held := getattr(noise, sensor)) is None:
            continue
        if held.N is None or not np.all(np.isfinite(held.N) & (held.N > 0)):
            found.append(FINDINGS("no_covariance", sensor, name=name))
            continue
        times, how = moved[sensor]
        lines.append(f"{name}: {listed(np.diag((times * held.N) ** 2 * rate))}   # {unit} at {number(rate)} Hz{how}")
        if any(values is not None and np.any(values > 0) for values in (held.K, held.B)):
            found.append(FINDINGS("white_alone", sensor))
    found.extend(said if lines else [])
    return lines
