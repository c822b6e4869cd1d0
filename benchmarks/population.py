"""Pooling over a fleet: errors of the coefficients alone, pooled, and with the true population known; coverage of every interval; odd
units; the next recording; levels; size.

    python benchmarks/population.py [--only errors,odd,next,levels,size] [--fleets 20]

errors: 30 devices with N 0.25 deg/sqrt(h), B 7.6 deg/h, K 1.8 deg/h/sqrt(s) at 100 Hz, whose B and K scatter by 20 and 30 % between
devices (normal logarithms), or by half of that; records of 5.5 and 22 minutes. Three samplers that share no code with jaxcal bound what
is possible: one knows the population, one knows its spread and must find its middle, and one knows only that the logarithms are normal.
odd: one device is three spreads away in B; also the power of a test that knows the population. next: how well the first recording of a
device predicts its second, alone and pooled. levels: devices, recordings and a covariate, from estimates with errors. size:
time and memory of the hierarchical step for 10,000 devices. Records are drawn ordinate by ordinate, as in
records.py.
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


def known(samples, records, mean, spread, rng, steps=6000, unknown=""):
    """Medians of the coefficients for a known population, by a Metropolis sampler for all devices at once, on bins of its own.

    With `unknown` "mean" the mean of the population is drawn too, and with "mean and spread" both are. The prior of the variance is flat.
    """
    count = samples - 1
    edges = np.unique(np.concatenate([np.arange(20), np.round(np.geomspace(20, count, 90))])).astype(int)
    size, shapes = np.diff(edges), columns(samples)
    shapes = np.add.reduceat(shapes, edges[:-1], axis=0) / size[:, None]
    power = np.stack([scipy.fft.dct(y, norm="ortho")[1:] ** 2 / RATE for y in records])
    power = np.add.reduceat(power, edges[:-1], axis=1) / size

    def likelihood(x):
        s = np.exp(2 * x) @ shapes.T
        return -0.5 * np.sum(size * (np.log(s) + power / s), axis=1)

    def prior(x):
        return -0.5 * np.sum(((x - mean) / spread) ** 2, axis=1)

    x = np.tile(mean, (len(records), 1))
    kept, width = [], np.array([0.005, 0.6 * spread[1], 0.6 * spread[2]])
    x[:, 0] = 0.5 * np.log(power[:, -30:].mean(axis=1))
    now = likelihood(x)
    for step in range(steps):
        tried = x + width * rng.standard_normal(x.shape)
        new = likelihood(tried)
        keep = np.log(rng.random(len(x))) < new - now + prior(tried) - prior(x)
        x, now = np.where(keep[:, None], tried, x), np.where(keep, new, now)
        if unknown:
            mean = x.mean(axis=0) + spread / np.sqrt(len(x)) * rng.standard_normal(3)
            shift = np.where(np.arange(3) == 1 + step % 2, 0.4 * spread * rng.standard_normal(), 0.0)
            new = likelihood(x + shift)
            if np.log(rng.random()) < np.sum(new - now):
                x, mean, now = x + shift, mean + shift, new
        if unknown == "mean and spread":
            spread = np.sqrt(np.sum((x - mean) ** 2, axis=0) / 2 / rng.gamma(len(x) / 2 - 1, size=3))
            # stretch all devices about the mean together with the spread, because one device at a time moves it slowly
            ratio = np.where(np.arange(3) == 1 + step % 2, np.exp(0.25 * rng.standard_normal()), 1.0)
            tried = mean + ratio * (x - mean)
            new = likelihood(tried)
            if np.log(rng.random()) < np.sum(new - now) + 2 * np.sum(np.log(ratio)):
                x, spread, now = tried, spread * ratio, new
        if step >= steps // 4:
            kept.append(x)
    return np.exp(np.median(kept, axis=0))


def said(text, file):
    """Print, and append to a file, so that an interrupted run keeps its results."""
    print(text, flush=True)
    if file:
        with open(file, "a", encoding="utf-8") as log:
            log.write(text + "\n")


def inside(interval, truth):
    return (interval[..., 0] <= truth) & (truth <= interval[..., 1])


def percent(values, digits=0):
    return ", ".join(f"{100 * value:.{digits}f}" for value in values)


def errors(fleets, file):
    said("| record | spread B, K | fleets | rmse alone B, K | pooled | mean and spread unknown | mean unknown | population known | "
         "pooled intervals hold N, B, K | of spread N, B, K | of median N, B, K | CPU s |\n|" + "---|" * 12, file)  # fmt: skip
    for minutes in (5.5, 22.0):
        for spread in ((0.2, 0.3), (0.1, 0.15)):
            rows, held, spent = [[] for _ in range(5)], [[], [], []], []
            for seed in range(fleets):
                rng, samples = np.random.default_rng([seed, int(minutes)]), int(minutes * 60 * RATE)
                truth, records, fits = fleet(samples, spread, rng)
                start = time.process_time()
                found = population(fits, terms=TERMS, seed=seed)
                spent.append(time.process_time() - start)
                law = np.log(CASE_A), np.array([0.05, *spread])
                best = [known(samples, records, *law, rng, unknown=unknown) for unknown in ("mean and spread", "mean", "")]
                for row, values in zip(rows, (found.raw, found.pooled, *best), strict=True):
                    row.append(values / truth - 1)
                limits = (found.pooled_interval, found.spread_interval, found.median_interval)
                for row, interval, true in zip(held, limits, (truth, law[1], CASE_A), strict=True):
                    row.append(np.mean(inside(interval, true).reshape(-1, 3), axis=0))
                if seed + 1 in (fleets // 4, fleets // 2, fleets):
                    cells = [percent(np.sqrt(np.mean(np.square(row), axis=(0, 1)))[1:], 1) for row in rows]
                    cells += [percent(np.mean(row, axis=0), 0 if row is not held[0] else 1) for row in held]
                    said(f"| {minutes} min | {spread} | {seed + 1} | " + " | ".join(cells) + f" | {np.median(spent):.1f} |", file)


def odd(fleets, file):
    samples, spread = int(22 * 60 * RATE), (0.2, 0.3)
    named, drawn_in, false = [], [], []
    for seed in range(fleets):
        _, _, fits = fleet(samples, spread, np.random.default_rng([seed, 7]), odd=3.0)
        found = population(fits, terms=TERMS, seed=seed)
        named.append((0, "B") in found.outliers)
        false.append(np.mean(found.chance[1:] < 0.05, axis=0))
        error = (np.log(found.raw_interval[0, 1, 1]) - np.log(found.raw_interval[0, 1, 0])) / (2 * 1.96)
        drawn_in.append((np.log(found.raw[0, 1]) - np.log(found.pooled[0, 1])) / error)
    said(
        f"a device three spreads away in B: named in {100 * np.mean(named):.0f} % of {fleets} fleets, others in N, B, K in "
        f"{percent(np.mean(false, axis=0), 1)} %; drawn in by {np.median(drawn_in):.2f} of its own standard error in the median, "
        f"{np.quantile(drawn_in, 0.9):.2f} in nine of ten fleets",
        file,
    )
    rng, estimates = np.random.default_rng(1), []
    for away in (None, 3.0):
        logs = np.log(CASE_A) + np.array([0.05, *spread]) * rng.standard_normal((40 * fleets, 3))
        if away is not None:
            logs[:, 1] = np.log(CASE_A[1]) + away * spread[0]
        estimates.append(np.array([_estimate(drawn(columns(samples) @ np.exp(2 * row), rng)) for row in logs]))
    distance = [np.abs(one - np.log(CASE_A[1])) for one in estimates]
    limit = np.quantile(distance[0], 0.95)
    said(
        f"a test that knows the population, by the likeliest B: named in {100 * np.mean(distance[1] > limit):.1f} % at 5 % false alarms, "
        f"{40 * fleets} devices each; the odd unit lies {np.mean(estimates[1] - np.log(CASE_A[1])) / spread[0]:.2f} +- "
        f"{np.std(estimates[1]) / spread[0]:.2f} spreads away, the limit at {limit / spread[0]:.2f}",
        file,
    )


def _estimate(y):
    """Logarithm of the most likely B, by Fisher scoring on bins of its own."""
    edges = np.unique(np.concatenate([np.arange(20), np.round(np.geomspace(20, len(y) - 1, 90))])).astype(int)
    size = np.diff(edges)
    power = np.add.reduceat(scipy.fft.dct(y, norm="ortho")[1:] ** 2 / RATE, edges[:-1]) / size
    shapes = np.add.reduceat(columns(len(y)), edges[:-1], axis=0) / size[:, None]
    x, middle = np.log(CASE_A), np.log(CASE_A)
    for _ in range(40):
        share = shapes * np.exp(2 * x)
        slope = 2 * share / share.sum(axis=1, keepdims=True)
        information = 0.5 * (slope * size[:, None]).T @ slope + 1e-3 * np.eye(3)
        pull = 0.5 * slope.T @ (size * (power / share.sum(axis=1) - 1)) - 1e-3 * (x - middle)
        x = x + np.clip(np.linalg.solve(information, pull), -0.7, 0.7)
    return x[1]


def following(fleets, file):
    """Log score of each device's second recording as predicted by the first, alone and pooled; B and K repeat within 5 %."""
    samples, gain = int(5.5 * 60 * RATE), []
    for seed in range(fleets):
        rng = np.random.default_rng([seed, 9])
        truth, _, fits = fleet(samples, (0.2, 0.3), rng)
        found = population(fits, terms=TERMS, seed=seed)
        shapes = columns(samples)
        scores = []
        for i, row in enumerate(truth):
            second = jaxcal.noise.log_likelihood(drawn(shapes @ (row * np.exp([0.0, 0.05, 0.05] * rng.standard_normal(3))) ** 2, rng), RATE)
            scores.append(
                [_score(second, found.raw[i], found.raw_interval[i], rng), _score(second, found.pooled[i], found.pooled_interval[i], rng)]
            )
        gain.append(np.mean(np.diff(np.array(scores), axis=1)))
    better = 100 * np.mean(np.array(gain) > 0)
    said(f"the next recording: the pooled values score {np.mean(gain):+.2f} +- {np.std(gain) / np.sqrt(fleets):.2f} in log likelihood a "
         f"recording against the recording alone; higher in {better:.0f} % of {fleets} fleets", file)  # fmt: skip


