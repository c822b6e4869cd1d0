"""Coverage and efficiency of north finding on tests not made by its own simulator (tests/alignment/world.py), with fixed seeds.

    python benchmarks/north.py                     everything: nine cells of 400 tests each, raw logs of 100 tests each
    python benchmarks/north.py --only raw          one part: cells, raw, lacks
    python benchmarks/north.py --runs 2000         more tests per cell

cells: coverage in % of the 95 % intervals of roll, pitch and azimuth, and rmse of the azimuth over the bound for that noise.
raw: rms difference, in standard deviations, between the results from raw logs and from ideal means over the same rests, with the same
knowledge of the table's angles; and coverage.
lacks: raw logs with what the model lacks: drifts of the gyro (0.4 deg/h over the test, a step of 0.3 deg/h), a tilting base, errors of
the table's angles. The table alone has no readings inside the rests. Columns, in %: azimuth given; roll, pitch, azimuth held or withheld;
named and not good; good; roll, pitch, azimuth held or named, and all three at once. Then how many of the good ones are off by more than
three stated errors, in any number and in the azimuth; the rmse of the azimuths given over the bound without a drift; half of the interval
of the azimuth over that of the bound, and of roll and pitch in arcsec.
"""

import argparse
import dataclasses
import pathlib
import sys
import time

import numpy as np

import jaxcal
from jaxcal.alignment import Positions, Readings, crlb, fit, from_log
from jaxcal.noise import Noise

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "tests" / "alignment"))
import world

ATTITUDE = np.array([1.0, 2.0, 40.0]) * world.DEG
NAMES = ("phi", "theta", "psi")


def noises(kind):
    pairs = (("accel", world.ACCEL), ("gyro", world.GYRO))
    return {f"{name}_noise": Noise(**dict(zip("NBK", c * world.NOISES[kind], strict=True))) for name, c in pairs}


def held(found):
    return [found.estimate[name].low <= truth <= found.estimate[name].high for name, truth in zip(NAMES, ATTITUDE, strict=True)]


def cells(runs):
    print(f"{'cell':32s} noise      cover: roll, pitch, azimuth   azimuth rmse / bound ({runs} tests: +- {1 / np.sqrt(2 * runs):.3f})")
    for plan in world.PLANS:
        for kind in world.NOISES:
            angle, start, dwell, accel, gyro = world.tables(np.random.default_rng(5), runs, plan, kind, ATTITUDE)
            places, given = Positions(angle, dwell=dwell, start=start, angle_std=0.0), noises(kind)
            bound = crlb(places, ATTITUDE, world.LATITUDE, **given).azimuth_std
            for known in (True, False) if kind == "white" else (True,):
                begin, inside, errors = time.perf_counter(), [], []
                for a, w in zip(accel, gyro, strict=True):
                    found = fit(Readings(places, a, w, **(given if known else {})), world.LATITUDE)
                    inside.append(held(found))
                    errors.append(np.nan if found.psi is None else found.psi - ATTITUDE[2])
                cover = " ".join(f"{100 * share:6.1f}" for share in np.mean(inside, axis=0))
                ratio = np.sqrt(np.nanmean(np.square(errors))) / bound
                print(
                    f"{plan + ', ' + kind:32s} {'given' if known else 'not given':9s}  {cover}           {ratio:.3f} "
                    f"(bound {np.rad2deg(bound):.4f} deg; {1e3 * (time.perf_counter() - begin) / runs:.0f} ms)",
                    flush=True,
                )


def raw(runs):
    print(f"raw logs, {runs} tests each: difference from ideal means in standard deviations, rms: roll, pitch, azimuth; cover; largest")
    modes = {"1 axis, angle column": (1, True), "3 axes, angle column": (3, True), "3 axes, angles from the gyro": (3, False)}
    for kind in ("white", "N+B+K"):
        for mode, (axes, known) in modes.items():
            given, differences, inside, lost = noises(kind), [], [], []
            for run in range(runs):
                rng = np.random.default_rng([run, 9])
                angles = np.array([0, 90, 180, 270, 270, 180, 90, 0][: 4 if run % 2 else 8])
                dwells = rng.uniform(60, 150, len(angles))
                stamps, angle, accel, gyro, rests, ideal = world.recording(rng, angles, dwells, kind, ATTITUDE, axes=axes)
                noise = {name.removesuffix("_noise"): one for name, one in given.items()}
                found = from_log(jaxcal.Log(stamps, accel=accel, gyro=gyro), angle=angle if known else None, noise=noise, angle_std=0.0)
                lost.append((np.sum(rests[:, 1] - rests[:, 0]) - np.sum(found.stop - found.start)) / 50 / len(rests))
                got = found.fit(world.LATITUDE)
                words = ("x",) if axes == 1 else ("x", "y", "fixed z")
                times = (rests[:, 1] - rests[:, 0]) / 50, rests[:, 0] / 50
                # angles from the gyroscope are as uncertain for the ideal means as for the log
                exact = np.repeat(angles * world.DEG, axes), 0.0
                place, doubt = exact if known else (found.readings.positions.angle, found.readings.positions.angle_std)
                places = Positions(place, words * len(angles), *(np.repeat(x, axes) for x in times), angle_std=doubt)
                means = Readings(places, *(mean.ravel() for mean in ideal), **given)
                best = fit(means, world.LATITUDE, model=found.model, free=found.free, priors=found.priors or None)
                differences.append([(got.parameters[name] - best.parameters[name]) / got.std[name] for name in NAMES])
                inside.append(held(got))
            rms = " ".join(f"{x:.3f}" for x in np.sqrt(np.mean(np.square(differences), axis=0)))
            cover = " ".join(f"{100 * share:5.1f}" for share in np.mean(inside, axis=0))
            print(f"{kind:6s} {mode:30s} {rms}   {cover}   {np.abs(differences).max():.2f}   {np.mean(lost):.2f} s cut off", flush=True)


