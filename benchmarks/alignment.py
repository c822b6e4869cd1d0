"""Accuracy and time of levelling and north finding, with fixed seeds.

    python benchmarks/alignment.py                   everything (minutes)
    python benchmarks/alignment.py --only speed      one part: accuracy, efficiency, methods, plan, speed
    python benchmarks/alignment.py --runs 4000       more draws per cell of the tables

The reference file, which some parts need, is searched for in JAXCAL_REFERENCE or ../shared.
"""

import argparse
import json
import os
import pathlib
import time

import jax
import jax.numpy as jnp
import numpy as np

from jaxcal.alignment import Positions, Sensor, azimuth, crlb, fit, level, plan, simulate
from jaxcal.alignment._findings import OUTCOMES
from jaxcal.alignment._model import NAMES

jax.config.update("jax_enable_x64", True)
DEG, G, EARTH = np.pi / 180, 9.80665, 7.292115e-5
ARW, VRW = 0.01 * DEG / 60, 50e-6 * G
SEVEN = NAMES[:7]
X4 = [("x", 0), ("x", 90), ("x", 180), ("x", 270)]
GRADES = {"navigation": (0.1, 5.0), "tactical": (1.0, 50.0), "MEMS": (10.0, 200.0)}  # multiples of 0.01 deg/sqrt(h), and micro-g sqrt(s)


def at(rows, total=240.0):
    return Positions([angle * DEG for _, angle in rows], [word for word, _ in rows], total / len(rows))


def vectors():
    root = pathlib.Path(os.environ.get("JAXCAL_REFERENCE", pathlib.Path(__file__).resolve().parents[1].parent / "shared"))
    return json.loads((root / "reference" / "alignment_vectors.json").read_text())


def apart(first, second):
    return np.abs(np.angle(np.exp(1j * (np.asarray(first) - np.asarray(second)))))


METHODS = {
    "opposed": [("x", 0), ("x", 180)], "quadrature": [("x", 90), ("x", 270)], "four_point": X4, "single_reading": [("x", 0)],
    "maximum": [("x", a) for a in range(0, 360, 60)], "bias_and_scale": X4[:3], "scale_first": X4[:3], "triad": [*X4[:3], ("z", 0)],
}  # fmt: skip


def accuracy(_):
    """Print noise-free errors for 300 random attitudes at least 10 degrees from the singularities, for all methods and the joint fit."""
    rng = np.random.default_rng(0)
    span = np.array([[-80, 80], [-80, 80], [10, 170], [-75, 75]]) * DEG
    draws = rng.uniform(span[:, 0], span[:, 1], (300, 4))
    draws[:, 2] *= rng.choice([-1, 1], 300)
    print("largest error in degrees over 300 random attitudes, readings without noise")
    rows = [*X4, ("x", 60), ("x", 120), ("x", 240), ("x", 300), ("y", 0), ("y", 90), ("y", 180), ("y", 270), ("z", 0)]
    places = at(rows)
    for method in ("four_point_x", "least_squares_x", "four_point_y", "least_squares_y", "bias_and_scale"):
        worst = 0.0
        for phi, theta, psi, lat in draws:
            found = level(simulate(places, [phi, theta, psi], lat), method=method)
            worst = max(worst, apart(found.phi, phi), apart(found.theta, theta))
        print(f"level {method:16s} {worst / DEG:.1e}")
    for method in METHODS:
        errors, away = [], []
        for phi, theta, psi, lat in draws:
            found = azimuth(simulate(places, [phi, theta, psi], lat), [phi, theta], lat, method=method, hint=psi)
            error = float(np.min(apart(found.roots, psi))) if found.roots.size else np.inf
            near = np.sort(apart(found.roots, psi)) if found.roots.size else np.zeros(2)
            errors.append(error)
            away.append(len(near) < 2 or near[1] > 10 * DEG)
        errors, away = np.array(errors), np.array(away)
        print(f"azimuth {method:14s} {errors[away].max() / DEG:.1e} for {away.sum()} with the next root 10 degrees off or more; "
              f"all: {errors.max() / DEG:.1e}")  # fmt: skip
    places = Positions([a * DEG for _, a in (*X4, *X4)], ["x"] * 4 + ["z"] * 4)
    worst = [0.0, 0.0]
    for phi, theta, psi, lat in draws[:100]:
        errors = [Sensor(1e-4, np.array([1e-4, -2e-4]), b) for b in (1e-3, 1e-7)]
        readings = simulate(places, [phi, theta, psi], lat, accel=errors[0], gyro=errors[1])
        for i, known in enumerate((lat, None)):
            found = fit(readings, known, free=NAMES[:11])
            worst[i] = max(worst[i], *apart(found.estimate.values[:3], [phi, theta, psi]))
    print(f"joint fit of 11 parameters {worst[0] / DEG:.1e}, and with the latitude {worst[1] / DEG:.1e} (100 attitudes, x4 + z4)")


