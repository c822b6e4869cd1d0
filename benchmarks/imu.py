"""jaxcal.imu on the Xsens log of imu_tk and in Monte Carlo, with fixed seeds.

    python benchmarks/imu.py                    everything (minutes)
    python benchmarks/imu.py --only xsens       one part: xsens, coverage
    python benchmarks/imu.py --runs 400         more runs

`xsens` needs the log (xsens_acc.mat, xsens_gyro.mat) in FOLDER/data/imu_tk, where FOLDER is JAXCAL_REFERENCE or ../shared. Times are
after compilation, which is timed separately. imu_tk itself (C++) takes 0.38 s for its fit of the gyroscope, and the same fit in NumPy
with finite differences 6.4 s; both were measured on another machine.
"""

import argparse
import os
import pathlib
import sys
import time

import jax
import numpy as np

import jaxcal
from jaxcal.imu import MEMS_NOISE, Triad, multi_position
from jaxcal.imu._fits import gyro_fit
from jaxcal.imu._recording import padded, recording, sampled_turns

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


def gyroscope(log, stamps, found):
    """Run imu_tk's fit of the gyroscope alone, from a start that is 25 % off."""
    still, slots = found.still, 64
    force = np.array([found.accel.correct(log.accel[i:j]).mean(axis=0) for i, j in zip(still.start, still.stop, strict=True)])
    up = padded(force / np.linalg.norm(force, axis=1, keepdims=True), slots)
    turns = sampled_turns(recording(log, stamps), still.start, still.stop, slots)
    begin = Triad(6258 * np.eye(3), found.gyro.bias)
    with jax.enable_x64(True):
        fit, first, best = timed(lambda: jax.block_until_ready(gyro_fit(begin, turns, up)))
    print(f"gyroscope of imu_tk: cost {float(fit.cost):.11f}; {best:.2f} s after compilation, {first:.1f} s with it")


def xsens(_):
    folder = pathlib.Path(os.environ.get("JAXCAL_REFERENCE", ROOT.parent / "shared")) / "data" / "imu_tk"
    if not folder.is_dir():
        print(f"no log of imu_tk at {folder}; set JAXCAL_REFERENCE")
        return
    accel, gyro = (np.loadtxt(folder / f"xsens_{name}.mat") for name in ("acc", "gyro"))
    log, stamps = jaxcal.Log(accel[:, 0], accel=accel[:, 1:], gyro=gyro[:, 1:]), accel[:, 0]
    options = {"gravity": 9.81744, "raw": True, "initial": 50.0, "time": stamps}
    found = {}
    for name, more in (("imu_tk", {"method": "imu_tk"}), ("joint", {}), ("joint, no G", {"g_sensitivity": False})):
        found[name], first, best = timed(lambda more=more: multi_position(log, **options, **more), 1)
        one = found[name]
        rms = np.rad2deg(np.sqrt(np.mean(one.residual_turn**2)))
        print(
            f"{name:12s} {len(one.still)} poses, left after a turn {rms:.3f} deg rms; held out {one.held_out[0]:.4f} m/s^2, "
            f"{np.rad2deg(one.held_out[1]):.3f} deg a component; {best:.1f} s with the held-out fits, {first:.0f} s with compilation"
        )
    print("costs: " + ", ".join(f"{k:.0f}: {cost:.6f} ({n:.0f})" for k, n, cost, *_ in found["imu_tk"].thresholds))
    theirs, ours = found["imu_tk"], found["joint"]
    for name, triad in (("accelerometer", theirs.accel), ("gyroscope", theirs.gyro)):
        form = np.linalg.inv(triad.matrix)
        print(name, "scale", np.diag(form), "bias", triad.bias, "misalignment", (form / np.diag(form))[~np.eye(3, dtype=bool)])
    inside = (ours.estimate.intervals()[:, 0] <= theirs.estimate.values) & (theirs.estimate.values <= ours.estimate.intervals()[:, 1])
    free = ours.estimate.error > 0
    print(f"of imu_tk's parameters, inside the joint fit's intervals: accelerometer {(inside & free)[:12].sum()} of {free[:12].sum()}, "
          f"gyroscope's matrix {inside[12:21].sum()} of 9")  # fmt: skip
    other = found["joint, no G"]
    inside = (other.estimate.intervals()[:, 0] <= theirs.estimate.values) & (theirs.estimate.values <= other.estimate.intervals()[:, 1])
    print(f"the same without g-sensitivity: accelerometer {(inside & free)[:12].sum()} of {free[:12].sum()}, gyroscope's matrix "
          f"{inside[12:21].sum()} of 9")  # fmt: skip
    gyroscope(log, stamps, theirs)


def coverage(runs):
    import cases

    truth = cases.turned_truth()
    for name, options in (
        ("noise known", {"noise": {sensor: {"N": value} for sensor, value in MEMS_NOISE.items()}}),
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
