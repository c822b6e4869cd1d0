"""A calibration of a device with random parameters in all sections, whose matrices mix the axes."""

import numpy as np

from jaxcal import Calibration


def made(seed, **sections):
    """The calibration of a seed; `sections` replace its own."""
    draw = np.random.default_rng(seed)

    def near(size):
        return np.eye(3) + size * draw.standard_normal((3, 3))

    noise = {"rate": float(draw.uniform(20, 2000))}
    for sensor, unit, n in (("gyro", "rad/s", 1e-4), ("accel", "m/s^2", 1e-3)):
        own = {"N": n * draw.uniform(1, 2, 3), "K": n * draw.uniform(0.01, 0.02, 3)}
        noise[sensor] = {"unit": unit, **dict.fromkeys("QBR"), **own}
    imu = {
        "accel": {"unit": "m/s^2", "matrix": near(0.02), "bias": 0.3 * draw.standard_normal(3), "covariance": None},
        "gyro": {"unit": "rad/s", "matrix": near(0.02), "bias": 0.02 * draw.standard_normal(3), "covariance": None,
                 "g_sensitivity": 1e-4 * draw.standard_normal((3, 3))},
    }  # fmt: skip
    mag = {"unit": "T", "soft_iron": near(0.1), "hard_iron": 3e-5 * draw.standard_normal(3), "field": 5e-5, "covariance": None}
    powers = np.array([1e-3, 1e-5, 1e-7])
    temperature = {"unit": "degC", "reference": 35.0, "minimum": -10.0, "maximum": 61.25, "accel": powers * draw.standard_normal((3, 3)),
                   "gyro": 0.01 * powers * draw.standard_normal((3, 3))}  # fmt: skip
    ids = {"px4": {"accel_id": 7, "gyro_id": 8, "mag_id": 9}, "ardupilot": {"accel_id": 10, "compass_id": 11}}
    device = {"name": "made", **ids}
    return Calibration(**({"noise": noise, "imu": imu, "magnetometer": mag, "temperature": temperature, "device": device} | sections))
