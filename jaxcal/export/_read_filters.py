"""Readers of the files of visual-inertial estimators: noise, and the matrices of Kalibr and OpenVINS."""

import re
from typing import Any

import numpy as np

from .._errors import DataError
from .._types import AnyArray
from .._units import si_unit
from ..calibration import Calibration
from ..imu import Triad
from ..magnetometer import MagModel
from ._rounded import exact_rotation
from ._yaml import parse

_AGAIN = "give rate= (Hz), the rate of the sensor"


def kalibr(text: str, options: dict[str, Any]) -> Calibration:
    """`imu.yaml`, or the result of Kalibr's calibration, whose matrices are read as well."""
    document = parse(text)
    if "imu0" not in document:
        return Calibration(noise=_continuous(document, options))
    part = _mapping(document, "imu0")
    imu = None
    if "accelerometers" in part and "gyroscopes" in part:
        accel, gyro = _mapping(part, "accelerometers"), _mapping(part, "gyroscopes")
        turn = _matrix(gyro, "C_gyro_i") if "C_gyro_i" in gyro else np.eye(3)
        sensitivity = _matrix(gyro, "A") @ turn if "A" in gyro else np.zeros((3, 3))
        imu = {"accel": Triad(_matrix(accel, "M"), np.zeros(3)), "gyro": Triad(_matrix(gyro, "M") @ turn, np.zeros(3), sensitivity)}
    return Calibration(noise=_continuous(part, options), imu=imu)


def openvins(text: str, options: dict[str, Any]) -> Calibration:
    """`kalibr_imu_chain.yaml`; biases, which it does not hold, are zero, and the frame is the file's IMU frame."""
    part = _mapping(parse(text), "imu0")
    imu = None
    if "Ta" in part or "Tw" in part:
        turns = {key: exact_rotation(_matrix(part, key)) for key in ("R_IMUtoACC", "R_IMUtoGYRO")}
        accel, gyro = _matrix(part, "Ta") @ turns["R_IMUtoACC"], _matrix(part, "Tw") @ turns["R_IMUtoGYRO"]
        imu = {"accel": Triad(accel, np.zeros(3)), "gyro": Triad(gyro, np.zeros(3), _matrix(part, "Tg"))}
    return Calibration(noise=_continuous(part, options), imu=imu)


def orbslam3(text: str, options: dict[str, Any]) -> Calibration:
    """The lines IMU.* of a configuration."""
    names = {
        "accelerometer_noise_density": "IMU.NoiseAcc", "accelerometer_random_walk": "IMU.AccWalk",
        "gyroscope_noise_density": "IMU.NoiseGyro",
        "gyroscope_random_walk": "IMU.GyroWalk", "update_rate": "IMU.Frequency",
    }  # fmt: skip
    document = parse(text)
    found = {ours: _number(document, theirs) for ours, theirs in names.items() if theirs != "IMU.Frequency" or theirs in document}
    return Calibration(noise=_continuous(found, options))


def vins(text: str, options: dict[str, Any]) -> Calibration:
    """The lines acc_n, gyr_n, acc_w and gyr_w, in the reading of their convention that is given."""
    document = parse(text)
    if "acc_n" not in document and ("Acc" in document or "Gyr" in document):
        raise DataError(
            "this is a result of imu_utils, whose acc_w and gyr_w are the lowest point of the Allan curve and no random walk; characterise "
            "the log itself (jaxcal noise)"
        )
    rate = options["rate"] or _stated(text, r"Discrete values for ([-+.eE\d]+) Hz")
    if rate is None:
        raise DataError(f"the values are per sample, and the file does not say of which rate; {_AGAIN}")
    convention = options["convention"] or ("per_sample" if "plain per-sample standard deviations N*sqrt(rate)." in text else "midpoint")
    if convention not in ("midpoint", "per_sample"):
        raise DataError(f'convention={convention!r}: expected "midpoint" (N sqrt(2 rate)) or "per_sample" (N sqrt(rate))')
    scale = np.sqrt(2 * rate if convention == "midpoint" else rate)
    found = {
        "accelerometer_noise_density": _number(document, "acc_n") / scale, "gyroscope_noise_density": _number(document, "gyr_n") / scale,
        "accelerometer_random_walk": _number(document, "acc_w") / np.sqrt(rate),
        "gyroscope_random_walk": _number(document, "gyr_w") / np.sqrt(rate), "update_rate": rate,
    }  # fmt: skip
    return Calibration(noise=_continuous(found, options))


