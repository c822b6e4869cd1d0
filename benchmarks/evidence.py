"""What `jaxcal.evidence` finds, and what it is worth to the estimators.

    python benchmarks/evidence.py [--only alarms,knocks,...] [--runs 100]

alarms: records of noise alone, share of records and of samples with a false alarm of each detector; uneven noise likewise.
knocks: a half sine of 0.01 to 0.5 rad/s and 0.2 to 2 s at the start, middle, end, or twice: found, named within 0.5 s, samples left in.
noise: the same records and put-downs through `noise.characterise`: N beside the truth, its interval, B and K beside those of the record
without the knock; and N of imu.yaml.
uneven: white noise with a level that wanders by 30 %: named, and intervals that hold.
stamps: stamps of a whole second: rate and N.
held: a slow magnetometer in a faster log, beside its distinct readings; packets of all sensors repeated for 0.1 to 0.3 s in a device log.
bands: a gyroscope with a dead band: stated error of the bias over the actual one, and verdict.
dead: one dead axis: what the other axes lose.
coarse: an accelerometer in steps of 15 mg: how often `imu` answers, and whether clipping is claimed.
resampled: readings of 250 Hz, copied or interpolated to 400 Hz, and noise of a filter: how often it is named.
rests: rests of a turntable, whatever its rate, noise and steps of the values: how many tables have all of theirs.
aside: sensors that are moved for some of the time: N, B and K of the rest beside the truth, by the share that is set aside.
real: the logs of JAXCAL_REFERENCE with the evidence as found, and with nothing set aside: each number's change over its error.
cost: seconds of the stage and of the commands.

Records of noise are made here, in the frequency domain; motion by the simulators of the package, which share nothing with the detectors.
"""

import argparse
import collections
import contextlib
import io
import itertools
import os
import pathlib
import resource
import subprocess
import sys
import tempfile
import time
import warnings

import numpy as np
import scipy.signal
import scipy.stats

import jaxcal
from jaxcal.evidence import bursts, find
from jaxcal.evidence._stretch import NO_READING, NOT_STILL
from jaxcal.evidence._uneven import unevenness
from jaxcal.io._suited import unsuited

ROUNDING = {"float": 0.0, "fine": 0.1, "sd": 1.0, "coarse": 2.0, "hidden": 10.0}  # step of the values, in standard deviations of the noise
AXES = np.array([0.6, -0.3, 0.74])  # direction of every event


def noise(rng, samples: int, rate: float, corner_b: float = 0.01, corner_k: float = 0.001, n: float = 1.0, q: float = 0.0) -> np.ndarray:
    """Record (samples, 3) of white noise n, flicker and random walk that reach it at two corner frequencies (Hz), and quantisation."""
    long = 2 * samples  # half of a period, so that the ends are independent
    f = np.fft.rfftfreq(long, 1 / rate)
    f[0] = f[1]
    root = n * np.sqrt((1 + corner_b / f + (corner_k / f) ** 2) * rate * long / 2)
    draws = rng.normal(size=(3, len(f))) + 1j * rng.normal(size=(3, len(f)))
    record = np.fft.irfft(draws * root, long)[:, :samples].T
    return record + q * n * np.sqrt(rate) * np.diff(rng.uniform(-1, 1, size=(samples + 1, 3)), axis=0)


def clean(seed: int, most: int = 1_000_000) -> tuple[np.ndarray, float, str]:
    """A record without any event: 10 min to 3 h, 10 to 400 Hz, rounded or not."""
    rng = np.random.default_rng(seed)
    seconds, rate = rng.choice([600, 1800, 3600, 10800]), float(rng.choice([10, 50, 100, 200, 400]))
    samples = int(min(seconds * rate, most))
    q, kind = rng.choice([0.0, 0.3]), str(rng.choice(list(ROUNDING)))
    y = noise(rng, samples, rate, 10 ** rng.uniform(-3, -0.5), 10 ** rng.uniform(-3.5, -1.5), 1.0, q)
    step = ROUNDING[kind] * np.sqrt(rate)
    return (np.round((y + rng.uniform(-0.5, 0.5) * step) / step) * step if step else y), rate, kind


def half_sine(t: np.ndarray, start: float, height: float, length: float) -> np.ndarray:
    """A knock."""
    return np.where((t >= start) & (t < start + length), height * np.sin(np.pi * (t - start) / length), 0.0)


def put_down(t: np.ndarray, height: float = 0.5, decay: float = 0.8, frequency: float = 2.0) -> np.ndarray:
    """Swinging of a sensor that was put down at the start."""
    return height * np.exp(-t / decay) * np.sin(2 * np.pi * frequency * t)