def _score(second, value, interval, rng, draws=400):
    """Logarithm of the mean likelihood over log-normal values with this interval."""
    floor = 0.1 * CASE_A
    low, high = np.log(np.maximum(interval, floor[:, None])).T
    x = np.log(np.maximum(value, floor)) + (high - low) / 3.92 * rng.standard_normal((draws, 3))
    shapes = np.stack([np.asarray(second.columns[term]) for term in TERMS], axis=1)
    s = np.exp(2 * x) @ shapes.T
    each = -0.5 * np.sum(np.asarray(second.weight) * (np.log(s) + np.asarray(second.density) / s), axis=1)
    return np.logaddexp.reduce(each) - np.log(draws)


def levels(fleets, file):
    """Test levels: devices of 0.2, recordings of 0.1, axes of 0.15, a covariate of 0.05, a class of 0.1, errors of about 0.1; normal."""
    runs, held, held_errors = 5 * fleets, [], []
    for seed in range(runs):
        rng = np.random.default_rng([seed, 11])
        device, recording, axis = (index.ravel() for index in np.indices((20, 3, 3)))
        age, batch = rng.standard_normal(20)[device], np.where(rng.random(20) < 0.5, "a", "b")[device]
        x = 0.2 * rng.standard_normal(20)[device] + 0.1 * rng.standard_normal((20, 3))[device, recording]
        x = x + 0.15 * rng.standard_normal((20, 3))[device, axis] + 0.03 * rng.standard_normal(180)
        x = x + 0.05 * (age - age.mean()) / age.std() + 0.1 * ((batch == "b") - np.mean(batch == "b"))
        error = rng.uniform(0.05, 0.15, 180)
        fits = [Estimate(("x",), [value], [[own**2]]) for value, own in zip(x + error * rng.standard_normal(180), error, strict=True)]
        within = {"recording": recording, "axis": axis}
        found = population(fits, devices=device, levels=within, covariates={"age": age, "batch": batch}, seed=seed)
        truth = np.array([0.2, 0.1, 0.15, 0.03, 0.05, 0.1, 0.0])
        limits = np.concatenate([found.components_interval[:, 0], found.effect_interval[:, 0], found.median_interval])
        held.append(inside(limits, truth))
        held_errors.append(np.mean(inside(found.pooled_interval[:, 0], x)))
    said(f"levels, {runs} fleets: intervals hold device, recording, axis, rest, age, class, median in {percent(np.mean(held, axis=0))} %; "
         f"pooled {100 * np.mean(held_errors):.1f} %", file)  # fmt: skip


@dataclasses.dataclass
class Estimate:
    """The parts of a fit that `population` needs, for fits that are not of noise."""

    names: tuple
    values: list
    covariance: list


def size(_, file):
    rng = np.random.default_rng(0)
    _, _, fits = fleet(int(5.5 * 60 * RATE), (0.2, 0.3), rng, devices=100)
    many = [dataclasses.replace(fits[i % 100]) for i in range(10_000)]
    start, spent = time.perf_counter(), time.process_time()
    population(many, terms=TERMS)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    said(f"10,000 devices: {time.perf_counter() - start:.0f} s, {time.process_time() - spent:.0f} s of processors, {memory:.1f} GB at most",
         file)  # fmt: skip


TABLES = {"errors": errors, "odd": odd, "next": following, "levels": levels, "size": size}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default=",".join(TABLES))
    parser.add_argument("--fleets", type=int, default=20)
    parser.add_argument("--out", help="file that every line is added to as it comes")
    options = parser.parse_args()
    for table in options.only.split(","):
        TABLES[table](options.fleets, options.out)
