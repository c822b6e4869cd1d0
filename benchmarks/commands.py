"""CPU time of whole commands, with an empty and with a warm compilation cache, and the time until the first table is on the screen.

    python benchmarks/commands.py                               every command, this checkout
    python benchmarks/commands.py --beside ../other             alternate with the same commands of another checkout, and give the ratio
    python benchmarks/commands.py --only noise mag --repeats 5

CPU means user and system seconds of the whole process, including imports, tracing and compilation. `first table` is the share of the wall
time after which the first table is printed. `import` is `import jaxcal`. `imu` is a simulated session of poses by hand.
"""

import argparse
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[1]
#: command -> its words, and a text in the first table
COMMANDS = {
    "noise": (["noise", "rest.csv"], "gyroscope: coefficient"),
    "mag": (["mag", "mag.csv"], "magnetometer, model"),
    "north": (["north", "north.csv", "--latitude", "35"], "joint least-squares fit"),
    "imu": (["imu", "tumble.csv"], "accelerometer: 95 %"),
    "allan": (["allan", "rest.csv"], "gyroscope: oadev"),
    "import": ([], ""),
}


def make_logs(folder: pathlib.Path) -> None:
    """Write the logs: 10^5 samples of six axes at rest, 360 magnetometer readings, four positions, a session by hand."""
    rng = np.random.default_rng(1)
    n, rate = 100_000, 100.0
    walk = np.cumsum(rng.normal(size=(n, 6)), axis=0) * [1e-7] * 6
    values = walk + rng.normal(size=(n, 6)) * [1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2] + [0, 0, 0, 0, 0, 9.8]
    header = "time [s],gx [rad/s],gy [rad/s],gz [rad/s],ax [m/s^2],ay [m/s^2],az [m/s^2]"
    table = np.column_stack([np.arange(n) / rate, values])
    np.savetxt(folder / "rest.csv", table, delimiter=",", header=header, comments="", fmt="%.9g")
    u = rng.normal(size=(360, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    m = (
        47.0 * u @ np.array([[1.1, 0.06, -0.04], [0.06, 0.92, 0.05], [-0.04, 0.05, 1.0]])
        + [8.0, -5.0, 3.0]
        + 0.3 * rng.normal(size=(360, 3))
    )
    table = np.column_stack([np.arange(360) / 50.0, m])
    np.savetxt(folder / "mag.csv", table, delimiter=",", header="time [s],mx [uT],my [uT],mz [uT]", comments="", fmt="%.7g")
    angles = np.deg2rad([0.0, 90.0, 180.0, 270.0])
    rates = 12.3 * np.cos(angles - 0.7) + 0.1 + 0.01 * rng.normal(size=4)
    force = 9.8 * 0.03 * np.cos(angles - 0.2) + 1e-3 + 1e-4 * rng.normal(size=4)
    rows = [f"{np.rad2deg(a):g},x,120,{f:.6f},{w:.5f}" for a, f, w in zip(angles, force, rates, strict=True)]
    (folder / "north.csv").write_text("\n".join(["angle [deg],mounting,dwell [s],accel [m/s^2],gyro [deg/h]", *rows]) + "\n")
    run(ROOT, ["simulate", "imu", "--out", "tumble.csv"], folder, folder / "made")


def run(checkout: pathlib.Path, words: list[str], folder: pathlib.Path, cache: pathlib.Path, mark: str = "") -> tuple[float, float]:
    """CPU seconds of a command, and the share of its wall time at which `mark` was printed."""
    # use the environment of a user: JAX_COMPILATION_CACHE_DIR would keep jaxcal from using its own folder of programs
    environment = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")} | {
        "PYTHONPATH": str(checkout),
        "XDG_CACHE_HOME": str(cache),
        "XLA_FLAGS": "",
        "PYTHONUNBUFFERED": "",
    }
    command = [sys.executable, "-m", "jaxcal.cli", *words] if words else [sys.executable, "-c", "import jaxcal"]
    before, start, seen = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter(), float("nan")
    with subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        for line in process.stdout:
            if mark and mark in line and seen != seen:
                seen = time.perf_counter() - start
        complaint = process.stderr.read()
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if process.returncode:
        raise SystemExit(f"jaxcal {' '.join(words)} of {checkout} ended with {process.returncode}: {complaint}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, seen / wall


def main() -> None:
    """Print a table with one row per command and checkout; each figure is the median of the repeats."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    parser.add_argument("--beside", type=pathlib.Path, help="another checkout of jaxcal")
    parser.add_argument("--repeats", type=int, default=3, help="warm runs; there is one on an empty cache")
    asked = parser.parse_args()
    checkouts = {"this": ROOT} | ({"other": asked.beside.resolve()} if asked.beside else {})
    print(f"{'command':10s}{'checkout':>10s}{'cold CPU s':>12s}{'warm CPU s':>12s}{'first table':>13s}")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        make_logs(folder)
        for command in asked.only:
            words, mark = COMMANDS[command]
            caches = {label: folder / f"cache-{label}-{command}" for label in checkouts}
            cold = {label: run(at, words, folder, caches[label], mark)[0] for label, at in checkouts.items()}
            # alternate between the checkouts, so that changes in the speed of the machine affect both
            warm = [{label: run(at, words, folder, caches[label], mark) for label, at in checkouts.items()} for _ in range(asked.repeats)]
            median = {label: [statistics.median(one[label][i] for one in warm) for i in (0, 1)] for label in checkouts}
            for label in checkouts:
                print(f"{command:10s}{label:>10s}{cold[label]:12.2f}{median[label][0]:12.2f}{100 * median[label][1]:11.0f} %", flush=True)
            if len(checkouts) == 2:
                ratios = cold["this"] / cold["other"], median["this"][0] / median["other"][0]
                print(f"{'':10s}{'ratio':>10s}{ratios[0]:12.2f}{ratios[1]:12.2f}", flush=True)


if __name__ == "__main__":
    main()
