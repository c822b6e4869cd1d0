"""Errors of the estimators of `jaxcal.noise.fit` beside the information bound, and the effect of disturbances, by Monte Carlo.

    python benchmarks/efficiency.py                    the tables of docs (about fifteen minutes on two cores)
    python benchmarks/efficiency.py --runs 40          a quick look
    python benchmarks/efficiency.py --only cases       one part: cases, power, absent, disturbances or time

100 Hz, N = 0.25 deg/sqrt(h), B = 7.6 deg/h, K = 1.8 deg/h/sqrt(s). A: n = 2^17, Q = 0. B: K = 0. C: Q = 1.8 arcsec. E: B = 0.
D, F: A, B at n = 2^19. All four terms are always fitted. Record k has seed k. The tables give the rmse in per cent of the coefficient with
its Monte Carlo standard error, the coverage of 95 % intervals, and the share of records in which a term is called present.
"""

import argparse
import dataclasses
import time

import numpy as np
import scipy.signal

import jaxcal
from jaxcal.noise import Noise

RATE, DEGREE = 100.0, np.pi / 180.0
TERMS = ("Q", "N", "B", "K")
FULL = Noise(N=0.25 / 60 * DEGREE, B=7.6 / 3600 * DEGREE, K=1.8 / 3600 * DEGREE)
CASES = {
    "A": (FULL, 1 << 17),
    "B": (dataclasses.replace(FULL, K=0.0), 1 << 17),
    "C": (dataclasses.replace(FULL, Q=1.8 / 3600 * DEGREE), 1 << 17),
    "D": (FULL, 1 << 19),
    "E": (dataclasses.replace(FULL, B=0.0), 1 << 17),
    "F": (dataclasses.replace(FULL, K=0.0), 1 << 19),
}
METHODS = ("whittle", "gls", "log", "slope")


def row(fits, truth):
    """Text on each term, from many fits."""
    cells = []
    for term in TERMS:
        true = float(getattr(truth, term))
        x = np.array([float(getattr(fit.noise, term)) for fit in fits])
        known = fits[0].interval
        if true:
            e = 100.0 * (x / true - 1.0)
            rmse = np.sqrt(np.mean(e**2))
            text = f"{e.mean():+6.1f} /{rmse:6.2f} ±{np.std(e**2) / (2 * rmse * np.sqrt(len(e))):4.2f}"
            if known:
                inside = np.mean([fit.interval[term][0] <= true <= fit.interval[term][1] for fit in fits])
                text += f" {100 * inside:5.1f}"
        else:
            text = f"{'absent':>22}"
        if known:
            text += f" {100 * np.mean([fit.presence[term] == 'present' for fit in fits]):5.1f}"
        cells.append(f"{text:34}")
    return "".join(cells)


