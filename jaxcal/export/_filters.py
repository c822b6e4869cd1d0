"""Files of visual-inertial estimators: Kalibr, OpenVINS, VINS, ORB-SLAM3, GTSAM. All except GTSAM can be read.

Kalibr's `imu.yaml`: https://github.com/ethz-asl/kalibr/wiki/IMU-Noise-Model. OpenVINS' `kalibr_imu_chain.yaml`:
https://docs.openvins.com/propagation_analytical.html (its IMU intrinsics). The loader of OpenVINS keeps one triangle of Ta and Tw, so both
matrices are factored into a triangle and a rotation first. This is exact, but it rotates the IMU's frame, which a warning reports.
"""

import math
import re
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError, ExportError
from .._types import AnyArray
from ..calibration import Calibration
from ..imu import Triad
from ._models import angle, factored, rounded, triads
from ._noise import Isotropic, isotropic, noise_of, per_axis, stored_noise
from ._options import SENSORS, UNITS, Options, Product, comment, listed, number
from ._yaml import mapping, numbers_of, parse, read_rate, stated

#: (quantity, sensor) -> key, in the order of the file
_KALIBR = {
    (quantity, sensor): f"{SENSORS[sensor]}_{key}"
    for sensor in ("accel", "gyro") for quantity, key in (("density", "noise_density"), ("random_walk", "random_walk"))
}  # fmt: skip
_ORBSLAM3 = {
    ("density", "gyro"): "IMU.NoiseGyro", ("density", "accel"): "IMU.NoiseAcc",
    ("random_walk", "gyro"): "IMU.GyroWalk", ("random_walk", "accel"): "IMU.AccWalk",
}  # fmt: skip
_VINS = {("density", "accel"): "acc_n", ("density", "gyro"): "gyr_n", ("random_walk", "accel"): "acc_w", ("random_walk", "gyro"): "gyr_w"}
_DIGITS = 9  # digits of a rotation in a file
#: allowed characters of a topic; in quotes they need no escape
_TOPIC = re.compile(r"[A-Za-z~/][A-Za-z0-9_~/]*")


def kalibr(calibration: Calibration, options: Options) -> Product:
    """Write continuous-time noise, and the rate that Kalibr uses to discretise it."""
    topic = _topic(options)
    noise = isotropic(calibration, options, "Kalibr makes the noise discrete with it")
    accel, gyro = (comment(fact[0].upper() + fact[1:]) for fact in noise.facts)
    lines = _lines(noise, _KALIBR)
    lines = (accel, *lines[:2], gyro, *lines[2:], f"rostopic: {topic}", f"update_rate: {number(noise.rate)}   # Hz")
    return Product("\n".join(lines) + "\n", noise.warnings)


def read_kalibr(text: str, options: dict[str, Any]) -> Calibration:
    """Read `imu.yaml`, or Kalibr's calibration result with its matrices."""
    document = parse(text)
    part = mapping(document, "imu0") if "imu0" in document else document
    imu = None
    if "imu0" in document and "accelerometers" in part and "gyroscopes" in part:
        accel, gyro = mapping(part, "accelerometers"), mapping(part, "gyroscopes")
        turn = numbers_of(gyro, "C_gyro_i", 3, 3) if "C_gyro_i" in gyro else np.eye(3)
        sensitivity = numbers_of(gyro, "A", 3, 3) @ turn if "A" in gyro else np.zeros((3, 3))
        imu = {
            "accel": Triad(numbers_of(accel, "M", 3, 3), np.zeros(3)),
            "gyro": Triad(numbers_of(gyro, "M", 3, 3) @ turn, np.zeros(3), sensitivity),
        }
    return Calibration(noise={**_read_noise(part, _KALIBR), "rate": read_rate(part, "update_rate", options)}, imu=imu)


def openvins(calibration: Calibration, options: Options) -> Product:
    """Write noise, and the matrices of the chosen model."""
    topic = _topic(options)
    noise = isotropic(calibration, options, "OpenVINS makes the noise discrete with it")
    parts = triads(calibration)
    matrices = [parts[sensor].matrix if sensor in parts else np.eye(3) for sensor in ("accel", "gyro")]
    sensitivity = parts["gyro"].g_sensitivity if "gyro" in parts else np.zeros((3, 3))
    found, turned, name = _triangles(matrices[0], matrices[1], sensitivity, options.model)
    lines = [
        "%YAML:1.0",
        "",
        "imu0:",
        *_block("T_i_b", np.eye(4)),
        *(f"  {key}: {number(noise.values[one])}" for one, key in _KALIBR.items()),
        f"  rostopic: {topic}",
        "  time_offset: 0.0",
        f"  update_rate: {number(noise.rate)}",
        f'  model: "{options.model}"',
        *(line for key, value in found.items() for line in _block(key, value)),
    ]
    said = list(noise.warnings)
    if not parts:
        said.append("the calibration holds no imu: identity matrices are written")
    elif len(parts) < 2:
        missing = SENSORS["gyro" if "accel" in parts else "accel"]
        said.append(f"the calibration holds no {missing}: its matrix is written as the identity")
    if angle(turned) > 1e-6:
        rows = "; ".join(listed(row) for row in turned)
        said.append(
            f"the IMU frame of this file is turned by {angle(turned):.4f} degrees from that of the calibration: x_file = {name} x with "
            f"{name} = {rows}; the extrinsics of cameras must be turned with it"
        )
    if any(np.any(part.bias) for part in parts.values()):
        said.append("biases are not written: OpenVINS estimates them while it runs")
    units = "units: noise density m/s^2/sqrt(Hz), rad/s/sqrt(Hz); random walk m/s^3/sqrt(Hz), rad/s^2/sqrt(Hz); Tg (rad/s)/(m/s^2)"
    return Product("\n".join(lines) + "\n", tuple(said), (units, *noise.facts))


