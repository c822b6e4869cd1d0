"""`jaxcal simulate`: logs of devices whose noise is known."""

import re
from pathlib import Path
from typing import Any

from .._units import STANDARD_GRAVITY, noise_factor, noise_units, si_unit
from ._options import CallError, Running
from ._outputs import staged
from ._screen import Screen, progress, show_written

_TERM = re.compile(r"([QNBKR])\s*=\s*(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+)\s*(.*)")
SUFFIXES = (".csv", ".npz")
LARGEST = 500_000_000  # samples; more would not fit the memory of most machines


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
    if out.suffix not in SUFFIXES:
        raise CallError(f"--out {out}: expected a name that ends in {' or '.join(SUFFIXES)}")
    if not 0.0 < rate < float("inf") or not 2.0 <= rate * duration <= LARGEST:
        raise CallError(f"--rate {rate:g} --duration {duration:g}: expected a log of 2 to {LARGEST} samples")
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
