"""Simulated recordings of a device that a hand waves, with known truth."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from .._arrays import from_vector
from .._errors import DataError
from .._log import Log
from .._precision import host_float64
from .._types import Numbers, Seed
from .._units import STANDARD_GRAVITY
from ..imu import Triad
from ..imu._simulate import NOISE, noisy
from ..magnetometer import MagModel
from ._hand import BETWEEN, DRIFT, Hand, HandMotion, Pauses
from ._model import DeviceModel

_TURNS = ("free", "one axis", "no tilt")


def random_device(seed: Seed, *, field: float = 50e-6) -> DeviceModel:
    """Draw a consumer MEMS device: scale errors of 1 %, misalignments of half a degree, and typical biases.

    Parameters
    ----------
    seed : seed of the device, or a NumPy generator.
    field : magnitude of the Earth's field, T.

    Returns
    -------
    DeviceModel
        Standard deviations: accelerometer bias 30 mg, gyroscope bias 1 deg/s, soft iron 5 %. The hard iron is half the field in a random
        direction. Delays are uniform within 20 ms. The determinant of the soft iron is 1.

    Examples
    --------
    >>> from jaxcal.device import random_device
    >>> float(random_device(1).gyro_delay) < 0.02
    True
    """
    rng = np.random.default_rng(seed)
    accel = np.eye(3) + np.triu(rng.normal(size=(3, 3))) * np.where(np.eye(3), 0.01, 0.009)
    gyro = np.eye(3) + rng.normal(size=(3, 3)) * np.where(np.eye(3), 0.01, 0.009)
    half = 0.05 * rng.normal(size=(3, 3))
    soft_iron = (np.eye(3) + (half + half.T) / 2) @ from_vector(np.deg2rad(2.0) * rng.normal(size=3))
    size = np.cbrt(np.linalg.det(soft_iron))
    direction = rng.normal(size=3)
    hard_iron = 0.5 * field * size * direction / np.linalg.norm(direction)
    biases = 0.03 * STANDARD_GRAVITY * rng.normal(size=3), np.deg2rad(1.0) * rng.normal(size=3)
    dip, early, late = rng.uniform(np.deg2rad(30.0), np.deg2rad(72.0)), rng.uniform(-0.02, 0.02), rng.uniform(-0.02, 0.02)
    return DeviceModel(
        Triad(accel, biases[0]), Triad(gyro, biases[1]), MagModel(soft_iron / size, hard_iron), field * size, dip, early, late
    )


@host_float64
def simulate(
    duration: float | int = 180.0, rate: float | int = 100.0, *, seed: int, rests: int = 0, still: float | int = 4.0,
    initial: float | int = 0.0, held: bool = False, turns: str = "free", reach: float | int = 0.25, swing: float | int = 1.0,
    tremor: float | int = 5e-5, arm: Numbers = (0.0, 0.0, 0.0), model: DeviceModel | None = None, noise: Mapping[str, Any] | None = None,
    gradient: float | int = 0.0, iron: tuple[float, float, float] | None = None,
) -> tuple[Log, DeviceModel, HandMotion]:  # fmt: skip
    """Simulate a recording of a device that a hand waves within its reach.

    Position and angles are Gaussian signals with spectral density (1 + (f / corner)^2)^-3, like a Matern process of order 5/2. They are
    sums of sinusoids; rates and accelerations are their derivatives in closed form, so nothing is integrated numerically. Each sensor
    reads the motion at its own time: the time stamp minus its delay.

    Parameters
    ----------
    duration : s. rate : Hz, of all sensors.
    seed : seed of the device, the motion and the noise.
    rests : number of rests within the recording. still : length of each, s. initial : length of a rest at its beginning, s; 0 for none.
    held : whether a hand holds the device in the rests, with tremor and slow drift. Otherwise it lies exactly still on a table.
    turns : "free", through all attitudes; "one axis", about an axis fixed in the device; "no tilt", about the vertical, device level.
    reach : m, standard deviation of the position along each axis.
    swing : rad/s, root mean square rate about each axis of "free".
    tremor : m, root mean square displacement between 8 and 12 Hz along each axis. The angles of the tremor are this over 0.1 m.
    arm : (3,) m, position of the device relative to the point about which the hand rotates it, in device axes. This point has the `reach`.
    model : the device; None for `random_device` with this seed.
    noise : {"accel": N, "gyro": N, "mag": N}, white noise in m/s/sqrt(s), rad/sqrt(s) and T sqrt(s), or a `jaxcal.noise.Noise` for each;
        a sensor that is not named has 120 ug/sqrt(Hz), 0.007 deg/s/sqrt(Hz), both two-sided as `Noise.N`, or 0.5 % of the field a reading.
    gradient : change of the field per metre, as a fraction of the field (Frobenius norm of the gradient), without curl or divergence.
    iron : (start, end, strength): times in s between which the device is beside iron, and the largest field of the iron, as a fraction of
        the Earth's field.

    Returns
    -------
    log : Log
        Readings of the three sensors, in rad/s, m/s^2 and the unit of the model's field (T).
    model : DeviceModel
        The true device.
    motion : HandMotion
        The true motion at the stamps.

    Raises
    ------
    DataError
        For lengths, rates or densities that are not positive, unknown turns, or rests that do not fit the recording.

    Examples
    --------
    >>> import jaxcal
    >>> log, model, motion = jaxcal.device.simulate(30.0, seed=1)
    >>> log.accel.shape, motion.attitude.shape
    ((3000, 3), (3000, 3, 3))

    References
    ----------
    Hand tremor of 8 to 12 Hz: Elble and Koller, Tremor, 1990.
    """
    positive = {"duration": duration, "rate": rate, "still": still, "swing": swing}
    bad = [f"{name}={value}" for name, value in positive.items() if not 0 < value < np.inf]
    rest = {"initial": initial, "reach": reach, "tremor": tremor, "gradient": gradient, "rests": rests}
    bad += [f"{name}={value}" for name, value in rest.items() if not 0 <= value < np.inf]
    if bad:
        raise DataError(f"{', '.join(bad)}: expected {', '.join(positive)} above 0, and {', '.join(rest)} of 0 or more")
    if np.shape(arm) != (3,) or not np.isfinite(arm).all():
        raise DataError(f"arm={arm}: expected three finite lengths in m")
    if turns not in _TURNS:
        raise DataError(f"turns={turns!r}: expected one of {', '.join(map(repr, _TURNS))}")
    count = round(float(duration) * rate)
    if count < 2:
        raise DataError(f"duration={duration} s at rate={rate} Hz is {count} samples: expected 2 or more")

    numbers = {name: np.random.default_rng([seed, i]) for i, name in enumerate(("device", "path", "field"))}
    device = random_device(numbers["device"]) if model is None else model
    pauses = _pauses(numbers["path"], float(duration), int(rests), float(still), float(initial), 1 - DRIFT if held else 1.0)
    hand = Hand(
        numbers["path"], pauses, turns=turns, reach=float(reach), swing=float(swing), tremor=float(tremor), held=held,
        arm=np.asarray(arm, dtype=float),
    )  # fmt: skip
    time = np.arange(count) / float(rate)
    true = hand.at(time)
    late = hand.at(time - float(device.gyro_delay))
    turned = hand.at(time - float(device.mag_delay))
    field = np.asarray(device.world_field)
    change = _gradient(numbers["field"]) * float(gradient) * np.linalg.norm(field)
    beside = numbers["field"].normal(size=3)
    outside = field + turned.position @ change.T
    if iron is not None:
        outside = outside + _bump(turned.time, *iron) * np.linalg.norm(field) * beside / np.linalg.norm(beside)
    inside = np.einsum("nji,nj->ni", turned.attitude, outside)
    readings = {
        "accel": device.accel.measure(_at_elements(true, np.asarray(device.lever))),
        "gyro": device.gyro.measure(late.rate, late.force),
        "mag": inside @ np.asarray(device.magnetometer.soft_iron).T + np.asarray(device.magnetometer.hard_iron),
    }
    # the density of the magnetometer gives its standard deviation at this rate
    known = {**NOISE, "mag": NOISE["mag"] * np.linalg.norm(field) / np.sqrt(float(rate)), **(noise or {})}
    return noisy(readings, known, float(rate), seed, 3), device, true


def _at_elements(true: HandMotion, lever: np.ndarray) -> np.ndarray:
    """(n, 3) specific force, of y and z at the positions of their sensing elements."""
    force = true.force.copy()
    for axis, arm in enumerate(lever, start=1):
        if arm.any():
            w = true.rate
            force[:, axis] += (np.cross(true.angular_acceleration, arm) + np.cross(w, np.cross(w, arm)))[:, axis]
    return force


def _gradient(rng: np.random.Generator) -> np.ndarray:
    """A symmetric matrix with trace 0 and Frobenius norm 1: a static field in air has neither curl nor divergence."""
    matrix = rng.normal(size=(3, 3))
    matrix = matrix + matrix.T
    matrix -= np.trace(matrix) / 3 * np.eye(3)
    return matrix / np.linalg.norm(matrix)


def _bump(time: np.ndarray, start: float, end: float, strength: float) -> np.ndarray:
    """(n, 1) strength of a field that rises and falls smoothly between two times."""
    if not (end > start and np.isfinite([start, end, strength]).all()):
        raise DataError(f"iron=({start}, {end}, {strength}): expected a start, a later end in s, and a strength as a part of the field")
    u = np.clip((time - start) / (end - start), 0, 1)
    return (strength * np.sin(np.pi * u) ** 2)[:, None]


def _pauses(rng: np.random.Generator, duration: float, rests: int, still: float, initial: float, depth: float) -> Pauses:
    """Rests spread over the recording at equal steps, with random offsets."""
    share = (duration - initial) / max(rests, 1)
    spare = share - still - BETWEEN
    if initial > duration or (rests and spare < 0):
        said = f"{rests} rests of {still:g} s and {initial:g} s at first, with {BETWEEN:g} s between them, do not fit in {duration:g} s"
        raise DataError(f"{said}: expected fewer or shorter rests, or a longer recording")
    starts = initial + BETWEEN / 2 + share * np.arange(rests) + spare * rng.uniform(0.2, 0.8, rests) * (rests > 0)
    first = np.array([-10.0]) if initial > 0 else np.empty(0)
    return Pauses(np.concatenate([first, starts]), np.concatenate([first + 10.0 + initial, starts + still]), depth)
