"""Coverage and verdicts of jaxcal.imu on recordings not made by its own simulator (tests/imu/world.py), with fixed seeds.

    python benchmarks/imu_honesty.py                        all cases, 100 runs each
    python benchmarks/imu_honesty.py --runs 30 --only base "12 poses"
    python benchmarks/imu_honesty.py --only faces           six faces that are not level
    python benchmarks/imu_honesty.py --only notes           needless and missed notes
    python benchmarks/imu_honesty.py --only temperature     three sessions at 0, 25 and 50 degC

Each row gives the share of "good" verdicts, the coverage in % of the 95 % intervals for every group of parameters, the root mean square
error over the predicted standard error, the rms errors of both matrices in %, how many good ones have an error of a matrix or bias above
three stated errors ("bad"), and the most frequent reasons for verdicts below "good".
"""

import argparse
import collections
import pathlib
import sys
import time

import numpy as np

import jaxcal

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
from tests.imu import test_thermal, world


def run(case, runs, **options):
    inside, good, ratios, errors, reasons, bad = (
        {g: [] for g in world.GROUPS},
        0,
        {g: [] for g in world.GROUPS},
        [],
        collections.Counter(),
        0,
    )
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
        known = found.estimate.error[:24] > 0
        # an interval of 95 % of few degrees of freedom is wider than 1.96 standard errors
        half = np.diff(found.estimate.intervals()[:24][known], axis=1)[:, 0] / 2
        bad += found.verdict == "good" and bool(np.any(np.abs(error[:24][known]) > 3 / 1.96 * half))
        for group, part in world.GROUPS.items():
            known = found.estimate.error[part] > 0
            low, high = found.estimate.intervals()[part][known].T
            inside[group].append(np.mean((low <= truth[part][known]) & (truth[part][known] <= high)))
            ratios[group].append(np.sqrt(np.mean((error[part][known] / found.estimate.error[part][known]) ** 2)))
    return good, inside, ratios, np.array(errors), reasons, bad


#: name, options of `world.six_faces`
FACES = {
    "level to 1 degree": {}, "sensor turned in the block by 1.7 degrees": {"mounting": 0.03},
    "level to 0.2 degrees": {"level": 0.2 * world.DEGREE}, "level": {"level": 1e-5}, "level to 3 degrees": {"level": 3 * world.DEGREE},
    "noise of 10 mm/s/sqrt(s)": {"noise": 1e-2}, "each face three times": {"repeats": 3},
}  # fmt: skip


def faces(runs):
    """Six faces: rms error and coverage of scale, misalignment and bias."""
    parts = {"scale": [0, 4, 8], "misalignment": [1, 2, 3, 5, 6, 7], "bias": [9, 10, 11]}
    for name, options in FACES.items():
        error, inside = [], []
        for seed in range(runs):
            accel, ends, truth = world.six_faces(seed, **options)
            labels = [f"{axis}_{kind}" for axis in "xyz" for kind in "pa"] * options.get("repeats", 1)
            log = jaxcal.Log(None, accel=accel, rate=world.RATE)
            regions = [(label, i, j) for label, (i, j) in zip(labels, ends, strict=True)]
            found = jaxcal.imu.ferraris(log, regions, gravity=world.GRAVITY).estimate
            low, high = found.intervals().T
            error.append(found.values - truth)
            inside.append((low <= truth) & (truth <= high))
        said = [
            f"{k} {np.sqrt(np.mean(np.square(error)[:, v])):.5f} {100 * np.mean(np.array(inside)[:, v]):.0f} %" for k, v in parts.items()
        ]
        print(f"{name:42s} {', '.join(said)}", flush=True)


def temperature(runs):
    """Scale over temperature from three sessions: coverage, and the error of the scale of a log that it corrects."""
    inside, error = [], []
    for seed in range(runs):
        found, _, truth = test_thermal.calibrated(seed)
        for t in (0.0, 12.0, 25.0, 40.0, 50.0):
            inside.append(test_thermal.scale_inside(found, truth, t))
            true = test_thermal.warmed(truth[[0, 4, 8]], t)
            error.append(np.diag(found.accel.at(t)[0][0]) / true - 1)
    size = 100 * np.sqrt(np.mean(np.square(error)))
    print(f"scale over temperature inside {100 * np.mean(inside):.0f} %, rms error of the accelerometer's {size:.4f} %")


def notes(runs):
    """How often the notes of drift, warm-up, delay and repeats are needless on plain cases, and missed where their cause is there."""
    told = collections.Counter()
    rng = np.random.default_rng(0)
    for seed in range(runs):
        for case, code in (("base", "drift"), ("gyro drift", "drift"), ("base", "warm_up"), ("warm-up", "warm_up")):
            stamps, accel, gyro, _ = world.record(seed, **world.CASES[case])
            log, auto = jaxcal.Log(stamps, accel=accel, gyro=gyro), {"terms": "auto"} if code == "warm_up" else {}
            found = jaxcal.imu.multi_position(log, gravity=world.GRAVITY, held_out=False, **auto)
            codes = {"warm_up", "drift"} if auto else {code}  # a warm-up is fitted as what describes it best
            told[code, case, bool(codes & {one.code for one in found.findings if not auto or "accel" in one.subject})] += 1
            if (case, code) == ("base", "drift"):
                delay = jaxcal.imu.motion(log, found)
                told[
                    "delay_unsure", "within a sample" if abs(delay.delay) < 1 / world.RATE else "off by more", "delay_unsure" in delay.codes
                ] += 1
        for again in (True, False):
            rates = [(axis, sign * size) for axis in range(3) for sign in (1, -1) for size in ((1.0, 2.0, 1.0) if again else (1.0, 2.0))]
            w = np.concatenate([np.tile(rate * np.eye(3)[axis], (400, 1)) for axis, rate in rates])
            test = jaxcal.imu.rate_test(jaxcal.Log(None, gyro=w + 1e-3 * rng.normal(size=w.shape), rate=100.0), [1.0, 2.0])
            told["no_repeats", "repeated" if again else "not repeated", "no_repeats" in test.codes] += 1
    for (code, case, said), count in sorted(told.items()):
        print(f"{code:14s} {case:16s} {'said' if said else 'not said':9s} {count} of {runs}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--only", nargs="*", default=list(world.CASES))
    chosen = parser.parse_args()
    for name, part in (("faces", faces), ("temperature", temperature), ("notes", notes)):
        if name in chosen.only:
            chosen.only.remove(name)
            part(chosen.runs)
    print(f"{'case':14s} good  cover: {', '.join(world.GROUPS)} | error over predicted | rms error: accel matrix %, gyro matrix %")
    for case in chosen.only:
        start = time.perf_counter()
        good, inside, ratios, errors, reasons, bad = run(case, chosen.runs)
        cover = " ".join(f"{100 * np.mean(x):5.0f}" if x else "    -" for x in inside.values())
        ratio = " ".join(f"{np.median(x):5.2f}" if x else "    -" for x in ratios.values())
        size = (
            " ".join(f"{100 * np.sqrt(np.mean(errors[:, world.GROUPS[g]] ** 2)):.4f}" for g in ("accel matrix", "gyro matrix"))
            if len(errors)
            else "-"
        )
        why = "; ".join(f"{n} x {text}" for text, n in reasons.most_common(2))
        print(
            f"{case:14s} {good:4d}  {cover} | {ratio} | {size} | bad {bad} | {why} ({(time.perf_counter() - start) / chosen.runs:.2f} s)",
            flush=True,
        )
