"""Calibrations as YAML for ROS nodes. There is no standard, so the user chooses a flavour."""

from typing import Any

import numpy as np

from .._errors import DataError, ExportError
from .._types import AnyArray
from ..calibration import Calibration
from ..imu import Triad
from ..magnetometer import MagModel
from ._models import correction, dropped_g_sensitivity, dropped_of_gyro, gyro_bias, inverse, triads, unknown_field
from ._noise import rate_of, stored_noise
from ._options import Options, Product, listed, number
from ._yaml import mapping, numbers_of, parse, stated

#: sensor -> key of its covariance, and unit
_COVARIANCES = {
    "gyro": ("angular_velocity_covariance", "(rad/s)^2 per sample"), "accel": ("linear_acceleration_covariance", "(m/s^2)^2 per sample"),
}  # fmt: skip


def ros(calibration: Calibration, options: Options) -> Product:
    """Write the chosen flavour."""
    make = {"ros2": _ros2, "imu_calib": _imu_calib, "dlio": _dlio, "madgwick": _madgwick}[options.flavour]
    lines, warnings = make(calibration, options)
    if calibration.temperature is not None:
        warnings.append("thermal models are not written, for there is no place for them; the biases hold at the reference temperature")
    return Product("\n".join(lines) + "\n", tuple(warnings))


def _ros2(calibration: Calibration, options: Options) -> tuple[list[str], list[str]]:
    parts, mag = triads(calibration), calibration.magnetometer
    lines, warnings = [], []
    if "accel" in parts:
        lines += [f"accel_matrix: {listed(correction(parts['accel'].matrix))}   # row-major; x = accel_matrix (y - accel_bias)"]
        lines += [f"accel_bias: {listed(parts['accel'].bias)}   # m/s^2"]
    if "gyro" in parts:
        gyro = parts["gyro"]
        lines += [f"gyro_matrix: {listed(correction(gyro.matrix))}", f"gyro_bias: {listed(gyro.bias)}   # rad/s"]
        lines += [f"gyro_g_sensitivity: {listed(gyro.g_sensitivity)}   # (rad/s)/(m/s^2)"]
    if mag is not None:
        unknown_field(calibration, warnings)
        lines += [f"mag_matrix: {listed(correction(mag.model.soft_iron))}", f"mag_bias: {listed(mag.model.hard_iron)}   # T"]
    lines += _covariances(calibration, options, warnings)
    if not lines:
        raise ExportError("the calibration holds no imu, magnetometer or noise, of which parameters could be made", code="no_part")
    return ["/**:", "  ros__parameters:", *(f"    {line}" for line in lines)], warnings


def _covariances(calibration: Calibration, options: Options, warnings: list[str]) -> list[str]:
    noise, lines = calibration.noise, []
    if noise is None:
        return []
    rate, said = rate_of(noise, calibration, options, "the covariances are per sample at this rate")
    for sensor, (name, unit) in _COVARIANCES.items():
        held = getattr(noise, sensor)
        if held is None or held.N is None or not np.all(np.isfinite(held.N) & (held.N > 0)):
            if held is not None:
                warnings.append(f"{name} is not written: no N was found on some axis of {sensor}")
            continue
        lines.append(f"{name}: {listed(np.diag((held.N * options.inflate) ** 2 * rate))}   # {unit} at {number(rate)} Hz")
        if any(values is not None and np.any(values > 0) for values in (held.K, held.B)):
            warnings.append(f"{name}: K and B are not written; a covariance holds white noise alone")
    if options.inflate != 1 and lines:
        warnings.append(f"the standard deviations behind the covariances are multiplied by {number(options.inflate)}")
    warnings.extend(said if lines else [])
    return lines


def _imu_calib(calibration: Calibration, options: Options) -> tuple[list[str], list[str]]:
    matrix, bias = _before_bias(calibration, ", for which alone imu_calib has a place")
    warnings = _left_out(calibration, "imu_calib", ("gyro", "magnetometer", "noise"))
    return [f"SM: {listed(matrix)}", f"bias: {listed(bias)}"], warnings


