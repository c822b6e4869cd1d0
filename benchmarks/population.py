"""Pooling over a fleet: errors of the coefficients alone, pooled, and with the true population known; coverage; odd units; size.

    python benchmarks/population.py [--only errors,odd,size] [--fleets 20]

errors: 30 devices with N 0.25 deg/sqrt(h), B 7.6 deg/h, K 1.8 deg/h/sqrt(s) at 100 Hz, whose B and K scatter by 20 and 30 % between devices
(normal logarithms), or by half of that; records of 5.5 and 22 minutes. odd: one device three spreads away in B. size: time and memory of
the hierarchical step for 10,000 devices. Records are drawn ordinate by ordinate, as in records.py.
"""

import argparse
import dataclasses
import resource
import time

import numpy as np
import scipy.fft
from records import CASE_A, RATE, columns, drawn

import jaxcal
from jaxcal.batch import population

TERMS = ("N", "B", "K")


def fleet(samples, spread, rng, devices=30, odd=None):
    """Coefficients of the devices (devices, 3), their records, and the fits."""
    logs = np.log(CASE_A) + np.array([0.05, *spread]) * rng.standard_normal((devices, 3))
    if odd is not None:
        logs[0, 1] = np.log(CASE_A[1]) + odd * spread[0]
    shapes = columns(samples)
    truth = np.exp(logs)
    records = [drawn(shapes @ row**2, rng) for row in truth]
    return truth, records, [jaxcal.noise.fit(y, RATE, terms="NBK") for y in records]


def known(samples, records, mean, spread, rng, steps=6000):
    """Medians of the coefficients with the true population known: Metropolis for all devices at once, on bins of its own."""
    count = samples - 1
    edges = np.unique(np.concatenate([np.arange(20), np.round(np.geomspace(20, count, 90))])).astype(int)
    size, shapes = np.diff(edges), columns(samples)
    shapes = np.add.reduceat(shapes, edges[:-1], axis=0) / size[:, None]
    power = np.stack([scipy.fft.dct(y, norm="ortho")[1:] ** 2 / RATE for y in records])
    power = np.add.reduceat(power, edges[:-1], axis=1) / size

    def density(x):
        s = np.exp(2 * x) @ shapes.T
        return -0.5 * np.sum(size * (np.log(s) + power / s), axis=1) - 0.5 * np.sum(((x - mean) / spread) ** 2, axis=1)

    x = np.tile(mean, (len(records), 1))
    now, kept, width = density(x), [], np.array([0.005, 0.6 * spread[1], 0.6 * spread[2]])
    x[:, 0] = 0.5 * np.log(power[:, -30:].mean(axis=1))
    now = density(x)
    for step in range(steps):
        tried = x + width * rng.standard_normal(x.shape)
        new = density(tried)
        keep = np.log(rng.random(len(x))) < new - now
        x, now = np.where(keep[:, None], tried, x), np.where(keep, new, now)
        if step >= steps // 4:
            kept.append(x)
    return np.exp(np.median(kept, axis=0))


def errors(fleets):
    print(
        "| record | spread B, K | rmse alone B, K | pooled | population known | 95 % intervals hold N, B, K | spread of B, K hold | CPU s |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for minutes in (5.5, 22.0):
        for spread in ((0.2, 0.3), (0.1, 0.15)):
            alone, pooled, best, inside, around, spent = [], [], [], [], [], []
            for seed in range(fleets):
                rng, samples = np.random.default_rng([seed, int(minutes)]), int(minutes * 60 * RATE)
                truth, records, fits = fleet(samples, spread, rng)
                start = time.process_time()
                found = population(fits, terms=TERMS, seed=seed)
                spent.append(time.process_time() - start)
                alone.append(found.raw / truth - 1)
                pooled.append(found.pooled / truth - 1)
                best.append(known(samples, records, np.log(CASE_A), np.array([0.05, *spread]), rng) / truth - 1)
                inside.append((found.pooled_interval[..., 0] <= truth) & (truth <= found.pooled_interval[..., 1]))
                low, high = found.spread_interval.T
                around.append((low[1:] <= spread) & (np.array(spread) <= high[1:]))
            rows = [100 * np.sqrt(np.mean(np.square(values), axis=(0, 1)))[1:] for values in (alone, pooled, best)]
            held, shown = 100 * np.mean(inside, axis=(0, 1)), 100 * np.mean(around, axis=0)
            cells = [f"{b:.1f}, {k:.1f}" for b, k in rows] + [", ".join(f"{v:.0f}" for v in held), ", ".join(f"{v:.0f}" for v in shown)]
            print(f"| {minutes} min | {spread} | " + " | ".join(cells) + f" | {np.median(spent):.1f} |", flush=True)


def odd(fleets):
    flagged, drawn_in, false = [], [], []
    for seed in range(fleets):
        _, _, fits = fleet(int(22 * 60 * RATE), (0.2, 0.3), np.random.default_rng([seed, 7]), odd=3.0)
        found = population(fits, terms=TERMS, seed=seed)
        flagged.append((0, "B") in found.outliers)
        false.append(np.mean([(i, term) in found.outliers for i in range(1, 30) for term in TERMS]))
        error = (np.log(found.raw_interval[0, 1, 1]) - np.log(found.raw_interval[0, 1, 0])) / (2 * 1.96)
        drawn_in.append((np.log(found.raw[0, 1]) - np.log(found.pooled[0, 1])) / error)
    print(
        f"a device three spreads away: named in {100 * np.mean(flagged):.0f} % of {fleets} fleets, others in {100 * np.mean(false):.1f} % "
        f"of cases; drawn in by {np.median(drawn_in):.2f} of its own standard error in the median"
    )


def size(_):
    rng = np.random.default_rng(0)
    _, _, fits = fleet(int(5.5 * 60 * RATE), (0.2, 0.3), rng, devices=100)
    many = [dataclasses.replace(fits[i % 100]) for i in range(10_000)]
    start, spent = time.perf_counter(), time.process_time()
    population(many, terms=TERMS)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(
        f"10,000 devices: {time.perf_counter() - start:.0f} s, {time.process_time() - spent:.0f} s of processors, {memory:.1f} GB at most"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="errors,odd,size")
    parser.add_argument("--fleets", type=int, default=20)
    options = parser.parse_args()
    for table in options.only.split(","):
        {"errors": errors, "odd": odd, "size": size}[table](options.fleets)