def disturbed(seed: int, height: float, length: float, where: str, rate: float = 100.0, seconds: float = 600.0, n: float = 1.4e-4):
    """A record of a gyroscope with knocks at the start, middle or end, or twice: rate, readings, and (start, stop) of each knock in s."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    y = noise(rng, len(t), rate, n=n)
    last = seconds - length - 0.3
    starts = {"start": [0.2], "middle": [seconds / 2], "end": [last], "twice": [seconds / 3, 2 * seconds / 3]}[where]
    for start in starts:
        y += half_sine(t, start, height, length)[:, None] * AXES
    return rate, y, [(start, start + length) for start in starts]


def wandering(seed: int, samples: int = 60_000, share: float = 0.3) -> np.ndarray:
    """White noise of mean square 1 + share^2, with a level that wanders by 30 % in a tenth of the record."""
    rng = np.random.default_rng(seed)
    f = np.fft.rfftfreq(2000, 1 / 1000)
    size = np.exp(-((f / 10.0) ** 2))
    level = np.fft.irfft(size * (rng.normal(size=len(f)) + 1j * rng.normal(size=len(f))), 2000)[:1000] * 1000 / np.sqrt(np.sum(size**2))
    return rng.normal(size=samples) * (1.0 + share * np.interp(np.linspace(0.0, 999.0, samples), np.arange(1000), level))


def slow_magnetometer(seed: int, times: int = 20) -> tuple[jaxcal.Log, jaxcal.Log]:
    """A tumble with each reading `times` times, and with each reading once."""
    import _faults

    m, _ = _faults.simulate(("white", 0.01), seed)
    return jaxcal.Log(None, mag=np.repeat(m * 5e-5, times, axis=0), rate=10.0 * times), jaxcal.Log(None, mag=m * 5e-5, rate=10.0)


def changed(log: jaxcal.Log, **sensors: np.ndarray) -> jaxcal.Log:
    """The log with other readings."""
    known = {name: getattr(log, name) for name in ("gyro", "accel", "mag") if getattr(log, name) is not None}
    return jaxcal.Log(None, **(known | sensors), rate=log.rate)


def with_repeats(log: jaxcal.Log, seed: int, count: int = 10) -> jaxcal.Log:
    """The log with packets in which all channels repeat for 0.1 to 0.3 s."""
    rng = np.random.default_rng(seed)
    sensors = {name: np.array(getattr(log, name)) for name in ("gyro", "accel", "mag")}
    for start in rng.choice(len(log.time) // 50 - 2, count, replace=False) * 50 + 25:
        length = int(rng.uniform(0.1, 0.3) * log.rate)
        for values in sensors.values():
            values[start : start + length] = values[start]
    return changed(log, **sensors)


def with_dead_band(log: jaxcal.Log, limit: float = np.deg2rad(0.4)) -> jaxcal.Log:
    """The log of a firmware that cuts small rates to zero."""
    return changed(log, gyro=np.where(np.abs(log.gyro) < limit, 0.0, log.gyro))


def resampled(y: np.ndarray, kind: str, rate: float = 250.0, wanted: float = 400.0) -> np.ndarray:
    """Readings at another rate: "copied" from the last one, or "interpolated"."""
    at = np.arange(int((len(y) - 1) * wanted / rate)) * rate / wanted
    if kind == "copied":
        return y[at.astype(int)]
    return np.stack([np.interp(at, np.arange(len(y)), column) for column in y.T], axis=1)


def alarms(runs: int) -> None:
    count, marked, samples, uneven = collections.Counter(), collections.Counter(), 0, 0
    for seed in range(runs):
        y, rate, _ = clean(seed)
        found = [one for one in find({"gyro": y}, rate) if one.kind != "coarse"]
        samples += len(y)
        for name in {one.kind for one in found}:
            count[name] += 1
        for one in found:
            marked[one.kind] += one.samples
        uneven += any(unevenness(column).loudest is not None for column in y.T)
    print(f"alarms: {runs} records; share of records and of samples")
    for name in ("knock", "moving", "step", "held", "stuck", "zeroed", "clipped", "warm_up", "wrapped", "resampled"):
        print(f"  {name:9} {100 * count[name] / runs:6.2f} % {100 * marked[name] / samples:8.4f} %")
    print(f"  uneven    {100 * uneven / runs:6.2f} % of records of three axes")


PLACES, HEIGHTS, LENGTHS = ("start", "middle", "end", "twice"), (0.01, 0.03, 0.15, 0.5), (0.2, 0.5, 1.0, 2.0)


def knocks(runs: int) -> None:
    """Sizes and lengths are drawn from their whole range. Every fifth record is put down at its start instead.

    That has no sharp end. It ends where what follows could no longer be found by itself: where its energy on three axes, over the square
    of N, is no more than noise alone reaches in one of 100 records, at any of its instants and lags, of which there are twice as many as
    samples. That is a signal-to-noise ratio of 6. The noise of a record moves the instant at which one finds nothing more. How far, says
    a detector that knows the swing, and asks in each record from which instant on its rest is too small.
    """
    rng, rows, best = np.random.default_rng(0), [], []
    for i in range(runs):
        height, length = np.exp(rng.uniform(np.log([HEIGHTS[0], LENGTHS[0]]), np.log([HEIGHTS[-1], LENGTHS[-1]])))
        put, rate = i % 5 == 4, float(rng.choice([50.0, 100.0, 200.0, 400.0]))
        _, y, known = disturbed(1000 + i, 0.0 if put else height, length, PLACES[i % 4], rate)
        if put:
            height = max(height, 0.05)
            swing = put_down(np.arange(len(y)) / rate, height, frequency=rng.uniform(1.0, 3.0))
            y += swing[:, None] * AXES
            least = scipy.stats.chi2.isf(0.01 / (2 * len(y)), 3)
            known = [(0.0, 0.4 * np.log(0.8 / 4 * (height / 1.4e-4) ** 2 / least))]
            part = slice(round(10.0 * rate), None, -1)  # sums from each instant on, of ten seconds
            matched, size = np.cumsum(swing[part, None] * y[part], axis=0), np.cumsum(swing[part] ** 2)
            found = np.sum(matched**2, axis=1) > least * size * 1.4e-4**2 * rate
            best.append(10.0 - np.argmax(found) / rate - known[0][1])
        ranges = [(a / rate, b / rate) for a, b in bursts(y, rate)]
        out = np.zeros(len(y), bool)
        for a, b in ranges:
            out[round(a * rate) : round(b * rate)] = True
        for start, stop in known:
            near = [one for one in ranges if one[0] < stop and one[1] > start]
            inside = out[round(start * rate) : round(stop * rate)]
            ends = (abs(near[0][0] - start), abs(near[-1][1] - stop)) if near else (np.inf, np.inf)
            more = (out.sum() / len(known) - inside.sum()) / rate
            rows.append((np.inf if put else height, bool(near), *ends, 1 - inside.mean(), more))
    rows = np.array(rows)
    print(f"knocks: {len(rows)}; found, both ends named within 0.5 s, worst start and end (s), share left in, seconds set aside beyond it")
    for low, high in (*itertools.pairwise(HEIGHTS), (np.inf, np.inf)):
        one = rows[(rows[:, 0] >= low) & (rows[:, 0] <= high)]
        within = np.mean(one[:, 2:4].max(axis=1) < 0.5)
        said = f"{low} to {high} rad/s" if high < np.inf else "put down"
        worst = "{:.2f} {:.2f}".format(*one[:, 2:4].max(axis=0))
        print(f"  {said} ({len(one)}): {one[:, 1].mean():.3f} {within:.3f}, {worst}, {one[:, 4].mean():.3f} {one[:, 5].mean():.2f}")
    best = np.abs(best)
    print(f"  put down, a detector that knows the swing: within 0.5 s {np.mean(best < 0.5):.3f}, worst {best.max():.2f}")


def beside(found, other, term: str) -> list[bool]:
    """For each axis, whether a coefficient agrees with that of another record within the error of either."""
    agree = []
    for name in found:
        ours, theirs = float(getattr(found[name].noise, term)), float(getattr(other[name].noise, term))
        inside = [
            one.interval[term][0] <= value <= max(one.interval[term][1], one.upper_limit[term])
            for value, one in ((ours, other[name]), (theirs, found[name]))
        ]
        agree.append(any(inside))
    return agree


def noise_runs(runs: int, rate: float = 100.0) -> np.ndarray:
    """(runs, 5): |N / truth - 1| of the worst axis, shares of N's intervals that hold, of B and K that agree, of N's without a knock."""
    rng, rows = np.random.default_rng(0), []
    for i in range(runs):
        height, length = rng.choice(HEIGHTS), rng.choice(LENGTHS)
        _, y, _ = disturbed(2000 + i, height, length, PLACES[i % 4], rate)
        _, plain, _ = disturbed(2000 + i, 0.0, length, PLACES[i % 4], rate)
        if i % 5 == 4:
            y = plain + put_down(np.arange(len(plain)) / rate, frequency=rng.uniform(1.0, 3.0))[:, None] * AXES
        found, other = (jaxcal.noise.characterise(jaxcal.Log(None, gyro=one, rate=rate)) for one in (y, plain))
        n = np.array([float(one.noise.N) for one in found.values()]) / 1.4e-4
        hold = [one.interval["N"][0] <= 1.4e-4 <= one.interval["N"][1] for one in found.values()]
        hold_plain = [one.interval["N"][0] <= 1.4e-4 <= one.interval["N"][1] for one in other.values()]
        rows.append(
            (
                np.abs(n - 1.0).max(),
                np.mean(hold),
                np.mean(beside(found, other, "B")),
                np.mean(beside(found, other, "K")),
                np.mean(hold_plain),
            )
        )
    return np.array(rows)


def of_yaml(y: np.ndarray, rate: float) -> float:
    """gyroscope_noise_density of the imu.yaml that `jaxcal noise` writes, rad/s/sqrt(Hz)."""
    from jaxcal.cli import main as command

    before = os.getcwd()
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        os.chdir(folder)
        try:
            accel = 1e-2 * np.random.default_rng(0).normal(size=y.shape) + [0.0, 0.0, 9.81]
            np.savez("log.npz", time=np.arange(len(y)) / rate, gyro=y, accel=accel)
            assert command(["noise", "log.npz", "--units", "gyro=rad/s", "--units", "accel=m/s^2"]) == 0
            lines = pathlib.Path("log-noise/imu.yaml").read_text().splitlines()
        finally:
            os.chdir(before)
    return float(next(line.split(":")[1].split("#")[0] for line in lines if line.startswith("gyroscope_noise_density")))


def noise_of_knocks(runs: int) -> None:
    rows = noise_runs(runs)
    worst, hold, b, k, plain = rows.max(axis=0)[0], *rows.mean(axis=0)[1:]
    usual = np.median(rows[:, 0])
    print(f"noise: {runs} records with knocks or put down: worst N off by {100 * worst:.1f} %, median {100 * usual:.1f} %; interval of N")
    print(f"  holds in {100 * hold:.0f} % (without a knock {100 * plain:.0f} %); B agrees in {100 * b:.0f} %, K in {100 * k:.0f} %")
    off = []
    for i in range(max(runs // 10, 4)):
        rate, y, _ = disturbed(3000 + i, HEIGHTS[i % 4], LENGTHS[-1 - i % 4], PLACES[i % 4])
        off.append(of_yaml(y, rate) / 1.4e-4 - 1.0)
    t = np.arange(360_000) / 100.0
    off.append(of_yaml(noise(np.random.default_rng(5), len(t), 100.0, n=1.4e-4) + put_down(t)[:, None] * AXES, 100.0) / 1.4e-4 - 1.0)
    print(f"  imu.yaml: {len(off)} records, worst gyroscope_noise_density off by {100 * np.abs(off).max():.1f} %")


def uneven(runs: int) -> None:
    named, hold = [], []
    for seed in range(runs):
        y = wandering(seed)
        curve, spectrum = jaxcal.allan.deviation(y, 100.0, m=[1, 10, 100]), jaxcal.spectrum.density(y, 100.0)
        named.append([any(one.code == "uneven" for one in found.findings) for found in (curve, spectrum)])
        truth = np.sqrt(1.09 / curve.m)
        inside = (spectrum.lower < 0.0109) & (spectrum.upper > 0.0109)
        hold.append([*((curve.lower < truth) & (truth < curve.upper)), inside[-1], inside.mean()])
    named, hold = 100 * np.mean(named, axis=0), 100 * np.mean(hold, axis=0)
    print(f"uneven: named in {named[0]:.0f} % by the deviation and {named[1]:.0f} % by the spectrum; intervals hold in {hold[0]:.0f},")
    print(f"  {hold[1]:.0f} and {hold[2]:.0f} % at m = 1, 10, 100; of the spectrum in {hold[3]:.0f} % at the end, {hold[4]:.0f} % at all")


def stamps(runs: int) -> None:
    rows = []
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        rate, step = rng.choice([4.37, 5.0, 10.0]), rng.choice([0.0, 0.5, 2.0])
        y = rng.normal(size=(40_000, 3)) * np.sqrt(rate)
        y = np.round(y / step / np.sqrt(rate)) * step * np.sqrt(rate) if step else y
        log = jaxcal.Log(np.floor(np.arange(40_000) / rate + rng.uniform()), gyro=y)
        found = jaxcal.noise.characterise(log)
        # the truth is that of the same readings at the true rate: N of a rounded record has its step in it
        own = jaxcal.noise.fit(y, rate)
        n = np.array([float(one.noise.N) for one in found.values()]) / np.asarray(own.noise.N)
        rows.append((abs(log.rate / rate - 1.0), np.abs(n - 1.0).max(), len(y) - len(log.time)))
    rows = np.array(rows)
    print(
        f"stamps: worst rate off by {100 * rows[:, 0].max():.3f} %, N by {100 * rows[:, 1].max():.2f} %; rows lost {rows[:, 2].max():.0f}"
    )


def held(runs: int) -> None:
    rows = []
    for seed in range(max(runs // 10, 4)):
        slow, own = (jaxcal.magnetometer.fit(log) for log in slow_magnetometer(seed))
        rows.append((slow.verdict == own.verdict, np.abs(slow.model.hard_iron - own.model.hard_iron).max() / 5e-5))
    rows = np.array(rows, dtype=float)
    equal, off = 100 * rows[:, 0].mean(), 100 * rows[:, 1].max()
    print(f"held: verdict equal in {equal:.0f} % of {len(rows)}, hard iron off by {off:.4f} % of the field at most")
    for seed in range(max(runs // 50, 2)):
        log, *_ = jaxcal.device.simulate(seed=seed, rests=8)
        spoilt = with_repeats(log, seed)
        # what repeated packets may cost is their samples: the fit of the log in which these are missing
        lost = {
            name: np.where(getattr(spoilt, name) == getattr(log, name), getattr(log, name), np.nan) for name in ("gyro", "accel", "mag")
        }
        plain, missing, repeated = (jaxcal.device.fit(one) for one in (log, changed(log, **lost), spoilt))
        error = np.maximum(missing.estimate.error, 1e-300)
        more = sorted(set(repeated.codes) - set(missing.codes))
        most = [np.nanmax(np.abs(repeated.estimate.values - other.estimate.values) / error) for other in (missing, plain)]
        print(
            f"  device: {plain.verdict}, with repeats {repeated.verdict}, more findings: {more}; moved by {most[0]:.3f} errors at most from"
        )
        print(f"    the log in which the same samples are missing, which is {most[1]:.2f} from the whole one")


def bands(runs: int) -> None:
    rows = []
    for seed in range(max(runs // 25, 3)):
        log, truth, _ = jaxcal.device.simulate(seed=seed, rests=8)
        found = jaxcal.device.fit(with_dead_band(log))
        rows.append(("device", found.verdict, *of_bias(found, np.asarray(truth.gyro.bias))))
    for seed in range(max(runs // 10, 3)):
        log = jaxcal.imu.simulate(24, rate=50.0, still=3.0, turn=2.0, seed=seed)
        found = jaxcal.imu.multi_position(with_dead_band(log), gravity=9.81)
        rows.append(("imu", found.verdict, *of_bias(found, np.asarray(jaxcal.imu.MEMS.gyro.bias))))
    for name in ("device", "imu"):
        mine = [one for one in rows if one[0] == name]
        bad = sum(verdict == "good" and ratio < 1 / 3 for _, verdict, ratio, _ in mine)
        verdicts, least = dict(collections.Counter(one[1] for one in mine)), min(one[2] for one in mine)
        print(f"bands: {name}: {verdicts}; good with a stated error a third of the actual one: {bad}; least ratio {least:.2f}")


def of_bias(found, truth: np.ndarray) -> tuple[float, np.ndarray]:
    """Stated error (half of the interval) of the gyroscope's bias over the actual one, the least of the axes; infinite without a number."""
    chosen = found.estimate.select("gyro.bias*")
    stated = np.diff(chosen.intervals(), axis=1)[:, 0] / 2
    actual = np.abs(np.asarray(chosen.values) - truth)
    ratio = np.where(np.isfinite(stated), stated / np.maximum(actual, 1e-12), np.inf)
    return float(np.min(ratio)), actual


