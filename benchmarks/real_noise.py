"""Noise of real records: agreement of halves, disturbances, and spectra that are not those of the model.

    python benchmarks/real_noise.py [--only halves,plain,clean,disturbed,slow,lines,spectra,speed] [--runs 20]

halves: both halves of static logs of other people, and of their quarters. Ratio of the difference of a coefficient to its stated error
(rms, share above 2), where the term is present in both halves; the same for the deviation at 1, 10 and 100 s and for the floor.
plain: case A of records.py (2^17 samples at 100 Hz): rmse, share of 95 % intervals that hold the truth, how often a term is called present;
then with single terms left out, how often an absent term is called present.
clean: how often each finding is said of records of the model, where none is needed (cases A to F of efficiency.py); rmse, also over the
information bound and over that of the maximum of the exact likelihood of Q, N, B and K alone, coverage and presence of each term.
disturbed: the same records with a knock, a sensor put down or lifted, a step, a fan, lost samples, stuck readings: shift of N, B and K in
their own standard errors (median, share below 1), and how often N is present.
slow: N and B with a slow change of the mean that is no noise: how often K is called present without a finding about a change.
lines: a narrow line that wanders near 0.1 Hz, and a microseism: how often interval and upper limit of B hold. A level that wanders by 30 %.
spectra: another exponent, Gauss-Markov processes: how often N, the deviation at 1, 10 and 100 s and the floor are inside their intervals.
speed: seconds of a fit.

Records are drawn ordinate by ordinate from a density, without `jaxcal.noise.Noise.simulate`; their expected deviations are computed here.
"""

import argparse
import logging
import pathlib
import time
import warnings

import numpy as np
import scipy.fft
import scipy.optimize
import scipy.signal

import jaxcal

DEG, RATE, N, AT_ONCE = np.pi / 180, 100.0, 2**17, 25
CASE_A = dict(zip("NBK", (0.25 * DEG / 60, 7.6 * DEG / 3600, 1.8 * DEG / 3600), strict=True))
TIMES = (1.0, 10.0, 100.0)


def density(n, N=0.0, B=0.0, K=0.0, Q=0.0, exponent=None, corner=0.0, processes=()):
    """Density of the ordinates of a DCT-II of n samples; `corner` is where a power law equals N, processes are (level over N^2, time)."""
    k, dt = np.arange(1, n), 1 / RATE
    s = 2 * np.sin(np.pi * k / (2 * n))
    total = N**2 + Q**2 / dt * s**2 + B**2 * dt / s * (1 - 2 / (np.pi**2 * k)) + K**2 * dt**2 / s**2
    if exponent:
        total = total + N**2 * (2 * np.pi * dt * corner / s) ** exponent
    for level, correlation in processes:
        a = np.exp(-dt / correlation)
        total = total + N**2 * level * (1 - a) ** 2 / (1 + a * a - 2 * a * np.cos(np.pi * k / n))
    return total


def drawn(level, rng):
    """A record whose ordinates have this density."""
    return scipy.fft.idct(np.concatenate([[0.0], np.sqrt(level * RATE) * rng.standard_normal(len(level))]), norm="ortho")


def expected_deviation(level, tau):
    """Allan deviation of a record with this density of its ordinates."""
    n = len(level) + 1
    x, m = np.pi * np.arange(1, n) / (2 * n), round(tau * RATE)
    # twice sin^4(m x) / (m sin x)^2, averaged over ordinates
    return np.sqrt(np.mean(2 * np.sin(m * x) ** 4 / (m * np.sin(x)) ** 2 * level) * RATE)


def fits_of(records):
    """A fit of each of many records of one length, which are fitted together."""
    found = []
    for first in range(0, len(records), AT_ONCE):
        part = np.stack(records[first : first + AT_ONCE], axis=1)
        together = jaxcal.noise.fit(part, RATE)
        found += [together.channel(i) for i in range(part.shape[1])]
    return found


def error_of(fit, term):
    """Half of the interval over 1.96, as a standard error."""
    low, high = fit.interval[term]
    return (high - low) / 3.92


def value_of(fit, term):
    return float(np.asarray(fit.noise.coefficient(term)))


def measured(fit, tau):
    """Deviation at a cluster time with its limits, from the curve of the fit."""
    curve = fit.deviation
    i = int(np.argmin(np.abs(curve.tau / tau - 1.0)))
    return (float(curve.tau[i]), *(float(np.asarray(one)[i]) for one in (curve.deviation, curve.lower, curve.upper)))


