"""Noise of records that are not as the model assumes: missing samples, several recordings, and records that are hardly any.

    python benchmarks/records.py [--only gaps,settling,recordings,degenerate] [--case exponent] [--runs 20] [--seed 1]

gaps: case A (2^17 samples at 100 Hz; N 0.25 deg/sqrt(h), B 7.6 deg/h, K 1.8 deg/h/sqrt(s)) with missing samples; rmse in % of N, B, K,
bound of the observed record, share of 95 % intervals that hold the truth, share of records in which K is present, CPU seconds of a fit.
settling: records of four spectra that lose 25, 40 and 60 % in four ways: in how many the filling of the gaps does not settle.
recordings, degenerate: several recordings of a device, and records that are hardly any. Disturbances and other spectra: real_noise.py.

Records are drawn ordinate by ordinate from their density, without using `jaxcal.noise.Noise.simulate`.
"""

import argparse
import contextlib
import io
import itertools
import pathlib
import tempfile
import time
import warnings
from functools import partial

import jax
import numpy as np
import record_bounds
import scipy.fft

import jaxcal
from jaxcal.cli import main

DEG = np.pi / 180
RATE = 100.0
CASE_A = np.array([0.25 * DEG / 60, 7.6 * DEG / 3600, 1.8 * DEG / 3600])
GAPS = {
    "none": (0, 0), "0.01 %": (1e-4, 1), "0.1 %": (1e-3, 1), "1 %": (0.01, 1), "5 %": (0.05, 1), "10 %": (0.1, 1), "20 %": (0.2, 1),
    "100 gaps of 0.1 %": (0.1, 1e-3), "10 gaps of 1 %": (0.1, 1e-2), "one gap of 30 %": (0.3, 0.3),
}  # fmt: skip


def columns(n):
    """Density of the ordinates of a DCT-II of n samples, per squared coefficient N, B, K."""
    k, dt = np.arange(1, n), 1 / RATE
    s = 2 * np.sin(np.pi * k / (2 * n))
    return np.stack([np.ones(n - 1), dt / s * (1 - 2 / (np.pi**2 * k)), dt**2 / s**2], axis=1)


def _quantised(n):
    """The same, per squared coefficient Q over the sampling interval."""
    return 4 * np.sin(np.pi * np.arange(1, n) / (2 * n)) ** 2


def drawn(density, rng):
    """A record whose ordinates have this density."""
    ordinates = np.sqrt(density * RATE) * rng.standard_normal(len(density))
    return scipy.fft.idct(np.concatenate([[0.0], ordinates]), norm="ortho")


def lost(y, share, length, rng):
    """The record without a share of its samples, in gaps of one length: 1 for single samples, otherwise a share of the record."""
    y, n = y.copy(), len(y)
    size = 1 if length == 1 else int(length * n)
    for start in rng.choice(n - size, round(share * n / size), replace=False):
        y[start : start + size] = np.nan
    return y


def _lost_samples(n, share, length, rng):
    return np.isnan(lost(np.zeros(n), share, length, rng))


def gaps(runs, seed, case=""):
    n = 2**17
    density = columns(n) @ CASE_A**2
    # Q is fitted, and is zero
    columns_all, squares = np.column_stack([columns(n), _quantised(n)]), np.append(CASE_A**2, 0.0)
    complete = record_bounds.complete_information(columns_all, squares)
    print(f"{'missing':20s} {'rmse N':>8s} {'B':>6s} {'K':>6s}   {'bound N':>8s} {'B':>6s} {'K':>6s}   inside N, B, K   K present   CPU s")
    for name, (share, length) in GAPS.items():
        if not name.startswith(tuple(case.split(";"))):
            continue
        errors, inside, present, spent = [], [], [], []
        for i in range(runs):
            y = drawn(density, np.random.default_rng([seed, i]))
            y = lost(y, share, length, np.random.default_rng([seed + 1, i])) if share else y
            start = time.process_time()
            found = jaxcal.noise.fit(y, RATE)
            spent.append(time.process_time() - start)
            errors.append([float(getattr(found.noise, term)) / truth - 1 for term, truth in zip("NBK", CASE_A, strict=True)])
            inside.append([found.interval[term][0] <= truth <= found.interval[term][1] for term, truth in zip("NBK", CASE_A, strict=True)])
            present.append(found.presence["K"] == "present")
        masks = partial(_lost_samples, n, share, length)
        gone = record_bounds.information_lost(columns_all, squares, masks, 400 if share else 0, 1 / RATE, seed)
        bound = 100 * record_bounds.relative_bound(complete - gone.sum(axis=0) / max(len(gone), 1), squares)
        rmse, held = 100 * np.sqrt(np.mean(np.square(errors), axis=0)), 100 * np.mean(inside, axis=0)
        cells = " ".join(f"{value:5.1f}" for value in held)
        print(
            f"{name:20s} {rmse[0]:8.2f} {rmse[1]:6.1f} {rmse[2]:6.1f}   {bound[0]:8.2f} {bound[1]:6.1f} {bound[2]:6.1f}   {cells}   "
            f"{100 * np.mean(present):9.1f}   {np.median(spent):5.2f}",
            flush=True,
        )


def _bursts_lost(n, share, rng):
    gone = np.zeros(n, bool)
    while gone.mean() < share:
        length = int(np.exp(rng.uniform(np.log(5), np.log(n / 20))))
        start = rng.integers(0, n - length)
        gone[start : start + length] = True
    return gone


