"""`jaxcal simulate`: logs of devices whose noise is known."""

import re
from pathlib import Path
from typing import Any, Literal

import cyclopts

from .._units import STANDARD_GRAVITY, noise_factor, noise_units
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


@simulate.command(name="mag")
def simulate_mag(
    *,
    out: Path,
    scenario: Literal["all", "three_turns", "twelve_points"] = "all",
    samples: int | None = None,
    noise: float = 0.2,
    field: float = 47.0,
    inclination: float = 57.0,
    hard_iron: tuple[float, float, float] = (21.7, 5.2, -10.2),
    soft_iron: float = 0.1,
    mounting: float = 0.0,
    running: Running = Running(),
) -> None:
    """A log of a magnetometer in many attitudes, with the specific force at rest.

    Hard iron, soft iron and mounting are printed: the truth to hold
    jaxcal mag against.

    Parameters
    ----------
    out
        File to write: FILE.csv or FILE.npz, in SI units.
    scenario
        Attitudes: all, three_turns, or twelve_points, as in the magnetometer paper.
    samples
        Attitudes of all (360), or headings of each turn.
    noise
        Standard deviation of an axis of a reading in uT; the specific force has the same part of gravity.
    field
        Norm of Earth's field in uT.
    inclination
        Its dip in degrees.
    hard_iron
        Offset in uT.
    soft_iron
        Largest entry of the symmetric matrix that is added to the unit matrix, drawn with the seed.
    mounting
        Angle in degrees by which the magnetometer is turned about its z axis.
    """
    if not noise >= 0 or not field > 0 or not abs(inclination) < 90 or not 0 <= soft_iron < 0.3:
        raise CallError("expected --noise of 0 or more, a positive --field, --inclination within 90 degrees, --soft-iron from 0 to 0.3")
    if out.suffix not in _SUFFIXES:
        raise CallError(f"--out {out}: expected a name that ends in {' or '.join(_SUFFIXES)}")
    if samples is not None and samples < 1:
        raise CallError(f"--samples {samples}: expected at least one")
    screen = Screen(running.quiet)
    with staged([out]) as places, progress("simulating", running.quiet):
        import numpy as np

        from ..magnetometer import MagModel, body_field, scenario as attitudes_of

        random = np.random.default_rng(running.seed)
        half = random.uniform(-soft_iron, soft_iron, (3, 3))
        angle = np.deg2rad(mounting)
        turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
        true = MagModel((np.eye(3) + (half + half.T) / 2) @ turn, 1e-6 * np.array(hard_iron))
        attitudes = attitudes_of(scenario, samples=samples, seed=running.seed)
        h = np.asarray(body_field(attitudes, 1e-6 * field, np.deg2rad(inclination)))
        up = -STANDARD_GRAVITY * np.asarray(body_field(attitudes, 1.0, np.pi / 2))
        m = np.asarray(true.measure(h)) + 1e-6 * noise * random.standard_normal(h.shape)
        up = up + STANDARD_GRAVITY * noise / field * random.standard_normal(h.shape)
        save_sensors(places[out], np.arange(len(m)) / 10.0, {"accel": up, "mag": m})
    screen.line(f"{len(m)} attitudes; hard iron {', '.join(f'{b:g}' for b in hard_iron)} uT; soft iron")
    for row in np.asarray(true.soft_iron):
        screen.line("  " + "  ".join(f"{c:+.5f}" for c in row))
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
        save_sensors(places[out], np.arange(samples) / rate, sensors)


def save_sensors(place: Path, time: Any, sensors: dict[str, Any]) -> None:
    import numpy as np

    if place.suffix == ".npz":
        np.savez(place, time=time, **sensors)
        return
    units = {"gyro": "rad/s", "accel": "m/s^2", "mag": "T"}
    names = ["time [s]", *(f"{sensor}_{axis} [{units[sensor]}]" for sensor in sensors for axis in "xyz")]
    table = np.column_stack([time, *sensors.values()])
    np.savetxt(place, table, fmt=["%.9f", *["%.9g"] * (len(names) - 1)], delimiter=",", header=",".join(names), comments="")
