"""OpenVINS' `kalibr_imu_chain.yaml`: https://docs.openvins.com/propagation_analytical.html (its IMU intrinsics).

The loader keeps one triangle of Ta and Tw, so that both matrices are factored into a triangle and a rotation first. Both factorings
are exact; they turn the IMU's frame, which is said.
"""

import numpy as np

from .._types import AnyArray
from ..calibration import Calibration
from ._isotropic import isotropic, noise_of, rate_of
from ._kalibr import topic_of
from ._matrices import angle, factored, rounded, triads
from ._options import Options, Product
from ._text import listed, number


def openvins(calibration: Calibration, options: Options) -> Product:
    """Noise, and the matrices of the model that is asked for."""
    topic = topic_of(options)
    noise = noise_of(calibration)
    gyro, accel = isotropic(noise, "gyro", options), isotropic(noise, "accel", options)
    rate, warnings = rate_of(noise, calibration, options, "OpenVINS makes the noise discrete with it")
    parts = triads(calibration)
    matrices = {sensor: parts[sensor].matrix if sensor in parts else np.eye(3) for sensor in ("accel", "gyro")}
    sensitivity = parts["gyro"].g_sensitivity if "gyro" in parts else np.zeros((3, 3))
    make = _kalibr if options.model == "kalibr" else _rpng
    found, turned, name = make(matrices["accel"], matrices["gyro"], sensitivity)
    lines = [
        "%YAML:1.0",
        "",
        "imu0:",
        *_block("T_i_b", np.eye(4)),
        f"  accelerometer_noise_density: {number(accel.density)}",
        f"  accelerometer_random_walk: {number(accel.random_walk)}",
        f"  gyroscope_noise_density: {number(gyro.density)}",
        f"  gyroscope_random_walk: {number(gyro.random_walk)}",
        f"  rostopic: {topic}",
        "  time_offset: 0.0",
        f"  update_rate: {number(rate)}",
        f'  model: "{options.model}"',
        *(line for key, value in found.items() for line in _block(key, value)),
    ]
    said = [*accel.warnings, *gyro.warnings, *warnings]
    if not parts:
        said.append("the calibration holds no imu: identity matrices are written")
    elif len(parts) < 2:
        missing = "gyroscope" if "accel" in parts else "accelerometer"
        said.append(f"the calibration holds no {missing}: its matrix is written as the identity")
    if angle(turned) > 1e-6:
        rows = "; ".join(listed(row) for row in turned)
        said.append(
            f"the IMU frame of this file is turned by {angle(turned):.4f} degrees from that of the calibration: x_file = {name} x with "
            f"{name} = {rows}; the extrinsics of cameras must be turned with it"
        )
    if any(np.any(part.bias) for part in parts.values()):
        said.append("biases are not written: OpenVINS estimates them while it runs")
    facts = (
        "units: noise density m/s^2/sqrt(Hz), rad/s/sqrt(Hz); random walk m/s^3/sqrt(Hz), rad/s^2/sqrt(Hz); Tg (rad/s)/(m/s^2)",
        f"accelerometer: {accel.about}", f"gyroscope: {gyro.about}",
    )  # fmt: skip
    return Product("\n".join(lines) + "\n", tuple(said), facts)


def _kalibr(accel: AnyArray, gyro: AnyArray, sensitivity: AnyArray) -> tuple[dict[str, AnyArray], AnyArray, str]:
    """Lower triangles; the IMU's frame is that in which the accelerometer's matrix is one."""
    ta, turned = factored(accel, "lower")
    tw, gyro_turn = factored(gyro @ turned.T, "lower")
    found = {"Tw": tw, "R_IMUtoGYRO": gyro_turn, "Ta": ta, "R_IMUtoACC": np.eye(3), "Tg": rounded(sensitivity @ turned.T)}
    return found, turned, "Qa"


def _rpng(accel: AnyArray, gyro: AnyArray, sensitivity: AnyArray) -> tuple[dict[str, AnyArray], AnyArray, str]:
    """Upper triangles; the IMU's frame is that in which the gyroscope's matrix is one."""
    tw, turned = factored(gyro, "upper")
    ta, accel_turn = factored(accel @ turned.T, "upper")
    found = {"Tw": tw, "R_IMUtoGYRO": np.eye(3), "Ta": ta, "R_IMUtoACC": accel_turn, "Tg": rounded(sensitivity @ turned.T)}
    return found, turned, "R'"


def _block(key: str, matrix: AnyArray) -> list[str]:
    return [f"  {key}:", *(f"    - {listed(row)}" for row in matrix)]