def _fits(places, attitude, latitude, accel, gyro, runs, seed, **options):
    """Azimuths and verdicts of many simulated joint fits at once; all cells of a table share the compiled program."""

    def one(key):
        readings = simulate(places, jnp.asarray(attitude), latitude, accel=accel, gyro=gyro, seed=key)
        found = fit(readings, latitude, **options)
        return found.estimate.values, found.outcome

    return jax.vmap(one)(jax.random.split(jax.random.key(seed), runs))


def efficiency(runs):
    """Print the root mean square error of the joint fit over the Cramer-Rao bound."""
    print(f"\nrmse / bound of the azimuth, {runs} runs each (standard error {1 / np.sqrt(2 * runs):.3f}); in brackets the bound in degrees")
    layouts = {
        "x4, priors 1e-4": (X4, {"free": SEVEN, "priors": {"s_a": 1e-4, "s_g": 1e-4}}),
        "x4 + z + -z": ([*X4, ("z", 0), ("-z", 0)], {"free": SEVEN}),
    }
    worst = []
    for name, (rows, options) in layouts.items():
        for grade, (gyro, accel) in GRADES.items():
            cells, places = [], at(rows, 2400.0 if grade == "MEMS" else 240.0)
            for lat in (0, 35, 60, 80):
                attitude = np.array([50.0, 30.0, 88.0]) * DEG
                noise = Sensor(white=accel * 1e-6 * G), Sensor(white=gyro * ARW)
                bound = crlb(places, attitude, lat * DEG, accel_noise=noise[0], gyro_noise=noise[1], **options)
                values, _ = _fits(places, attitude, lat * DEG, *noise, runs, 1, **options)
                rmse = np.sqrt(np.mean(apart(values[:, 2], attitude[2]) ** 2))
                cells.append(f"{rmse / bound.azimuth_std:.3f} ({bound.azimuth_std / DEG:.3g})")
                worst.append(rmse / bound.azimuth_std)
            print(f"{name:16s} {grade:11s} latitude 0: {cells[0]}  35: {cells[1]}  60: {cells[2]}  80: {cells[3]}")
    print(f"all: {min(worst):.3f} to {max(worst):.3f}")
    # beyond 10 degrees the bound of a linear model means little, and every run reports it
    rows, options = layouts["x4, priors 1e-4"]
    noise = Sensor(white=200e-6 * G), Sensor(white=10 * ARW)
    bound = crlb(at(rows), attitude, 80 * DEG, accel_noise=noise[0], gyro_noise=noise[1], **options).azimuth_std
    values, verdict = (np.asarray(v) for v in _fits(at(rows), attitude, 80 * DEG, *noise, runs, 1, **options))
    error = apart(values[:, 2], attitude[2]) / bound
    said = [
        f"{OUTCOMES[int(v)]} {np.mean(verdict == v):.1%} ({np.sqrt(np.mean(error[verdict == v] ** 2)):.2f})" for v in np.unique(verdict)
    ]
    print(
        f"MEMS, x4, 240 s only, latitude 80: bound {bound / DEG:.3g} degrees; verdict, share of the runs (rmse / bound): {', '.join(said)}"
    )


