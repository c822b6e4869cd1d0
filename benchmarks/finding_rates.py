"""How often findings are said with their cause and without it, on records made without the package (`_hand.py`, `_thermal.py`, `world.py`).

    python benchmarks/finding_rates.py --runs 30
    python benchmarks/finding_rates.py --only device "temperature: lag of 60 s"

Each row counts verdicts and codes. A case begins with its package; `--only` takes the beginnings of cases.
"""

import argparse
import collections
import pathlib
import sys

import _hand
import _thermal
import numpy as np
import scipy.signal
from scipy.spatial.transform import Rotation

import jaxcal

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
from tests.imu import world


def device(seed, change=None, **options):
    """A device by hand for 60 s at 50 Hz with five rests; `change` changes the readings of a sensor."""
    readings = _hand.recording(seed, duration=60.0, rate=50.0, rests=5, still=3.0, **options)[0]
    if change:
        readings[change[0]] = change[1](readings[change[0]])
    return jaxcal.device.fit(jaxcal.Log(None, rate=50.0, **readings), gravity=_hand.GRAVITY)


def poses(seed, change=None, **options):
    """A session of 24 poses; `change` changes the readings of the gyroscope."""
    stamps, accel, gyro, _ = world.record(seed, **options)
    gyro = gyro if change is None else change(gyro)
    return jaxcal.imu.multi_position(jaxcal.Log(stamps, accel=accel, gyro=gyro), gravity=world.GRAVITY)


def ramps(seed, late, speeds=(1.0, 1.0), timed=True):
    """A bias over ramps up and down, each at its own speed, whose sensor follows the thermometer by `late` s."""
    rng, legs = np.random.default_rng([31, seed]), [np.linspace(0.0, 1.0, round(2250 / speed)) for speed in speeds]
    share = np.concatenate([1 - leg if k % 2 else leg for k, leg in enumerate(legs)])
    true = _thermal.LOW + (_thermal.HIGH - _thermal.LOW) * share
    keep = np.exp(-1 / late) if late else 0.0
    inner = scipy.signal.lfilter([1 - keep], [1.0, -keep], true - true[0]) + true[0]
    bias = _thermal.smooth()(inner) + _thermal.noise(len(true), _thermal.QUIET, rng)
    seen = true + 0.02 * rng.standard_normal(len(true))
    return jaxcal.temperature.fit(seen, bias, time=np.arange(len(true)) if timed else None)


def turned(y):
    """Rates of a gyroscope that turns by three degrees in its mount after five sixths of the recording."""
    after = np.arange(len(y))[:, None] > 5 * len(y) // 6
    return np.where(after, y @ Rotation.from_rotvec([0.05, 0.0, 0.0]).as_matrix().T, y)


#: case -> a result for a seed
CASES = {
    "device: plain": device,
    "device: gyroscope half": lambda seed: device(seed, ("gyro", lambda y: 0.507 * y)),
    "device: accelerometer 5 Hz": lambda seed: device(seed, poles={"accel": 5.0}),
    "device: accelerometer 20 Hz": lambda seed: device(seed, poles={"accel": 20.0}),
    "device: gyroscope turns in its mount": lambda seed: device(seed, ("gyro", turned)),
    "imu: plain": poses,
    "imu: gyroscope half": lambda seed: poses(seed, lambda y: 0.507 * y),
    "imu: gyroscope limited to 1 rad/s without a mark": lambda seed: poses(seed, np.tanh),
    "temperature: plain": lambda seed: ramps(seed, 0.0),
    "temperature: lag of 60 s": lambda seed: ramps(seed, 60.0),
    "temperature: lag of 60 s, ramps of two speeds": lambda seed: ramps(seed, 60.0, (1.0, 1.0, 0.4, 0.4)),
    "temperature: without times": lambda seed: ramps(seed, 0.0, timed=False),
}


def answer(made, seed):
    """Verdict and codes; an error is a verdict, too."""
    try:
        found = made(seed)
    except jaxcal.DataError as error:
        return "error", [error.code]
    return found.verdict, sorted(found.codes)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--only", nargs="*", default=[""])
    chosen = parser.parse_args()
    for name, made in CASES.items():
        if name.startswith(tuple(chosen.only)):
            answers = [answer(made, seed) for seed in range(chosen.runs)]
            verdicts = dict(collections.Counter(verdict for verdict, _ in answers).most_common())
            codes = dict(collections.Counter(code for _, said in answers for code in said).most_common())
            print(f"{name:50s} of {chosen.runs}: {verdicts}, {codes}", flush=True)


if __name__ == "__main__":
    main()
