"""`jaxcal.device.fit` on recordings by hand whose truth is known: error, bound, coverage and verdict, cell by cell.

    python benchmarks/device.py                            all cells, 100 recordings each
    python benchmarks/device.py --runs 20 --seed 1000 --only free brisk
    python benchmarks/device.py --show                     the tables of what is there already
    python benchmarks/device.py --time                     seconds and memory of the first and the second call, in one process

Every recording is one line of the file --out (JSON), written as it comes. Recordings that are in the file already are not fitted again,
so that an interrupted run goes on. The bound is that of `_device_bound.py`, which knows the noise, the rests and the spectrum of the place.

The table of a cell has, for each group of parameters, the root mean square error, the root mean square bound (2 s for each recording), the
ratio of both, the error that the fit predicts, the share of 95 % intervals that hold the truth with its own interval of 95 % over
recordings, and the errors of the fits to single sensors where there are rests.
"""

import argparse
import collections
import dataclasses
import json
import pathlib
import re
import resource
import time

import _device_bound as bound
import numpy as np
import scipy.signal

import jaxcal

NOISE_ACCEL, NOISE_GYRO, RATE = 120e-6 * 9.80665, np.deg2rad(0.007), 100.0
#: AR(1) of the samples' usual deviation: coefficient 0.7, for all three sensors
_TAU = -1 / RATE / np.log(0.7)


def _ar1(deviation):
    return jaxcal.noise.Noise(markov=((deviation * np.sqrt(2 / _TAU), _TAU),))


@dataclasses.dataclass(frozen=True)
class Cell:
    """Options of `simulate`, what the bound knows (None: no bound), options of `fit`, and flicker (accel, gyro) that is added.

    `clocks` keeps every n-th reading of each sensor, so that each has stamps of its own; `simulate` has the rate before.
    `drift` is by how much the gyroscope's bias changes along the recording, in a random direction, rad/s.
    `wander` are Gauss-Markov errors that are added: sensor -> (deviation, s), of the magnetometer as a part of the field.
    """

    motion: dict
    known: bound.Setting | None = None
    options: dict = dataclasses.field(default_factory=dict)
    flicker: tuple | None = None
    drift: float = 0.0
    wander: dict = dataclasses.field(default_factory=dict)
    clocks: dict = dataclasses.field(default_factory=dict)


