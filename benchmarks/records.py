"""Noise of records that do not follow the model: missing samples, and other causes that look like slow noise.

    python benchmarks/records.py [--only gaps,causes,power,tails,doubling,recordings,degenerate,levels,alternatives]
        [--case exponent] [--runs 20] [--seed 1]

gaps: case A (2^17 samples at 100 Hz; N 0.25 deg/sqrt(h), B 7.6 deg/h, K 1.8 deg/h/sqrt(s)) with missing samples; rmse in % of N, B, K,
bound of the observed record, share of 95 % intervals that hold the truth, share of records in which K is present, CPU seconds of a fit.
causes: white noise (2^16 samples) with a step, a sinusoid, a warm-up, noise of another exponent or two Gauss-Markov processes; how often
B and K are present or a hint, N is covered, how wide its interval is, and how often the cause is named: in all records, and in those
whose likelihood ratio of the true density over Q, N, B and K exceeds the level of 1 %. Then noise of the model, where B and K are there.
power: share of such records in which a verdict can find K, or B, at most, if 3 % of the records of another spectrum may show it.
tails, doubling, recordings, degenerate: heavy tails, a level that doubles, several recordings of a device, and records that are hardly any.
alternatives: gain in likelihood of each family of other spectra, for records with noise of the model; this sets the levels of
`jaxcal.noise._alternatives`.
levels: highest likelihood ratio of each family of causes, for records of noise alone; this sets `jaxcal.noise._causes.LEVELS`.

Records are drawn ordinate by ordinate from their density, without using `jaxcal.noise.Noise.simulate`.
"""

import argparse
import contextlib
import io
import pathlib
import tempfile
import time
import warnings
from functools import partial

import jax
import numpy as np
import record_bounds
import scipy.fft
import scipy.optimize

import jaxcal
from jaxcal._precision import host_float64
from jaxcal.cli import main
from jaxcal.noise import _causes
from jaxcal.noise._alternatives import find_alternatives
from jaxcal.noise._model import checked_terms
from jaxcal.noise._ordinates import Bins, layout
from jaxcal.noise._result import PRESENT
from jaxcal.noise._spectral import fit_bins, groups_of
from jaxcal.noise._terms import Filter
from jaxcal.spectrum._average import log_groups

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


#: name -> (family that is to be named, (level, correlation time in s) of processes, exponent and its corner in Hz)
#: findings that name something else than the noise of the model
CAUSES = {"step", "ramp", "warm_up", "sinusoid", "other_noise"}
SPECTRA = {
    "exponent 0.8, corner 0.1 Hz": ("noise of exponent", (), (0.8, 0.1)),
    "exponent 0.8, corner 1 Hz": ("noise of exponent", (), (0.8, 1.0)),
    "exponent 1.2, corner 0.1 Hz": ("noise of exponent", (), (1.2, 0.1)),
    "exponent 1.2, corner 1 Hz": ("noise of exponent", (), (1.2, 1.0)),
    "processes of 0.5 and 30 s": ("Gauss-Markov process", ((5, 0.5), (200, 30.0)), None),
    "processes of 1 and 20 s": ("Gauss-Markov process", ((1, 1.0), (1, 20.0)), None),
    "process of 25 s, like N, B": ("Gauss-Markov process", ((7.2, 25.0),), None),
}
DETECTABLE = 6.63  # likelihood ratio of the true density over Q, N, B and K that one in a hundred exceeds, for one parameter more


def _law(n, exponent):
    """Density of the ordinates of noise of an exponent, 1 at 1 Hz."""
    return (2 * np.sin(np.pi * np.arange(1, n) / (2 * n)) * RATE / (2 * np.pi)) ** -exponent


def _process(n, correlation_time):
    """Density of the ordinates of a Gauss-Markov process of this correlation time in s, 1 at low frequencies."""
    a = np.exp(-1 / (RATE * correlation_time))
    return (1 - a) ** 2 / (1 + a * a - 2 * a * np.cos(np.pi * np.arange(1, n) / n))


def _density(name, n):
    """Density of the ordinates of one of SPECTRA beside white noise of density 1."""
    _, processes, law = SPECTRA[name]
    density = 1.0 + sum(level * _process(n, time) for level, time in processes)
    return density if law is None else density + law[1] ** law[0] * _law(n, law[0])