def ros(text: str, options: dict[str, Any]) -> Calibration:
    """Any of the flavours that `write` knows, told apart by their keys."""
    document = parse(text)
    if "SM" in document:
        return Calibration(imu={"accel": _after_matrix(_matrix(document, "SM"), _vector(document, "bias"))})
    if "dlio" in document:
        inner = _mapping(_mapping(_mapping(document, "dlio"), "imu"), "intrinsics")
        accel, gyro = _mapping(inner, "accel"), _mapping(inner, "gyro")
        accel = _after_matrix(_matrix(accel, "sm"), _vector(accel, "bias"))
        return Calibration(imu={"accel": accel, "gyro": Triad(np.eye(3), _vector(gyro, "bias"))})
    if "mag_bias_x" in document:
        bias = np.array([_number(document, f"mag_bias_{axis}") for axis in "xyz"])
        return Calibration(magnetometer=MagModel(np.eye(3), bias))
    if "/**" in document:
        return _ros2(_mapping(_mapping(document, "/**"), "ros__parameters"), text, options)
    raise DataError("the file has none of the keys SM, dlio, mag_bias_x and /**, by which a calibration for ROS is known")


def _ros2(found: dict[str, Any], text: str, options: dict[str, Any]) -> Calibration:
    def held(name: str) -> tuple[AnyArray, AnyArray]:
        return inverse(_matrix(found, f"{name}_matrix")), _vector(found, f"{name}_bias")

    imu = {"accel": Triad(*held("accel"))} if "accel_matrix" in found else {}
    if "gyro_matrix" in found:
        imu["gyro"] = Triad(*held("gyro"), _matrix(found, "gyro_g_sensitivity"))
    mag = MagModel(*held("mag")) if "mag_matrix" in found else None
    noise: dict[str, Any] = {}
    for sensor, key in (("gyro", "angular_velocity_covariance"), ("accel", "linear_acceleration_covariance")):
        if key in found:
            rate = options["rate"] or _stated(text, r"per sample at ([-+.eE\d]+) Hz")
            if rate is None:
                raise DataError(f"the covariances are per sample, and the file does not say of which rate; {_AGAIN}")
            n = np.sqrt(np.abs(np.diag(_matrix(found, key))) / rate)
            noise |= {"rate": rate, sensor: {"unit": si_unit(sensor), "Q": None, "N": n, "B": None, "K": None, "R": None}}
    return Calibration(imu=imu or None, magnetometer=mag, noise=noise or None)


def inverse(matrix: AnyArray) -> AnyArray:
    """Forward matrix of a correction.

    Raises
    ------
    DataError
        If it has no inverse.
    """
    try:
        return np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        raise DataError("a matrix of the file has no inverse") from None


def _after_matrix(correction: AnyArray, bias: AnyArray) -> Triad:
    """An accelerometer whose bias is subtracted after the matrix."""
    matrix = inverse(correction)
    return Triad(matrix, matrix @ bias)


def _continuous(found: dict[str, Any], options: dict[str, Any]) -> dict[str, Any]:
    """Noise section of Kalibr's five keys; the one number stands for all three axes."""
    rate = options["rate"] or (_number(found, "update_rate") if "update_rate" in found else None)
    if rate is None:
        raise DataError(f"the file does not say the rate; {_AGAIN}")
    noise: dict[str, Any] = {"rate": float(rate)}
    for sensor, name in (("gyro", "gyroscope"), ("accel", "accelerometer")):
        n, k = (_number(found, f"{name}_{quantity}") for quantity in ("noise_density", "random_walk"))
        noise[sensor] = {"unit": si_unit(sensor), "Q": None, "N": [n] * 3, "B": None, "K": [k] * 3, "R": None}
    return noise


def _stated(text: str, pattern: str) -> float | None:
    found = re.search(pattern, text)
    try:
        value = float(found[1]) if found else 0.0
    except ValueError:
        return None
    return value if 0 < value < np.inf else None


def _mapping(found: dict[str, Any], key: str) -> dict[str, Any]:
    value = found.get(key)
    if not isinstance(value, dict):
        raise DataError(f"{key} is {'missing' if value is None else 'no mapping'}; expected keys below it")
    return value


def _number(found: dict[str, Any], key: str) -> float:
    return float(_array(found, key, 1)[0])


def _vector(found: dict[str, Any], key: str) -> AnyArray:
    return _array(found, key, 3)


def _matrix(found: dict[str, Any], key: str) -> AnyArray:
    return _array(found, key, 9).reshape(3, 3)


def _array(found: dict[str, Any], key: str, size: int) -> AnyArray:
    value = found.get(key)
    rows = value if isinstance(value, list) else [value]
    flat: list[Any] = [item for row in rows for item in (row if isinstance(row, list) else [row])]
    try:
        # YAML takes 1e-3, without a point, for a word
        values = np.array([float("nan") if isinstance(item, bool) else float(item) for item in flat])
    except (TypeError, ValueError, OverflowError):
        values = np.array([])
    if len(values) != size or not np.all(np.abs(values) < 1e15):
        expected = f"{size} numbers" if size > 1 else "a number"
        raise DataError(f"{key} is {'missing' if value is None else repr(value)[:80]}; expected {expected}")
    return values