LISTED = {  # alignment.md, section 8: (phi, theta, psi, latitude) -> seven methods, J3, J4, J6
    (50, 30, 88, 0): (0.171, 0.375, 0.240, 0.164, 0.578, 0.208, 0.271, 0.205, 0.218, 0.256),
    (50, 30, 88, 35): (0.207, 0.439, 0.287, 0.207, 2.64, 0.251, 0.333, 0.256, 0.267, 0.312),
    (50, 30, 88, 60): (0.337, 0.709, 0.472, 0.333, 13.3, 0.448, 0.553, 0.449, 0.437, 0.511),
    (50, 30, 88, 80): (0.975, 2.06, 1.39, 0.990, 9.95, 1.39, 1.61, 1.39, 1.26, 1.47),
    (1, 2, 88, 35): (0.177, 2.29, 0.250, 0.180, 11.6, 0.225, 0.261, 0.222, 0.255, 0.312),
    (1, 2, 88, 80): (0.870, 5.31, 1.22, 0.843, 7.36, 1.10, 1.23, 1.10, 1.20, 1.47),
    (1, 2, 5, 35): (2.32, 0.184, 0.258, 2.42, 17.0, 0.382, 0.455, 0.381, 0.255, 0.312),
    (1, 2, 5, 80): (5.01, 0.855, 1.20, 5.23, 14.9, 1.80, 2.10, 1.79, 1.20, 1.47),
}
LISTED_METHODS = ("opposed", "quadrature", "four_point", "single_reading", "maximum", "bias_and_scale", "triad")
#: positions of the accelerometer; by default those of the method, but some methods need more positions to determine the level
LEVELLING = {"opposed": X4, "quadrature": X4, "single_reading": X4, "four_point": X4, "maximum": None, "bias_and_scale": X4, "triad": X4}


def draws(method, attitude, latitude, runs, seed):
    """Azimuth errors of a closed form, from the root nearest to the truth, with a separately measured level."""
    rows = METHODS[method]
    gyro_at, level_rows = at(rows), METHODS["maximum"] if method == "maximum" else X4
    level_at, by = at(level_rows), "least_squares_x" if method == "maximum" else "four_point_x"
    attitude = jnp.asarray(attitude)

    def one(key):
        first, second = jax.random.split(key)
        flat = level(simulate(level_at, attitude, latitude, accel=Sensor(white=VRW), seed=first), method=by, hint=attitude[0])
        readings = simulate(gyro_at, attitude, latitude, gyro=Sensor(white=ARW), seed=second)
        found = azimuth(readings, jnp.stack([flat.phi, flat.theta]), latitude, method=method, hint=attitude[2])
        # the listed figures include clipped draws: if no root is real, the nearest angle counts
        return found.psi, found.answered

    return jax.vmap(one)(jax.random.split(jax.random.key(seed), runs))


