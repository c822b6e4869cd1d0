"""Coverage and efficiency of north finding on tests not made by its own simulator (tests/alignment/world.py), with fixed seeds.

    python benchmarks/north.py                     everything: nine cells of 400 tests each, raw logs of 100 tests each
    python benchmarks/north.py --only raw          one part: cells, raw
    python benchmarks/north.py --runs 2000         more tests per cell

cells: coverage in % of the 95 % intervals of roll, pitch and azimuth, and rmse of the azimuth over the bound for that noise.
raw: rms difference, in standard deviations, between the results from raw logs and from ideal means over the same rests, with the same
knowledge of the table's angles; and coverage.
"""

import argparse
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
            places, given = Positions(angle, dwell=dwell, start=start), noises(kind)
            bound = crlb(places, ATTITUDE, world.LATITUDE, **given).azimuth_std
            for known in (True, False) if kind == "white" else (True,):
                begin, inside, errors = time.perf_counter(), [], []
                for a, w in zip(accel, gyro, strict=True):
                    found = fit(Readings(places, a, w, **(given if known else {})), world.LATITUDE)
                    inside.append(held(found))
                    errors.append(found.psi - ATTITUDE[2])
                cover = " ".join(f"{100 * share:6.1f}" for share in np.mean(inside, axis=0))
                ratio = np.sqrt(np.mean(np.square(errors))) / bound
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
                found = from_log(jaxcal.Log(stamps, accel=accel, gyro=gyro), angle=angle if known else None, noise=noise)
                lost.append((np.sum(rests[:, 1] - rests[:, 0]) - np.sum(found.stop - found.start)) / 50 / len(rests))
                got = found.fit(world.LATITUDE)
                words = ("x",) if axes == 1 else ("x", "y", "fixed z")
                times = (rests[:, 1] - rests[:, 0]) / 50, rests[:, 0] / 50
                # angles from the gyroscope are as uncertain for the ideal means as for the log
                exact = np.repeat(angles * world.DEG, axes), None
                place, doubt = exact if known else (found.readings.positions.angle, found.readings.positions.angle_std)
                places = Positions(place, words * len(angles), *(np.repeat(x, axes) for x in times), angle_std=doubt)
                means = Readings(places, *(mean.ravel() for mean in ideal), **given)
                best = fit(means, world.LATITUDE, model=found.model, free=found.free, priors=found.priors or None)
                differences.append([(got.parameters[name] - best.parameters[name]) / got.std[name] for name in NAMES])
                inside.append(held(got))
            rms = " ".join(f"{x:.3f}" for x in np.sqrt(np.mean(np.square(differences), axis=0)))
            cover = " ".join(f"{100 * share:5.1f}" for share in np.mean(inside, axis=0))
            print(f"{kind:6s} {mode:30s} {rms}   {cover}   {np.abs(differences).max():.2f}   {np.mean(lost):.2f} s cut off", flush=True)


PARTS = {"cells": cells, "raw": raw}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=PARTS)
    parser.add_argument("--runs", type=int)
    options = parser.parse_args()
    for name, default in (("cells", 400), ("raw", 100)):
        if options.only in (None, name):
            PARTS[name](options.runs or default)
