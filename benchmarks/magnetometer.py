"""jaxcal.magnetometer beside scipy's least_squares in one run, and Monte Carlo tables, with fixed seeds.

    python benchmarks/magnetometer.py                  everything (minutes)
    python benchmarks/magnetometer.py --only speed     one part: speed, partial, others, scenarios, coverage, known, chosen, joint, faults,
                                                       random, guided, halves
    python benchmarks/magnetometer.py --runs 300       more runs per cell of the tables

Times are the best of several after compilation; compilation is timed separately. Ratios above 1 favour jaxcal.
"""

import argparse
import contextlib
import itertools
import json
import os
import pathlib
import time

import _faults
import numpy as np
import scipy.optimize
from scipy.spatial.transform import Rotation

from jaxcal.magnetometer import (
    Accelerometer,
    Gyroscope,
    MagModel,
    body_field,
    fit,
    guide,
    scenario,
)
from jaxcal.magnetometer._judge import by_iron, heading_change, heading_errors as stated_errors

MILD = MagModel(np.array([[1.10, 0.06, -0.04], [0.06, 0.92, 0.05], [-0.04, 0.05, 1.0]]), np.array([0.8, -0.5, 0.3]))
PAPER = MagModel(
    np.linalg.inv([[0.9847, -0.2311, -0.0363], [-0.2311, 1.3609, -0.3391], [-0.0363, -0.3391, 0.8710]]), np.array([2.1746, 5.152, 10.2458])
)
SENSORS = {
    "full": MagModel(np.array([[1.1, 0.15, -0.1], [0.0, 0.9, 0.1], [0.05, -0.1, 1.0]]), np.array([0.3, -0.2, 0.5])),
    "symmetric": MILD,
    "diagonal": MagModel(np.diag([1.1, 1.0, 0.9]), np.zeros(3)),
    "sphere": MagModel(np.eye(3), np.zeros(3)),
}
FIELD, DIP = 47.0, np.deg2rad(57.0)
HEADINGS = np.deg2rad([2.4, 77.4, 115.5, 167.5, 222.6, 249.4, 300.3, 356.1])
METHODS = ("ml", "consistent", "constrained")


