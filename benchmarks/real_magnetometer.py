"""The magnetometer's number and verdict on real logs and on simulated ones, axes that mirror, and vehicles that hardly tilt.

    python benchmarks/real_magnetometer.py                  everything (two minutes)
    python benchmarks/real_magnetometer.py --only real      one part: real, faults, white, spoilt, mirrored, level, flight, track
    python benchmarks/real_magnetometer.py --runs 200       more runs for each simulated case

Real logs come from ../shared/data (JAXCAL_REFERENCE). "Actual" is half the heading difference of disjoint halves there, the root mean
square of two splits, and the truth for the mean state during the log in simulations, which share nothing with the estimator.
"""

import argparse
import json
import os
import pathlib
import time
import warnings

import _faults
import _flight
import numpy as np
from scipy.spatial.transform import Rotation

import jaxcal
from jaxcal.magnetometer import Accelerometer, Attitude, Gyroscope, Headings, MagModel, fit, heading_uncertainty, track

FOLDER = pathlib.Path(os.environ.get("JAXCAL_REFERENCE", "../shared")) / "data"
LOGS = ("broad_05_slow_rotation_B.hdf5", "vqf_imu_data.npz", "madgwick_ExampleData.mat", "fusion_sensor_data.csv")
LEVEL = _faults.level_field()
YAW = np.arange(24) * np.pi / 12
MOST = 15_000  # readings of a log