def _made(n):
    """Name -> (family that should be named, function that draws a record); white noise has density 1."""
    t = np.arange(n) / n
    white, sd = np.ones(n - 1), np.sqrt(RATE)
    spectra = {name: (family, partial(drawn, _density(name, n))) for name, (family, _, _) in SPECTRA.items()}
    return {
        "plain": ("", partial(drawn, white)),
        "step of 0.3 sd": ("step", lambda r: drawn(white, r) + 0.3 * sd * (t > r.uniform(0.2, 0.8))),
        "step of 1 sd": ("step", lambda r: drawn(white, r) + sd * (t > r.uniform(0.2, 0.8))),
        "sinusoid, 1 to 6 cycles": (
            "a sinusoid of",
            lambda r: drawn(white, r) + 0.1 * sd * np.sin(2 * np.pi * (r.uniform(1, 6) * t + r.uniform())),
        ),
        "warm-up": ("warm_up", lambda r: drawn(white, r) + sd * np.exp(-t / r.uniform(0.02, 0.2))),
    } | spectra


def _plain(n):
    """Name -> (no family, record from a generator) of noise of the model; N is 1."""
    noises = {"N, B": (1, 0.3, 0), "N, B strong": (1, 1, 0), "N, K": (1, 0, 0.1), "N, B, K": (1, 0.3, 0.1)}
    densities = {name: columns(n) @ np.square(np.array(noise, dtype=float)) for name, noise in noises.items()}
    densities |= {"case A": columns(n) @ (CASE_A / CASE_A[0]) ** 2, "case A, 2^17": columns(2 * n) @ (CASE_A / CASE_A[0]) ** 2}
    return {name: ("", partial(drawn, density)) for name, density in densities.items()}


