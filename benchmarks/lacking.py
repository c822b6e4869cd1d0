"""What sensors and tables do beyond the models of jaxcal: intervals and verdicts, with simulators that share nothing with the package.

    python benchmarks/lacking.py                       every case, 40 runs each
    python benchmarks/lacking.py --runs 100 --first 1000 --only north "imu creep"     other seeds

A row gives the share of 95 % intervals that hold; of results that are good; of those that name the cause and are not good, or name it as
far as the readings can show it; of intervals held or named; and how many results that are good and name nothing are off: their largest
error is over three stated ones, and over what the largest of as many independent normal errors exceeds in 5 % (3.07 for 24 numbers). A
stated error is half of the 95 % interval over 1.96. At the end stand the cases in which less than 90 % are held or named, or more than
5 % of the good ones are off.

The recordings come from `tests/imu/world.py`, `tests/alignment/world.py` and `_hand.py`.
"""

import argparse
import pathlib
import statistics
import sys
import time

import _hand
import numpy as np

import jaxcal

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import north
from device_faults import PERMUTED, typed

from tests.alignment import world as table
from tests.imu import test_thermal, world as hand

_WELL = 0.9  # share of intervals that must be held or named


def largest(count):
    """Errors, in stated ones, above which the largest of so many counts as off."""
    return max(3.0, statistics.NormalDist().inv_cdf(0.5 + 0.95 ** (1 / max(count, 1)) / 2))


def weighed(found, errors, halves, named):
    """Errors in halves of their intervals, whether the result is good, and whether it names the cause."""
    given = np.isfinite(halves) & (halves > 0)
    return np.abs(errors[given]) / halves[given], found.verdict == "good", bool(named)


def poses(codes, clip=None, **options):
    """Sessions by hand, with effects of `world.record`; `clip` is a range of the gyroscope (deg/s) whose end the noise hides."""

    def one(run):
        stamps, accel, gyro, truth = hand.record(run, **options)
        if clip is not None:
            reach = clip * hand.DEGREE
            gyro = np.clip(gyro, -reach, reach) + hand.NOISE_GYRO * np.random.default_rng(run).normal(size=gyro.shape)
        log = jaxcal.Log(stamps, accel=accel, gyro=gyro)
        found = jaxcal.imu.multi_position(log, gravity=hand.GRAVITY, held_out=clip is not None)
        if found.verdict == "refused":
            return np.zeros(0), False, bool(codes & found.codes)
        half = np.diff(found.estimate.intervals(), axis=1)[:24, 0] / 2
        named = codes & found.codes and (found.verdict != "good" or "memory_open" in codes)
        return weighed(found, (found.estimate.values - truth)[:24], half, named)

    return one


def faces(run):
    """Six faces that are level to one degree."""
    accel, ends, truth = hand.six_faces(run)
    regions = [(f"{axis}_{kind}", *ends[2 * i + j]) for i, axis in enumerate("xyz") for j, kind in enumerate("pa")]
    found = jaxcal.imu.ferraris(jaxcal.Log(None, accel=accel, rate=hand.RATE), regions, gravity=hand.GRAVITY)
    return weighed(found, found.estimate.values - truth, np.diff(found.estimate.intervals(), axis=1)[:, 0] / 2, False)


def six_by_hand(run):
    """Six poses by hand: the refusal names the method that takes them."""
    accel = hand.six_faces(run)[0]
    found = jaxcal.imu.multi_position(jaxcal.Log(None, accel=accel, rate=hand.RATE), gravity=hand.GRAVITY)
    said = [one for one in found.findings if one.code == "few_rests"]
    return np.zeros(0), found.verdict == "good", said and "six_position" in said[0].spelt("terminal")


def axes(run, scale=1.0):
    """A gyroscope with permuted axes, or with the scale of another range."""
    turn = PERMUTED[(7 * run + 1) % 48] if scale == 1 else np.eye(3)
    log = jaxcal.Log(None, rate=100.0, **_hand.poses(run, wrong=scale * turn))
    found = jaxcal.imu.multi_position(log, gravity=_hand.GRAVITY, held_out=False)
    said = [one.facts["axes"] for one in found.findings if one.code == "gyro_axes"]
    named = "range" in found.codes if scale != 1 else said == ([] if np.array_equal(turn, np.eye(3)) else [typed(turn)])
    return np.zeros(0), found.verdict == "good" and scale == 1 and not np.array_equal(turn, np.eye(3)), named


def device(codes, **options):
    """Recordings of a moving device, with effects of `_hand.recording`."""

    def one(run):
        readings, truth = _hand.recording(run, **options)
        found = jaxcal.device.fit(jaxcal.Log(None, rate=100.0, **readings), gravity=_hand.GRAVITY)
        errors, halves = [], []
        for number in found.estimate.numbers():
            field, _, place = number.name.partition("[")
            if field in ("accel.matrix", "accel.bias", "gyro.matrix", "gyro.bias") and number.state == "estimated":
                errors.append(number.value - truth[field][tuple(int(i) for i in place[:-1].split(","))])
                halves.append(number.half)
        return weighed(found, np.array(errors), np.array(halves), codes & found.codes)

    return one


