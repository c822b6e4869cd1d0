"""`jaxcal simulate imu`: a log of a sensor held still in many poses."""

import math
from pathlib import Path

from .._units import STANDARD_GRAVITY
from ._options import CallError, Running
from ._outputs import staged
from ._screen import Screen, progress, show_written
from ._simulate import LARGEST, SUFFIXES, noise_from_text, save_log


def simulate_imu(
    *,
    out: Path,
    rate: float = 100.0,
    poses: int = 24,
    still: float = 4.0,
    turn: float = 3.0,
    initial: float = 30.0,
    gyro: str | None = None,
    accel: str | None = None,
    latitude: float | None = None,
    running: Running = Running(),
) -> None:
    """A log of a sensor held still in many poses, with turns between them.

    Scale factors, misalignment, biases and g-sensitivity are those of a
    common MEMS unit (jaxcal.imu.simulate shows them).

    Parameters
    ----------
    out
        File to write: FILE.csv or FILE.npz, in SI units.
    rate
        Sampling rate in Hz.
    poses
        Number of poses.
    still
        Length of each pose in s.
    turn
        Length of each turn in s.
    initial
        Length of the rest at the beginning in s.
    gyro
        Noise of each gyroscope axis, as for simulate noise.
    accel
        Noise of each accelerometer axis.
    latitude
        Latitude in degrees, to add the Earth's rate and take gravity there.
    """
    if out.suffix not in SUFFIXES:
        raise CallError(f"--out {out}: expected a name that ends in {' or '.join(SUFFIXES)}")
    if poses < 2 or not all(0.0 < x < float("inf") for x in (rate, still, turn, initial)):
        raise CallError("--poses, --rate, --still, --turn, --initial: expected 2 poses or more, and positive numbers")
    if latitude is not None and not -90.0 <= latitude <= 90.0:
        raise CallError(f"--latitude {latitude:g}: expected degrees between -90 and 90")
    if rate * (initial + poses * (still + turn)) > LARGEST:
        raise CallError(f"--rate {rate:g}: expected a log of at most {LARGEST} samples")
    from ..imu import MEMS_NOISE, gravity, simulate as simulated

    given = {sensor: noise_from_text(text, sensor) for sensor, text in (("gyro", gyro), ("accel", accel)) if text is not None}
    screen = Screen(running.quiet)
    with staged([out]) as places, progress("simulating", running.quiet):
        angle = None if latitude is None else math.radians(latitude)
        log = simulated(
            poses, rate=rate, initial=initial, still=still, turn=turn, noise=MEMS_NOISE | given, seed=running.seed, latitude=angle,
            gravity=STANDARD_GRAVITY if angle is None else float(gravity(angle)),
        )  # fmt: skip
        save_log(places[out], log.time, {"gyro": log.gyro, "accel": log.accel})
    show_written(screen, [out])
