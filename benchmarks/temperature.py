"""Tables of thermal models, with fixed seeds: jumps, noise, rate of change, hysteresis, and time of a fit.

    python benchmarks/temperature.py                  everything (an hour)
    python benchmarks/temperature.py --only phantoms  one part: phantoms, noise, rate, lag, doubts, curves, hysteresis, speed
    python benchmarks/temperature.py --runs 20        fewer runs of each

`_thermal.py` makes the records of the first four parts without jaxcal. In the other parts, errors compare the curve with the truth, in
mdeg/s.
"""

import argparse
import collections
import time
import warnings

import _thermal
import numpy as np

from jaxcal.temperature import Chebyshev, fit, reference_bias, simulate

MDEG = np.deg2rad(1e-3)
JUMPS = (0.3, 0.1, 0.02, 0.0)
MODELS = ("polynomial 1", "polynomial 3", "polynomial 5", "polynomial 9", "polynomial 15", "table", "auto")


def errors(value, low, high, test, jump):
    """rms, rms in 24-25 degC, and maximum of the error of a curve, with its median removed."""
    t = test.true_temperature
    off = (value(np.clip(t, low, high)) - reference_bias(t, np.deg2rad(jump))) / MDEG
    off = off - np.median(off)
    near = (t >= 24) & (t <= 25)
    return np.sqrt(np.mean(off**2)), np.sqrt(np.mean(off[near] ** 2)), np.abs(off).max()


def phantoms(runs):
    print(f"\n{runs} records each: jumps found beyond those there, missed, and heights inside their intervals of 95 %\n")
    for case in _thermal.JUMPS:
        excess, errors = zip(*(_thermal.counted(case, run) for run in range(runs)), strict=True)
        z = np.concatenate(errors)
        held = (
            f"{100 * np.mean(np.abs(z) < 1.96):.1f} % of {len(z)}, rms of error over standard error {np.sqrt(np.mean(z**2)):.2f}"
            if len(z)
            else ""
        )
        share = f", heights inside {held}" if held else ""
        print(f"{case}: phantoms in {np.mean(np.array(excess) > 0):.1%}, missed in {np.mean(np.array(excess) < 0):.1%}{share}", flush=True)


def noise(runs):
    print(f"\nN, B, K = {_thermal.LOUD}: rms error on the next cycle of {runs} records, less its mean; intervals of 95 %\n")
    for random in (False, True):
        found = [_thermal.compared(run, random) for run in range(runs)]
        rms = {name: np.sqrt(np.mean([one[0][name] ** 2 for one in found])) for name in found[0][0]}
        print("random curves:" if random else "one curve:", ", ".join(f"{name} {value:.4f}" for name, value in rms.items()))
        truth, following = (100 * np.mean([one[i] for one in found]) for i in (1, 2))
        print(f"  intervals hold the curve in {truth:.1f} %, the readings of the next cycle in {following:.1f} %", flush=True)


def rate(runs):
    static, found = np.mean([_thermal.rate(run) for run in range(runs)], axis=0)
    print(f"\neffect of dT/dt, {runs} records: polynomial 5 leaves {static:.2f}, auto {found:.3f} on the next cycle", flush=True)


def lag(runs):
    left, found = np.array([_thermal.lagging(run) for run in range(runs)]).T
    print(
        f"\nlag 60 s, thermometer noise 0.02 degC, {runs} records: {left.mean():.2f} mdeg/s on the second cycle, at most {left.max():.2f}, "
        f"lag {found.mean():.2f} +- {found.std():.2f} s", flush=True,
    )  # fmt: skip


def doubts(runs):
    print(f"\n{runs} records each: curve inside its intervals of 95 %, rms left on the next cycle, verdicts, findings\n")
    for case in ("coarse thermometer", "two lags", "ageing"):
        inside, left, verdicts, codes = zip(*(_thermal.doubtful(case, run) for run in range(runs)), strict=True)
        said = dict(collections.Counter(code for one in codes for code in one)), dict(collections.Counter(verdicts))
        print(f"{case}: {100 * np.mean(inside):.1f} %, {np.sqrt(np.mean(np.square(left))):.3f}, {said}", flush=True)


def curves(runs):
    runs = min(runs, 12)
    for thermometer in (0.02, 0.0):
        print(f"\nrms / rms in 24-25 degC / maximum, mdeg/s, mean of {runs} runs; thermometer noise {thermometer} degC\n")
        print("| model | " + " | ".join(f"J = {jump:g}" for jump in JUMPS) + " |\n|" + "---|" * 5)
        for model in MODELS:
            kind, _, degree = model.partition(" ")
            cells = []
            for jump in JUMPS:
                found = []
                for run in range(runs):
                    random = np.random.default_rng(run)
                    train, test = (simulate(jump=np.deg2rad(jump), thermometer=thermometer, seed=random) for _ in range(2))
                    one = fit(train.temperature, train.bias, time=train.time, model=kind, degree=int(degree) if degree else None).model
                    found.append(errors(one.curve.value, one.low, one.high, test, jump))
                cells.append("/".join(f"{value:.3g}" for value in np.mean(found, axis=0)))
            print(f"| {model} | " + " | ".join(cells) + " |", flush=True)


def hysteresis(_):
    print(
        "\ntrained on the first cycle, rms error on the second, mdeg/s\n\n| truth | thermometer noise | error | found |\n|---|---|---|---|"
    )
    n = 4500
    for name, truth in (("none", {}), ("lag 60 s", {"lag": 60.0}), ("play 0.6 degC", {"play": 0.6}), ("both", {"lag": 40.0, "play": 0.4})):
        for thermometer in (0.0, 0.02):
            made = simulate(profile="cycle", duration=9000.0, walk=0.0, thermometer=thermometer, seed=3, **truth)
            found = fit(made.temperature[:n], made.bias[:n], time=made.time[:n]).model
            left = made.bias - found.correct(made.bias, made.temperature, time=made.time) - made.truth
            error = np.sqrt(np.mean(left[n:] ** 2)) / MDEG
            print(f"| {name} | {thermometer} | {error:.3g} | lag {found.lag:.1f} s, play {found.play:.2f} degC |", flush=True)


def speed(_):
    print()
    for n in (5400, 54_000, 540_000):
        made = simulate(duration=5400.0, rate=n / 5400.0, seed=1)
        for model, degree in (("polynomial", 3), ("table", None), ("auto", None)):
            times = []
            for _ in range(3):
                start = time.perf_counter()
                fit(made.temperature, made.bias, time=made.time, model=model, degree=degree)
                times.append(time.perf_counter() - start)
            print(f"{n} samples, {model}: {1e3 * min(times):.0f} ms", flush=True)
    model = Chebyshev(np.ones(6), 20.0, 45.0)
    t = np.linspace(20, 45, 1_000_000)
    start = time.perf_counter()
    model.value(t)
    print(f"polynomial 5 at 10^6 temperatures: {1e3 * (time.perf_counter() - start):.0f} ms")


PARTS = {
    "phantoms": phantoms,
    "noise": noise,
    "rate": rate,
    "lag": lag,
    "doubts": doubts,
    "curves": curves,
    "hysteresis": hysteresis,
    "speed": speed,
}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=PARTS)
    parser.add_argument("--runs", type=int, default=100)
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # there are warnings of temperatures just outside the range
    for name, part in PARTS.items():
        if options.only in (None, name):
            part(options.runs)
