"""`jaxcal simulate temperature`: a log of a gyroscope that warms and cools."""

from pathlib import Path
from typing import Literal

from ._options import CallError, Running
from ._outputs import staged
from ._screen import Screen, progress, show_written
from ._simulate import LARGEST, SUFFIXES, save_log


def simulate_temperature(
    *,
    out: Path,
    jump: float = 0.3,
    profile: Literal["ramp", "cycle"] = "ramp",
    lag: float = 0.0,
    play: float = 0.0,
    noise: float = 4e-3,
    walk: float = 2e-5,
    rate: float = 1.0,
    duration: float = 5400.0,
    running: Running = Running(),
) -> None:
    """A log of a gyroscope at rest whose bias depends on a temperature of 20 to 45 degC.

    The x axis has a cubic and a jump at 24.5 degC, the y axis the jump
    downwards, the z axis no jump.

    Parameters
    ----------
    out
        File to write: FILE.csv or FILE.npz, in SI units.
    jump
        Height of the jump in deg/s.
    profile
        ramp, once from 20 to 45 degC; cycle, a sine of 75 minutes.
    lag
        Seconds by which the sensor follows the temperature.
    play
        Half-width of the backlash in degC.
    noise
        Standard deviation of a sample in deg/s.
    walk
        Standard deviation of the bias's step from sample to sample in deg/s.
    rate
        Sampling rate in Hz.
    duration
        Length of the log in s.
    """
    if out.suffix not in SUFFIXES:
        raise CallError(f"--out {out}: expected a name that ends in {' or '.join(SUFFIXES)}")
    if not 0.0 < rate < float("inf") or not 2.0 <= rate * duration <= LARGEST:
        raise CallError(f"--rate {rate:g} --duration {duration:g}: expected a log of 2 to {LARGEST} samples")
    if min(lag, play, noise, walk) < 0:
        raise CallError("--lag, --play, --noise and --walk are not negative")
    screen = Screen(running.quiet)
    with staged([out]) as places, progress("simulating", running.quiet):
        import numpy as np

        from ..temperature import simulate as simulated

        random = np.random.default_rng(running.seed)
        made = [
            simulated(
                jump=np.deg2rad(height), profile=profile, lag=lag, play=play, noise=np.deg2rad(noise), walk=np.deg2rad(walk),
                duration=duration, rate=rate, seed=random,
            )
            for height in (jump, -jump, 0.0)
        ]  # fmt: skip
        # one thermometer, that of the first axis; the true temperature is the same for all
        sensors = {"gyro": np.stack([one.bias for one in made], axis=1), "temperature": made[0].temperature}
        save_log(places[out], made[0].time, sensors)
    show_written(screen, [out])