def floor(fit):
    """Lowest point of the curve with its limits: (cluster time, value, low, high); the value and low are NaN if the record shows none."""
    found = fit.numbers["floor"]
    return float(fit.numbers["floor_at"].value), found.value, found.low, found.high


def static_logs(folder):
    """(name, values, rate) of the sensors of logs at rest."""
    for name in ("imu1", "imu2"):
        stored = np.load(folder / "adis16405" / f"{name}.npz")
        values = stored["counts"] * stored["scale"]
        yield f"{name} gyro", values[:, :3], float(stored["fs"])
        yield f"{name} accel", values[:, 3:], float(stored["fs"])
    for name in ("xsens_gyro", "xsens_acc"):
        values = np.loadtxt(folder / "imu_tk" / f"{name}.mat")[:4800, 1:]
        yield name, values, 100.0
    for name in ("mpu6050_pico_imu_data.csv", "road_bike_imu_data.csv", "gyroscope_20180927_100324.csv"):
        log = jaxcal.read(folder / "logs" / name)
        for sensor in ("gyro", "accel"):
            if getattr(log, sensor) is not None:
                yield f"{name} {sensor}", np.asarray(getattr(log, sensor)), log.rate


def halves(runs, seed, folder):
    found = {key: [] for key in ("N", "B", "K", *TIMES, "floor")}
    cases = []
    for name, values, rate in static_logs(folder):
        cases.append((name, values, rate))
        if len(values) > 400_000:
            cases += [(f"{name} {i}", part, rate) for i, part in enumerate(np.array_split(values, 4))]
    fitted, sentences = 0, 0
    for _, values, rate in cases:
        pair = []
        for part in (values[: len(values) // 2], values[len(values) // 2 :]):
            fit = jaxcal.noise.fit(part, rate)
            pair.append([fit.channel(i) for i in range(part.shape[1])])
            sentences += len(getattr(fit, "findings", getattr(fit, "warnings", ())))
        for first, second in zip(*pair, strict=True):
            fitted += 1
            for term in "NBK":
                if first.presence[term] == second.presence[term] == "present":
                    a, b = value_of(first, term), value_of(second, term)
                    found[term].append((b - a) / np.hypot(error_of(first, term), error_of(second, term)))
            for key in (*TIMES, "floor"):
                one, two = (floor(fit) if key == "floor" else measured(fit, key) for fit in (first, second))
                if (key == "floor" and np.isfinite(one[1] * two[1])) or (
                    key != "floor" and abs(one[0] / key - 1) < 0.05 and key < 0.1 * len(values) / 2 / rate
                ):
                    errors = [np.log(fit[3] / fit[2]) / 3.92 for fit in (one, two)]
                    found[key].append(np.log(two[1] / one[1]) / np.hypot(*errors))
    print(f"{fitted} pairs of halves, {sentences} findings")
    for key, values in found.items():
        values = np.array(values)
        if len(values):
            above = 100 * np.mean(np.abs(values) > 2)
            print(f"{key!s:6s} n {len(values):3d}   rms {np.sqrt(np.mean(values**2)):5.2f}   above 2: {above:4.1f} %", flush=True)


def plain(runs, seed, _):
    level = density(N, **CASE_A)
    errors, held, present = [], [], []
    for fit in fits_of([drawn(level, np.random.default_rng([seed, i])) for i in range(runs)]):
        errors.append([value_of(fit, term) / CASE_A[term] - 1 for term in "NBK"])
        held.append([fit.interval[term][0] <= CASE_A[term] <= fit.interval[term][1] for term in "NBK"])
        present.append([fit.presence[term] == "present" for term in "NBK"])
    rmse = np.round(100 * np.sqrt(np.mean(np.square(errors), axis=0)), 2)
    shares = (np.round(100 * np.mean(rows, axis=0)) for rows in (held, present))
    print("case A  N, B, K: rmse %, held %, present %:", rmse, *shares, flush=True)
    for left in ("N", "NB", "NK"):
        level, false, hints = density(N, **{term: CASE_A[term] for term in left}), [], []
        for fit in fits_of([drawn(level, np.random.default_rng([seed, 1, i])) for i in range(runs)]):
            false.append([fit.presence[term] == "present" for term in "QNBK" if term not in left])
            hints.append(any(code in fit.codes for code in CHANGES) if hasattr(fit, "codes") else 0)
        shares = np.round(100 * np.mean(false, axis=0), 1)
        print(f"only {left:3s} absent terms present %", *shares, f" change named {100 * np.mean(hints):.1f} %", flush=True)


FINDINGS = ("set_aside", "lines", "band", "misfit", "step", "ramp", "warm_up", "sinusoid", "instead", "rival", "uneven")
CLEAN = {
    "A": (CASE_A, N), "B": ({**CASE_A, "K": 0.0}, N), "C": ({**CASE_A, "Q": 1.8 * DEG / 3600}, N), "D": (CASE_A, 4 * N),
    "E": ({**CASE_A, "B": 0.0}, N), "F": ({**CASE_A, "K": 0.0}, 4 * N),
}  # fmt: skip


def likeliest(y, start):
    """Q, N, B and K of highest likelihood, by scoring from a start, without a search for anything else."""
    edges = np.unique(np.concatenate([np.arange(65), np.geomspace(64, len(y) - 1, 300).astype(int)]))
    count = np.diff(edges).astype(float)
    ordinates = scipy.fft.dct(y - y.mean(), norm="ortho")[1:] ** 2 / RATE
    p, *x = (np.add.reduceat(row, edges[:-1]) / count for row in (ordinates, *(density(len(y), **{term: 1.0}) for term in "QNBK")))
    x, theta = np.stack(x, axis=1), np.square(start)
    for _ in range(40):
        weight = np.sqrt(count) / (x @ theta)
        theta = 0.5 * (theta + scipy.optimize.nnls(x * weight[:, None], p * weight)[0])
    return np.sqrt(theta)


def clean(runs, seed, _):
    print("case", *(f"{code:>9s}" for code in FINDINGS))
    for name, (truth, n) in CLEAN.items():
        level = density(n, **truth)
        records = [drawn(level, np.random.default_rng([seed, 7, i])) for i in range(runs)]
        fits, alone = fits_of(records), np.array([likeliest(y, [truth.get(term, 0.0) for term in "QNBK"]) for y in records])
        print(f"{name:4s}", *(f"{100 * np.mean([code in fit.codes for fit in fits]):9.0f}" for code in FINDINGS), flush=True)
        # information on the squared coefficients, all four of which are fitted
        rows = np.stack([density(n, **{term: 1.0}) / level for term in "QNBK"])
        scale = np.sqrt(np.sum(rows**2, axis=1))
        bound = np.sqrt(2.0 * np.diagonal(np.linalg.inv(rows @ rows.T / np.outer(scale, scale)))) / scale
        for term, own in zip("QNBK", bound, strict=True):
            if true := truth.get(term, 0.0):
                relative = np.array([value_of(fit, term) for fit in fits]) / true - 1.0
                held = np.mean([fit.interval[term][0] <= true <= fit.interval[term][1] for fit in fits])
                rmse, share = np.sqrt(np.mean(relative**2)), np.mean([fit.presence[term] == "present" for fit in fits])
                least = np.sqrt(np.mean((alone[:, "QNBK".index(term)] / true - 1.0) ** 2))
                print(f"     {term}  rmse {100 * rmse:6.2f} %, of the bound {rmse * 2.0 * true**2 / own:5.2f}, of the likeliest "
                      f"{rmse / least:5.2f}   held {100 * held:4.0f} %   present {100 * share:4.0f} %", flush=True)  # fmt: skip


CHANGES = ("step", "ramp", "warm_up", "sinusoid", "temperature", "instead")
T = np.arange(N) / RATE


def _knock(y, size, length, at):
    i, m = int(at * N), int(length * RATE)
    y[i : i + m] += size * np.sin(np.pi * np.arange(m) / m)
    return y


def _put_down(y, rng):
    y += 0.5 * np.exp(-T / 0.8) * np.sin(2 * np.pi * rng.uniform(1, 3) * T)
    return y


def _lifted(y, rng):
    i, m = N // 3, int(10 * RATE)
    y[i : i + m] += np.cumsum(rng.standard_normal(m)) * 0.02
    return y


def _lost(y, rng):
    y[rng.choice(N, N // 100, replace=False)] = np.nan
    return y


def _stuck(y, rng):
    i = int(rng.uniform(0.2, 0.8) * N)
    y[i : i + 500] = y[i]
    return y


SD = CASE_A["N"] * np.sqrt(RATE)
DISTURBED = {
    "nothing": lambda y, rng: y,
    "knock 0.03 rad/s, 1 s, middle": lambda y, rng: _knock(y, 0.03, 1.0, 0.5),
    "knock 0.15 rad/s, 0.2 s, start": lambda y, rng: _knock(y, 0.15, 0.2, 0.0),
    "knock 0.5 rad/s, 2 s, end": lambda y, rng: _knock(y, 0.5, 2.0, 0.98),
    "two knocks of 0.1 rad/s": lambda y, rng: _knock(_knock(y, 0.1, 0.5, 0.3), -0.1, 0.5, 0.7),
    "put down": _put_down,
    "lifted for 10 s": _lifted,
    "step of 1 sd": lambda y, rng: y + SD * (0.4 * T[-1] < T),
    "step of 3 sd": lambda y, rng: y + 3 * SD * (0.6 * T[-1] < T),
    "step of 10 sd": lambda y, rng: y + 10 * SD * (0.3 * T[-1] < T),
    "fan at 21.3 Hz": lambda y, rng: y + 0.2 * SD * np.sin(2 * np.pi * 21.3 * T),
    "1 % lost": _lost,
    "stuck for 5 s": _stuck,
}


def disturbed(runs, seed, _):
    level = density(N, **CASE_A)
    records = [drawn(level, np.random.default_rng([seed, i])) for i in range(runs)]
    bases = fits_of(records)
    print(f"{'':32s} shift in standard errors, median N, B, K    below 1 %    N present %")
    for name, change in DISTURBED.items():
        shifts, present = [], []
        changed = [change(y.copy(), np.random.default_rng([seed, 2, i])) for i, y in enumerate(records)]
        for base, fit in zip(bases, fits_of(changed), strict=True):
            shifts.append([abs(value_of(fit, t) - value_of(base, t)) / max(error_of(base, t), 1e-30) for t in "NBK"])
            present.append(fit.presence["N"] == "present")
        print(f"{name:32s}", *np.round(np.median(shifts, axis=0), 2), "   ", *np.round(100 * np.mean(np.array(shifts) < 1, axis=0)),
              "   ", round(100 * np.mean(present)), flush=True)  # fmt: skip


DEG_H = DEG / 3600
SLOW = {
    "60 deg/h with 250 s from the middle": lambda u, rng: 60 * DEG_H * -np.expm1(-np.maximum(u - u[-1] / 2, 0) / 250),
    "lagged temperature": lambda u, rng: 30 * DEG_H * _lagged(_room(u, rng), 120.0),
    "warm-up with two constants": lambda u, rng: 60 * DEG_H * (np.exp(-u / 30) + np.exp(-u / 400)),
    "air conditioning, sawtooth": lambda u, rng: 15 * DEG_H * scipy.signal.sawtooth(2 * np.pi * (u / 400 + rng.uniform()), 0.3),
    "creep, log(t)": lambda u, rng: 15 * DEG_H * np.log1p(u / 10),
    "warm-up of 5 sd": lambda u, rng: 5 * SD * np.exp(-u / 200),
}


def _lagged(x, lag):
    keep = np.exp(-1 / (RATE * lag))
    return scipy.signal.lfilter([1 - keep], [1, -keep], x)


def _room(u, rng):
    """A room whose temperature changes by a degree, once, over some minutes."""
    start, rise = rng.uniform(0.2, 0.6) * u[-1], rng.uniform(100, 300)
    return 1.0 / (1.0 + np.exp(-(u - start) / rise))


def slow(runs, seed, _):
    level = density(N, N=CASE_A["N"], B=CASE_A["B"])
    for name, make in SLOW.items():
        present = silent = 0
        sources = [np.random.default_rng([seed, 3, i]) for i in range(runs)]
        for fit in fits_of([drawn(level, rng) + make(T, rng) for rng in sources]):
            present += fit.presence["K"] == "present"
            silent += fit.presence["K"] == "present" and not any(code in fit.codes for code in CHANGES)
        print(f"{name:40s} K present {100 * present / runs:3.0f} %   without a finding {100 * silent / runs:3.0f} %", flush=True)


def _narrow(rng, centre, width, size):
    """A line whose frequency wanders: noise through a resonance."""
    radius = np.exp(-np.pi * width / RATE)
    x = scipy.signal.lfilter([1.0], [1.0, -2 * radius * np.cos(2 * np.pi * centre / RATE), radius**2], rng.standard_normal(N))
    return size * x / np.std(x)


LINES = {
    "line near 0.1 Hz, 0.003 Hz wide": lambda y, rng: y + _narrow(rng, 0.1, 0.003, 3 * CASE_A["B"]),
    "microseism, 0.2 Hz, 0.05 Hz wide": lambda y, rng: y + _narrow(rng, 0.2, 0.05, 3 * CASE_A["B"]),
    "level wanders by 30 %": lambda y, rng: y * np.exp(0.3 * np.interp(T, np.linspace(0, T[-1], 12), rng.standard_normal(12))),
}


def lines(runs, seed, _):
    level = density(N, N=CASE_A["N"], B=CASE_A["B"])
    for name, make in LINES.items():
        held = {"N": 0, "B": 0, "limit": 0}
        sources = [np.random.default_rng([seed, 4, i]) for i in range(runs)]
        for fit in fits_of([make(drawn(level, rng), rng) for rng in sources]):
            truth = dict(CASE_A)
            if "level" in name:  # what the record holds on average over the law of the level
                truth["N"] *= np.exp(0.3**2)
            for term in "NB":
                low, high = fit.interval[term]
                below = truth[term] <= max(high, float(fit.upper_limit[term]))
                held[term] += below and low <= truth[term]
            held["limit"] += below
        shares = (f"{what} held {100 * count / runs:3.0f} %" for what, count in held.items())
        print(f"{name:36s}", "   ".join(shares), "of B", flush=True)


SPECTRA = {
    "case A": {"B": CASE_A["B"] / CASE_A["N"], "K": CASE_A["K"] / CASE_A["N"]},
    "exponent 0.8, corner 0.1 Hz": {"exponent": 0.8, "corner": 0.1},
    "exponent 0.8, corner 1 Hz": {"exponent": 0.8, "corner": 1.0},
    "exponent 1.2, corner 0.1 Hz": {"exponent": 1.2, "corner": 0.1},
    "exponent 1.2, corner 1 Hz": {"exponent": 1.2, "corner": 1.0},
    "process of 25 s": {"processes": ((7.2, 25.0),)},
    "processes of 0.5 and 30 s": {"processes": ((5, 0.5), (200, 30.0))},
    "processes of 1 and 20 s": {"processes": ((1, 1.0), (1, 20.0))},
}


def spectra(runs, seed, _):
    print(f"{'':30s} N held   sigma({', '.join(f'{tau:g}' for tau in TIMES)} s)   floor    B, K present")
    for name, shape in SPECTRA.items():
        level, rows, present = density(N, N=1.0, **shape), [], []
        truth = [expected_deviation(level, tau) for tau in TIMES]
        for fit in fits_of([drawn(level, np.random.default_rng([seed, 5, i])) for i in range(runs)]):
            row = [fit.interval["N"][0] <= 1.0 <= fit.interval["N"][1]]
            for tau, sigma in zip(TIMES, truth, strict=True):
                at, _, low, high = measured(fit, tau)
                sigma = sigma if abs(at / tau - 1) < 1e-6 else expected_deviation(level, at)
                row.append(low <= sigma <= high)
            at, _, low, high = floor(fit)
            row.append(not low > expected_deviation(level, at) and expected_deviation(level, at) <= high)
            rows.append(row)
            present.append([fit.presence[term] == "present" for term in "BK"])
        cells = [f"{value:6.0f}" for value in 100 * np.mean(rows, axis=0)]
        print(f"{name:30s}", *cells, "     ", *np.round(100 * np.mean(present, axis=0)), flush=True)


def speed(runs, seed, _):
    for n in (2**17, 10**6):
        ys = [drawn(density(n, **CASE_A), np.random.default_rng([seed, 6, i])) for i in range(4)]
        jaxcal.noise.fit(ys[0], RATE)
        spent = []
        for y in ys[1:]:
            start = time.process_time(), time.perf_counter()
            jaxcal.noise.fit(y, RATE)
            spent.append((time.process_time() - start[0], time.perf_counter() - start[1]))
        cpu, wall = 1e3 * np.median(spent, axis=0)
        print(f"{n} samples: {cpu:.1f} ms of CPU, {wall:.1f} ms", flush=True)
    many = np.stack([drawn(density(N, **CASE_A), np.random.default_rng([seed, 6, i])) for i in range(64)], axis=1)
    jaxcal.noise.fit(many, RATE)
    start = time.process_time(), time.perf_counter()
    jaxcal.noise.fit(many, RATE)
    spent = [1e3 * (now - then) / 64 for now, then in zip((time.process_time(), time.perf_counter()), start, strict=True)]
    print(f"64 records of {N} samples in one call: {spent[0]:.1f} ms of CPU a record, {spent[1]:.1f} ms", flush=True)


if __name__ == "__main__":
    parts = {
        "halves": halves,
        "plain": plain,
        "clean": clean,
        "disturbed": disturbed,
        "slow": slow,
        "lines": lines,
        "spectra": spectra,
        "speed": speed,
    }
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default=",".join(parts))
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--data", type=pathlib.Path, default=pathlib.Path(__file__).parents[2] / "shared" / "data")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    logging.disable()
    for part in options.only.split(","):
        print(f"\n{part}")
        parts[part](options.runs, options.seed, options.data)
