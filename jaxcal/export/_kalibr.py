"""Kalibr's `imu.yaml`: https://github.com/ethz-asl/kalibr/wiki/IMU-Noise-Model."""

import re

from .._errors import ExportError
from ..calibration import Calibration
from ._isotropic import isotropic, noise_of, rate_of
from ._options import UNITS, Options, Product
from ._text import comment, number

#: what a name may hold; between quotes these characters need no escape
_TOPIC = re.compile(r"[A-Za-z~/][A-Za-z0-9_~/]*")


def topic_of(options: Options) -> str:
    """The topic, quoted where YAML would take it for something else."""
    if not _TOPIC.fullmatch(options.topic):
        raise ExportError(f'topic={options.topic!r}: expected the name of a ROS topic, such as "/imu0"')
    return options.topic if options.topic.startswith("/") else f'"{options.topic}"'


def kalibr(calibration: Calibration, options: Options) -> Product:
    """Continuous-time noise and the rate by which Kalibr makes it discrete."""
    topic = topic_of(options)
    noise = noise_of(calibration)
    gyro, accel = isotropic(noise, "gyro", options), isotropic(noise, "accel", options)
    rate, warnings = rate_of(noise, calibration, options, "Kalibr makes the noise discrete with it")
    lines = (
        comment(f"Accelerometer: {accel.about}"),
        f"accelerometer_noise_density: {number(accel.density)}   # {UNITS['density']['accel']}",
        f"accelerometer_random_walk: {number(accel.random_walk)}   # {UNITS['random_walk']['accel']}",
        comment(f"Gyroscope: {gyro.about}"),
        f"gyroscope_noise_density: {number(gyro.density)}   # {UNITS['density']['gyro']}",
        f"gyroscope_random_walk: {number(gyro.random_walk)}   # {UNITS['random_walk']['gyro']}",
        f"rostopic: {topic}",
        f"update_rate: {number(rate)}   # Hz",
    )
    return Product("\n".join(lines) + "\n", (*accel.warnings, *gyro.warnings, *warnings))
