"""The tables of thermal models: jumps, hysteresis, intervals and time of a fit, with fixed seeds.

    python benchmarks/temperature.py                  everything (minutes)
    python benchmarks/temperature.py --only jump      one part: jump, hysteresis, intervals, speed
    python benchmarks/temperature.py --runs 48        more runs per cell of the tables

Errors are those of the curve against the truth, in mdeg/s.
"""

import argparse
import time
import warnings

import numpy as np

from jaxcal.temperature import Chebyshev, binned, fit, reference_bias, simulate
from jaxcal.temperature._linear import table_curve
from jaxcal.temperature._smoothing import spline_curve

MDEG = np.deg2rad(1e-3)
JUMPS = (0.3, 0.1, 0.02, 0.0)
MODELS = (
    "polynomial 1", "polynomial 3", "polynomial 5", "polynomial 9", "polynomial 15", "polynomial", "table", "table 1 degC",
    "pchip", "spline", "steps", "auto",
)  # fmt: skip


def errors(value, low, high, test, jump):
    """rms, rms in 24-25 degC, maximum; median removed."""
    t = test.true_temperature
    off = (value(np.clip(t, low, high)) - reference_bias(t, np.deg2rad(jump))) / MDEG
    off = off - np.median(off)
    near = (t >= 24) & (t <= 25)
    return np.sqrt(np.mean(off**2)), np.sqrt(np.mean(off[near] ** 2)), np.abs(off).max()


def jump_table(runs):
    for thermometer in (0.02, 0.0):
        print(f"\nrms / rms in 24-25 degC / maximum, mdeg/s, mean of {runs} runs; thermometer noise {thermometer} degC\n")
        print("| model | " + " | ".join(f"J = {jump:g}" for jump in JUMPS) + " |\n|" + "---|" * 5)
        rows = {model: [] for model in MODELS}
        for jump in JUMPS:
            cells, said = {model: [] for model in MODELS}, {model: [] for model in MODELS}
            for run in range(runs):
                random = np.random.default_rng(run)
                train, test = (simulate(jump=np.deg2rad(jump), thermometer=thermometer, seed=random) for _ in range(2))
                for model in MODELS:
                    kind, _, degree = model.partition(" ")
                    if model == "table 1 degC":
                        curve = table_curve(binned(train.temperature, train.bias, 1.0))
                        cells[model].append(errors(curve.value, -99, 99, test, jump))
                        continue
                    found = fit(train.temperature, train.bias, model=kind, degree=int(degree) if degree else None)
                    cells[model].append(errors(found.model.curve.value, found.model.low, found.model.high, test, jump))
                    alarm = any("is not a polynomial" in sentence for sentence in found.warnings)
                    said[model].append((found.degree or 0, len(found.steps), alarm, found.kind == "steps"))
            for model in MODELS:
                text = "/".join(f"{value:.3g}" for value in np.mean(cells[model], axis=0))
                if said[model]:
                    degree, steps, alarm, chosen = np.mean(said[model], axis=0)
                    text += {"polynomial": f" (degree {degree:.1f}, alarm {alarm:.0%})", "steps": f" ({steps:.1f} steps)",
                             "auto": f" (steps {chosen:.0%}, alarm {alarm:.0%})"}.get(model, "")  # fmt: skip
                rows[model].append(text)
        for model in MODELS:
            print(f"| {model} | " + " | ".join(rows[model]) + " |", flush=True)