#: 100, 87.5 and 46.7 Hz, from readings at 700 Hz; every n-th reading of white noise has n times its power density
_CLOCKS = {"gyro": 7, "accel": 8, "mag": 15}
_FINE = {"rate": 700.0, "noise": {"accel": NOISE_ACCEL / np.sqrt(8), "gyro": NOISE_GYRO / np.sqrt(7)}}
_COLOURED = {"noise": {"accel": _ar1(NOISE_ACCEL * 10), "gyro": _ar1(NOISE_GYRO * 10), "mag": _ar1(0.005 * 50e-6)}}
#: m/s^2 and rad/s: flicker of the biases, which the fit is told
_FLICKER = (50e-6 * 9.80665, np.deg2rad(10 / 3600))
_TOLD = {"noise": {"accel": {"N": NOISE_ACCEL, "B": _FLICKER[0]}, "gyro": {"N": NOISE_GYRO, "B": _FLICKER[1]}}}
_DAY = 86400.0  # s, within which the bias is the mean of the flicker
#: as sensors without temperature control and rooms with iron have them
_REAL = {"accel": (1e-3 * 9.80665, 2.0), "gyro": (np.deg2rad(0.02), 1.0), "mag": (0.005, 5.0)}
CELLS = {
    "free": Cell({}, bound.Setting()),
    "brisk": Cell({"swing": 2.0}, bound.Setting()),
    "24 rests": Cell({"rests": 24, "initial": 10.0, "still": 4.0}, bound.Setting()),
    "8 rests": Cell({"rests": 8}, bound.Setting()),
    "8 rests in the hand": Cell({"rests": 8, "held": True}),
    "arm 0.15 m": Cell({"arm": (0.1, -0.1, 0.05), "reach": 0.1}, bound.Setting(reach=0.1)),
    "AR(1)": Cell(_COLOURED),
    "AR(1), 8 rests": Cell(_COLOURED | {"rests": 8}),
    "wandering errors": Cell({}, wander=_REAL),
    "wandering errors, 8 rests": Cell({"rests": 8}, wander=_REAL),
    "clocks of their own": Cell(_FINE, clocks=_CLOCKS),
    "clocks of their own, brisk": Cell(_FINE | {"swing": 2.0}, clocks=_CLOCKS),
    "clocks of their own, 8 rests": Cell(_FINE | {"rests": 8}, clocks=_CLOCKS),
    "flicker": Cell({}, options=_TOLD, flicker=_FLICKER),
    "flicker, 8 rests": Cell({"rests": 8}, options=_TOLD, flicker=_FLICKER),
    "drift of 60 deg/h, 8 rests": Cell({"rests": 8}, drift=np.deg2rad(60 / 3600)),
    "gradient 10 %/m": Cell({"gradient": 0.1}),
    "gradient 30 %/m": Cell({"gradient": 0.3}),
    "iron for 15 s": Cell({"iron": (60.0, 75.0, 0.3)}),
    "reach 1.5 m": Cell({"reach": 1.5}),
    "8 rests, lever and g-sensitivity": Cell({"rests": 8}, options={"lever": True, "g_sensitivity": True}),
    "one axis": Cell({"turns": "one axis"}),
    "no tilt": Cell({"turns": "no tilt"}),
}
#: group -> its places in `bound.parameters`, the factor to the unit, and the unit
_DIAGONAL, _REST = [0, 3, 5], [1, 2, 4]
GROUPS = {
    "accel scale": (_DIAGONAL, 100, "%"), "accel misalignment": (_REST, 180 / np.pi, "deg"),
    "accel bias": (range(6, 9), 1e3 / 9.80665, "mg"),
    "gyro scale": ([9, 13, 17], 100, "%"), "gyro rotation": ([10, 11, 12, 14, 15, 16], 180 / np.pi, "deg"),
    "gyro bias": (range(18, 21), 3600 * 180 / np.pi, "deg/h"), "soft iron": ([21, 25, 29], 100, "%"),
    "iron and rotation": ([22, 23, 24, 26, 27, 28], 180 / np.pi, "deg"), "hard iron": (range(30, 33), 100 / 50e-6, "% of 50 uT"),
    "dip": ([33], 180 / np.pi, "deg"), "gyro delay": ([34], 1e3, "ms"), "mag delay": ([35], 1e3, "ms"),
}  # fmt: skip


def of_fit(found):
    """(37,) values and (37, 2) intervals in the order of `bound.parameters`, NaN for what has no number."""
    square = [(i, j) for i in range(3) for j in range(3)]
    names = [
        *(f"accel.matrix[{i},{j}]" for i, j in bound.UPPER), *(f"accel.bias[{i}]" for i in range(3)),
        *(f"gyro.matrix[{i},{j}]" for i, j in square), *(f"gyro.bias[{i}]" for i in range(3)),
        *(f"magnetometer.soft_iron[{i},{j}]" for i, j in square), *(f"magnetometer.hard_iron[{i}]" for i in range(3)),
        "dip", "gyro_delay", "mag_delay", "field",
    ]  # fmt: skip
    numbers = [found.estimate[name] for name in names]
    return np.array([one.value for one in numbers]), np.array([(one.low, one.high) for one in numbers])


def run(cell, seed):
    """The line of one recording."""
    log, model, true = jaxcal.device.simulate(seed=seed, **cell.motion)
    truth, line = bound.parameters(model), {}
    if cell.flicker:
        log = _with_flicker(log, cell.flicker, seed)
    if cell.drift:
        way = np.random.default_rng([seed, 32]).normal(size=3)
        ramp = np.linspace(-0.5, 0.5, len(log.time))[:, None] * cell.drift * way / np.linalg.norm(way)
        log = jaxcal.Log(None, accel=log.accel, gyro=log.gyro + ramp, mag=log.mag, rate=log.rate)
    if cell.wander:
        log = _with_wander(log, cell.wander, float(model.field), seed)
    if cell.clocks:
        log = _with_clocks(log, cell.clocks)
    start = time.perf_counter()
    try:
        found = jaxcal.device.fit(log, **cell.options)
    except jaxcal.JaxcalError as error:
        line |= {"verdict": "error", "reason": str(error)}
    else:
        values, interval = of_fit(found)
        unknown = [name for name, state in found.estimate.states.items() if state == "open"]
        line |= {"error": values - truth, "inside": _inside(truth, interval), "width": (interval[:, 1] - interval[:, 0]) / 2,
                 "verdict": found.verdict, "reason": found.reason, "unknown": unknown, "disturbed": list(found.disturbed),
                 "warnings": list(found.warnings)}  # fmt: skip
    line["seconds"] = time.perf_counter() - start
    if cell.known is not None:
        line["bound"] = np.sqrt(np.diag(bound.covariance_of(bound.information(true, model, cell.known), model)))
    if cell.motion.get("rests") and not cell.clocks:
        line |= _single(log, truth)
    return line