PLACES = {name: world.PLANS[name] for name in ("4 x 120 s", "8 mirrored x 60 s")} | {"16 in pairs x 30 s": world.PAIRS}
FAULTS = {"tilt 41 arcsec": {"tilt": 41 / 3600 * world.DEG}} | {
    f"angles off by {size} deg{', at each alike' * repeats}": {"encoder": size * world.DEG, "repeats": repeats}
    for repeats in (False, True) for size in (0.05, 0.1)
}  # fmt: skip


def lacking(run, plan, name, known=True, inside=True, exact=False, axes=1):
    """Result of a raw log with a drift or a fault, and the error of roll, pitch and azimuth; `exact` says that the angles are."""
    rng = np.random.default_rng([run, 31])
    attitude = np.array([1.0, 2.0, rng.uniform(-180, 180)]) * world.DEG
    angles, dwell = PLACES[plan]
    options = {"rate": 10.0, "axes": axes, "drift": world.DRIFTS.get(name), **FAULTS.get(name, {})}
    stamps, angle, accel, gyro, _, _ = world.recording(rng, angles, [dwell] * len(angles), "white", attitude, **options)
    noise = {key.removesuffix("_noise"): one for key, one in noises("white").items()} if known else None
    made = from_log(jaxcal.Log(stamps, accel=accel, gyro=gyro), angle=angle, noise=noise, angle_std=0.0 if exact else None)
    made = made if inside else dataclasses.replace(made, readings=dataclasses.replace(made.readings, parts=None))
    found = made.fit(world.LATITUDE)
    numbers = [found.estimate[one] for one in NAMES]
    return found, [abs((one.value - true + np.pi) % (2 * np.pi) - np.pi) for one, true in zip(numbers, attitude, strict=True)]


def lacks(runs):
    print(f"{runs} raw logs each, white noise; the docstring names the columns")
    cases = [(plan, kind, {}) for plan in PLACES for kind in world.DRIFTS]
    cases += [(plan, "none", {"exact": True}) for plan in PLACES]
    cases += [("4 x 120 s", kind, {"inside": False}) for kind in ("none", "linear", "exponential", "step")]
    cases += [("4 x 120 s", kind, {"known": False}) for kind in ("none", "linear")]
    cases += [("4 x 120 s", name, {"known": known}) for name in FAULTS if "alike" not in name for known in (True, False)]
    cases += [(plan, name, {}) for plan in ("8 mirrored x 60 s", "16 in pairs x 30 s") for name in FAULTS]
    cases += [("4 x 120 s", name, {"axes": 3}) for name in ("none", "angles off by 0.05 deg", "angles off by 0.1 deg")]
    both = ("none", "angles off by 0.1 deg", "angles off by 0.1 deg, at each alike")
    cases += [(plan, name, {"known": False}) for plan in ("8 mirrored x 60 s", "16 in pairs x 30 s") for name in both]
    bound = world.GYRO[0] * np.sqrt(2 / 480.0) / (world.EARTH * np.cos(world.LATITUDE))
    for plan, name, options in cases:
        given, held, off, half, named, good, bad = [], [], [], [], [], [], []
        for run in range(runs):
            found, errors = lacking(run, plan, name, **options)
            numbers = [found.estimate[one] for one in NAMES]
            given.append(numbers[2].state != "open")
            held.append([one.state == "open" or error <= one.half for one, error in zip(numbers, errors, strict=True)])
            off.append(errors[2])
            half.append([one.half for one in numbers])
            named.append(found.verdict != "good" and bool({"drift", "drift_open", "tilt", "misfit"} & found.codes))
            good.append(found.verdict == "good")
            bad.append([one.state != "open" and error > 3 * one.half / 1.96 for one, error in zip(numbers, errors, strict=True)])
        held, named, level = np.array(held), np.array(named), np.rad2deg(np.nanmedian(half, axis=0))
        rmse = np.sqrt(np.mean(np.square(np.array(off)[given]))) / bound if any(given) else np.nan
        either, bad = held | named[:, None], np.array(bad)[good]
        share = [", ".join(f"{100 * x:.0f}" for x in np.mean(one, axis=0)) for one in (held, either)]
        said = "".join(f", {key} {value}" for key, value in options.items() if (key, value) != ("known", True))
        wide = level[2] / np.rad2deg(1.96 * bound)
        good_ones = f"{np.sum(np.any(bad, axis=1))}, {np.sum(bad[:, 2])} of {len(bad)}"
        all_three, azimuth = 100 * np.mean(np.all(either, axis=1)), 100 * np.mean(given)
        print(f"| {plan}, {name}{said} | {azimuth:.0f} | {share[0]} | {100 * np.mean(named):.0f} | {100 * np.mean(good):.0f} | "
              f"{share[1]}; {all_three:.0f} | {good_ones} | {rmse:.2f} | {wide:.2f}; {3600 * level[0]:.1f}, {3600 * level[1]:.1f} |",
              flush=True)  # fmt: skip


PARTS = {"cells": cells, "raw": raw, "lacks": lacks}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=PARTS)
    parser.add_argument("--runs", type=int)
    options = parser.parse_args()
    for name, default in (("cells", 400), ("raw", 100), ("lacks", 100)):
        if options.only in (None, name):
            PARTS[name](options.runs or default)