def hysteresis(runs):
    print("\ntrained on the first cycle, rms error on the second, mdeg/s: static / with what was found (lag s, play degC)\n")
    print("| truth | thermometer noise | polynomial 5 | table | steps | found |\n|---|---|---|---|---|---|")
    n = 4500
    for name, truth in (("none", {}), ("lag 60 s", {"lag": 60.0}), ("play 0.6 degC", {"play": 0.6}), ("both", {"lag": 40.0, "play": 0.4})):
        for thermometer in (0.0, 0.02):
            made = simulate(profile="cycle", duration=9000.0, walk=0.0, thermometer=thermometer, seed=3, **truth)
            t, b, s = made.temperature[:n], made.bias[:n], made.time[:n]
            chosen = fit(t, b, time=s)
            given = {"lag": chosen.model.lag, "play": chosen.model.play}
            cells = []
            for model, degree in (("polynomial", 5), ("table", None), ("steps", None)):
                pair = []
                for options in ({}, given):
                    found = fit(t, b, time=s, model=model, degree=degree, **options).model
                    left = made.bias - found.correct(made.bias, made.temperature, time=made.time) - made.truth
                    pair.append(np.sqrt(np.mean(left[n:] ** 2)) / MDEG)
                cells.append("{:.3g} / {:.3g}".format(*pair))
            what = f"{chosen.kind}, lag {given['lag']:.1f} s, play {given['play']:.2f} degC"
            print(f"| {name} | {thermometer} | " + " | ".join(cells) + f" | {what} |", flush=True)


def intervals(runs):
    print("\nshare of the curve inside its intervals of 95 %, and of step parameters (centre, width, height) inside theirs\n")
    for walk in (0.0, 2e-5):
        for model, degree, jump in (("polynomial", 3, 0.0), ("steps", None, 0.3), ("spline", None, 0.0), ("table", None, 0.0)):
            inside, steps = [], []
            for run in range(5 * runs):
                made = simulate(jump=np.deg2rad(jump), seed=run, walk=np.deg2rad(walk))
                found = fit(made.temperature, made.bias, model=model, degree=degree)
                t = np.linspace(20.2, 44.8, 100)
                low, high = found.interval_at(t)
                truth = reference_bias(t, np.deg2rad(jump)) + np.mean(made.bias - made.truth)
                inside.append((low <= truth) & (truth <= high))
                if found.steps:
                    step = max(found.steps, key=lambda one: abs(one.height))
                    off = step.centre - 24.5, step.width - 0.08, step.height - np.deg2rad(jump)
                    steps.append(np.abs(off) < 1.96 * np.array([step.centre_error, step.width_error, step.height_error]))
            text = "" if not steps else "; steps " + " ".join(f"{100 * share:.0f} %" for share in np.mean(steps, axis=0))
            print(f"random walk {walk:g} deg/s: {model}, J = {jump}: {100 * np.mean(inside):.1f} %{text}", flush=True)


def speed(runs):
    print()
    for n in (5400, 54_000, 540_000):
        made = simulate(duration=5400.0, rate=n / 5400.0, seed=1)
        for model in ("polynomial", "table", "pchip", "spline", "steps", "auto"):
            times = []
            for _ in range(3):
                start = time.perf_counter()
                fit(made.temperature, made.bias, time=made.time, model=model)
                times.append(time.perf_counter() - start)
            print(f"{n} samples, {model}: {1e3 * min(times):.0f} ms", flush=True)
    for size in (250, 2500, 25_000):
        t = np.linspace(0, size / 10, 10 * size)
        bins = binned(t, np.sin(t) + np.random.default_rng(0).normal(size=len(t)))
        start = time.perf_counter()
        spline_curve(bins)
        print(f"spline of {len(bins.t)} bins: {1e3 * (time.perf_counter() - start):.0f} ms", flush=True)
    model = Chebyshev(np.ones(6), 20.0, 45.0)
    t = np.linspace(20, 45, 1_000_000)
    start = time.perf_counter()
    model.value(t)
    print(f"polynomial 5 at 10^6 temperatures: {1e3 * (time.perf_counter() - start):.0f} ms")


PARTS = {"jump": jump_table, "hysteresis": hysteresis, "intervals": intervals, "speed": speed}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=PARTS)
    parser.add_argument("--runs", type=int, default=12)
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # of temperatures a hair outside the range
    for name, part in PARTS.items():
        if options.only in (None, name):
            part(options.runs)