def read_openvins(text: str, options: dict[str, Any]) -> Calibration:
    """Read `kalibr_imu_chain.yaml`. It has no biases, so these are zero; the frame is the file's IMU frame."""
    part = mapping(parse(text), "imu0")
    imu = None
    if "Ta" in part or "Tw" in part:
        accel_turn, gyro_turn = (_exact_rotation(numbers_of(part, key, 3, 3)) for key in ("R_IMUtoACC", "R_IMUtoGYRO"))
        accel, gyro = numbers_of(part, "Ta", 3, 3) @ accel_turn, numbers_of(part, "Tw", 3, 3) @ gyro_turn
        imu = {"accel": Triad(accel, np.zeros(3)), "gyro": Triad(gyro, np.zeros(3), numbers_of(part, "Tg", 3, 3))}
    return Calibration(noise={**_read_noise(part, _KALIBR), "rate": read_rate(part, "update_rate", options)}, imu=imu)


def vins(calibration: Calibration, options: Options) -> Product:
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
    acc, gyr = (number(noise.values["density", sensor] * scales[other]) for sensor in ("accel", "gyro"))
    scale = {"density": scales[options.convention], "random_walk": scales["per_sample"]}
    units = ("m/s^2", "rad/s", "m/s^3, K*sqrt(rate)", "rad/s^2, K*sqrt(rate)")
    lines = (
        f"# Discrete values for {number(noise.rate)} Hz. Change the rate, change these numbers.",
        f"# acc_n, gyr_n: {readings[options.convention]}.",
        f"# {readings[other][0].upper()}{readings[other][1:]}: acc {acc}, gyr {gyr}",
        *(f"{key}: {number(noise.values[one] * scale[one[0]])}   # {unit}" for (one, key), unit in zip(_VINS.items(), units, strict=True)),
        f"g_norm: {number(options.gravity)}",
        f'imu_topic: "{topic.strip(chr(34))}"',
    )
    return Product("\n".join(lines) + "\n", noise.warnings, noise.facts)


def read_vins(text: str, options: dict[str, Any]) -> Calibration:
    """Read the lines acc_n, gyr_n, acc_w and gyr_w, in the given convention or that of the file."""
    document = parse(text)
    if "acc_n" not in document and ("Acc" in document or "Gyr" in document):
        raise DataError(
            "this is a result of imu_utils, whose acc_w and gyr_w are the lowest point of the Allan curve and no random walk; characterise "
            "the log itself (jaxcal noise)",
            code="unreadable",
        )
    rate = stated(text, r"Discrete values for ([-+.eE\d]+) Hz", options, "the values")
    convention = options["convention"] or ("per_sample" if "plain per-sample standard deviations N*sqrt(rate)." in text else "midpoint")
    if convention not in ("midpoint", "per_sample"):
        raise DataError(
            f'convention={convention!r}: expected "midpoint" (N sqrt(2 rate)) or "per_sample" (N sqrt(rate))', code="unreadable"
        )
    scales = {"density": np.sqrt(2 * rate if convention == "midpoint" else rate), "random_walk": np.sqrt(rate)}
    return Calibration(noise={**_read_noise(document, _VINS, scales), "rate": float(rate)})


def orbslam3(calibration: Calibration, options: Options) -> Product:
    """Write continuous-time noise for ORB-SLAM3, whose loader discretises it with IMU.Frequency."""
    noise = isotropic(calibration, options, "ORB-SLAM3 makes the noise discrete with it")
    lines = (*_lines(noise, _ORBSLAM3), f"IMU.Frequency: {number(noise.rate)}   # Hz")
    mounting = "IMU.T_b_c1 (camera to body), which ORB-SLAM3 needs beside these lines, is not the sensor's and stays yours"
    return Product("\n".join(lines) + "\n", (*noise.warnings, mounting), noise.facts)