def _dlio(calibration: Calibration, options: Options) -> tuple[list[str], list[str]]:
    matrix, accel_bias = _before_bias(calibration, "; DLIO reads its intrinsics together with the gyroscope's")
    bias, warnings = gyro_bias(calibration), dropped_of_gyro(calibration)
    if bias is None:
        bias = np.zeros(3)
        warnings.append("the calibration holds no gyroscope: its bias is written as zero")
    lines = [
        "dlio:",
        "  imu:",
        "    calibration: false   # true ignores the values below",
        "    intrinsics:",
        "      accel:",
        f"        bias: {listed(accel_bias)}   # m/s^2, subtracted after sm",
        f"        sm: {listed(matrix)}   # row-major",
        "      gyro:",
        f"        bias: {listed(bias)}   # rad/s",
    ]
    return lines, warnings + _left_out(calibration, "DLIO", ("magnetometer", "noise"))


def _before_bias(calibration: Calibration, why: str) -> tuple[AnyArray, AnyArray]:
    """Matrix of the accelerometer's correction, and the bias to subtract after the matrix."""
    accel = triads(calibration).get("accel")
    if accel is None:
        raise ExportError(f"the calibration holds no accelerometer{why}", code="no_part")
    matrix = correction(accel.matrix)
    return matrix, matrix @ accel.bias


def _madgwick(calibration: Calibration, options: Options) -> tuple[list[str], list[str]]:
    mag = calibration.magnetometer
    if mag is None:
        raise ExportError("the calibration holds no magnetometer, for which alone imu_filter_madgwick has a place", code="no_part")
    lost = np.linalg.norm(correction(mag.model.soft_iron) - np.eye(3), 2)
    warnings = [f"magnetometer: soft iron not written, for there is no place for it: {lost:.4g}"] if lost > 0 else []
    lines = [f"mag_bias_{axis}: {number(float(value))}   # T" for axis, value in zip("xyz", mag.model.hard_iron, strict=True)]
    return lines, warnings + _left_out(calibration, "imu_filter_madgwick", ("accel", "gyro", "noise"))


def _left_out(calibration: Calibration, tool: str, names: tuple[str, ...]) -> list[str]:
    held = {**triads(calibration), "magnetometer": calibration.magnetometer, "noise": calibration.noise}
    missing = [name for name in names if held.get(name) is not None]
    said = [f"{tool} has no place for {', '.join(missing)}, which the calibration holds"] if missing else []
    return said + (dropped_g_sensitivity(calibration) if "gyro" in missing else [])


def read_ros(text: str, options: dict[str, Any]) -> Calibration:
    """Read any flavour of `write`; the keys of the file identify it."""
    document = parse(text)
    if "SM" in document:
        return Calibration(imu={"accel": _after_matrix(document, "SM")})
    if "dlio" in document:
        inner = mapping(document, "dlio", "imu", "intrinsics")
        gyro = mapping(inner, "gyro")
        return Calibration(
            imu={"accel": _after_matrix(mapping(inner, "accel"), "sm"), "gyro": Triad(np.eye(3), numbers_of(gyro, "bias", 3))}
        )
    if "mag_bias_x" in document:
        return Calibration(magnetometer=MagModel(np.eye(3), np.array([numbers_of(document, f"mag_bias_{axis}") for axis in "xyz"])))
    if "/**" not in document:
        raise DataError(
            "the file has none of the keys SM, dlio, mag_bias_x and /**, by which a calibration for ROS is known", code="no_part"
        )
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


def _after_matrix(found: dict[str, Any], key: str) -> Triad:
    """Read an accelerometer whose bias is subtracted after the matrix."""
    matrix = inverse(numbers_of(found, key, 3, 3))
    return Triad(matrix, matrix @ numbers_of(found, "bias", 3))