def cases(runs):
    """Print bias, rmse, coverage and verdicts of every method in every case."""
    print(f"{'':18}" + "".join(f"{term + ': bias / rmse ±, covers, present %':34}" for term in TERMS))
    for name, (truth, n) in CASES.items():
        for method in METHODS:
            count = runs if n == 1 << 17 else max(runs // 3, 16)
            if name == "A" and method in ("whittle", "gls"):
                count = 8 * runs // 3  # 400 for 150 runs: gives the coverage to 1 %
            fits = [jaxcal.noise.fit(truth.simulate(n, RATE, seed=seed), RATE, method=method) for seed in range(count)]
            print(f"{name} {method:11}{count:4d} {row(fits, truth)}", flush=True)


def power(runs):
    """Print the share of records in which K and B of different strength are called present, with other terms as in case A."""
    for term, unit, values in (("K", "deg/h/sqrt(s)", (0.3, 0.5, 0.8, 1.2, 1.8)), ("B", "deg/h", (2.0, 3.5, 5.0, 7.6))):
        for value in values:
            truth = dataclasses.replace(FULL, **{term: value / 3600 * DEGREE})
            for method in ("whittle", "gls"):
                rise = [
                    float(jaxcal.noise.fit(truth.simulate(1 << 17, RATE, seed=seed), RATE, method=method).significance[term])
                    for seed in range(runs)
                ]
                shares = [100 * np.mean(np.array(rise) > level) for level in (2.71, 5.41, 11.8)]
                found = ", ".join(f"{share:.0f}" for share in shares)
                print(f"{method:8} {term} = {value} {unit}: present in {found} % at 2.71, 5.41, 11.8", flush=True)


def absent(runs):
    """Print how often an absent Q or K (case B) is called present at a nominal 1 %."""
    truth, n = CASES["B"]
    for method in ("whittle", "gls"):
        fits = [jaxcal.noise.fit(truth.simulate(n, RATE, seed=seed), RATE, method=method) for seed in range(runs)]
        found = {term: sum(fit.presence[term] == "present" for fit in fits) for term in ("Q", "K")}
        said = ", ".join(f"{term} in {count} ({100 * count / runs:.2f} %)" for term, count in found.items())
        print(f"{method:8} calls present: {said} of {runs} records", flush=True)


def disturbances(runs):
    """Print the bias of N, B and K under each disturbance, with the default fit and with the cure that the warning names."""
    n = 1 << 17
    t = np.arange(n) / RATE
    white = FULL.N * np.sqrt(RATE)
    b, a = scipy.signal.butter(2, 20.0, fs=RATE)

    def spiked(y, seed):
        y = y.copy()
        y[np.random.default_rng(seed).choice(n, 10, replace=False)] += 50 * white
        return y

    def marked(y, seed):
        process = Noise(markov=((3e-3 * DEGREE * np.sqrt(2.0), 1.0),))
        return y + process.simulate(n, RATE, seed=seed + 10_000)

    table = {
        "none": (lambda y, seed: y, {}),
        "20 Hz low-pass": (lambda y, seed: scipy.signal.lfilter(b, a, y), {}),
        "10 outliers of 50 sd": (spiked, {}),
        "Gauss-Markov 3e-3 deg/s, 1 s": (marked, {"terms": (*TERMS, "markov")}),
        "sinusoid 0.1 Hz, 2e-3 deg/s": (lambda y, seed: y + 2e-3 * DEGREE * np.sin(2 * np.pi * 0.1 * t + seed), {}),
        "ramp 0.1 deg/s": (lambda y, seed: y + 0.1 * DEGREE * t / t[-1], {"terms": (*TERMS, "R")}),
        "rounding, 1.5 sd": (lambda y, seed: np.round(y / (1.5 * white)) * 1.5 * white, {}),
        "rounding, 6 sd": (lambda y, seed: np.round(y / (6 * white)) * 6 * white, {}),
    }
    for name, (spoil, cure) in table.items():
        for options in [{}] + ([cure] if cure else []):
            fits = [jaxcal.noise.fit(spoil(FULL.simulate(n, RATE, seed=seed), seed), RATE, **options) for seed in range(runs)]
            text = "  ".join(
                f"{term} {100 * np.mean([float(getattr(fit.noise, term)) / float(getattr(FULL, term)) - 1 for fit in fits]):+7.1f}"
                for term in "NBK"
            )
            warned = np.mean([bool(fit.warnings) for fit in fits])
            label = name + (" (cured)" if options else "")
            print(
                f"{label:38} bias % {text}   warned {100 * warned:.0f} %, from {np.median([float(f.band[0]) for f in fits]):.2g} s",
                flush=True,
            )


def seconds():
    """Time one fit after compilation: the whole `fit`, with intervals, checks and the Allan deviation."""
    for n, channels in ((1 << 17, 1), (1 << 19, 1), (10**6, 6)):
        y = np.stack([FULL.simulate(n, RATE, seed=seed) for seed in range(channels)], axis=1)
        y = np.asfortranarray(y) if channels > 1 else y[:, 0]
        for method in ("whittle", "gls"):
            start = time.perf_counter()
            jaxcal.noise.fit(y, RATE, method=method)
            first, times = time.perf_counter() - start, []
            for _ in range(5):
                start = time.perf_counter()
                jaxcal.noise.fit(y, RATE, method=method)
                times.append(time.perf_counter() - start)
            print(f"{method:8} {n:8d} x {channels}: {1e3 * min(times):7.1f} ms, first call {first:.1f} s", flush=True)


def main():
    """Run all parts, or one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=150, help="records of each case")
    parser.add_argument("--only", choices=["cases", "power", "absent", "disturbances", "time"], help="one part")
    options = parser.parse_args()
    parts = {
        "time": seconds,
        "cases": lambda: cases(options.runs),
        "power": lambda: power(options.runs),
        "absent": lambda: absent(max(options.runs, 400)),
        "disturbances": lambda: disturbances(min(options.runs, 40)),
    }
    for name, part in parts.items():
        if options.only in (None, name):
            print(f"\n{name}")
            part()


if __name__ == "__main__":
    main()
