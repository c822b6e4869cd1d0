"""Coverage and verdicts of jaxcal.imu on recordings not made by its own simulator (tests/imu/world.py), with fixed seeds.

    python benchmarks/imu_honesty.py                        all cases, 100 runs each
    python benchmarks/imu_honesty.py --runs 30 --only base "12 poses"

Each row gives the share of "good" verdicts, the coverage in % of the 95 % intervals for every group of parameters, the root mean square
error over the predicted standard error, the rms errors of both matrices in %, and the most frequent reasons for verdicts below "good".
"""

import argparse
import collections
import pathlib
import sys
import time

import numpy as np

import jaxcal

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "tests" / "imu"))
import world


def run(case, runs, **options):
    inside, good, ratios, errors, reasons = {g: [] for g in world.GROUPS}, 0, {g: [] for g in world.GROUPS}, [], collections.Counter()
    for seed in range(runs):
        stamps, accel, gyro, truth = world.record(seed, **world.CASES[case])
        found = jaxcal.imu.multi_position(jaxcal.Log(stamps, accel=accel, gyro=gyro), gravity=world.GRAVITY, held_out=False, **options)
        good += found.verdict == "good"
        if found.verdict != "good":
            reasons[f"{found.verdict}: {', '.join(sorted(found.codes))}"] += 1
        if found.accel is None:
            continue
        error = found.estimate.values - truth
        errors.append(error)
        for group, part in world.GROUPS.items():
            known = found.estimate.error[part] > 0
            low, high = found.estimate.intervals()[part][known].T
            inside[group].append(np.mean((low <= truth[part][known]) & (truth[part][known] <= high)))
            ratios[group].append(np.sqrt(np.mean((error[part][known] / found.estimate.error[part][known]) ** 2)))
    return good, inside, ratios, np.array(errors), reasons


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--only", nargs="*", default=list(world.CASES))
    chosen = parser.parse_args()
    print(f"{'case':14s} good  cover: {', '.join(world.GROUPS)} | error over predicted | rms error: accel matrix %, gyro matrix %")
    for case in chosen.only:
        start = time.perf_counter()
        good, inside, ratios, errors, reasons = run(case, chosen.runs)
        cover = " ".join(f"{100 * np.mean(x):5.0f}" if x else "    -" for x in inside.values())
        ratio = " ".join(f"{np.median(x):5.2f}" if x else "    -" for x in ratios.values())
        size = (
            " ".join(f"{100 * np.sqrt(np.mean(errors[:, world.GROUPS[g]] ** 2)):.4f}" for g in ("accel matrix", "gyro matrix"))
            if len(errors)
            else "-"
        )
        why = "; ".join(f"{n} x {text}" for text, n in reasons.most_common(2))
        print(f"{case:14s} {good:4d}  {cover} | {ratio} | {size} | {why} ({(time.perf_counter() - start) / chosen.runs:.2f} s)", flush=True)
