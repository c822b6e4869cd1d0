"""A turntable by NumPy and SciPy alone: nothing of the package. Noise of a whole test, its means over the rests, and raw logs."""

import numpy as np
from scipy.signal import fftconvolve
from scipy.spatial.transform import Rotation

DEG, EARTH, G = np.pi / 180, 7.292115e-5, 9.80665
LATITUDE = 35 * DEG

#: N, B, K, SI: a gyro of 0.002 deg/sqrt(h), 0.02 deg/h, 0.1 deg/h/sqrt(h), an accelerometer of 50 micro-g sqrt(s), 10 micro-g
GYRO = np.array([0.002 * DEG / 60, 0.02 * DEG / 3600, 0.1 * DEG / 3600 / 60])
ACCEL = np.array([50e-6 * G, 10e-6 * G, 5e-7 * G])
#: which of N, B and K there is
NOISES = {"white": np.array([1, 0, 0]), "N+B": np.array([1, 1, 0]), "N+B+K": np.array([1, 1, 1])}
#: table angles in degrees, and the time on each in s
PLANS = {
    "4 x 120 s": ([0, 90, 180, 270], 120.0), "8 mirrored x 60 s": ([0, 90, 180, 270, 270, 180, 90, 0], 60.0),
    "4 x 600 s": ([0, 90, 180, 270], 600.0),
}  # fmt: skip
MOVE = 8.0  # s between rests


def noise(rng, coefficients, shape, dt):
    """Samples of N, B and K, time last. Flicker by the filter of Kasdin (Proc. IEEE 83, 1995, 802), begun eight records earlier."""
    white, flicker, walk = coefficients
    n = shape[-1]
    made = white / np.sqrt(dt) * rng.normal(size=shape)
    if flicker:
        taps = np.cumprod(np.concatenate([[1.0], 1 - 0.5 / np.arange(1.0, 9 * n)]))
        made += (
            flicker
            * fftconvolve(rng.normal(size=(*shape[:-1], 9 * n)), np.broadcast_to(taps, (*shape[:-1], 9 * n)), axes=-1)[..., 8 * n : 9 * n]
        )
    if walk:
        made += walk * np.sqrt(dt) * np.cumsum(rng.normal(size=shape), axis=-1)
    return made


def vectors(attitude, angle):
    """Specific force and Earth's rate in axes that turn with the table, (..., 3), for roll, pitch and azimuth and table angles."""
    phi, theta, psi = attitude
    nav = Rotation.from_euler("ZYX", [psi, theta, phi])  # table axes in north, east, down
    body = nav * Rotation.from_rotvec(np.multiply.outer(angle, [0.0, 0.0, 1.0]))
    return body.inv().apply([0.0, 0.0, -G]), body.inv().apply([EARTH * np.cos(LATITUDE), 0.0, -EARTH * np.sin(LATITUDE)])


def tables(rng, runs, plan, kind, attitude, bias=(1e-3, 2e-7), dt=1.0):
    """Angles, starts, dwell, and means (runs, n) of accelerometer and gyro over the rests of `runs` tests with noise of a kind."""
    angles, dwell = PLANS[plan]
    angle = np.array(angles) * DEG
    start = np.arange(len(angle)) * (dwell + MOVE)
    count, step = round(dwell / dt), round((dwell + MOVE) / dt)
    force, rate = (vector[:, 0] for vector in vectors(attitude, angle))
    means = []
    for ideal, offset, coefficients in ((force, bias[0], ACCEL), (rate, bias[1], GYRO)):
        samples = noise(rng, coefficients * NOISES[kind], (runs, step * len(angle)), dt)
        means.append(ideal + offset + samples.reshape(runs, len(angle), step)[:, :, :count].mean(axis=2))
    return angle, start, dwell, *means