def dead(runs: int) -> None:
    y = noise(np.random.default_rng(1), 60_000, 100.0, n=1.4e-4)
    cut = y.copy()
    cut[:, 1] = 0.0
    whole, part = (jaxcal.noise.characterise(jaxcal.Log(None, gyro=one, rate=100.0)) for one in (y, cut))
    ratio = [float(part[name].noise.N / whole[name].noise.N) for name in part]
    print(f"dead: noise: {sorted(part)} left, N changes by {100 * np.abs(np.array(ratio) - 1.0).max():.2f} %")
    made = jaxcal.temperature.simulate(jump=0.0)
    rates = np.stack([made.bias, 0.0 * made.bias, made.bias], axis=1)
    print(f"  temperature: {sorted(jaxcal.temperature.characterise(jaxcal.Log(made.time, gyro=rates, temperature=made.temperature)))} left")
    log = jaxcal.imu.simulate(24, rate=50.0, still=3.0, turn=2.0, seed=0)
    whole = jaxcal.imu.multi_position(log, gravity=9.81)
    part = jaxcal.imu.multi_position(changed(log, gyro=log.gyro * [1.0, 0.0, 1.0]), gravity=9.81)
    print(f"  imu, a dead axis of the gyroscope: {whole.verdict} -> {part.verdict}, {part.codes}")