def _with_flicker(log, sizes, seed):
    """The log with flicker of the density B^2 / (2 pi f) between one cycle a day and half the rate, as lines with random phases."""
    rng = np.random.default_rng([seed, 30])
    edges = np.geomspace(1 / _DAY, log.rate / 2, 301)
    middle, width = np.sqrt(edges[1:] * edges[:-1]), np.diff(edges)
    angle = 2 * np.pi * np.asarray(log.time)[:, None] * middle
    waves = np.concatenate([np.cos(angle), np.sin(angle)], axis=1) * np.sqrt(np.tile(2 * width / (2 * np.pi * middle), 2))
    added = [size * waves @ rng.normal(size=(600, 3)) for size in sizes]
    return jaxcal.Log(None, accel=log.accel + added[0], gyro=log.gyro + added[1], mag=log.mag, rate=log.rate)


def _with_wander(log, sizes, field, seed):
    """The log with Gauss-Markov errors of each axis."""
    rng, readings = np.random.default_rng([seed, 31]), {}
    for sensor, (size, seconds) in sizes.items():
        keep = np.exp(-1 / (log.rate * seconds))
        steps = rng.normal(size=(len(log.time), 3))
        steps[0] /= np.sqrt(1 - keep**2)
        error = size * np.sqrt(1 - keep**2) * scipy.signal.lfilter([1.0], [1.0, -keep], steps, axis=0)
        readings[sensor] = getattr(log, sensor) + error * (field if sensor == "mag" else 1.0)
    return jaxcal.Log(None, **readings, rate=log.rate)


def _with_clocks(log, every):
    """The log with every n-th reading of each sensor, with the gyroscope's stamps and those of the others."""
    readings = {name: getattr(log, name)[::n] for name, n in every.items()}
    stamps = {name: log.time[::n] for name, n in every.items()}
    return jaxcal.Log(stamps.pop("gyro"), **readings, own_time=stamps)


def _inside(truth, interval):
    return [None if not np.isfinite(low) else bool(low <= value <= high) for value, (low, high) in zip(truth, interval, strict=True)]


def _single(log, truth):
    """Errors of the fits to single sensors, one after the other as a user would call them, in the same places; NaN where they have none.

    The frame is that of `device.fit`: `multi_position` makes the accelerometer's matrix upper triangular too, and the magnetometer gets its
    rotation from the rates that `multi_position` corrects.
    """
    error = np.full(37, np.nan)
    alone = jaxcal.imu.multi_position(log, gravity=9.80665)
    if alone.accel is not None:
        matrix = np.asarray(alone.accel.matrix)
        error[:6] = [matrix[i] for i in bound.UPPER] - truth[:6]
        error[6:9] = alone.accel.bias - truth[6:9]
    aid = None
    if alone.gyro is not None:
        error[9:18] = np.ravel(alone.gyro.matrix) - truth[9:18]
        error[18:21] = alone.gyro.bias - truth[18:21]
        force = None if alone.accel is None else alone.accel.correct(log.accel)
        aid = jaxcal.magnetometer.Gyroscope(np.asarray(alone.gyro.correct(log.gyro, force)), log.rate)
    found = jaxcal.magnetometer.fit(log.mag, aid=aid)
    if found.model is not None:
        error[30:33] = np.asarray(found.model.hard_iron) - truth[30:33]
        if aid is not None:
            iron = np.asarray(found.model.soft_iron)
            error[21:30] = np.ravel(iron / np.cbrt(np.linalg.det(iron))) - truth[21:30]
    return {"single": error, "alone": f"imu {alone.verdict}, magnetometer {found.verdict}"}


def _plain(value):
    if isinstance(value, np.ndarray):
        return [float(f"{x:.6g}") if np.isfinite(x) else None for x in value]
    return value


def _lines(path):
    found = collections.defaultdict(dict)
    if path.exists():
        for text in path.read_text().splitlines():
            line = json.loads(text)
            found[line["cell"]][line["seed"]] = line
    return found


def _column(lines, name):
    return np.array([[np.nan if x is None else float(x) for x in line[name]] for line in lines if name in line])


