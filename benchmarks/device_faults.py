"""Axes and low-passes that nobody told `imu` and `device` about, in simulations that share nothing with the package (`_hand.py`).

python benchmarks/device_faults.py axes --runs 60       the axes of each sensor permuted by one of the 48; and not permuted
python benchmarks/device_faults.py real                 the same with the public nine-axis logs below `JAXCAL_REFERENCE`
python benchmarks/device_faults.py poles --runs 100     a first-order low-pass of 5 to 20 Hz; intervals of 95 % that hold, verdicts
"""

import argparse
import collections
import itertools
import os
import pathlib

import _hand
import numpy as np

import jaxcal
from jaxcal.device._start import axes_of, recorded, started

PERMUTED = [
    np.array([[sign * (place == j) for j in range(3)] for sign, place in zip(signs, order, strict=True)], dtype=float)
    for order in itertools.permutations(range(3)) for signs in itertools.product((1, -1), repeat=3)
]  # fmt: skip
POLES = {
    "none": {},
    "none, no rests": {"rests": 0},
    "accel 5 Hz": {"poles": {"accel": 5.0}},
    "accel 5 Hz, no rests": {"poles": {"accel": 5.0}, "rests": 0},
    "accel 5 Hz, noise too": {"poles": {"accel": 5.0}, "filtered_noise": True},
    "accel 20 Hz": {"poles": {"accel": 20.0}},
    "gyro 5 Hz": {"poles": {"gyro": 5.0}},
    "both 10 Hz": {"poles": {"accel": 10.0, "gyro": 10.0}},
}
REAL = ("broad_05_slow_rotation_B.hdf5", "madgwick_ExampleData.mat", "vqf_imu_data.npz", "fusion_sensor_data.csv")


def typed(turn):
    """What `--axes` takes for a sensor whose readings were multiplied by `turn`."""
    return ",".join(("-" if row.sum() < 0 else "") + "xyz"[int(np.argmax(np.abs(row)))] for row in turn.T)


def named(log, turn):
    """Whether `device` finds the axes of the gyroscope, and of the magnetometer (as a rotation; the latitude tells a mirror)."""
    record = recorded(jaxcal.Log(None, accel=log.accel, gyro=log.gyro @ turn.T, mag=log.mag, rate=log.rate), 9.80665)[0]
    try:
        gyro = np.array_equal(axes_of(record.accel, record.gyro, log.rate, ("gyroscope", "accelerometer")), turn.T)
    except jaxcal.DataError as error:
        gyro = f"--axes gyro={typed(turn)}" in error.args[0].spelt("terminal")
    record, _, mag = recorded(jaxcal.Log(None, accel=log.accel, gyro=log.gyro, mag=log.mag @ turn.T, rate=log.rate), 9.80665)
    return gyro, np.array_equal(started(record, mag).axes[1], turn * np.linalg.det(turn))


def axes(runs, seed):
    """Axes of simulated sessions and recordings."""
    counts = collections.Counter()
    for n in range(seed, seed + runs):
        for kind, turn in (("permuted", PERMUTED[(7 * n + 1) % 48]), ("as they are", np.eye(3))):
            session = jaxcal.Log(None, rate=100.0, **_hand.poses(n, wrong=turn))
            found = jaxcal.imu.multi_position(session, gravity=9.80665, held_out=False)
            said = [one.facts["axes"] for one in found.findings if one.code == "gyro_axes"]
            counts["imu", kind] += said == ([] if np.array_equal(turn, np.eye(3)) else [typed(turn)])
            readings = _hand.recording(n, duration=60.0, rests=4 * (n % 2), swing=(0.1, 0.2, 0.35)[n % 3])[0]
            for sensor, right in zip(("gyro", "mag"), named(jaxcal.Log(None, rate=100.0, **readings), turn), strict=True):
                counts[f"device, {sensor}", kind] += right
    print(*(f"{who}, axes {kind}: right in {count} of {runs}" for (who, kind), count in counts.items()), sep="\n")


def real():
    """Axes of public logs."""
    folder = pathlib.Path(os.environ.get("JAXCAL_REFERENCE", "../shared")) / "data" / "logs"
    for name in REAL:
        log = jaxcal.read(folder / name, quiet=True)
        gyro, mag = zip(*(named(log, one) for one in PERMUTED), strict=True)
        print(f"{name}: gyro {sum(gyro)}, mag {sum(mag)} of 48", flush=True)


def poles(runs, seed, only):
    """Coverage and verdicts with low-passes."""
    for cell in only or POLES:
        inside, ratio, told = collections.defaultdict(list), collections.defaultdict(list), collections.Counter()
        for n in range(seed, seed + runs):
            readings, truth = _hand.recording(n, **POLES[cell])
            found = jaxcal.device.fit(jaxcal.Log(None, rate=100.0, **readings), gravity=9.80665)
            iron = truth["mag.matrix"]
            true = truth | {"magnetometer.soft_iron": iron / np.cbrt(np.linalg.det(iron)), "magnetometer.hard_iron": truth["mag.bias"]}
            told.update([found.verdict, *found.codes])
            for name in found.estimate.names:
                field, _, place = name.partition("[")
                one = found.estimate[name]
                if field in true and one.state == "estimated" and place:
                    value = true[field][tuple(int(i) for i in place[:-1].split(","))]
                    inside[field].append(one.low <= value <= one.high)
                    ratio[field].append(1.96 * (one.value - value) / one.half)
        print(f"{cell} ({runs}): {dict(told)}")
        for field, held in inside.items():
            off = np.sqrt(np.mean(np.square(ratio[field])))
            print(f"    {field}: {100 * np.mean(held):.1f} % hold, actual over stated error {off:.2f}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("axes", "real", "poles"))
    parser.add_argument("--runs", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", choices=list(POLES), metavar="CELL")
    chosen = parser.parse_args()
    if chosen.what == "real":
        real()
    elif chosen.what == "axes":
        axes(chosen.runs, chosen.seed)
    else:
        poles(chosen.runs, chosen.seed, chosen.only)


if __name__ == "__main__":
    main()
