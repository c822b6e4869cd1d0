"""`jaxcal demo`: a simulated device, for which every result can be compared with the truth."""

from pathlib import Path

from ._noise import Writing, characterise
from ._options import Reading, Running, Seed, Simulating
from ._screen import Screen
from ._simulate import noise_from_text, write_log

# an inertial unit of the better MEMS class; every term dominates somewhere between 0.01 s and 1,000 s
_DEVICE = {
    "gyro": "Q=0.5arcsec,N=0.25deg/sqrt(h),B=8deg/h,K=1.8deg/h/sqrt(s)",
    "accel": "Q=3e-5m/s,N=0.05m/s/sqrt(h),B=0.03mg,K=4m/s/h^(3/2)",
}
_BIAS = {"gyro": (5e-3, -3e-3, 1e-3), "accel": (0.08, -0.05, 0.03)}  # rad/s, m/s^2
_RATE, _DURATION = 100.0, 3600.0


def demo(*, out: Path = Path("jaxcal-demo"), seed: Seed = 0, running: Running = Running()) -> None:
    """Simulate an hour of a device at rest, and compare jaxcal noise with the truth.

    Parameters
    ----------
    out
        Folder for the log and the reports, made if it is missing.
    """
    screen = Screen(running.quiet)
    truth = {sensor: noise_from_text(text, sensor) for sensor, text in _DEVICE.items()}
    log = out / "imu.csv"
    screen.line(f"A simulated device at rest for {_DURATION / 3600:g} h at {_RATE:g} Hz (seed {seed}):")
    for sensor, text in _DEVICE.items():
        screen.line(f"  {sensor:6} {text.replace(',', ', ')}")
    simulating = Simulating(quiet=running.quiet, force=running.force, seed=seed)
    write_log(log, truth, _RATE, _DURATION, simulating, bias=_BIAS, folder=out)
    screen.line(f"\njaxcal noise {log}")
    done = characterise(log, "QNBK", 0.95, None, Reading(), Writing(out=out), running)
    missed, total = [], 0
    for channel, fit in done.found.items():
        for term, (low, high) in fit.interval.items():
            total += 1
            if not low <= truth[channel.partition("_")[0]].coefficient(term) <= high:
                missed.append(f"{term} of {channel.replace('_', ' ')}")
    outside = f"; those of {', '.join(missed)} do not" if missed else ""
    done.screen.lines(["", f"{total - len(missed)} of {total} intervals of 95 % hold the truth{outside}."])
    done.end()
    screen.line("Now your own log, of a sensor at rest for an hour or more: jaxcal noise LOG")
