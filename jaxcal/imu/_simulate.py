"""Simulated recordings and readings of sensors with known parameters."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._log import Log
from .._precision import host_float64
from .._types import Numbers
from .._units import STANDARD_GRAVITY
from ._known import checked_gravity
from ._model import EARTH_RATE, Imu, Triad
from ._observability import PLACES

#: a typical MEMS unit
MEMS = Imu(
    Triad(np.array([[1.012, 0.004, -0.006], [0.0, 0.991, 0.009], [0.0, 0.0, 1.005]]), np.array([0.12, -0.08, 0.2])),
    Triad(
        np.array([[0.993, 0.006, 0.003], [-0.005, 1.008, -0.004], [0.002, 0.007, 1.011]]), np.array([0.004, -0.006, 0.002]),
        np.array([[3e-5, -1e-5, 2e-5], [1e-5, -4e-5, 0.5e-5], [-2e-5, 1e-5, 2e-5]]),
    ),
)  # fmt: skip
#: its white noise: accelerometer (120 ug/sqrt(Hz)) in m/s/sqrt(s), gyroscope (0.007 deg/s/sqrt(Hz)) in rad/sqrt(s), and standard deviation
#: of a reading of a magnetometer, as a part of the field
NOISE = {"accel": 120e-6 * STANDARD_GRAVITY, "gyro": np.deg2rad(0.007), "mag": 0.005}


def attitudes(poses: int = 24, seed: Any = 0) -> np.ndarray:
    """Attitudes for a calibration by hand: faces, edges and corners of the case in random order, each with an error of some degrees.

    Parameters
    ----------
    poses : number of attitudes; above 26, faces, edges and corners repeat.
    seed : seed of the order and the errors, or a NumPy generator.

    Returns
    -------
    (poses, 3) unit vectors, the upward direction in body axes.
    """
    rng = np.random.default_rng(seed)
    places = PLACES[np.argsort(np.count_nonzero(PLACES, axis=1), kind="stable")]
    chosen = places[np.arange(poses) % len(places)] + 0.12 * rng.normal(size=(poses, 3))
    return rng.permutation(chosen / np.linalg.norm(chosen, axis=1, keepdims=True))


def _attitude_with(up: np.ndarray, heading: float) -> np.ndarray:
    """Rotation matrix C_nb (from body axes to north, west, up) with the given upward direction in body axes."""
    aside = np.eye(3)[np.argmin(np.abs(up))]
    first = np.cross(aside, up)
    first /= np.linalg.norm(first)
    level = np.stack([first, np.cross(up, first), up])
    c, s = np.cos(heading), np.sin(heading)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ level


@host_float64
def simulate(
    poses: int = 24, *, rate: float | int = 100.0, initial: float | int = 30.0, still: float | int = 4.0, turn: float | int = 3.0,
    accel: Triad = MEMS.accel, gyro: Triad = MEMS.gyro, noise: Mapping[str, Any] | None = None, gravity: float | int = 9.81,
    latitude: float | None = None, up: Numbers | None = None, motion: int | None = None, seed: int = 0,
) -> Log:  # fmt: skip
    """Simulate a recording for `multi_position`: an initial rest, then still poses with smooth turns between them.

    Every turn is about an axis fixed in the body; its rate and acceleration are zero at both ends. The sensor sits in the centre of
    rotation. Rates and forces are exact.

    Parameters
    ----------
    poses : number of still intervals, including the initial rest.
    rate : Hz. initial, still, turn : length of the initial rest, of the other rests and of the turns, s.
    accel, gyro : `Triad`s of the sensors, or subclasses; the default is `jaxcal.imu.MEMS`.
    noise : {"accel": N, "gyro": N}, white noise in m/s/sqrt(s) and rad/sqrt(s), or a `jaxcal.noise.Noise` for each; a sensor that is not
        named has that of a typical MEMS unit.
    gravity : m/s^2.
    latitude : rad, to add the Earth's rate; None leaves it out.
    up : (poses, 3) upward directions in body axes; None for faces, edges and corners, each with an error of some degrees.
    motion : seed of poses and headings, for several recordings of the same motion; None uses `seed`.
    seed : seed of the noise.

    Returns
    -------
    Log
        In the unit of the readings: m/s^2 and rad/s if the matrices are near the identity.

    Raises
    ------
    DataError
        If there are fewer than 2 poses, or a length is not positive.

    Examples
    --------
    >>> from jaxcal.imu import simulate
    >>> log = simulate(poses=12, still=3.0, turn=2.0)
    >>> f"{log.duration:.0f} s at {log.rate:g} Hz"
    '85 s at 100 Hz'
    """
    if poses < 2 or not all(np.isfinite(x) and x > 0 for x in (rate, initial, still, turn)):
        said = f"poses={poses}, rate={rate}, initial={initial}, still={still}, turn={turn}: expected 2 poses or more, and lengths above 0"
        raise DataError(said)
    rng = np.random.default_rng([seed if motion is None else motion, 0])
    size = checked_gravity(gravity)
    directions = attitudes(poses, rng) if up is None else np.asarray(up, dtype=float)
    if directions.shape != (poses, 3):
        raise DataError(f"up has shape {directions.shape}; expected ({poses}, 3)")
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    held = [_attitude_with(u, h) for u, h in zip(directions, rng.uniform(0, 2 * np.pi, poses), strict=True)]
    rest, moving = round(float(still) * rate), round(float(turn) * rate)
    body, rates = [], []
    for i, attitude in enumerate(held):
        samples = round(float(initial) * rate) if i == 0 else rest
        body.append(np.broadcast_to(attitude, (samples, 3, 3)))
        rates.append(np.zeros((samples, 3)))
        if i + 1 < poses:
            vector = scipy.spatial.transform.Rotation.from_matrix(attitude.T @ held[i + 1]).as_rotvec()
            x = (np.arange(moving) + 1) / (moving + 1)
            part, speed = x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2 * rate / (moving + 1)
            body.append(attitude @ scipy.spatial.transform.Rotation.from_rotvec(part[:, None] * vector).as_matrix())
            rates.append(speed[:, None] * vector)
    c_nb, w = np.concatenate(body), np.concatenate(rates)
    force = size * c_nb[:, 2, :]
    if latitude is not None:
        w = w + EARTH_RATE * (np.cos(latitude) * c_nb[:, 0, :] + np.sin(latitude) * c_nb[:, 2, :])
    readings = {"accel": accel.measure(force), "gyro": gyro.measure(w, force)}
    return noisy(readings, {**NOISE, **(noise or {})}, float(rate), seed, 1)


def noisy(readings: dict[str, Any], noise: dict[str, Any], rate: float, seed: int, stream: int) -> Log:
    """A log of exact readings (n, 3) of each sensor with its noise: a white noise N, or a `jaxcal.noise.Noise`.

    `stream` separates the random numbers of this noise from others of the same seed.
    """
    rng, seen = np.random.default_rng([seed, stream]), {}
    for sensor, exact in readings.items():
        own, exact = noise[sensor], np.asarray(exact)
        if hasattr(own, "simulate"):
            seen[sensor] = exact + np.stack([own.simulate(len(exact), rate, seed=rng) for _ in range(3)], axis=1)
        elif 0 <= own < np.inf:
            seen[sensor] = exact + float(own) * np.sqrt(rate) * rng.normal(size=exact.shape)
        else:
            raise DataError(f"noise of {sensor} is {own}: expected a number of 0 or more, or a jaxcal.noise.Noise", code="noise")
    return Log(None, **seen, rate=rate, provenance={"simulated": True, "seed": seed})
