"""`jaxcal simulate`: logs of devices whose noise is known."""

import math
import re
from pathlib import Path
from typing import Any, Literal

import cyclopts

from .._units import STANDARD_GRAVITY, noise_factor, noise_units, si_unit
from ._options import CallError, Running
from ._outputs import staged
from ._screen import Screen, progress, show_written

simulate = cyclopts.App(name="simulate", help="Logs of simulated devices, whose truth is known.", help_format="plaintext")

_TERM = re.compile(r"([QNBKR])\s*=\s*(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+)\s*(.*)")
_SUFFIXES = (".csv", ".npz")
_LARGEST = 500_000_000  # samples; more would not fit the memory of most machines


@simulate.command(name="noise")
def simulate_noise(
    *,
    out: Path,
    rate: float = 100.0,
    duration: float = 3600.0,
    gyro: str | None = None,
    accel: str | None = None,
    running: Running = Running(),
) -> None:
    """A log of a level sensor at rest: the noise given, and gravity on accel_z.

    Coefficients are two-sided and have units:
    N=0.25deg/sqrt(h),B=7.6deg/h,K=0.5deg/h/sqrt(s).

    Parameters
    ----------
    out
        File to write: FILE.csv or FILE.npz, in SI units.
    rate
        Sampling rate in Hz.
    duration
        Length of the log in s.
    gyro
        Noise of each gyroscope axis.
    accel
        Noise of each accelerometer axis.
    """
    truth = {sensor: noise_from_text(text, sensor) for sensor, text in (("gyro", gyro), ("accel", accel)) if text is not None}
    if not truth:
        raise CallError('give the noise of a sensor, as in --gyro "N=0.25deg/sqrt(h),B=7.6deg/h"')
    screen = Screen(running.quiet)
    write_log(out, truth, rate, duration, running)
    show_written(screen, [out])


@simulate.command(name="imu")
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
    if out.suffix not in _SUFFIXES:
        raise CallError(f"--out {out}: expected a name that ends in {' or '.join(_SUFFIXES)}")
    if poses < 2 or not all(0.0 < x < float("inf") for x in (rate, still, turn, initial)):
        raise CallError("--poses, --rate, --still, --turn, --initial: expected 2 poses or more, and positive numbers")
    if latitude is not None and not -90.0 <= latitude <= 90.0:
        raise CallError(f"--latitude {latitude:g}: expected degrees between -90 and 90")
    if rate * (initial + poses * (still + turn)) > _LARGEST:
        raise CallError(f"--rate {rate:g}: expected a log of at most {_LARGEST} samples")
    from ..imu import gravity, simulate as simulated
    from ..imu._simulate import NOISE

    given = {sensor: noise_from_text(text, sensor) for sensor, text in (("gyro", gyro), ("accel", accel)) if text is not None}
    screen = Screen(running.quiet)
    with staged([out]) as places, progress("simulating", running.quiet):
        angle = None if latitude is None else math.radians(latitude)
        log = simulated(
            poses, rate=rate, initial=initial, still=still, turn=turn, noise=NOISE | given, seed=running.seed, latitude=angle,
            gravity=STANDARD_GRAVITY if angle is None else float(gravity(angle)),
        )  # fmt: skip
        _save(places[out], log.time, {"gyro": log.gyro, "accel": log.accel})
    show_written(screen, [out])


def noise_from_text(text: str, sensor: str) -> Any:
    """`Noise` from coefficients with units, as in ``N=0.25deg/sqrt(h),B=7.6deg/h``.

    Examples
    --------
    >>> from jaxcal.cli._simulate import noise_from_text
    >>> round(noise_from_text("N=60deg/sqrt(h)", "gyro").N, 6)
    0.017453
    """
    coefficients = {}
    for part in text.split(","):
        found = _TERM.fullmatch(part.strip())
        if found is None:
            raise CallError(f"--{sensor} {text}: {part.strip()!r} is not TERM=VALUE UNIT, with a term of QNBKR, such as N=0.25deg/sqrt(h)")
        term, value, unit = found.groups()
        if term in coefficients:
            raise CallError(f"--{sensor} {text}: {term} is given twice")
        if not unit:
            raise CallError(f"--{sensor} {text}: {term} has no unit; use one of {', '.join(noise_units(term, sensor))}")
        coefficients[term] = float(value) * noise_factor(term, sensor, unit.strip())
    from ..noise import Noise

    return Noise(**coefficients)


def write_log(
    out: Path,
    truth: dict[str, Any],
    rate: float,
    duration: float,
    running: Running,
    bias: dict[str, tuple[float, float, float]] | None = None,
    folder: Path | None = None,
) -> None:
    """Simulate three independent axes of every sensor in `truth`, add the biases and gravity on z, and write the log."""
    if out.suffix not in _SUFFIXES:
        raise CallError(f"--out {out}: expected a name that ends in {' or '.join(_SUFFIXES)}")
    if not 0.0 < rate < float("inf") or not 2.0 <= rate * duration <= _LARGEST:
        raise CallError(f"--rate {rate:g} --duration {duration:g}: expected a log of 2 to {_LARGEST} samples")
    with staged([out], folder=folder) as places, progress("simulating", running.quiet):
        import numpy as np

        samples = round(rate * duration)
        random = np.random.default_rng(running.seed)
        sensors = {}
        for sensor, noise in truth.items():
            axes = [noise.simulate(samples, rate, seed=random) for _ in range(3)]
            sensors[sensor] = np.stack(axes, axis=1) + np.asarray((bias or {}).get(sensor, (0.0, 0.0, 0.0)))
        if "accel" in sensors:
            sensors["accel"][:, 2] += STANDARD_GRAVITY
        save_log(places[out], np.arange(samples) / rate, sensors)


@simulate.command(name="temperature")
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
    if out.suffix not in _SUFFIXES:
        raise CallError(f"--out {out}: expected a name that ends in {' or '.join(_SUFFIXES)}")
    if not 0.0 < rate < float("inf") or not 2.0 <= rate * duration <= _LARGEST:
        raise CallError(f"--rate {rate:g} --duration {duration:g}: expected a log of 2 to {_LARGEST} samples")
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


def save_log(place: Path, time: Any, sensors: dict[str, Any]) -> None:
    """Write a log as CSV or NPZ, in SI units; what is missing is an empty field, or NaN."""
    import numpy as np

    if place.suffix == ".npz":
        np.savez(place, time=time, **sensors)
        return
    names = ["time [s]"]
    for sensor, values in sensors.items():
        axes = [f"_{axis}" for axis in "xyz"[: values.shape[1]]] if values.ndim == 2 else [""]
        names += [f"{sensor}{axis} [{si_unit(sensor)}]" for axis in axes]
    table = np.column_stack([time, *sensors.values()])
    np.savetxt(place, table, fmt=["%.9f", *["%.9g"] * (len(names) - 1)], delimiter=",", header=",".join(names), comments="")