def _ratio(y, density):
    """Twice the log likelihood of the true density over that of the best Q, N, B and K, from the record's own ordinates."""
    n = len(y)
    ordinates = scipy.fft.dct(y, norm="ortho")[1:] ** 2 / RATE
    edges = np.unique(np.geomspace(1, n, 400).astype(int))[:-1] - 1
    count = np.diff(np.append(edges, n - 1))
    given = (np.column_stack([columns(n), _quantised(n)]), ordinates, density)
    shapes, mean, true = (np.add.reduceat(x, edges, axis=0).T / count for x in given)

    def cost(logs):
        s = np.exp(logs) @ shapes
        return np.sum(count * (np.log(s) + mean / s)), np.exp(logs) * (shapes @ (count * (1 - mean / s) / s))

    starts = [(np.log(np.mean(density[-n // 4 :])), b, k, -6.0) for b in (-12.0, -3.0, 2.0) for k in (-20.0, -8.0, -2.0)]
    best = min(scipy.optimize.minimize(cost, start, jac=True, method="L-BFGS-B", bounds=[(-40, 20)] * 4).fun for start in starts)
    return best - np.sum(count * (np.log(true) + mean / true))


def causes(runs, seed, case=""):
    print(f"{'record':28s} B present   hint   K present   hint   N covered   width   named   detectable   of them named   (in % of {runs})")
    made = _made(2**16)
    chosen = {name: one for name, one in (made | _plain(2**16)).items() if name.startswith(tuple(case.split(";")))}
    for name, (family, make) in chosen.items():
        rows, ratios = [], []
        for i in range(runs):
            y = make(np.random.default_rng([seed, i]))
            found = jaxcal.noise.fit(y, RATE)
            low, high = found.interval["N"]
            told = {one.code: str(one.facts.get("model", "")) for one in found.findings}
            named = family in told or (bool(family) and family in told.get("other_noise", "")) or (not family and bool(CAUSES & set(told)))
            verdicts = [found.presence[term] == word for term in "BK" for word in ("present", "hint")]
            rows.append([*verdicts, low <= 1.0 <= high, high - low, named])
            ratios.append(_ratio(y, _density(name, 2**16)) if name in SPECTRA else np.nan)
        rows, seen = np.array(rows, dtype=float), np.array(ratios) > DETECTABLE
        cells = [100 * value for value in np.mean(rows, axis=0)]
        told = f"{100 * np.mean(seen):9.1f}   {100 * np.mean(rows[seen, 6]):9.1f}" if seen.any() else ""
        print(f"{name:28s}" + "".join(f"{value:9.1f}" for value in cells) + f"   {told}", flush=True)


def power(runs, seed):
    n, level = 2**16, 0.03
    times = [correlation_times for _, correlation_times, _ in SPECTRA.values() if len(correlation_times) == 2]
    print(f"power in %, of {runs} records where coefficients are estimated; exponent 1 taken for granted: power, and falsely present")
    print(f"{'record':16s} term {'against the nearest':28s}      known  estimated   exp. 1 K    falsely")
    models = {"case A": CASE_A / CASE_A[0]} | {"N, B, K": (1, 0.3, 0.1), "N, K": (1, 0, 0.1), "N, B": (1, 0.3, 0)}
    for name, samples in (("case A", n), ("case A", 2 * n), ("N, B, K", n), ("N, K", n), ("N, B", n)):
        starts, count = log_groups(samples - 1, keep_tail=True)
        rivals = {"exponent 1.2": [_law(samples, 1.2)]} if name != "N, B" else {
            f"processes of {a:g} and {b:g} s": [_process(samples, a), _process(samples, b)] for (_, a), (_, b) in times
        }  # fmt: skip
        means = np.add.reduceat(columns(samples), starts) / count[:, None]
        density = means @ np.square(np.array(models[name], dtype=float))
        for rival, shapes in rivals.items():
            others = np.add.reduceat(np.column_stack([np.ones(samples - 1), *shapes]), starts) / count[:, None]
            other = record_bounds.likeliest(density, others, count)[1]
            known = record_bounds.neyman_pearson(density, other, count, level, seed=seed)
            flicker = means[:, :2]  # without K, the exponent may also be 1
            alone = [others, flicker] if name != "N, B" else [others]
            null, found = (record_bounds.ratios(one, means, alone, count, runs, seed + i) for i, one in enumerate((other, density)))
            shares = [known, np.mean(found > np.quantile(null, 1.0 - level))]
            if name != "N, B":
                shares += [np.mean(record_bounds.ratios(one, means, [flicker], count, runs, seed) > PRESENT) for one in (density, other)]
            where = f"{name}, 2^{samples.bit_length() - 1}"
            cells = "".join(f"{100 * share:11.1f}" for share in shares)
            print(f"{where:16s} {'B' if name == 'N, B' else 'K':4s} {rival:28s}{cells}", flush=True)


def levels(runs, seed):
    n = 2**16
    low = columns(n)[:512]
    asked, _causes._MOST = dict(_causes.LEVELS), 1
    print(f"{'noise':8s} {'family':12s}   highest likelihood ratio in 50, 90, 97, 99.7 % of {runs}")
    for name, noise in {"N": (1, 0, 0), "N, B": (1, 0.1, 0), "N, B, K": (1, 0.1, 0.03), "N, K": (1, 0, 0.1)}.items():
        squares = np.array(noise, dtype=float) ** 2
        for family in [one for one in asked if one != "temperature"]:
            _causes.LEVELS.update({one: 2.0 if one == family else np.inf for one in asked})
            found = []
            for i in range(runs):
                y = drawn(columns(n) @ squares, np.random.default_rng([seed, i]))
                fitted = np.array([float(getattr(jaxcal.noise.fit(y, RATE, terms="NBK").noise, term)) for term in "NBK"]) ** 2
                cause = _causes.find_causes(y, low, fitted, [False, True, True], 1 / RATE)
                found.append(cause[0].gain if cause else 0.0)
            print(f"{name:8s} {family:12s}   " + "  ".join(f"{q:6.1f}" for q in np.quantile(found, [0.5, 0.9, 0.97, 0.997])))
    _causes.LEVELS.update(asked)


def alternatives(runs, seed):
    n = 2**16
    terms = (*checked_terms("QNBK"), Filter())
    _, count, shapes, frequency = layout(n, 1 / RATE, terms)
    print(f"{'noise':8s} {'family':16s}   twice the gain in log likelihood in 50, 90, 97, 99 % of {runs}")
    for name, noise in {"N, B": (1, 1.0, 0), "N, B, K": (1, 0.3, 0.1), "N, K": (1, 0, 0.1), "case A": CASE_A}.items():
        found = {}
        for i in range(runs):
            density = shapes[:, 1:4] @ np.square(noise)
            drawn_ordinates = density * np.random.default_rng([seed, i]).gamma(count / 2, 2 / count)
            bins = Bins(drawn_ordinates / density[-1], count, shapes, frequency, 1.0)
            fitted = fit_bins(bins, groups_of(count, n - 1), True, tuple(term.name for term in terms))
            for one in find_alternatives(fitted, terms, 1 / RATE, n / RATE).listed:
                found.setdefault(one.family, []).append(one.gain)
        for family, gains in found.items():
            gains = np.append(gains, np.full(runs - len(gains), -np.inf))  # runs without B and K, which nothing can replace
            print(f"{name:8s} {family:16s}   " + "  ".join(f"{np.sort(gains)[int(q * (runs - 1))]:6.1f}" for q in (0.5, 0.9, 0.97, 0.99)))


def tails(runs, seed):
    """N of the core of white noise with heavy tails, 2^16 samples: its error, and whether the interval holds it."""
    n = 2**16
    laws = {
        "normal": (1.0, lambda r: r.standard_normal(n)),
        "9 % of 12 standard deviations": (1.0, lambda r: r.standard_normal(n) * np.where(r.random(n) < 0.09, 12.0, 1.0)),
        "9 % of Laplace bursts": (1.0, lambda r: r.standard_normal(n) + (r.random(n) < 0.09) * r.laplace(0, 15, n)),
        "9 % of uniform bursts": (1.0, lambda r: r.standard_normal(n) + (r.random(n) < 0.09) * r.uniform(-10, 10, n)),
        "Student, 3 degrees of freedom": (3.0**0.5, lambda r: r.standard_t(3, n)),
    }
    print(f"{'law':30s}   mean error of N   largest, %   N covered   tails named   (in % of {runs})")
    for name, (truth, draw) in laws.items():
        rows = []
        for i in range(runs):
            found = jaxcal.noise.fit(draw(np.random.default_rng([seed, i])), RATE, robust=True)
            (low, high), truth_here = found.interval["N"], truth / np.sqrt(RATE)
            named = "heavy" in found.codes
            rows.append([found.noise.N / truth_here - 1, low <= truth_here <= high, named])
        error, inside, named = 100 * np.array(rows, dtype=float).T
        print(f"{name:30s}{error.mean():15.2f}{np.abs(error).max():13.2f}{inside.mean():12.1f}{named.mean():12.1f}", flush=True)


def doubling(runs, seed):
    """White noise whose level doubles at 30 to 70 % of 2^16 samples."""
    n, rows = 2**16, []
    for i in range(runs):
        r = np.random.default_rng([seed, i])
        y = r.standard_normal(n) * np.where(np.arange(n) < n * r.uniform(0.3, 0.7), 1.0, 2.0)
        found = jaxcal.noise.fit(y, RATE)
        ratios = next((one.facts["ratios"] for one in found.findings if one.code == "level"), [])
        levels = np.array(ratios) * float(found.noise.N) * np.sqrt(RATE)
        error = np.abs(np.array(levels) / [1.0, 2.0] - 1).max() if len(levels) == 2 else np.nan
        rows.append(
            [found.presence["N"] == "present", len(levels) == 2, error, found.presence["B"] == "present", found.presence["K"] == "present"]
        )
    present, two, error, b, k = 100 * np.array(rows, dtype=float).T
    print(f"level doubles, {runs} records: N present {present.mean():.1f} %, two levels {two.mean():.1f} %, their largest error "
          f"{np.nanmax(error):.2f} %, B and K present {b.mean():.1f} and {k.mean():.1f} %")  # fmt: skip


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
                tables = (fit.interval, fit.upper_limit, fit.significance, fit.longer_record, fit.decides, fit.covariance, fit.noise)
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
    parser.add_argument("--only", default="gaps,causes")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", default="", help="rows of gaps and causes that begin with one of these, separated by semicolons")
    options = parser.parse_args()
    tables = {"gaps": partial(gaps, case=options.case), "causes": partial(causes, case=options.case), "levels": levels}
    tables |= {"alternatives": host_float64(alternatives), "tails": tails, "doubling": doubling, "recordings": recordings}
    tables |= {"degenerate": degenerate, "power": power}
    for table in options.only.split(","):
        tables[table](options.runs, options.seed)