def coarse(runs: int) -> None:
    rows = []
    for seed in range(max(runs // 10, 4)):
        log = jaxcal.imu.simulate(24, rate=50.0, still=3.0, turn=2.0, seed=seed)
        step = 0.015 * 9.80665
        log = changed(log, accel=np.round(log.accel / step) * step)
        found = jaxcal.imu.multi_position(log, gravity=9.81)
        rows.append((found.verdict != "refused", "clipped" in log.codes, "held" in {one.kind for one in log.evidence}))
    rows = 100 * np.mean(rows, axis=0)
    print(f"coarse: imu answers in {rows[0]:.0f} %; clipping claimed in {rows[1]:.0f} %, repeats in {rows[2]:.0f} %")


def resampling(runs: int) -> None:
    rows = collections.defaultdict(list)
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        y = rng.normal(size=(20_000, 3))
        filtered = scipy.signal.lfilter(*scipy.signal.butter(2, 0.5), rng.normal(size=(30_000, 3)), axis=0)
        hum = rng.normal(size=(30_000, 3)) + np.sin(np.arange(30_000)[:, None] * 0.9 + rng.uniform(0, 6, 3))
        for name, one in {
            "copied": resampled(y, "copied"),
            "interpolated": resampled(y, "interpolated"),
            "filtered": filtered,
            "hum": hum,
        }.items():
            rows[name].append(bool({"held", "resampled"} & {found.kind for found in find({"gyro": one}, 400.0)}))
    print("resampled: named in", {name: f"{100 * np.mean(found):.0f} %" for name, found in rows.items()})


def rests(runs: int) -> None:
    """Tables of 1 to 200 Hz, with noise of a good sensor or 30 and 1000 times as much, and steps of 0 to 5 standard deviations of it."""
    sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
    import tests.alignment.world as world
    from jaxcal.evidence._rests import still_intervals

    found, lost = collections.Counter(), []
    for seed in range(runs):
        rng = np.random.default_rng([seed, 77])
        rate, axes, factor = float(rng.choice([1, 5, 20, 50, 100, 200])), int(rng.choice([1, 3])), rng.choice([1.0, 30.0, 1000.0])
        places = [0, 90, 180, 270, 0, 270, 180, 90][: rng.choice([4, 8])]
        dwells = rng.uniform(8, 40, len(places)) if rate >= 20 else rng.uniform(60, 150, len(places))
        made = world.recording(rng, places, dwells, "N+B+K", np.deg2rad([1.0, 2.0, 40.0]), axes=axes, rate=rate)
        sensors, size = {}, rng.choice([0.0, 1.0, 5.0])
        for name, y, n in zip(("accel", "gyro"), made[2:4], (world.ACCEL[0] * min(factor, 30.0), world.GYRO[0] * factor), strict=True):
            sd = n * np.sqrt(rate)
            y = y + sd * rng.normal(size=y.shape)
            sensors[name] = np.round(y / sd / size) * size * sd if size else y
        ends = still_intervals(sensors, rate, table=True, angle=made[1] if rng.integers(2) else None, least=5.0).ends
        kind = f"steps of {size:g} sd, noise x {factor:g}"
        found[kind, len(ends) == len(made[4])] += 1
        if len(ends) == len(made[4]):
            lost.append((np.abs(ends - made[4]) / rate).max())
    whole = sum(count for (_, same), count in found.items() if same)
    print(f"rests: all rests of {whole} of {runs} tables, each end within {np.median(lost):.2f} s in the median; not all of")
    print("  ", {kind: count for (kind, same), count in found.items() if not same})


def handled(seed: int, rate: float = 50.0, seconds: float = 600.0, n: float = 1.4e-4) -> np.ndarray:
    """A gyroscope with noise n that is moved for 2 to 90 % of the time, in 1 to 8 pieces, with 3 to 10,000 times its noise; 0.1 to 1 Hz."""
    rng = np.random.default_rng([seed, 77])
    y = noise(rng, int(seconds * rate), rate, n=n)
    share, pieces, t = np.exp(rng.uniform(np.log(0.02), np.log(0.9))), int(rng.integers(1, 9)), np.arange(len(y)) / rate
    cuts = np.sort(rng.uniform(0, 1 - share, pieces)) * seconds + share * seconds * np.arange(pieces) / pieces
    size = n * np.sqrt(rate) * np.exp(rng.uniform(np.log(3.0), np.log(1e4)))
    for start in cuts:
        inside = (t >= start) & (t < start + share * seconds / pieces)
        phase = 2 * np.pi * (np.exp(rng.uniform(np.log(0.1), 0.0, 4)) * t[inside, None] + rng.uniform(size=4))
        y[inside, 2] += size * np.sin(phase).sum(axis=1) / np.sqrt(2)
    return y[:, 2:]


def aside(runs: int) -> None:
    """Coefficients of what is left of a sensor that was moved, by the share that is set aside."""
    rows, n = [], 1.4e-4
    for seed in range(runs):
        log = jaxcal.Log(None, gyro=handled(seed), rate=50.0).cleaned(still=True)
        share = sum(one.facts["percent"] for one in log.findings if one.code == "set_aside")
        try:
            found = jaxcal.noise.characterise(log)
        except jaxcal.JaxcalError:
            rows.append((share, np.nan, np.nan, False, False))
            continue
        off = max(abs(float(one.noise.N) - n) / np.ptp(one.interval["N"]) * 2 * 1.96 for one in found.values())
        held = np.mean([one.interval["N"][0] <= n <= one.interval["N"][1] for one in found.values()])
        other = {code for one in found.values() for code in {f.code for f in one.findings if f.severity > 0}} - {"set_aside"}
        rows.append((share, off, held, found.verdict == "good", bool(other)))
    rows = np.array(rows)
    print("aside: set aside, %; records; refused; N held, %; N off by over 3 errors; good; of the others, weak for the share alone")
    for low, high in itertools.pairwise((-1.0, 5.0, 10.0, 20.0, 30.0, 50.0, 100.0)):
        part = rows[(rows[:, 0] > low) & (rows[:, 0] <= high)]
        if not len(part):
            continue
        seen = part[np.isfinite(part[:, 1])]
        alone = np.sum((seen[:, 3] == 0) & (seen[:, 4] == 0))
        print(f"  {max(low, 0):.0f} to {high:.0f}: {len(part)}, {len(part) - len(seen)}, {100 * seen[:, 2].sum() / max(len(seen), 1):.0f}, "
              f"{np.sum(seen[:, 1] > 3.07)}, {int(seen[:, 3].sum())}, {alone}")  # fmt: skip


def real_logs():
    """Name, command and log of every real log with an IMU or a magnetometer that suits a command."""
    root = pathlib.Path(os.environ["JAXCAL_REFERENCE"], "data")
    paths = [path for path in sorted(root.rglob("*")) if path.is_file() and "expected" not in path.name]
    for path in [*paths, root / "imu_tk"]:
        options = {"units": "accel=m/s^2"} if "mikoff" in str(path) else {}
        with contextlib.suppress(jaxcal.JaxcalError):
            if path.name == "imu_tk":
                accel, gyro = (np.loadtxt(path / f"xsens_{name}.mat") for name in ("acc", "gyro"))
                log = jaxcal.Log(accel[:, 0], accel=accel[:, 1:], gyro=gyro[:, 1:])
                yield path.name, "imu", log
                continue
            if path.name == "imu1.npz" or path.name == "imu2.npz":  # counts and their scales
                held = np.load(path)
                y = held["counts"] * held["scale"]
                log = jaxcal.Log(None, gyro=np.radians(y[:, :3]), accel=9.80665 * y[:, 3:], rate=100.0)
            elif path.parent.name == "mikoff" and path.suffix == ".log":
                y = np.loadtxt(path)
                log = jaxcal.Log(None, accel=y[:, :3], gyro=y[:, 3:6], rate=100.0)
            else:
                log = jaxcal.read(path, quiet=True, **options)
            for command in ("noise", "mag", "imu"):
                there = {"noise": True, "mag": log.mag is not None, "imu": log.accel is not None and log.gyro is not None}[command]
                if there and unsuited(command, log.cleaned(True) if command == "noise" else log) is None:
                    yield path.name, command, log


def numbers_of(command: str, log: jaxcal.Log, raw: bool = False) -> dict[str, tuple[float, float]]:
    """Each number of a command, and its standard error."""
    if command == "noise":
        found = jaxcal.noise.characterise(log)
        return {
            f"{name} {term}": (float(getattr(one.noise, term)), float(np.ptp(one.interval[term])) / 3.92)
            for name, one in found.items() for term in "NBK" if one.interval[term][0] > 0
        }  # fmt: skip
    found = jaxcal.magnetometer.fit(log) if command == "mag" else jaxcal.imu.multi_position(log, raw=raw, gravity=9.81, held_out=False)
    estimate = found.estimate
    return dict(
        zip(estimate.names, zip(np.asarray(estimate.values).tolist(), np.asarray(estimate.error).tolist(), strict=True), strict=True)
    )


def real(_: int) -> None:
    """Each estimate with the evidence as it is found, and with nothing set aside, in stated errors."""
    print("real: numbers; those that change by more than the error, the largest change; what was set aside")
    total = collections.Counter()
    for name, command, log in real_logs():
        aside = [one for one in log.evidence if one.kind in (*NO_READING, *(NOT_STILL if command == "noise" else ()))]
        total["logs"] += 1
        total["with evidence"] += bool(aside)
        if not aside:
            continue  # nothing is set aside, and nothing can change
        try:
            raw = name == "imu_tk"
            ours = numbers_of(command, log.cleaned(command == "noise", left=() if command == "noise" else ("clipped", "zeroed")), raw)
            kept = numbers_of(command, log.cleaned(command == "noise", (*NO_READING, *NOT_STILL)), raw)
        except jaxcal.JaxcalError as error:
            print(f"  {name} {command}: {str(error)[:80]}")
            continue
        apart = {key: (abs(ours[key][0] - kept[key][0]), ours[key][1]) for key in ours.keys() & kept.keys()}
        moved = {key: change / error if error > 0 else np.inf if change else 0.0 for key, (change, error) in apart.items()}
        many = {key: size for key, size in moved.items() if size > 1.0}
        worst = max(moved, key=moved.get, default="")
        kinds = {kind: round(sum(one.samples for one in aside if one.kind == kind) / log.rate, 2) for kind in {one.kind for one in aside}}
        print(f"  {name} {command}: {len(moved)} numbers, {len(many)} moved, most {worst} {moved.get(worst, 0.0):.2g}; seconds of {kinds};",
              f"only in one: {sorted(ours.keys() ^ kept.keys())}")  # fmt: skip
        total["numbers"] += len(moved)
        total["moved"] += len(many)
    print("  " + ", ".join(f"{what} {count}" for what, count in total.items()))


def cost(_: int) -> None:
    y = np.random.default_rng(0).normal(size=(1_000_000, 6)) * 1e-3 + [0, 0, 0, 0, 0, 9.81]
    jaxcal.Log(None, gyro=y[:100_000, :3], rate=100.0).evidence  # noqa: B018
    with tempfile.TemporaryDirectory() as folder:
        np.savez(pathlib.Path(folder, "log.npz"), time=np.arange(len(y)) / 100.0, gyro=y[:, :3], accel=y[:, 3:])
        words = [sys.executable, "-m", "jaxcal", "noise", "log.npz", "--units", "gyro=rad/s", "--units", "accel=m/s^2", "--force"]
        spent = [0.0]
        for _ in range(3):  # the first one compiles
            subprocess.run(words, cwd=folder, check=True, capture_output=True)
            used = resource.getrusage(resource.RUSAGE_CHILDREN)
            spent.append(used.ru_utime + used.ru_stime)
    whole = min(np.diff(spent)[1:])
    stage = []
    for _ in range(3):
        log = jaxcal.Log(None, gyro=y[:, :3], accel=y[:, 3:], rate=100.0)
        began = time.process_time()
        log.evidence  # noqa: B018
        stage.append(time.process_time() - began)
    share = 100 * min(stage) / whole
    print(f"cost: six channels of 10^6 samples: {min(stage):.2f} s of the {whole:.2f} s (of all cores) of `jaxcal noise`: {share:.0f} %")


PARTS = {"alarms": alarms, "knocks": knocks, "noise": noise_of_knocks, "uneven": uneven, "stamps": stamps, "held": held, "bands": bands,
         "dead": dead, "coarse": coarse, "resampled": resampling, "rests": rests, "aside": aside, "real": real, "cost": cost}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default=",".join(PARTS))
    parser.add_argument("--runs", type=int, default=100)
    options = parser.parse_args()
    warnings.simplefilter("error", RuntimeWarning)
    for name in options.only.split(","):
        PARTS[name](options.runs)


if __name__ == "__main__":
    main()