def show(path):
    """Print the tables."""
    found = _lines(path)
    for name, _cell in CELLS.items():
        lines = list(found.get(name, {}).values())
        if not lines:
            continue
        verdicts = collections.Counter(line["verdict"] for line in lines)
        seconds = np.median([line["seconds"] for line in lines])
        print(f"\n## {name}: {len(lines)} recordings, {dict(verdicts)}, {seconds:.1f} s each")
        for (verdict, reason), count in collections.Counter(
            (line["verdict"], line["reason"].split(". ")[0][:150]) for line in lines if line["verdict"] != "good"
        ).most_common(3):
            print(f"  {count} x {verdict}: {reason}")
        told = collections.Counter(
            " ".join(re.sub(r"[-+.\d]+", "#", word).split()[:9]) for line in lines for word in line.get("warnings", ())
        )
        for word, count in told.most_common(4):
            print(f"  {count} warnings: {word} ...")
        named = [sum(stop - start for start, stop in line["disturbed"]) for line in lines if "disturbed" in line]
        if any(named):
            print(f"  named as disturbed: {np.mean(named):.1f} s on average")
        unknown = collections.Counter(word for line in lines for word in line.get("unknown", ()))
        if unknown:
            print("  without number: " + ", ".join(f"{word} ({count})" for word, count in unknown.most_common()))
        alone = collections.Counter(line["alone"] for line in lines if "alone" in line)
        if alone:
            print("  single sensors: " + "; ".join(f"{word} ({count})" for word, count in alone.items()))
        error, inside, limit, single = (_column(lines, word) for word in ("error", "inside", "bound", "single"))
        if not len(error):
            continue
        print("| | rmse | bound | ratio | predicted | coverage, % | single sensors |\n|---|---|---|---|---|---|---|")
        for group, (places, factor, unit) in GROUPS.items():
            at = list(places)
            rmse = factor * np.sqrt(np.nanmean(error[:, at] ** 2)) if np.isfinite(error[:, at]).any() else np.nan
            held = inside[:, at][np.isfinite(inside[:, at]).all(axis=1)].mean(axis=1)
            cover = f"{100 * held.mean():.1f} +- {100 * 1.96 * held.std() / np.sqrt(len(held)):.1f}" if len(held) else "-"
            width = factor * np.sqrt(np.nanmean(_column(lines, "width")[:, at] ** 2)) / 1.96 if len(held) else np.nan
            low = factor * np.sqrt(np.mean(limit[:, at] ** 2)) if len(limit) else np.nan
            alone = factor * np.sqrt(np.nanmean(single[:, at] ** 2)) if len(single) and np.isfinite(single[:, at]).any() else np.nan
            cells = [rmse, low, rmse / low, width]
            shown = [f"{x:.3g}" if np.isfinite(x) else "-" for x in cells]
            print(f"| {group}, {unit} | {' | '.join(shown)} | {cover} | {alone:.3g} |".replace("nan", "-"))


def clock():
    """Seconds and memory of the first and the second call."""
    for seed in (1, 2):
        log = jaxcal.device.simulate(seed=seed)[0]
        before = resource.getrusage(resource.RUSAGE_SELF)
        start = time.perf_counter()
        jaxcal.device.fit(log)
        after = resource.getrusage(resource.RUSAGE_SELF)
        used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        print(
            f"call {seed}: {time.perf_counter() - start:.1f} s, {used:.1f} s of the processor, peak {after.ru_maxrss / 1e6:.2f} GB",
            flush=True,
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0, help="of the first recording")
    parser.add_argument("--only", nargs="*", default=list(CELLS), choices=list(CELLS), metavar="CELL")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("device.jsonl"))
    parser.add_argument("--show", action="store_true")
    parser.add_argument("--time", action="store_true")
    chosen = parser.parse_args()
    if chosen.time:
        return clock()
    if not chosen.show:
        done = _lines(chosen.out)
        # recording by recording through all cells, so that a run that is cut has some of each
        for seed in range(chosen.seed, chosen.seed + chosen.runs):
            for name in chosen.only:
                if seed not in done[name]:
                    line = run(CELLS[name], seed)
                    text = json.dumps({"cell": name, "seed": seed} | {key: _plain(value) for key, value in line.items()})
                    with chosen.out.open("a") as file:
                        file.write(text + "\n")
    return show(chosen.out)


if __name__ == "__main__":
    main()