LOSSES = {
    "scattered": lambda n, share, rng: rng.permutation(n) < share * n,
    "periodic": lambda n, share, rng: np.arange(n) % 200 < 200 * share,
    "in bursts": _bursts_lost,
    "in one gap": lambda n, share, rng: (np.arange(n) >= 0.3 * n) & (np.arange(n) < (0.3 + share) * n),
}


def settling(runs, seed):
    n = 2**13
    for name, make in LOSSES.items():
        unsettled, spent = 0, time.process_time()
        for scale in ((1, 1, 1), (1, 1, 0), (1, 0, 0), (1, 0, 30)):
            density = columns(n) @ (CASE_A * scale) ** 2
            for share, i in itertools.product((0.25, 0.4, 0.6), range(runs)):
                y = drawn(density, np.random.default_rng([seed, 8, i]))
                y[make(n, share, np.random.default_rng([seed, 9, i]))] = np.nan
                unsettled += "unsettled" in jaxcal.noise.fit(y, RATE).codes
        each = (time.process_time() - spent) / (12 * runs)
        print(f"lost {name:10s} {unsettled} of {12 * runs} do not settle, {each:.2f} s of CPU each", flush=True)


def recordings(runs, seed):
    """Whether the interval of four recordings holds the coefficient of the fifth; 4,096 samples, true spreads of N."""
    for spread in (0.01, 0.1, 0.3):
        inside = []
        for i in range(runs):
            r = np.random.default_rng([seed, i])
            truth = np.exp(spread * r.standard_normal(5))
            found = jaxcal.noise.fit_recordings([n * r.standard_normal(4096) for n in truth[:4]], RATE, terms="NK")
            low, high = found.interval["N"]
            inside.append(low <= truth[4] / np.sqrt(RATE) <= high)
        print(
            f"spread {100 * spread:.0f} %: the interval of four recordings holds the fifth's N in {100 * np.mean(inside):.1f} % of {runs}",
            flush=True,
        )


def degenerate(runs, seed):
    """Short, moving and degenerate records: answers, refusals, NaN, warnings of Python; and the status of the command for moving ones."""
    kinds = {
        "white": lambda t, w, r: w, "moving": lambda t, w, r: r.uniform(1, 5) * np.sin(r.uniform(0.5, 3) * t) + 0.01 * w,
        "sine": lambda t, w, r: 1e-9 * w + np.sin(2 * np.pi * r.uniform(0.1, 30.0) * t), "summed": lambda t, w, r: w.cumsum().cumsum(),
        "coarse": lambda t, w, r: np.round(0.4 * w), "late": lambda t, w, r: np.where(np.arange(len(t)) < len(t) // 2, 0.0, w),
        "lost": lambda t, w, r: np.where(r.random(len(t)) < r.random(), np.nan, w),
        "growing": lambda t, w, r: w * np.exp(5 * t / max(t[-1], 0.01)), "ramp": lambda t, w, r: 100.0 * t,
        "step": lambda t, w, r: (t > t[len(t) // 2]).astype(float), "cauchy": lambda t, w, r: r.standard_cauchy(len(t)),
        "held": lambda t, w, r: np.repeat(w[: len(t) // 10 + 1], 10)[: len(t)], "offset": lambda t, w, r: 1e15 + 1e8 * w,
        "tiny": lambda t, w, r: 1e-150 * w, "constant": lambda t, w, r: 0 * t,
    }  # fmt: skip
    counts = dict.fromkeys(("answers", "refusals", "NaN", "warnings", "other errors"), 0)
    for i in range(runs):
        r, kind = np.random.default_rng([seed, i]), list(kinds)[i % len(kinds)]
        n = int(np.exp(r.uniform(np.log(2), np.log(5000))))
        y = kinds[kind](np.arange(n) / RATE, r.standard_normal(n), r)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                fit = jaxcal.noise.fit(y, RATE)
                tables = (fit.interval, fit.upper_limit, fit.significance, fit.longer_record, fit.covariance, fit.noise)
                outcome = "NaN" if any(np.isnan(leaf).any() for leaf in jax.tree.leaves(tables)) else "answers"
            except jaxcal.JaxcalError:
                outcome = "refusals"
            except Warning:
                outcome = "warnings"
            except Exception:
                outcome = "other errors"
        counts[outcome] += 1
        if outcome not in ("answers", "refusals"):
            print(kind, n, outcome)
    print(f"{runs} records: {counts}")
    status = []
    for i in range(runs // 10):
        r = np.random.default_rng([seed, i, 1])
        n = int(r.uniform(500, 5000))
        t = np.arange(n) / RATE
        turn = np.stack([r.uniform(0.3, 3) * np.sin(r.uniform(0.5, 3) * t + phase) for phase in range(3)], axis=1)
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "log.csv"
            table = np.column_stack([t, turn + 0.01 * r.standard_normal((n, 3))])
            np.savetxt(path, table, delimiter=",", header="time [s],gyro_x [rad/s],gyro_y [rad/s],gyro_z [rad/s]", comments="")
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                status.append(main(["noise", str(path), "--json", str(path.with_suffix(".json"))]))
    print(f"{len(status)} logs of a sensor that moves: status 0 in {sum(one == 0 for one in status)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="gaps")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", default="", help="rows of gaps that begin with one of these, separated by semicolons")
    options = parser.parse_args()
    tables = {"gaps": partial(gaps, case=options.case), "settling": settling, "recordings": recordings, "degenerate": degenerate}
    for table in options.only.split(","):
        tables[table](options.runs, options.seed)