def methods(runs):
    """Print the method comparison of alignment.md, section 8."""
    print(
        f"\nstandard deviation of the azimuth in degrees, 240 s in all, {runs} draws; listed value, ours, ratio; draws without a root in %"
    )
    off = []
    for case, listed in LISTED.items():
        attitude, lat = np.array(case[:3]) * DEG, case[3] * DEG
        cells = []
        for method, expected in zip(LISTED_METHODS, listed, strict=False):
            psi, good = map(np.asarray, draws(method, attitude, lat, runs, 5))
            rms = np.sqrt(np.mean(apart(np.asarray(psi)[good], attitude[2]) ** 2)) / DEG
            cells.append(
                f"{method} {expected:g} {rms:.3g} ({rms / expected:.2f}{'' if good.all() else f', {100 * (1 - good.mean()):.0f} %'})"
            )
            if expected < 1.5:
                off.append(rms / expected)
        bounds = []
        for rows, options, expected in zip(
            (X4[:3], X4, [*X4, ("z", 0), ("-z", 0)]),
            ({"s_a": 1e-4}, {"s_a": 1e-4, "s_g": 1e-4}, None), listed[7:], strict=True,
        ):  # fmt: skip
            bound = crlb(at(rows), attitude, lat, accel_noise=VRW, gyro_noise=ARW, free=SEVEN, priors=options).azimuth_std / DEG
            bounds.append(f"{expected:g} {bound:.4g}")
            off.append(bound / expected)
        print(f"{case}: " + "; ".join(cells) + "; J3 J4 J6 " + ", ".join(bounds))
    print(f"ratio to the listed value where that is below 1.5 degrees: {min(off):.3f} to {max(off):.3f}")


def plans(_):
    """Compare `plan` with the listed optima."""
    print("\nazimuth bound in degrees, 240 s, tactical gyro, latitude 35: plan, listed optimum, uniform four, gain")
    for case in vectors()["design"]:
        begin = time.perf_counter()
        found = plan(
            240.0, case["latitude_deg"] * DEG, attitude=np.array(case["attitude_deg"]) * DEG, accel_noise=VRW, gyro_noise=ARW,
            free=SEVEN, priors={"s_a": 1e-4, "s_g": case["gyro_scale_prior"]},
        )  # fmt: skip
        print(f"{case['attitude_deg']} prior {case['gyro_scale_prior']:g}: {found.criterion / DEG:.6f}, {case['optimum_sigma_deg']:.6f}, "
              f"{case['uniform_sigma_deg']:.6f}, {case['uniform_sigma_deg'] / found.criterion * DEG:.4f}; "
              f"{time.perf_counter() - begin:.1f} s")  # fmt: skip


def speed(_):
    """Time 10,000 simulated alignments under vmap."""
    attitude, latitude = jnp.asarray(np.array([50.0, 30.0, 88.0]) * DEG), 35 * DEG
    places = at([*X4, ("z", 0), ("-z", 0)])
    noise = {"accel": Sensor(white=VRW), "gyro": Sensor(white=ARW)}
    keys = jax.random.split(jax.random.key(0), 10_000)

    def closed(key):
        readings = simulate(places, attitude, latitude, **noise, seed=key)
        flat = level(readings)
        return azimuth(readings, flat, latitude).psi

    def joint(key):
        return fit(simulate(places, attitude, latitude, **noise, seed=key), latitude, free=SEVEN).estimate.values[2]

    print("\n10,000 simulated alignments under vmap")
    for name, one in (("four_point_x and four_point", closed), ("joint fit of 7 parameters, 12 readings", joint)):
        run = jax.jit(jax.vmap(one))
        begin = time.perf_counter()
        run(keys).block_until_ready()
        first = time.perf_counter() - begin
        times, processor = [], []
        for _ in range(5):
            begin, busy = time.perf_counter(), time.process_time()
            psi = run(keys).block_until_ready()
            times.append(time.perf_counter() - begin)
            processor.append(time.process_time() - busy)
        spread = np.sqrt(np.mean(apart(psi, attitude[2]) ** 2)) / DEG
        print(
            f"{name}: {min(times):.2f} s, {min(processor):.2f} s of processor time (first call "
            f"with compilation {first:.1f} s); rmse {spread:.4f} degrees"
        )


PARTS = {"accuracy": accuracy, "efficiency": efficiency, "methods": methods, "plan": plans, "speed": speed}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=PARTS)
    parser.add_argument("--runs", type=int, default=2000)
    options = parser.parse_args()
    for name, part in PARTS.items():
        if options.only in (None, name):
            part(options.runs)
