"""Kalibr's `imu.yaml`: https://github.com/ethz-asl/kalibr/wiki/IMU-Noise-Model."""

import re

from .._errors import ExportError
from ..calibration import Calibration
from ._isotropic import isotropic, noise_of
from ._options import UNITS, Options
from ._text import comment, number

#: what a name may hold; between quotes these characters need no escape
_TOPIC = re.compile(r"[A-Za-z~/][A-Za-z0-9_~/]*")


def kalibr(calibration: Calibration, options: Options) -> tuple[str, tuple[str, ...]]:
    """Text of the file, and warnings."""
    if not _TOPIC.fullmatch(options.topic):
        raise ExportError(f'topic={options.topic!r}: expected the name of a ROS topic, such as "/imu0"')
    noise = noise_of(calibration)
    gyro, accel = isotropic(noise, "gyro", options), isotropic(noise, "accel", options)
    rate = number(noise.rate)
    lines = (
        comment(f"Accelerometer: {accel.about}"),
        f"accelerometer_noise_density: {number(accel.density)}   # {UNITS['density']['accel']}",
        f"accelerometer_random_walk: {number(accel.random_walk)}   # {UNITS['random_walk']['accel']}",
        comment(f"Gyroscope: {gyro.about}"),
        f"gyroscope_noise_density: {number(gyro.density)}   # {UNITS['density']['gyro']}",
        f"gyroscope_random_walk: {number(gyro.random_walk)}   # {UNITS['random_walk']['gyro']}",
        f"rostopic: {options.topic}" if options.topic.startswith("/") else f'rostopic: "{options.topic}"',
        f"update_rate: {rate}   # Hz",
    )
    warnings = [*accel.warnings, *gyro.warnings, f"update_rate is {rate} Hz, the rate of the log; Kalibr needs the true rate of the sensor"]
    if calibration.imu or calibration.temperature:
        warnings.append("Kalibr takes noise alone and estimates its own biases and matrices; those of this calibration are not written")
    return "\n".join(lines) + "\n", tuple(warnings)
