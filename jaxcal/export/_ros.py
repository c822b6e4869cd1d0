"""Calibrations as parameters of a ROS 2 node, in YAML. There is no standard for their names."""

from typing import Any

import numpy as np

from .._answer import Finding
from .._errors import DataError, ExportError
from .._types import AnyArray
from ..calibration import Calibration
from ..imu import Triad
from ..magnetometer import MagModel
from ._findings import FINDINGS
from ._models import correction, inverse, triads, unknown_field
from ._noise import rate_of, stored_noise
from ._options import Product, listed, number
from ._yaml import mapping, numbers_of, parse, stated

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
    inflated = f", inflated by {number(options.inflate)}" if options.inflate != 1 else ""
    rate, said = rate_of(noise, calibration, options, "the covariances are per sample at this rate")
    for sensor, (name, unit) in _COVARIANCES.items():
        held = getattr(noise, sensor)
        if held is None:
            continue
        if held.N is None or not np.all(np.isfinite(held.N) & (held.N > 0)):
            found.append(FINDINGS("no_covariance", sensor, name=name))
            continue
        lines.append(f"{name}: {listed(np.diag((held.N * options.inflate) ** 2 * rate))}   # {unit} at {number(rate)} Hz{inflated}")
        if any(values is not None and np.any(values > 0) for values in (held.K, held.B)):
            found.append(FINDINGS("white_alone", sensor))
    found.extend(said if lines else [])
    return lines


def read_ros(text: str, options: dict[str, Any]) -> Calibration:
    """Read the file of `write`."""
    document = parse(text)
    if "/**" not in document:
        raise DataError("the file has no key /**, by which parameters of ROS are known", code="unreadable")
    found = mapping(document, "/**", "ros__parameters")

    def held(name: str) -> tuple[AnyArray, AnyArray]:
        return inverse(numbers_of(found, f"{name}_matrix", 3, 3)), numbers_of(found, f"{name}_bias", 3)

    imu = {"accel": Triad(*held("accel"))} if "accel_matrix" in found else {}
    if "gyro_matrix" in found:
        imu["gyro"] = Triad(*held("gyro"), numbers_of(found, "gyro_g_sensitivity", 3, 3))
    mag = MagModel(*held("mag")) if "mag_matrix" in found else None
    noise: dict[str, Any] = {}
    for sensor, (key, _) in _COVARIANCES.items():
        if key in found:
            rate = stated(text, r"per sample at ([-+.eE\d]+) Hz", options, "the covariances")
            noise |= {"rate": rate, sensor: stored_noise(sensor, N=np.sqrt(np.abs(np.diag(numbers_of(found, key, 3, 3))) / rate))}
    return Calibration(imu=imu or None, magnetometer=mag, noise=noise or None)
