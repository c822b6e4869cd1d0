"""Fragments for visual-inertial estimators: VINS, ORB-SLAM3, GTSAM."""

import math

import numpy as np

from .._types import AnyArray
from ..calibration import Calibration
from ._isotropic import isotropic, noise_of, per_axis, rate_of
from ._kalibr import topic_of
from ._options import UNITS, Options, Product
from ._text import listed, number

_SPREAD = "the values are per sample and hold for this rate alone"


def vins(calibration: Calibration, options: Options) -> Product:
    """Per-sample noise of VINS-Mono and VINS-Fusion, in the reading of its convention that is asked for; the other is in a comment.

    Their `integration_base.h` adds 2 (0.5)^2 ACC_N^2 dt^2 and (ACC_W dt)^2 a step, which is N^2 dt and K^2 dt.
    """
    topic = topic_of(options)
    noise = noise_of(calibration)
    gyro, accel = isotropic(noise, "gyro", options), isotropic(noise, "accel", options)
    rate, warnings = rate_of(noise, calibration, options, _SPREAD)
    midpoint, single = math.sqrt(2 * rate), math.sqrt(rate)

    def both(scale: float) -> str:
        return f"acc {number(accel.density * scale)}, gyr {number(gyro.density * scale)}"

    if options.convention == "midpoint":
        scale = midpoint
        reading = (
            "# acc_n, gyr_n: N*sqrt(2*rate), which makes the code's mid-point covariance equal N^2*dt.",
            f"# Plain per-sample standard deviations N*sqrt(rate): {both(single)}",
        )
    else:
        scale = single
        reading = (
            "# acc_n, gyr_n: plain per-sample standard deviations N*sqrt(rate).",
            f"# N*sqrt(2*rate), which makes the code's mid-point covariance equal N^2*dt: {both(midpoint)}",
        )
    lines = (
        f"# Discrete values for {number(rate)} Hz. Change the rate, change these numbers.",
        *reading,
        f"acc_n: {number(accel.density * scale)}   # m/s^2",
        f"gyr_n: {number(gyro.density * scale)}   # rad/s",
        f"acc_w: {number(accel.random_walk * single)}   # m/s^3, K*sqrt(rate)",
        f"gyr_w: {number(gyro.random_walk * single)}   # rad/s^2, K*sqrt(rate)",
        f"g_norm: {number(options.gravity)}",
        f'imu_topic: "{topic.strip(chr(34))}"',
    )
    said = (*accel.warnings, *gyro.warnings, *warnings)
    return Product("\n".join(lines) + "\n", said, (f"accelerometer: {accel.about}", f"gyroscope: {gyro.about}"))


def orbslam3(calibration: Calibration, options: Options) -> Product:
    """Continuous-time noise of ORB-SLAM3, whose loader makes it discrete with IMU.Frequency."""
    noise = noise_of(calibration)
    gyro, accel = isotropic(noise, "gyro", options), isotropic(noise, "accel", options)
    rate, warnings = rate_of(noise, calibration, options, "ORB-SLAM3 makes the noise discrete with it")
    lines = (
        f"IMU.NoiseGyro: {number(gyro.density)}   # {UNITS['density']['gyro']}",
        f"IMU.NoiseAcc: {number(accel.density)}   # {UNITS['density']['accel']}",
        f"IMU.GyroWalk: {number(gyro.random_walk)}   # {UNITS['random_walk']['gyro']}",
        f"IMU.AccWalk: {number(accel.random_walk)}   # {UNITS['random_walk']['accel']}",
        f"IMU.Frequency: {number(rate)}   # Hz",
    )
    mounting = "IMU.T_b_c1 (camera to body), which ORB-SLAM3 needs beside these lines, is not the sensor's and stays yours"
    said = (*accel.warnings, *gyro.warnings, *warnings, mounting)
    return Product("\n".join(lines) + "\n", said, (f"accelerometer: {accel.about}", f"gyroscope: {gyro.about}"))


def gtsam(calibration: Calibration, options: Options) -> Product:
    """Python that makes GTSAM's `PreintegrationCombinedParams`; all covariances are continuous in time and per axis."""
    noise = noise_of(calibration)
    n_gyro, k_gyro, gyro, gyro_said = per_axis(noise, "gyro", options)
    n_accel, k_accel, accel, accel_said = per_axis(noise, "accel", options)
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
    spread = _bias_covariance(calibration)
    if spread is not None:
        lines += [
            "# covariance of the bias estimate, accelerometer first; releases spell the setter differently",
            "bias_covariance = np.array([",
            *(f"    {listed(row)}," for row in spread),
            "])",
            'for name in ("setBiasAccOmegaInit", "setBiasAccOmegaInt"):',
            "    if hasattr(params, name):",
            "        getattr(params, name)(bias_covariance)",
        ]
    return Product("\n".join(lines) + "\n", (*accel_said, *gyro_said), (f"accelerometer: {accel}", f"gyroscope: {gyro}"))


def _bias_covariance(calibration: Calibration) -> AnyArray | None:
    """(6, 6), accelerometer first; None where one of the two is not known."""
    found = np.zeros((6, 6))
    parts = {} if calibration.imu is None else calibration.imu.parts
    for first, sensor in ((0, "accel"), (3, "gyro")):
        held = parts[sensor].covariance if sensor in parts else None
        known = None if held is None else held.of([f"bias[{i}]" for i in range(3)])
        if known is None:
            return None
        found[first : first + 3, first : first + 3] = known
    return found
