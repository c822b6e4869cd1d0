"""Files of visual-inertial estimators: Kalibr, OpenVINS, VINS, ORB-SLAM3, GTSAM.

Kalibr's `imu.yaml`: https://github.com/ethz-asl/kalibr/wiki/IMU-Noise-Model. OpenVINS' `kalibr_imu_chain.yaml`:
https://docs.openvins.com/propagation_analytical.html (its IMU intrinsics). The loader of OpenVINS keeps one triangle of Ta and Tw, so both
matrices are factored into a triangle and a rotation first. This is exact, but it rotates the IMU's frame, which a warning reports.
"""

import math
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._types import AnyArray
from ..calibration import Calibration
from ._findings import FINDINGS
from ._formats import SENSORS
from ._models import angle, factored, rounded, triads
from ._noise import Isotropic, isotropic, per_sensor
from ._options import UNITS, Product, comment, listed, number

#: (term, sensor) -> key, in the order of the file
_KALIBR = {
    (term, sensor): f"{SENSORS[sensor]}_{key}"
    for sensor in ("accel", "gyro") for term, key in (("N", "noise_density"), ("K", "random_walk"))
}  # fmt: skip
_ORBSLAM3 = {
    ("N", "gyro"): "IMU.NoiseGyro", ("N", "accel"): "IMU.NoiseAcc",
    ("K", "gyro"): "IMU.GyroWalk", ("K", "accel"): "IMU.AccWalk",
}  # fmt: skip
_VINS = {("N", "accel"): "acc_n", ("N", "gyro"): "gyr_n", ("K", "accel"): "acc_w", ("K", "gyro"): "gyr_w"}


def write_kalibr(calibration: Calibration, options: Any) -> Product:
    """Write continuous-time noise, and the rate that Kalibr uses to discretise it."""
    topic = _topic(options)
    noise = isotropic(calibration, options, "Kalibr makes the noise discrete with it")
    accel, gyro = (comment(fact[0].upper() + fact[1:]) for fact in noise.facts)
    lines = _lines(noise, _KALIBR)
    lines = (accel, *lines[:2], gyro, *lines[2:], f"rostopic: {topic}", f"update_rate: {number(noise.rate)}   # Hz")
    return Product("\n".join(lines) + "\n", noise.findings)


def write_openvins(calibration: Calibration, options: Any) -> Product:
    """Write noise, and the matrices of the model "kalibr"."""
    topic = _topic(options)
    noise = isotropic(calibration, options, "OpenVINS makes the noise discrete with it")
    parts = triads(calibration)
    matrices = [parts[sensor].matrix if sensor in parts else np.eye(3) for sensor in ("accel", "gyro")]
    sensitivity = parts["gyro"].g_sensitivity if "gyro" in parts else np.zeros((3, 3))
    # lower triangles, in the frame in which the matrix of the accelerometer is one
    ta, turned = factored(matrices[0])
    tw, gyro_turn = factored(matrices[1] @ turned.T)
    written = {"Tw": tw, "R_IMUtoGYRO": gyro_turn, "Ta": ta, "R_IMUtoACC": np.eye(3), "Tg": rounded(sensitivity @ turned.T)}
    lines = [
        "%YAML:1.0", "", "imu0:", *_block("T_i_b", np.eye(4)),
        *(f"  {key}: {number(noise.values[one])}" for one, key in _KALIBR.items()),
        f"  rostopic: {topic}", "  time_offset: 0.0", f"  update_rate: {number(noise.rate)}", '  model: "kalibr"',
        *(line for key, value in written.items() for line in _block(key, value)),
    ]  # fmt: skip
    found = list(noise.findings)
    missing = [SENSORS[sensor] for sensor in ("accel", "gyro") if sensor not in parts]
    if missing:
        found.append(FINDINGS("placeholder", what=f"matrix of the {' and '.join(missing)}", value="the identity"))
    units = "units: noise density m/s^2/sqrt(Hz), rad/s/sqrt(Hz); random walk m/s^3/sqrt(Hz), rad/s^2/sqrt(Hz); Tg (rad/s)/(m/s^2)"
    facts = (units, *noise.facts)
    if angle(turned) > 1e-6:
        found.append(FINDINGS("frame_turned", angle=angle(turned)))
        facts = (*facts, f"x_file = Qa x with Qa = {'; '.join(listed(row) for row in turned)}")
    if any(np.any(part.bias) for part in parts.values()):
        found.append(FINDINGS("estimated_by_tool", tool="OpenVINS"))
    return Product("\n".join(lines) + "\n", found, facts)


