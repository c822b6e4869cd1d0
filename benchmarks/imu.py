"""jaxcal.imu on the Xsens log of imu_tk and in Monte Carlo, with fixed seeds.

    python benchmarks/imu.py                    everything (minutes)
    python benchmarks/imu.py --only xsens       one part: xsens, coverage
    python benchmarks/imu.py --runs 400         more runs

`xsens` needs the log (xsens_acc.mat, xsens_gyro.mat) in FOLDER/data/imu_tk, where FOLDER is JAXCAL_REFERENCE or ../shared. Times are
after compilation, which is timed separately.
"""

import argparse
import os
import pathlib
import sys
import time

import numpy as np

import jaxcal
from jaxcal.imu import multi_position
from jaxcal.imu._simulate import NOISE

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "imu"))


def timed(function, repeats=3):
    start = time.perf_counter()
    found = function()
    first = time.perf_counter() - start
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return found, first, min(times)


def xsens(_):
    folder = pathlib.Path(os.environ.get("JAXCAL_REFERENCE", ROOT.parent / "shared")) / "data" / "imu_tk"
    if not folder.is_dir():
        print(f"no log of imu_tk at {folder}; set JAXCAL_REFERENCE")
        return
    accel, gyro = (np.loadtxt(folder / f"xsens_{name}.mat") for name in ("acc", "gyro"))
    log = jaxcal.Log(accel[:, 0], accel=accel[:, 1:], gyro=gyro[:, 1:])
    for name, more in (("joint", {}), ("joint, no G", {"g_sensitivity": False})):
        one, first, best = timed(lambda more=more: multi_position(log, gravity=9.81744, raw=True, **more), 1)
        rms = np.rad2deg(np.sqrt(np.mean(one.residual_turn**2)))
        print(
            f"{name:12s} {len(one.still)} poses, left after a turn {rms:.3f} deg rms; held out {one.held_out[0]:.4f} m/s^2, "
            f"{np.rad2deg(one.held_out[1]):.3f} deg a component; {best:.1f} s with the held-out fits, {first:.0f} s with compilation"
        )


def coverage(runs):
    import cases

    truth = cases.turned_truth()
    for name, options in (
        ("noise known", {"noise": {sensor: {"N": value} for sensor, value in NOISE.items()}}),
        ("noise not known", {}),
        ("noise not known, no loss", {"loss": None}),
    ):
        fits = []
        start = time.perf_counter()
        for seed in range(runs):
            fits.append(multi_position(cases.recording(seed), gravity=cases.GRAVITY, held_out=False, **options))
            if seed == 0:
                start = time.perf_counter()
        spent = (time.perf_counter() - start) / max(runs - 1, 1)
        free, bound = cases.bound(fits[0])
        errors = np.array([fit.estimate.values for fit in fits])[:, free] - truth[free]
        inside = np.mean(
            [(f.estimate.intervals()[free, 0] <= truth[free]) & (truth[free] <= f.estimate.intervals()[free, 1]) for f in fits]
        )
        ratio = np.sqrt(np.mean(errors**2, axis=0) / np.diag(bound))
        print(
            f"{name}: {runs} fits, intervals hold {100 * inside:.1f} %; rmse over the bound "
            f"{np.sqrt(np.mean(ratio**2)):.3f} (root mean square of {len(free)} parameters), from {ratio.min():.2f} to "
            f"{ratio.max():.2f}; {spent:.2f} s a fit"
        )


PARTS = {"xsens": xsens, "coverage": coverage}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=PARTS)
    parser.add_argument("--runs", type=int, default=100)
    options = parser.parse_args()
    for name, part in PARTS.items():
        if options.only in (None, name):
            part(options.runs)