def read_orbslam3(text: str, options: dict[str, Any]) -> Calibration:
    """Read the lines IMU.* of a configuration."""
    document = parse(text)
    return Calibration(noise={**_read_noise(document, _ORBSLAM3), "rate": read_rate(document, "IMU.Frequency", options)})


def gtsam(calibration: Calibration, options: Options) -> Product:
    """Write Python code that makes GTSAM's `PreintegrationCombinedParams`; all covariances are continuous-time and per axis."""
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
    parts = {} if calibration.imu is None else calibration.imu.parts
    held = [parts[sensor].covariance if sensor in parts else None for sensor in ("accel", "gyro")]
    blocks = [block for one in held if one is not None and (block := one.of([f"bias[{i}]" for i in range(3)])) is not None]
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
    return Product("\n".join(lines) + "\n", (*accel_said, *gyro_said), (f"accelerometer: {accel}", f"gyroscope: {gyro}"))


def _topic(options: Options) -> str:
    """The topic, in quotes if YAML could misread it."""
    if not _TOPIC.fullmatch(options.topic):
        raise ExportError(f'topic={options.topic!r}: expected the name of a ROS topic, such as "/imu0"', code="option")
    return options.topic if options.topic.startswith("/") else f'"{options.topic}"'


def _lines(noise: Isotropic, names: dict[tuple[str, str], str]) -> list[str]:
    return [f"{key}: {number(noise.values[one])}   # {UNITS[one[0]][one[1]]}" for one, key in names.items()]


def _read_noise(document: dict[str, Any], names: dict[tuple[str, str], str], scales: dict[str, Any] | None = None) -> dict[str, Any]:
    """Noise of both sensors from four keys; the numbers are divided by `scales`, and each is used for all three axes."""
    found = {one: numbers_of(document, key) / (scales or {}).get(one[0], 1.0) for one, key in names.items()}
    return {sensor: stored_noise(sensor, N=[found["density", sensor]] * 3, K=[found["random_walk", sensor]] * 3) for sensor in SENSORS}


def _block(key: str, matrix: AnyArray) -> list[str]:
    return [f"  {key}:", *(f"    - {listed(row)}" for row in matrix)]


def _triangles(accel: AnyArray, gyro: AnyArray, sensitivity: AnyArray, model: str) -> tuple[dict[str, AnyArray], AnyArray, str]:
    """Matrices of an OpenVINS model, the rotation of the IMU's frame, and the name of this rotation.

    "kalibr": lower triangles, in the frame in which the accelerometer's matrix is lower triangular. "rpng": upper triangles, in the frame
    in which the gyroscope's matrix is upper triangular.
    """
    if model == "kalibr":
        ta, turned = factored(accel, "lower")
        tw, gyro_turn = factored(gyro @ turned.T, "lower")
        accel_turn = np.eye(3)
    else:
        tw, turned = factored(gyro, "upper")
        ta, accel_turn = factored(accel @ turned.T, "upper")
        gyro_turn = np.eye(3)
    found = {"Tw": tw, "R_IMUtoGYRO": gyro_turn, "Ta": ta, "R_IMUtoACC": accel_turn, "Tg": rounded(sensitivity @ turned.T)}
    return found, turned, "Qa" if model == "kalibr" else "R'"


def _exact_rotation(turn: AnyArray) -> AnyArray:
    """Find the rotation whose entries round to the given nine digits; else the nearest rotation.

    Nine digits determine a rotation to 5e-10 only, and about one in three entries of the nearest rotation would round to other digits.
    Errors are linear in the three angles of a small rotation, so a linear programme finds the rotation with the smallest largest error.
    """
    u, _, v = np.linalg.svd(turn)
    near = u @ v
    if np.linalg.det(near) < 0 or np.abs(near - turn).max() > 1e-4:
        raise DataError("R_IMUtoACC or R_IMUtoGYRO is no rotation", code="unreadable")
    steps = np.stack([np.cross(np.eye(3)[k], near, axisb=0, axisc=0).ravel() for k in range(3)], axis=1)
    size = np.abs(turn.ravel())
    unit = 10.0 ** (np.ceil(np.log10(np.maximum(size, 1e-13))) - _DIGITS)  # value of the ninth digit
    half = np.where(size < 1e-13, 1e-15, 0.5 * unit)[:, None]  # tiny entries are written as exact zeros
    off, scale = (turn - near).ravel(), 5e-10
    rows = np.vstack([np.hstack([steps, -half / scale]), np.hstack([-steps, -half / scale])])
    found = scipy.optimize.linprog([0, 0, 0, 1.0], A_ub=rows, b_ub=np.concatenate([off, -off]) / scale, bounds=[(None, None)] * 4)
    if not found.success or not np.any(found.x[:3]):
        return near
    angles = found.x[:3] * scale
    size = np.linalg.norm(angles)
    cross = np.cross(np.eye(3), angles / size)
    return (np.eye(3) + np.sin(size) * cross + (1 - np.cos(size)) * cross @ cross) @ near