def write_vins(calibration: Calibration, options: Any) -> Product:
    """Write the per-sample noise of VINS-Mono and VINS-Fusion in the chosen convention; a comment states the values of the other one.

    Their `integration_base.h` adds 2 (0.5)^2 ACC_N^2 dt^2 and (ACC_W dt)^2 in each step, which must equal N^2 dt and K^2 dt.
    """
    topic = _topic(options)
    noise = isotropic(calibration, options, "the values are per sample and hold for this rate alone")
    scales = {"midpoint": math.sqrt(2 * noise.rate), "per_sample": math.sqrt(noise.rate)}
    readings = {
        "midpoint": "N*sqrt(2*rate), which makes the code's mid-point covariance equal N^2*dt",
        "per_sample": "plain per-sample standard deviations N*sqrt(rate)",
    }
    other = next(name for name in scales if name != options.convention)
    acc, gyr = (number(noise.values["N", sensor] * scales[other]) for sensor in ("accel", "gyro"))
    scale = {"N": scales[options.convention], "K": scales["per_sample"]}
    units = ("m/s^2", "rad/s", "m/s^3, K*sqrt(rate)", "rad/s^2, K*sqrt(rate)")
    lines = (
        f"# Discrete values for {number(noise.rate)} Hz. Change the rate, change these numbers.",
        f"# acc_n, gyr_n: {readings[options.convention]}.",
        f"# {readings[other][0].upper()}{readings[other][1:]}: acc {acc}, gyr {gyr}",
        *(f"{key}: {number(noise.values[one] * scale[one[0]])}   # {unit}" for (one, key), unit in zip(_VINS.items(), units, strict=True)),
        f"g_norm: {number(options.gravity)}",
        f'imu_topic: "{topic.strip(chr(34))}"',
    )
    return Product("\n".join(lines) + "\n", noise.findings, noise.facts)


def write_orbslam3(calibration: Calibration, options: Any) -> Product:
    """Write continuous-time noise for ORB-SLAM3, whose loader discretises it with IMU.Frequency."""
    noise = isotropic(calibration, options, "ORB-SLAM3 makes the noise discrete with it")
    lines = (*_lines(noise, _ORBSLAM3), f"IMU.Frequency: {number(noise.rate)}   # Hz")
    mounting = "IMU.T_b_c1 (camera to body), which ORB-SLAM3 needs beside these lines, does not come from the sensor"
    return Product("\n".join(lines) + "\n", noise.findings, (*noise.facts, mounting))


def write_gtsam(calibration: Calibration, options: Any) -> Product:
    """Write Python code that makes GTSAM's `PreintegrationCombinedParams`; all covariances are continuous-time and per axis."""
    noise = per_sensor(calibration, options)
    (n_gyro, k_gyro, gyro, gyro_said), (n_accel, k_accel, accel, accel_said) = noise["gyro"], noise["accel"]
    make = {"up": "MakeSharedU", "down": "MakeSharedD"}[options.frame]
    gravity = number(options.gravity)
    lines = [
        "import gtsam",
        "import numpy as np",
        "",
        f"# z {options.frame}, gravity {gravity} m/s^2; all covariances continuous-time.",
        f"params = gtsam.PreintegrationCombinedParams.{make}({gravity})",
        f"params.setAccelerometerCovariance(np.diag({listed(n_accel**2)}))  # (m/s^2)^2/Hz",
        f"params.setGyroscopeCovariance(np.diag({listed(n_gyro**2)}))  # (rad/s)^2/Hz",
        f"params.setBiasAccCovariance(np.diag({listed(k_accel**2)}))  # (m/s^3)^2/Hz",
        f"params.setBiasOmegaCovariance(np.diag({listed(k_gyro**2)}))  # (rad/s^2)^2/Hz",
        "params.setIntegrationCovariance(1.0e-08 * np.eye(3))  # m^2/s, not from the sensor",
    ]
    parts = {} if calibration.imu is None else calibration.imu.parts
    held = [parts[sensor].spread(f"bias[{i}]" for i in range(3)) if sensor in parts else None for sensor in ("accel", "gyro")]
    blocks = [block for block in held if block is not None]
    if len(blocks) == 2:
        lines += [
            "# covariance of the bias estimate, accelerometer first; releases spell the setter differently",
            "bias_covariance = np.array([",
            *(f"    {listed(row)}," for row in scipy.linalg.block_diag(*blocks)),
            "])",
            'for name in ("setBiasAccOmegaInit", "setBiasAccOmegaInt"):',
            "    if hasattr(params, name):",
            "        getattr(params, name)(bias_covariance)",
        ]
    return Product("\n".join(lines) + "\n", [*accel_said, *gyro_said], (f"accelerometer: {accel}", f"gyroscope: {gyro}"))


def _topic(options: Any) -> str:
    """The topic, in quotes if YAML could misread it."""
    return options.topic if options.topic.startswith("/") else f'"{options.topic}"'


def _lines(noise: Isotropic, names: dict[tuple[str, str], str]) -> list[str]:
    return [f"{key}: {number(noise.values[one])}   # {UNITS[one[0]][one[1]]}" for one, key in names.items()]


def _block(key: str, matrix: AnyArray) -> list[str]:
    return [f"  {key}:", *(f"    - {listed(row)}" for row in matrix)]