def real():
    """Name, readings, specific force (or None) and rates with their rate (or None) of each real log."""
    place = FOLDER / "magnetometer"
    yield "mag_out", np.loadtxt(place / "ellipsoid_fit_python" / "mag_out.txt"), None, None, 1.0
    yield "mag3", np.loadtxt(place / "jremington" / "mag3_raw.csv", delimiter=","), None, None, 1.0
    for path in sorted(place.glob("betaflight/*_tumble.json")):
        rows = [[one[axis] for axis in "xyz"] for one in json.loads(path.read_text())["samples"]]
        yield path.stem.split("-")[2], np.array(rows, dtype=float), None, None, 1.0
    table = np.loadtxt(next(place.glob("pichim/*.txt")), delimiter=",")
    yield "pichim", table[:, :3], None, table[:, 3:], 200.0
    for path in (place / "sunsided" / "hmc5883l_compass.mat", *(FOLDER / "logs" / name for name in LOGS)):
        log = jaxcal.read(path)
        there = np.flatnonzero(np.isfinite(log.usable("mag")).all(axis=1))
        there = there[:: max(len(there) // MOST, 1)]
        yield path.stem[:12], log.mag[there], None if log.accel is None else log.accel[there], None, log.rate
    for path in sorted(place.glob("furbrain/*.json")):
        shots = json.loads(path.read_text())
        gravity = np.array(shots["grav"])[:, [1, 0, 2]] * [-1, -1, 1]
        yield path.stem, np.array(shots["mag"]) * [1, 1, -1], fit(gravity, model="symmetric").model.correct(gravity), None, 1.0


def heading_of(y):
    """Magnetic headings of corrected fields at level."""
    return np.arctan2(-y[:, 1], y[:, 0])


def apart(one, two):
    """Root mean square difference of level headings by two fits, in degrees, averaged over the axes that may point down."""
    found = []
    for turn in _faults.TURNS:
        y = two.model.correct(one.model.measure(float(one.field) * LEVEL @ turn)) @ turn.T
        found.append(np.mean(np.angle(np.exp(1j * (heading_of(y) - YAW))) ** 2))
    return np.rad2deg(np.sqrt(np.mean(found)))


def on_real(_):
    print("| real log | readings | verdict | stated, deg | actual, deg | actual over stated |\n|---|---|---|---|---|---|")
    ratios, rows = [], []
    for name, m, *_ in real():
        if len(m) < 100:  # halves of fewer shots do not determine a fit
            continue
        found, quarters = fit(m, inclination=_faults.DIP), np.array_split(m, 4)
        pairs = [np.array_split(m, 2), (np.concatenate(quarters[::2]), np.concatenate(quarters[1::2]))]
        halves = [[fit(part, inclination=_faults.DIP) for part in pair] for pair in pairs]
        kept = [pair for pair in halves if all(one.model is not None and one.kind != "planar" for one in pair)]
        actual = np.sqrt(np.mean([(apart(*pair) / 2) ** 2 for pair in kept])) if kept else np.nan
        stated = np.rad2deg(found.heading_error[0])
        rows.append((found.verdict, actual))
        if found.verdict != "refused":
            ratios.append(actual / stated)
        print(f"| {name} | {len(m)} | {found.verdict} | {stated:.2f} | {actual:.2f} | {actual / stated:.2f} |", flush=True)
    right = [verdict for verdict, actual in rows if actual < 1.0]
    print(
        f"actual over stated, of those not refused: median {np.median(ratios):.2f}, rms {np.sqrt(np.mean(np.square(ratios))):.2f}; "
        f"good {right.count('good')} of {len(right)} below a degree; good above 1.5: {sum(v == 'good' and a > 1.5 for v, a in rows)}"
    )


def on_faults(runs):
    print("\n| case | good | actual over stated, median | named |\n|---|---|---|---|")
    everything = []
    for case in _faults.CASES:
        table = _faults.tried(fit, case, max(runs // 4, 5))
        everything.append(table)
        print(f"| {case[0]} {case[1]:g} | {table[:, 0].mean():.0%} | {np.median(table[:, 2]):.2f} | {table[:, 3].mean():.0%} |", flush=True)
    good, true, ratio, _, inside = np.concatenate(everything).T
    taken = good > 0
    print(
        f"{len(good) // 3} logs, three axes down: good among right {np.mean(taken[true < 1]):.0%}, "
        f"bad among good {np.mean(true[taken] > 1):.1%}, "
        f"above 1.5 degrees {np.mean(true[taken] > 1.5):.1%}; "
        f"below 2.1 p {np.mean(ratio < 2.1):.1%}; actual over stated, rms {np.sqrt(np.mean(ratio**2)):.2f}; "
        f"hard iron inside {inside.mean():.1%}"
    )


def on_white(runs):
    off, inside = [], []
    for seed in range(4 * runs):
        rng = np.random.default_rng([seed, 2])
        u = rng.normal(size=(2000, 3))
        u = (u / np.linalg.norm(u, axis=1, keepdims=True))[u[:, 2] > 0][:500]
        found = fit(u @ _faults.SOFT.T + _faults.HARD + 0.005 * rng.normal(size=u.shape), model="symmetric")
        off.append(found.model.hard_iron - _faults.HARD)
        numbers = found.estimate.select("hard_iron*").numbers()
        inside += [one.low < truth < one.high for one, truth in zip(numbers, _faults.HARD, strict=True)]
    print(f"\nhalf a sphere, 500 readings, noise 0.5 %: hard iron rms {100 * np.sqrt(np.mean(np.square(off))):.3f} % an axis, "
          f"inside {np.mean(inside):.1%}")  # fmt: skip


def spoilt(m, field, kind, rng):
    """Readings with a fault that a robust fit does not see."""
    m, count = m.copy(), len(m)
    name, _, size = kind.partition(" ")
    if name == "spikes":
        pick = rng.choice(count, max(round(float(size) / 100 * count), 1), replace=False)
        m[pick] += 10 ** rng.uniform(0, 3, (len(pick), 1)) * rng.normal(size=(len(pick), 3))
    elif name == "outliers":
        pick = rng.choice(count, count // 5, replace=False)
        m[pick] += 0.05 / np.sqrt(3) * rng.choice([-1.0, 1.0], size=(len(pick), 3))  # five standard deviations off
    elif name == "zeros":
        m[rng.choice(count, count // 20, replace=False)] = 0.0
    elif name == "dwell":
        rest = field[count // 2] @ _faults.SOFT.T + _faults.HARD + 0.01 * rng.normal(size=(2 * count, 3))
        m = np.concatenate([m[: count // 2], rest, m[count // 2 :]])
    elif name == "held":
        m = np.repeat(m, 5, axis=0)
    return m


def on_spoilt(runs):
    print("\nheadings beside the fit of the clean log, degrees: median, 95th percentile, share within 0.1; verdicts")
    for kind in ("spikes 0.1", "spikes 1", "spikes 3", "outliers", "zeros", "dwell", "held"):
        off, words = [], []
        for seed in range(runs):
            rng = np.random.default_rng([seed, 4])
            field = _faults.turned(2000, rng, 0.12)
            m = field @ _faults.SOFT.T + _faults.HARD + 0.01 * rng.normal(size=field.shape)
            clean, found = fit(m), fit(spoilt(m, field, kind, rng))
            words.append(found.verdict)
            off.append(np.inf if found.model is None else apart(clean, found))
        shares = ", ".join(f"{word} {words.count(word)}" for word in dict.fromkeys(words))
        print(f"{kind:10s} {np.median(off):.3f} {np.quantile(off, 0.95):.3f} {np.mean(np.array(off) < 0.1):.0%}; {shares}", flush=True)


def hand(seed, count=500, rate=50.0):
    """Readings, specific force, rates and headings of a sensor turned by hand."""
    rng = np.random.default_rng([seed, 6])
    rates = 0.12 * rate * _faults.wander(np.exp(-1 / 25), count, 3, rng)
    attitude, body = Rotation.random(random_state=seed).as_matrix(), []
    for step in Rotation.from_rotvec((rates[1:] + rates[:-1]) / 2 / rate).as_matrix():
        body.append(attitude)
        attitude = attitude @ step
    body = np.array([*body, attitude])
    field = np.array([np.cos(_faults.DIP), 0.0, np.sin(_faults.DIP)]) @ body
    m = field @ _faults.SOFT.T + _faults.HARD + 0.005 * rng.normal(size=field.shape)
    up = -9.81 * (body[:, 2, :] + np.deg2rad(0.3) * rng.normal(size=field.shape))
    return m, up, rates + 0.002 * rng.normal(size=rates.shape), np.arctan2(body[:, 1, 0], body[:, 0, 0]), rate


def on_mirrored(_):
    good = {"accel": 0, "dip known": 0, "dip only": 0, "gyro": 0, "headings": 0}
    named = 0
    for seed in range(20):
        m, up, rates, heading, rate = hand(seed)
        for axis in range(3):
            wrong = m * np.where(np.arange(3) == axis, -1.0, 1.0)
            known = fit(wrong, aid=Accelerometer(up), inclination=_faults.DIP)
            tried = (
                fit(wrong, aid=Accelerometer(up)), known, fit(wrong, aid=Accelerometer(up, turns=False)),
                fit(wrong, aid=Gyroscope(rates, rate)), fit(wrong, aid=Headings(heading, up)),
            )  # fmt: skip
            for name, found in zip(good, tried, strict=True):
                good[name] += found.verdict == "good"
            named += any(one.code == "mirrored" and one.facts["what"] == f"{'xyz'[axis]} is reversed" for one in known.findings)
    print(f"\none mirrored axis, 60 logs: called good {good}; named where the sign of the dip is known: {named} of 60")
    print("| log | aid | as recorded | one axis mirrored | named with the dip known |\n|---|---|---|---|---|")
    wrong = 0
    for name, m, up, rates, rate in nine():
        for sensor, aid in (
            ("accel", None if up is None else Accelerometer(up)),
            ("gyro", None if rates is None else Gyroscope(rates, rate)),
        ):
            if aid is None:
                continue
            try:
                found = fit(m, aid=aid)
            except jaxcal.DataError as error:
                print(f"| {name} | {sensor} | {error.code} | | |", flush=True)
                continue
            turned = [m * np.where(np.arange(3) == axis, -1.0, 1.0) for axis in range(3)]
            words = [fit(one, aid=aid).verdict for one in turned]
            wrong += words.count("good")
            named = ""
            if sensor == "accel" and found.alignment is not None:
                known = [fit(one, aid=aid, inclination=found.alignment.dip) for one in turned]
                named = f"{sum('mirrored' in one.codes for one in known)} of 3"
                wrong += sum(one.verdict == "good" for one in known)
            print(f"| {name} | {sensor} | {found.verdict} | {', '.join(words)} | {named} |", flush=True)
    print(f"mirrored logs called good: {wrong}")


def nine():
    """Name, readings, specific force or None, and rates or None with their rate, of every log with a magnetometer and another sensor."""
    for name, m, up, rates, rate in real():
        if up is not None or rates is not None:
            yield name, m, up, rates, rate
    for path in sorted((FOLDER / "logs").iterdir()):
        if path.name in LOGS:
            continue
        try:
            log = jaxcal.read(path)
        except (jaxcal.DataError, OSError):
            continue
        if log.mag is None or log.mag.shape[1] != 3 or log.accel is None or log.accel.shape[1] != 3:
            continue
        there = np.flatnonzero(np.isfinite(log.usable("mag")).all(axis=1))
        there = there[:: max(len(there) // MOST, 1)]
        if len(there) > 100:
            yield path.stem[:12], log.mag[there], log.accel[there], None, log.rate


def vehicle(case, seed):
    """Heading errors in degrees at level and at tilts of 10 and 20 degrees, actual and stated, of one vehicle."""
    soft, half, lean, kind = case
    rng = np.random.default_rng([seed, 8])
    change, dip, field = soft * rng.normal(size=(3, 3)), np.deg2rad(65.0), 48.0
    matrix = np.eye(3) + (change if kind == "headings" else (change + change.T) / 2)
    hard = 15 * rng.normal(size=3)
    if kind == "headings":
        angles = np.stack([np.arange(8) * np.pi / 4, np.zeros(8), np.zeros(8)], axis=1)
    else:
        tilt, way = np.deg2rad(lean) * np.sqrt(rng.random(26)), rng.uniform(0, 2 * np.pi, 26)
        angles = np.stack([rng.uniform(0, 2 * np.pi, 26), tilt * np.cos(way), tilt * np.sin(way)], axis=1)
    off = np.deg2rad(half) * rng.normal(size=angles.shape)
    place = field * np.array([np.cos(dip), 0.0, np.sin(dip)])
    bodies = Rotation.from_euler("ZYX", angles + (off if kind == "headings" else 0.0))
    m = np.repeat(bodies.inv().apply(place) @ matrix.T + hard, 20, axis=0)
    m = m + 0.3 * rng.normal(size=m.shape)
    error = np.deg2rad(0.3) * rng.normal(size=(26, 3)) if kind != "headings" else 0.0
    up = np.repeat(-9.81 * (Rotation.from_euler("ZYX", angles).inv().apply([0.0, 0.0, 1.0]) + error), 20, axis=0)
    aid = Headings(np.repeat(angles[:, 0], 20)) if kind == "headings" else Accelerometer(up)
    if kind == "one heading":
        known = np.full(len(m), np.nan)
        known[:20] = angles[0, 0] + np.deg2rad(rng.normal())
        aid = Headings(known, up, error=np.deg2rad(1.0))
    spread = 0.01 if half else 0.0
    found = fit(m, aid=aid, field=field * np.exp(spread * rng.normal()), inclination=dip + np.deg2rad(half) * rng.normal())
    errors = []
    for degrees in (0.0, 10.0, 20.0):
        ways = np.arange(8) * np.pi / 4 if degrees else np.zeros(1)
        seen = np.array([[yaw, np.deg2rad(degrees) * np.cos(w), np.deg2rad(degrees) * np.sin(w)] for w in ways for yaw in YAW])
        body = Rotation.from_euler("ZYX", seen)
        y = body.apply(found.model.correct(body.inv().apply(place) @ matrix.T + hard))
        real = np.rad2deg(np.sqrt(np.mean(heading_of(y) ** 2)))
        stated = np.sqrt(np.mean(jaxcal.magnetometer.heading_uncertainty(found, YAW, tilt=np.deg2rad(degrees)) ** 2))
        errors += [real, np.rad2deg(stated)]
    return errors


VEHICLES = {
    "8 headings x 20, exact": (0.05, 0.0, 0.0, "headings"), "with errors of 0.5 degree, field 1 %": (0.05, 0.5, 0.0, "headings"),
    "soft iron 10 %": (0.1, 0.5, 0.0, "headings"), "26 attitudes within 5 degrees": (0.05, 0.5, 5.0, "accel"),
    "within 10 degrees": (0.05, 0.5, 10.0, "accel"), "within 20 degrees": (0.05, 0.5, 20.0, "accel"),
    "within 10 degrees, one heading of 1 degree": (0.05, 0.5, 10.0, "one heading"),
}  # fmt: skip


def on_level(runs):
    print("\n| actual / stated heading error, degrees | level | tilt 10 | tilt 20 |\n|---|---|---|---|")
    ratios = []
    for name, case in VEHICLES.items():
        table = np.sqrt(np.mean(np.square([vehicle(case, seed) for seed in range(runs)]), axis=0))
        ratios += [a / b for a, b in table.reshape(3, 2)]
        print(f"| {name} | " + " | ".join(f"{a:.2f} / {b:.2f}" for a, b in table.reshape(3, 2)) + " |", flush=True)
    print(f"actual over stated: {', '.join(f'{one:.3f}' for one in ratios)}; from {min(ratios):.3f} to {max(ratios):.3f}")


FLIGHTS = {
    "banks of 15 to 40 degrees, 10 minutes": {}, "errors alike for 10 s, 5 minutes": {"tau": 10.0, "minutes": 5.0},
    "banks of 5 to 15 degrees": {"banks": (5.0, 15.0)}, "attitudes off by 3 degrees": {"tilt": 3.0},
}  # fmt: skip


def on_flight(runs):
    print(
        "\n| actual / stated heading error, degrees | level | tilt 10 | tilt 20 | tilt 45 | largest at level |\n|---|---|---|---|---|---|"
    )
    for name, case in FLIGHTS.items():
        rows = []
        for seed in range(runs):
            flight = _flight.flown(seed, **case)
            found = fit(flight.readings[0], aid=Attitude(flight.attitude.as_quat(scalar_first=True)), inclination=_flight.DIP)
            stated = [heading_uncertainty(found, YAW, tilt=np.deg2rad(tilt)) for tilt in _flight.TILTS]
            rows.append((_flight.heading_errors(found.model, flight.irons[0]), np.sqrt(np.mean(np.square(stated), axis=1))))
        table = np.rad2deg(np.sqrt(np.mean(np.square(rows), axis=0)))
        cells = " | ".join(f"{a:.2f} / {b:.2f}" for a, b in table.T)
        print(f"| {name} | {cells} | {np.rad2deg(np.max(rows, axis=0)[0, 0]):.2f} |", flush=True)


def on_track(runs):
    print("\n| hard iron that walks by 1 % of the field in an hour | rms, % | over the bound | inside | walk, % |\n|---|---|---|---|---|")
    cases = {
        "4 h": {"hours": 4.0},
        "16 h, 20,000 readings": {"hours": 16.0, "count": 20_000},
        "tilts of 6 degrees": {"hours": 4.0, "tilt": 0.1},
    }
    for name, case in cases.items():
        for known in (True, False) if "tilts" not in name else (True,):  # small tilts show no soft iron
            rows = []
            for seed in range(max(runs // 4, 5)):
                dive = _flight.dived(seed, **case)
                found = track(dive.m, dive.time, **({"model": MagModel(dive.soft, np.zeros(3)), "field": 1.0} if known else {}))
                true = np.stack([np.interp(found.time, dive.time, axis) for axis in dive.hard.T], axis=1)
                held = np.abs(found.hard_iron - true) < 1.96 * np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
                off = np.mean((found.at(dive.time) - dive.hard) ** 2)
                rows.append((off, np.mean(_flight.least(dive) ** 2), held.mean(), 60 * found.walk))
            off, least, inside, walk = np.mean(rows, axis=0)
            word = f"{name}, soft iron {'known' if known else 'estimated'}"
            print(f"| {word} | {100 * np.sqrt(off):.3f} | {np.sqrt(off / least):.2f} | {inside:.1%} | {100 * walk:.2f} |", flush=True)
    dive = _flight.dived(0, count=1_000_000, hours=6.0)
    for word in ("first", "second"):
        start = time.perf_counter()
        track(dive.m, dive.time)
        print(f"a million readings, {word} call: {time.perf_counter() - start:.1f} s")


PARTS = {"real": on_real, "faults": on_faults, "white": on_white, "spoilt": on_spoilt, "mirrored": on_mirrored, "level": on_level,
         "flight": on_flight, "track": on_track}  # fmt: skip

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=PARTS)
    parser.add_argument("--runs", type=int, default=40)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    for part, function in PARTS.items():
        if options.only in (None, part):
            function(options.runs)