def turntable(plan, name, codes=frozenset({"drift", "drift_open", "tilt", "misfit"}), **options):
    """Raw logs of a turntable, with the drifts and faults of `north.lacking`."""

    def one(run):
        found, errors = north.lacking(run, plan, name, **options)
        halves = np.array([np.nan if one.state == "open" else one.half for one in (found.estimate[key] for key in north.NAMES)])
        named = codes & found.codes and (found.verdict != "good" or codes == {"drift_order"})
        return weighed(found, np.array(errors), halves, named)

    return one


def roots(run):
    """A test without a latitude, of which two fit: both numbers are withheld, and the option that the finding names decides."""
    attitude = np.array([1.0, 2.0, np.random.default_rng(run).uniform(-180, 180)]) * table.DEG
    angle, start, dwell, accel, gyro = table.tables(np.random.default_rng(run), 1, "4 x 120 s", "white", attitude)
    places = jaxcal.alignment.Positions(angle, dwell=dwell, start=start, angle_std=0.0)
    readings = jaxcal.alignment.Readings(places, accel[0], gyro[0], **north.noises("white"))
    open_ = jaxcal.alignment.fit(readings)
    said = next((one for one in open_.findings if one.code == "undecided"), None)
    named = said is not None and open_.psi is None and open_.latitude is None and "--hemisphere" in said.spelt("terminal")
    found = jaxcal.alignment.fit(readings, hemisphere="north")
    error = (found.psi - attitude[2] + np.pi) % (2 * np.pi) - np.pi
    numbers = found.estimate["psi"], found.estimate["latitude"]
    half = np.array([one.half for one in numbers])
    return weighed(found, np.array([error, found.latitude - table.LATITUDE]), half, named)


def sessions(run):
    """Scale over temperature from three sessions: inside its intervals at five temperatures."""
    found, _, truth = test_thermal.calibrated(run)
    inside = [test_thermal.scale_inside(found, truth, t) for t in (0.0, 12.0, 25.0, 40.0, 50.0)]
    return np.where(np.ravel(inside), 0.5, 1.5), True, False


MEMORY, TURNS = {"lack_accel", "lack_memory", "memory_possible"}, {"held_out", "turns_disagree", "poor", "lack_gyro", "few_turns_left"}
CASES = {
    "imu 24 poses": poses(set()), "imu 12 poses": poses(set(), poses=12), "imu six faces level to 1 deg": faces,
    "imu creep 0.05 %, 12 poses": poses(MEMORY, creep=5e-4, poses=12),
    "imu creep 0.05 %, 12 poses, or its limit": poses({*MEMORY, "memory_open"}, creep=5e-4, poses=12),
    "imu creep 0.1 %, 12 poses": poses(MEMORY, creep=1e-3, poses=12),
    "imu creep 0.1 %": poses(MEMORY, creep=1e-3), "imu creep 0.5 %": poses(MEMORY, creep=5e-3),
    "imu hysteresis 1.2 mg": poses(MEMORY, hysteresis=1.2e-3 * hand.GRAVITY),
    "imu jump after pose 12": poses({"lack_step"}, **hand.CASES["jump"]),
    "imu gyroscope drifts 0.1 deg/s": poses(set(), **hand.CASES["gyro drift"]),
    "imu gyroscope ends at 140 deg/s": poses(TURNS, clip=140, poses=18), "imu six poses by hand": six_by_hand,
    "imu gyroscope's axes permuted": axes, "imu gyroscope's scale 0.507": lambda run: axes(run, 0.507),
    "imu at 0, 25 and 50 degC": sessions,
    "device plain": device(set()), "device accelerometer behind 5 Hz": device({"low_pass"}, poles={"accel": 5.0}),
    **{f"north {plan}, {kind}": turntable(plan, kind) for plan in north.PLACES for kind in table.DRIFTS},
    "north 4 x 120 s, step": turntable("4 x 120 s", "step", frozenset({"drift_order"})),
    **{f"north {plan}, {name}": turntable(plan, name) for plan in ("4 x 120 s", "16 in pairs x 30 s") for name in north.FAULTS},
    "north without latitude": roots,
}  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--only", nargs="*", default=[""], help="beginnings of names of cases")
    chosen, short = parser.parse_args(), []
    print("| case | held | good | named | held or named | off among good | CPU s a run |\n|---|---|---|---|---|---|---|")
    for name in [name for name in CASES if name.startswith(tuple(chosen.only))]:
        begin = time.process_time()
        ratios, good, named = zip(*(CASES[name](run) for run in range(chosen.first, chosen.first + chosen.runs)), strict=True)
        held = [np.mean(one <= 1) if len(one) else np.nan for one in ratios]
        either = np.mean([1.0 if told else np.nan_to_num(share) for share, told in zip(held, named, strict=True)])
        off = [
            bool(np.any(1.96 * one > largest(len(one)))) for one, well, told in zip(ratios, good, named, strict=True) if well and not told
        ]
        inside = f"{100 * np.nanmean(held):.0f} %" if np.isfinite(held).any() else ""
        print(f"| {name} | {inside} | {100 * np.mean(good):.0f} % | {100 * np.mean(named):.0f} % | {100 * either:.0f} % | "
              f"{sum(off)} of {len(off)} | {(time.process_time() - begin) / chosen.runs:.2f} |", flush=True)  # fmt: skip
        if either < _WELL or sum(off) > 0.05 * len(off):
            short.append((either, name))
    print("short of it:", "; ".join(f"{name} ({100 * share:.0f} %)" for share, name in sorted(short)) or "none")


if __name__ == "__main__":
    main()