def directions(count, rng, coverage="full"):
    u = rng.normal(size=(8 * count, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    kept = {"full": u[:, 2] > -2, "hemisphere": u[:, 2] > 0, "band": np.abs(u[:, 2]) < 0.5}[coverage]
    return u[kept][:count]


def best(function, repeats=7):
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def spent(function, repeats=40):
    """Wall time and CPU time of each call, ms."""
    for _ in range(3):
        function()
    times = []
    for _ in range(repeats):
        start = time.perf_counter(), time.process_time()
        function()
        times.append((time.perf_counter() - start[0], time.process_time() - start[1]))
    return 1e3 * np.array(times).T


def residuals(p, m):
    """First-order orthogonal distances in NumPy, with the same nine parameters: the fastest formulation for scipy."""
    upper = np.array([[p[0], p[1], p[2]], [0, p[3], p[4]], [0, 0, p[5]]])
    v = (m - p[6:]) @ upper.T
    r = np.linalg.norm(v, axis=1)
    return (r - 1) * r / np.linalg.norm(v @ upper, axis=1)


def by_scipy(m, begin, method="lm"):
    return scipy.optimize.least_squares(residuals, begin, args=(m,), method=method, x_scale="jac")


def speed(_):
    rng = np.random.default_rng(0)
    m = MILD.measure(directions(500, rng)) + 0.01 * rng.normal(size=(500, 3))
    start = time.perf_counter()
    fit(m, model="symmetric")
    print(f"one fit of 500 readings, first call with compilation: {time.perf_counter() - start:.2f} s")
    for model in ("symmetric", "auto"):
        print(f"one fit, model={model!r}: {1e3 * best(lambda model=model: fit(m, model=model)):.1f} ms")
    begin = np.r_[np.linalg.inv(MILD.soft_iron)[np.triu_indices(3)], MILD.hard_iron]
    alone = 1e3 * best(lambda: by_scipy(m, begin))
    print(f"scipy least_squares, first-order distance, from the truth, no start and no verdict: {alone:.1f} ms")
    print("one fit as it is by default, ms of 40: least, median, 95th percentile; median of the processor time")
    for count, coverage in ((500, "full"), (500, "hemisphere"), (1000, "full"), (1000, "hemisphere")):
        for (kind, sensor), sigma in itertools.product(SENSORS.items(), (0.01, 0.05)):
            other = sensor.measure(directions(count, rng, coverage)) + sigma * rng.normal(size=(count, 3))
            took, busy = spent(lambda other=other: fit(other))
            cells = " ".join(f"{value:5.1f}" for value in (took.min(), *np.percentile(took, (50, 95)), np.median(busy)))
            print(f"{count:4d} readings, {coverage:10s} {kind:9s} {100 * sigma:.0f} % noise: {cells}")
    many = MILD.measure(directions(200_000, rng)) + 0.01 * rng.normal(size=(200_000, 3))
    print(f"one fit of 200,000 readings, thinned to {fit(many).numbers['used'].value:.0f}: {best(lambda: fit(many), 3):.2f} s")


def partial(runs):
    print("\nmean hard-iron error in per cent of the field +- standard error / median direction error in degrees +- standard error")
    sphere = directions(500, np.random.default_rng(99))
    for coverage in ("full", "hemisphere", "band"):
        for sigma in (0.005, 0.02, 0.05):
            cells = []
            for method in METHODS:
                rng, offsets, angles = np.random.default_rng(7), [], []
                failed = 0
                for _ in range(runs):
                    m = MILD.measure(directions(300, rng, coverage))
                    found = fit(m + sigma * rng.normal(size=m.shape), method=method, model="symmetric")
                    if found.model is None or not np.isfinite(found.heading_error).all():
                        failed += 1
                        continue
                    y = found.model.correct(MILD.measure(sphere))
                    cosine = np.sum(sphere * y, axis=1) / np.linalg.norm(y, axis=1)
                    offsets.append(found.model.hard_iron - MILD.hard_iron)
                    angles.append(np.rad2deg(np.sqrt(np.mean(np.arccos(np.clip(cosine, -1, 1)) ** 2))))
                kept = len(offsets)
                bias, error = 100 * np.linalg.norm(np.mean(offsets, 0)), 100 * np.linalg.norm(np.std(offsets, 0)) / np.sqrt(kept)
                doubt = 1.25 * np.std(angles) / np.sqrt(kept)
                cells.append(
                    f"{method} {bias:.2f}+-{error:.2f} / {np.median(angles):.2f}+-{doubt:.2f}" + (f" ({failed} refused)" if failed else "")
                )
            print(f"{coverage:10s} {100 * sigma:3.1f} %: " + ";  ".join(cells))


def quadric(m, kind):
    """Centre and correction by an algebraic fit of x'Ax + 2v'x = 1, as other tools make it."""
    shift = m.mean(axis=0) * (kind == "mean-centred")
    (x, y, z), one = (m - shift).T, np.ones(len(m))
    design = np.stack([x * x, y * y, z * z, 2 * y * z, 2 * x * z, 2 * x * y, 2 * x, 2 * y, 2 * z], axis=1)
    if kind == "Li and Griffiths":  # least |D p| under 4ac - b^2 = 1 of the invariants, by the generalised eigenvalues
        c = np.zeros((6, 6))
        c[:3, :3] = 1 - 2 * np.eye(3)
        c[3:, 3:] = -4 * np.eye(3)
        s = (d := np.column_stack([design, one])).T @ d
        rest = np.linalg.solve(s[6:, 6:], s[6:, :6])
        values, vectors = np.linalg.eig(np.linalg.solve(c, s[:6, :6] - s[:6, 6:] @ rest))
        p = vectors[:, np.argmax(values.real)].real
        p = np.concatenate([p, -rest @ p])
    elif kind == "Petrov":  # x^2 + y^2 + z^2 = the rest of the quadric
        columns = np.column_stack([design[:, :3] @ [[1, 1], [1, -2], [-2, 1]], design[:, 3:], one])
        u = np.linalg.lstsq(columns, (m**2).sum(axis=1), rcond=None)[0]
        p = np.concatenate([[u[0] + u[1] - 1, u[0] - 2 * u[1] - 1, u[1] - 2 * u[0] - 1], u[2:]])
    else:
        p = np.linalg.lstsq(design[:, : 9 if kind == "quadric = 1" else 6], one, rcond=None)[0]
        p = np.concatenate([p, np.zeros(9 - len(p)), [-1.0]])
    matrix = np.array([[p[0], p[5], p[4]], [p[5], p[1], p[3]], [p[4], p[3], p[2]]])
    centre = -np.linalg.solve(matrix, p[6:9])
    values, turn = np.linalg.eigh(matrix / (centre @ matrix @ centre - p[9]))
    return centre + shift, (turn * np.sqrt(np.abs(values))) @ turn.T


def radial(m):
    """Centre and correction of least squared |A (m - b)| - 1 from the truth: where ArduPilot and PX4 would end without their limits."""
    sym = lambda p: np.array([[p[0], p[1], p[2]], [p[1], p[3], p[4]], [p[2], p[4], p[5]]])  # noqa: E731
    begin = np.r_[np.linalg.inv(MILD.soft_iron)[np.triu_indices(3)], MILD.hard_iron]
    p = scipy.optimize.least_squares(lambda p: np.linalg.norm((m - p[6:]) @ sym(p), axis=1) - 1, begin).x
    return p[6:], sym(p)


def ours(m):
    found = fit(m, model="symmetric").model
    return found.hard_iron, np.linalg.inv(found.soft_iron)


def others(runs):
    print("\nhalf a sphere, 300 readings, 2 % noise: hard-iron error in per cent of the field / directions in degrees, rms; medians")
    sphere = directions(500, np.random.default_rng(99))
    shapes = {kind: lambda m, kind=kind: quadric(m, kind) for kind in ("Li and Griffiths", "Petrov", "quadric = 1", "mean-centred")}
    for name, method in (shapes | {"radial": radial, "maximum likelihood": ours}).items():
        rng, off, turned = np.random.default_rng(7), [], []
        for _ in range(runs):
            m = MILD.measure(directions(300, rng, "hemisphere"))
            centre, matrix = method(m + 0.02 * rng.normal(size=m.shape))
            y = (MILD.measure(sphere) - centre) @ matrix.T
            cosine = np.sum(sphere * y, axis=1) / np.linalg.norm(y, axis=1)
            off.append(100 * np.linalg.norm(centre - MILD.hard_iron))
            turned.append(np.rad2deg(np.sqrt(np.mean(np.arccos(np.clip(cosine, -1, 1)) ** 2))))
        rms = [np.sqrt(np.mean(np.square(values))) for values in (off, turned)]
        print(f"{name:18s} {rms[0]:.2g} / {rms[1]:.2g}; {np.median(off):.2g} / {np.median(turned):.2g}")


def heading_errors(model):
    """Errors in degrees at eight level headings, from the angle itself, so that fields too steep for `heading` count too."""
    level = np.stack([HEADINGS, 0 * HEADINGS, 0 * HEADINGS], axis=1)
    x, y, _ = np.asarray(model.correct(PAPER.measure(body_field(level, FIELD, DIP)))).T
    return np.rad2deg(np.angle(np.exp(1j * (np.arctan2(-y, x) - HEADINGS))))


def least_heading_error(field, sigma):
    """Cramer-Rao bound at level in degrees, from the information of the orthogonal distances at the exact readings."""
    h, (i, j) = field / FIELD, np.triu_indices(3)
    normal = h @ np.linalg.inv(PAPER.soft_iron)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    rows = np.concatenate([FIELD * (normal[:, i] * h[:, j] + normal[:, j] * h[:, i]) / np.where(i == j, 2, 1), normal], axis=1)
    to_iron = np.zeros((13, 9))  # hard iron, the nine entries of the soft iron, and the field, which is known
    to_iron[3 + 3 * i + j, range(6)] = to_iron[3 + 3 * j + i, range(6)] = to_iron[range(3), range(6, 9)] = 1.0
    covariance = sigma**2 * to_iron @ np.linalg.inv(rows.T @ rows) @ to_iron.T
    return np.rad2deg(stated_errors(by_iron(PAPER, FIELD), DIP, np.array([0.0, 0.0, 1.0]), [covariance])[0][0])


def scenarios(runs):
    print("\nrms heading error in degrees at eight level headings, of the bound and of each method; then for ml the ratio to the bound and")
    print("to the prediction, the share of runs with all eight below 1 degree, and the verdicts. (n): runs without an ellipsoid, left out")
    for sigma in (0.05, 0.1, 0.2, 0.5, 1.0):
        for name in ("all", "three_turns", "twelve_points"):
            fields = [body_field(scenario(name, seed=run), FIELD, DIP) for run in range(runs)]
            least = np.sqrt(np.mean([least_heading_error(field, sigma) ** 2 for field in fields]))
            cells = []
            for method in ("ml", "constrained"):
                rng, errors, predicted, verdicts = np.random.default_rng(3), [], [], []
                for field in fields:
                    m = PAPER.measure(field) + sigma * rng.normal(size=field.shape)
                    found = fit(m, model="symmetric", inclination=DIP, method=method)
                    verdicts.append(found.verdict)
                    if found.model is not None:
                        errors.append(heading_errors(found.model))
                        predicted.append(np.rad2deg(found.heading_error[0]))
                rms = np.sqrt(np.mean(np.square(errors)))
                text = f"{method} {rms:.3g}" + (f" ({runs - len(errors)})" if len(errors) < runs else "")
                if method == "ml":
                    ratio = rms / np.sqrt(np.mean(np.square(predicted)))
                    below = np.sum(np.max(np.abs(errors), axis=1) < 1) / runs
                    share = ", ".join(f"{word} {verdicts.count(word) / runs:.0%}" for word in ("good", "weak", "refused"))
                    spread = [np.sqrt(np.mean(np.square(errors)[rng.integers(runs, size=runs)])) / least for _ in range(400)]
                    about = f"{rms / least:.2f}+-{np.std(spread):.2f}, {ratio:.2f}, {below:.2f}; {share}"
                cells.append(text)
            print(f"{sigma:4.2f} uT {name:14s} bound {least:.3g};  " + ";  ".join(cells) + f";  ml: {about}", flush=True)


def known(runs):
    print("\nhalf a sphere, 300 readings, by the standard deviation of the given field: rms hard-iron error in per cent of the field,")
    print("mean share of it inside the intervals of 95 %; the given norms have that error")
    size = np.linalg.det(MILD.soft_iron) ** (1 / 3)
    for sigma in (0.02, 0.05):
        cells = []
        for error in (None, 0.05, 0.02, 0.01):
            rng, offsets, inside = np.random.default_rng(7), [], []
            for _ in range(4 * runs):
                m = MILD.measure(directions(300, rng, "hemisphere"))
                m = m + sigma * rng.normal(size=m.shape)
                norm = size * np.exp((error or 0.0) * rng.normal())
                found = fit(m, model="symmetric", field=norm, field_error=error)
                offsets.append(found.model.hard_iron - MILD.hard_iron)
                inside.append(np.abs(offsets[-1]) < 1.96 * found.estimate.select("hard_iron*").error)
            rms = 100 * np.sqrt(np.mean(np.sum(np.square(offsets), axis=1)))
            cells.append(f"{error if error else 'none'}: {rms:.2f}, {100 * np.mean(inside):.1f} %")
        print(f"{100 * sigma:g} % noise: " + ";  ".join(cells), flush=True)


def chosen(runs):
    print("\nmodel='auto', 300 readings of a cap, 2 % noise: models, verdicts, rms heading error in degrees, real and predicted")
    attitudes = np.stack([np.arange(24) * np.pi / 12, np.zeros(24), np.zeros(24)], axis=1)
    field = body_field(attitudes, 1.0, DIP)
    for name, soft in (
        ("none", np.eye(3)),
        ("3 %", [[1.03, 0.01, -0.01], [0.01, 0.98, 0.01], [-0.01, 0.01, 1.0]]),
        ("10 %", MILD.soft_iron),
    ):
        sensor = MagModel(np.array(soft), np.array([0.3, -0.2, 0.1]))
        for lowest in (0.0, 0.3, 0.5, 0.7):
            found, real = [], []
            for run in range(2 * runs):
                rng = np.random.default_rng(run)
                u = np.concatenate([directions(4800, rng), directions(4800, rng)])
                m = sensor.measure(u[u[:, 2] > lowest][:300])
                found.append(fit(m + 0.02 * rng.normal(size=m.shape), inclination=DIP))
                y = np.asarray(found[-1].model.correct(sensor.measure(field)))
                off = np.arctan2(-y[:, 1], y[:, 0]) - attitudes[:, 0]
                real.append(np.rad2deg(np.angle(np.exp(1j * off))))
            told = np.rad2deg(np.sqrt(np.mean([one.heading_error[0] ** 2 for one in found])))
            shares = [f"{word} {sum(word in (one.kind, one.verdict) for one in found) / len(found):.0%}"
                      for word in ("sphere", "diagonal", "symmetric", "good", "weak", "refused")]  # fmt: skip
            print(f"soft iron {name}, z > {lowest}: {', '.join(shares)}; {np.sqrt(np.mean(np.square(real))):.2f}, {told:.2f}", flush=True)


def covered(runs):
    print("\nshare of truths inside the intervals of 95 %: hard iron, soft iron, and their mean")
    size = np.linalg.det(PAPER.soft_iron) ** (1 / 3)
    truth = np.r_[PAPER.hard_iron, np.ravel(PAPER.soft_iron) / size]
    for name, sigma in (("all", 0.2), ("three_turns", 0.1)):
        rng, inside = np.random.default_rng(11), []
        for run in range(4 * runs):
            m = PAPER.measure(body_field(scenario(name, seed=run), FIELD, DIP))
            found = fit(m + sigma * rng.normal(size=m.shape), model="symmetric")
            inside.append(np.abs(found.estimate.values[:12] - truth) < 1.96 * found.estimate.error[:12])
        share = np.mean(inside, axis=0)
        print(f"{name}, {sigma} uT, {4 * runs} fits: {' '.join(f'{100 * s:.1f}' for s in share)}; mean {100 * share.mean():.1f} %")


TURNED = MagModel(MILD.soft_iron @ Rotation.from_rotvec(np.deg2rad([2.0, -1.0, 3.0])).as_matrix(), MILD.hard_iron)
NORTH = np.array([np.cos(DIP), 0.0, np.sin(DIP)])


def driven(kind, count, rate, rng, sigma):
    """Readings, rates (white noise of 0.1 deg/s per sample, bias 0.2 deg/s) and specific force (0.5 % white) of a smooth motion."""
    fine, phase = 4, rng.uniform(0, 2 * np.pi, 3)
    t = np.arange(-1, fine * count + 1) / (fine * rate)
    swing = lambda most, pace, i: np.deg2rad(most) * np.sin(pace * t + phase[i])  # noqa: E731
    euler = {
        "everywhere": [0.8 * t + phase[0], swing(69, 0.5, 1), 0.67 * t + phase[2]],
        "three turns, tilt 20": [6 * np.pi * t * rate / count + phase[0], swing(20, 0.7, 1), swing(20, 0.53, 2)],
        "cap 40": [swing(40, 0.31, 0), swing(28, 0.6, 1), swing(28, 0.83, 2)],
    }[kind]
    body = Rotation.from_euler("ZYX", np.stack(euler, axis=1))
    rates = (body[:-2].inv() * body[2:]).as_rotvec()[::fine] * fine * rate / 2
    body = body[1:-1][::fine].inv()
    m = TURNED.measure(body.apply(NORTH)) + sigma * rng.normal(size=rates.shape)
    gyro = rates + np.deg2rad([0.2, -0.14, 0.1]) + np.deg2rad(0.1) * rng.normal(size=rates.shape)
    return m, gyro, 9.81 * (0.005 * rng.normal(size=rates.shape) - body.apply([0.0, 0.0, 1.0]))


def headings_off(model):
    yaw = np.arange(24) * np.pi / 12
    field = Rotation.from_euler("ZYX", np.stack([yaw, 0 * yaw, 0 * yaw], axis=1)).inv().apply(NORTH)
    x, y, _ = np.asarray(model.correct(TURNED.measure(field))).T
    return np.rad2deg(np.sqrt(np.mean(np.angle(np.exp(1j * (np.arctan2(-y, x) - yaw))) ** 2)))


def jointly(runs):
    print(
        "\nrms over the runs of the hard-iron error, per cent of the field, and of the heading error, degrees: magnitudes alone, with the"
    )
    print("sensor; the prediction of both; the shares called good; share of truths (b and C) inside the intervals of 95 %")
    size = np.linalg.det(TURNED.soft_iron) ** (1 / 3)
    truth = np.r_[TURNED.hard_iron, np.ravel(TURNED.soft_iron) / size]
    for sensor, kind in itertools.product(("gyro", "accel"), ("everywhere", "three turns, tilt 20", "cap 40")):
        rows, inside = [], []
        for run in range(runs):
            m, gyro, accel = driven(kind, 1000, 50.0, np.random.default_rng([run, 5]), 0.01)
            aid = Gyroscope(gyro, 50.0) if sensor == "gyro" else Accelerometer(accel)
            both = [fit(m), fit(m, aid=aid)]
            rows.append([
                [100 * np.linalg.norm(f.model.hard_iron - TURNED.hard_iron), headings_off(f.model), np.rad2deg(f.heading_error[0]),
                 f.verdict == "good"] for f in both
            ])  # fmt: skip
            inside.append(np.abs(both[1].estimate.values[:12] - truth) < 1.96 * both[1].estimate.error[:12])
        table = np.array(rows)
        rms = np.sqrt(np.mean(table[..., :3] ** 2, axis=0))
        good = 100 * table[..., 3].mean(axis=0)
        print(
            f"{sensor}, {kind}, {runs} runs: hard iron {rms[0, 0]:.2f}, {rms[1, 0]:.2f}; heading {rms[0, 1]:.2f}, {rms[1, 1]:.2f}; "
            f"predicted {rms[0, 2]:.2f}, {rms[1, 2]:.2f}; good {good[0]:.0f} %, {good[1]:.0f} %; inside {100 * np.mean(inside):.1f} %",
            flush=True,
        )  # fmt: skip


def faults(runs):
    """Compare predicted errors and verdicts with the truth, on logs with errors that the fit does not model."""
    print("\n| case | good | bad among good | true over predicted, median | hard iron inside | costs more than the limit | named there |")
    print("|---|---|---|---|---|---|---|")
    for name, size in _faults.CASES:
        good, true, ratio, named, inside = _faults.tried(fit, (name, size), runs).T
        bad = true > 1.0
        word = f"{100 * np.mean(named[bad]):.0f} %" if bad.any() and _faults.CASES[name, size] else ""
        among = f"{100 * np.mean(bad[good > 0]):.0f} %" if good.any() else ""
        print(
            f"| {name} {size:g} | {100 * np.mean(good):.0f} % | {among} | {np.median(ratio):.2f} | {100 * np.mean(inside):.0f} % | "
            f"{100 * np.mean(bad):.0f} % | {word} |", flush=True,
        )  # fmt: skip


def random(runs):
    """Fit random logs, none of which may raise an exception (thirty for each run, 2,010 with --runs 67)."""
    words = {"good": 0, "weak": 0, "refused": 0}
    for seed in range(30 * runs):
        words[fit(_faults.random_log(seed)).verdict] += 1
    print(f"\n{30 * runs} random logs: {words}", flush=True)


def replayed(m, limit):
    """Readings until the limit is expected, in log order and chosen by `guide`; readings when `guide` says stop, and the fit then."""
    plain = next((n for n in range(12, len(m), 4) if guide(m[:n], limit=limit).heading_error <= limit), None)
    taken, left, reached = [0], list(range(1, len(m))), None
    while left:
        advice = guide(m[taken], limit=limit)
        if reached is None and advice.heading_error <= limit:
            reached = len(taken)
        if advice.stop:
            return plain, reached, len(taken), advice.fit
        u = m[left] - (np.mean(m[taken], axis=0) if advice.fit is None else advice.fit.model.hard_iron)
        taken.append(left.pop(np.argmax(u @ advice.direction / np.linalg.norm(u, axis=1))))
    return plain, reached, None, None


def guided(runs):
    """Compare the order of a log with that of `guide`: readings until one degree is expected, and the error when `guide` says stop.

    For a real log, the error is the difference from the fit of the whole log.
    """
    limit = np.deg2rad(1.0)
    print("\n| log | in its order | guided | ratio | at stop | error at stop, degrees | within the limit |\n|---|---|---|---|---|---|---|")
    for noise, share in ((0.01, 1.0), (0.005, 0.1), (0.02, 0.1)):
        rows = []
        for seed in range(int(share * runs)):
            plain, reached, stopped, found = replayed(_faults.simulate(("white", noise), seed)[0], limit)
            rows.append((plain, reached, reached / plain, stopped, _faults.heading_error(found.model)))
        *counts, off = np.array(rows, dtype=float).T
        middle = " | ".join(f"{np.median(values):.3g}" for values in counts)
        print(
            f"| simulated, noise {100 * noise:g} %, {len(off)} runs | {middle} | {np.rad2deg(np.median(off)):.2f} | "
            f"{100 * np.mean(off <= limit):.0f} % |",
            flush=True,
        )
    folder = pathlib.Path(os.environ.get("JAXCAL_REFERENCE", "../shared")) / "data" / "magnetometer"
    for name, m in _real(folder).items():
        m = m[np.unique(np.linspace(0, len(m) - 1, 600).astype(int))]
        whole = fit(m, model="symmetric")
        plain, reached, stopped, found = replayed(m, limit)
        off = np.nan if found is None else np.sqrt(np.mean(heading_change(found.model, whole.model, whole.field) ** 2))
        ratio = f"{reached / plain:.2f}" if plain and reached else ""
        print(f"| {name} | {plain} | {reached} | {ratio} | {stopped} | {np.rad2deg(off):.2f} | |", flush=True)


def _real(folder):
    """Tumbles recorded by other people, in counts."""
    if not folder.is_dir():
        return {}
    found = {
        "pichim": np.loadtxt(next((folder / "pichim").glob("*.txt")), delimiter=",")[:, :3],
        "jremington": np.loadtxt(folder / "jremington" / "mag3_raw.csv", delimiter=",")[:, -3:],
        "ellipsoid_fit_python": np.loadtxt(folder / "ellipsoid_fit_python" / "mag_out.txt"),
    }
    with contextlib.suppress(ImportError):
        import h5py

        with h5py.File(folder / "sunsided" / "hmc5883l_compass.mat") as file:
            rows = np.array(file["compassBuffer"])
        found["sunsided"] = (rows if rows.shape[1] == 4 else rows.T)[:, 1:]
    for path in sorted((folder / "betaflight").glob("*_tumble.json")):
        samples = json.loads(path.read_text())["samples"]
        found["betaflight " + path.stem.split("-")[2]] = np.array([[one[axis] for axis in "xyz"] for one in samples], dtype=float)
    return found


def halves(_):
    """Compare halves of real logs."""
    folder = pathlib.Path(os.environ.get("JAXCAL_REFERENCE", "../shared")) / "data" / "magnetometer"
    ratios, standard = [], []
    print("\n| log | halves differ, degrees | predicted | ratio | hard iron, standard errors rms |\n|---|---|---|---|---|")
    for name, m in _real(folder).items():
        one, two = (fit(half, model="symmetric") for half in np.array_split(m, 2))
        off = np.sqrt(np.mean(heading_change(two.model, one.model, one.field, inclination=one.inclination) ** 2))
        told = np.hypot(one.heading_error[0], two.heading_error[0])
        moved = (one.model.hard_iron - two.model.hard_iron) / np.hypot(
            one.estimate.select("hard_iron*").error, two.estimate.select("hard_iron*").error
        )
        ratios.append(off / told)
        standard.append(moved)
        print(f"| {name} | {np.rad2deg(off):.2f} | {np.rad2deg(told):.2f} | {off / told:.2f} | {np.sqrt(np.mean(moved**2)):.2f} |")
    if ratios:
        print(
            f"median ratio {np.median(ratios):.2f}; hard iron {np.sqrt(np.mean(np.square(standard))):.2f} standard errors rms", flush=True
        )


PARTS = {
    "speed": speed, "partial": partial, "others": others, "scenarios": scenarios, "coverage": covered, "known": known, "chosen": chosen,
    "joint": jointly, "faults": faults, "random": random, "guided": guided,
    "halves": halves,
}  # fmt: skip

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=PARTS)
    parser.add_argument("--runs", type=int, default=60)
    options = parser.parse_args()
    for name, part in PARTS.items():
        if options.only in (None, name):
            part(options.runs)
