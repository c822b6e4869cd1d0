"""Accuracy of `jaxcal.noise.fit`, and whether its intervals hold the truth as often as they should, by Monte Carlo.

    python benchmarks/coverage.py                    the figures of the README (about two minutes on two cores)
    python benchmarks/coverage.py --runs 1000        more records

The exact generators simulate every record with its own seed, so the figures can be reproduced. Each figure has its Monte Carlo standard
error. There are three devices: the demo's gyroscope; the same without B and K, to count how often they are found though absent; and the
same behind a moving average of 20 samples, which makes the shortest cluster times wrong, so that they must be left out, and changes Q.
"""

import argparse
import time

import numpy as np

import jaxcal
from jaxcal.cli._demo import _DEVICE, _DURATION, _RATE
from jaxcal.cli._simulate import noise_from_text

_WINDOW = 20


def averaged(record):
    """The record behind a moving average, as a sensor with a digital filter would report it."""
    return np.convolve(record, np.full(_WINDOW, 1.0 / _WINDOW), mode="valid")


def study(name, truth, runs, change, first_seed, terms=("Q", "N", "B", "K")):
    """Fit `runs` records of one device, and print one row per term."""
    value, inside, below, verdict = ({term: [] for term in terms} for _ in range(4))
    start = time.perf_counter()
    for seed in range(first_seed, first_seed + runs):
        samples = int(_RATE * _DURATION)
        found = jaxcal.noise.fit(change(truth.simulate(samples + _WINDOW, _RATE, seed=seed))[:samples], _RATE)
        for term in terms:
            true = float(getattr(truth, term))
            low, high = found.interval[term]
            value[term].append(float(getattr(found.noise, term)))
            inside[term].append(low <= true <= high)
            below[term].append(true <= found.upper_limit[term])
            verdict[term].append(found.presence[term])
    seconds = (time.perf_counter() - start) / runs
    print(f"\n{name}: {runs} records of {_DURATION / 3600:g} h at {_RATE:g} Hz, {seconds:.2f} s each")
    print(f"{'':4}{'bias %':>14}{'scatter %':>16}{'interval holds %':>20}{'below limit %':>17}{'present %':>12}{'hint %':>9}")
    for term in terms:
        true, x = float(getattr(truth, term)), np.array(value[term])
        print(f"{term:4}", end="")
        if true:
            relative = x / true - 1.0
            scatter = 100.0 * relative.std(ddof=1)
            print(f"{100.0 * relative.mean():8.2f} ±{scatter / np.sqrt(runs):5.2f}", end="")
            print(f"{scatter:9.2f} ±{scatter / np.sqrt(2.0 * runs):5.2f}", end="")
        else:
            print(f"{'-':>14}{'-':>16}", end="")
        for hits in (inside[term], below[term]):
            share = float(np.mean(hits))
            print(f"{100.0 * share:11.1f} ±{100.0 * np.sqrt(share * (1.0 - share) / runs):4.1f}", end="")
        print(f"{100.0 * verdict[term].count('present') / runs:13.1f}{100.0 * verdict[term].count('hint') / runs:9.1f}", flush=True)


def main():
    """Run the three studies."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=200, help="records of each device")
    runs = parser.parse_args().runs
    whole = noise_from_text(_DEVICE["gyro"], "gyro")
    study("the demo's gyroscope", whole, runs, lambda record: record, 0)
    study("the same without B and K", jaxcal.noise.Noise(Q=whole.Q, N=whole.N), runs, lambda record: record, 10_000)
    study(f"the first behind a moving average of {_WINDOW} samples", whole, runs, averaged, 20_000, ("N", "B", "K"))


if __name__ == "__main__":
    main()
