"""Other tools beside jaxcal on the same simulated records: the tables of docs/comparison.md.

    python benchmarks/compare_peers.py                     print the tables (about three minutes)
    python benchmarks/compare_peers.py --write             put them into the page
    python benchmarks/compare_peers.py --peers PYTHON      interpreter with allantools, imucal and magyc (default: this one);
                                                           python -m venv peers && peers/bin/pip install allantools imucal magyc

Programs that the registry has are run: "run" in the tables. Of the others, the published rule is written here again: "rule". Each tool gets
the records of all runs at once, in a process of its own. Truth and noise come from NumPy alone.
"""

import argparse
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

PAGE = pathlib.Path(__file__).resolve().parents[1] / "docs" / "comparison.md"
GRAVITY, RATE = 9.81, 100.0
#: rad/sqrt(s), rad/s, rad/s/sqrt(s) of an hour in which B and K both show
TRUE = {"N": 0.03, "B": 0.004, "K": 0.0003}
HOUR = 360_000
NOTHING = "\N{EN DASH}"
TAUS = np.geomspace(0.1, 1000.0, 60)


# --- each runs one tool, on arrays of all runs


def allan_curves(records):
    """Overlapping Allan deviations by allantools, one row for each record."""
    import allantools

    return np.array([allantools.oadev(y, RATE, "freq", TAUS)[1] for y in records["y"]])


def magnitudes_magyc(records, name):
    """Hard iron and the matrix that corrects, by a function of magyc that takes the readings alone."""
    import magyc

    found = []
    for m in records["m"]:
        answer = magyc.twostep_hsi(m, np.array([1.0, 0.0, 0.0])) if name == "twostep_hsi" else getattr(magyc, name)(m)
        found.append(np.column_stack([answer[0], np.linalg.inv(answer[1])]))
    return np.array(found)


def gyro_magyc(records, name):
    """The same, from readings and rates."""
    import magyc

    time = np.arange(records["m"].shape[1]) / 50.0
    found = [getattr(magyc, name)(m, gyro, time)[:2] for m, gyro in zip(records["m"], records["gyro"], strict=True)]
    return np.array([np.column_stack([hard, np.linalg.inv(soft)]) for hard, soft in found])


def session_imucal(records):
    """Corrected true vectors of the test, by imucal's Ferraris calibration."""
    from imucal import FerrarisCalibration, FerrarisSignalRegions

    found = []
    for accel, gyro, seen_accel, seen_gyro in zip(*(records[x] for x in ("accel", "gyro", "seen_accel", "seen_gyro")), strict=True):
        parts = {f"acc_{label}": accel[part] for label, part in regions().items()}
        parts |= {f"gyr_{label}": np.rad2deg(gyro[part]) for label, part in regions().items()}
        known = FerrarisCalibration(grav=GRAVITY, expected_angle=360.0)
        known = known.compute(FerrarisSignalRegions(**{x: parts[x] for x in FerrarisSignalRegions._fields}), RATE, "m/s^2", "deg/s")
        a, w = known.calibrate(seen_accel, np.rad2deg(seen_gyro), "m/s^2", "deg/s")
        found.append(np.stack([a, np.deg2rad(w)]))
    return np.array(found)


PEERS = {"allan_curves": allan_curves, "magnitudes_magyc": magnitudes_magyc, "gyro_magyc": gyro_magyc, "session_imucal": session_imucal}


def asked(python, function, records, *options):
    """What a function of this file finds in another interpreter; None if it fails there, with the last line of the error."""
    with tempfile.TemporaryDirectory() as folder:
        place = pathlib.Path(folder)
        np.savez(place / "in.npz", **records)
        command = [python, __file__, "--run", function, *options, "--folder", folder]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            print(f"{function} {' '.join(options)}: {done.stderr.strip().splitlines()[-1]}", file=sys.stderr)
            return None
        return np.load(place / "out.npy")


# --- noise


def flicker(count, rng):
    """Noise of the two-sided density 1/(2 pi f) per sample, by filtering white noise in the frequency domain of twice the length."""
    spectrum = np.fft.rfft(rng.normal(size=2 * count))
    f = np.fft.rfftfreq(2 * count, 1 / RATE)
    spectrum[1:] *= np.sqrt(RATE / (2 * np.pi * f[1:]) * (np.pi * f[1:] / RATE) / np.sin(np.pi * f[1:] / RATE))
    spectrum[0] = 0.0
    return np.fft.irfft(spectrum)[:count]


def by_slopes(deviation):
    """MATLAB's example and NaveGo: the point of the curve whose slope is nearest to that of each term."""
    slope = np.gradient(np.log(deviation), np.log(TAUS))
    at = {term: int(np.argmin(np.abs(slope - wanted))) for term, wanted in (("N", -0.5), ("B", 0.0), ("K", 0.5))}
    return [deviation[at["N"]] * np.sqrt(TAUS[at["N"]]), deviation[at["B"]] / 0.664, deviation[at["K"]] * np.sqrt(3.0 / TAUS[at["K"]])]


def by_lines(deviation):
    """kalibr_allan: lines of slope -1/2 before and +1/2 after the lowest point."""
    low = int(np.argmin(deviation))
    before, after = slice(0, low + 1), slice(low, None)
    line = lambda part, slope: np.exp(np.mean(np.log(deviation[part] / TAUS[part] ** slope)))  # noqa: E731
    return [line(before, -0.5), np.nan, line(after, 0.5) * np.sqrt(3.0)]


def by_short_line(deviation):
    """allan_variance_ros: slope -1/2 through the times below 10 s, +1/2 through all, evenly in tau; B is the lowest point."""
    weight = np.gradient(TAUS)
    short = TAUS < 10.0
    mean = lambda part, slope: np.exp(np.average(np.log(deviation[part] / TAUS[part] ** slope), weights=weight[part]))  # noqa: E731
    return [mean(short, -0.5), np.min(deviation), mean(slice(None), 0.5) * np.sqrt(3.0)]


def by_nnls(deviation):
    """nmayorov/allan-variance: non-negative least squares of five terms, with relative weights."""
    from scipy.optimize import nnls

    terms = np.stack([3 / TAUS**2, 1 / TAUS, np.full(len(TAUS), 2 * np.log(2) / np.pi), TAUS / 3, TAUS**2 / 2], axis=1)
    return np.sqrt(nnls(terms / deviation[:, None] ** 2, np.ones(len(TAUS)))[0][1:4])


def noise(python, runs):
    from jaxcal.noise import fit

    records = []
    for run in range(runs):
        rng = np.random.default_rng([run, 1])
        walk = np.cumsum(rng.normal(size=HOUR)) / np.sqrt(RATE)
        records.append(TRUE["N"] * np.sqrt(RATE) * rng.normal(size=HOUR) + TRUE["B"] * flicker(HOUR, rng) + TRUE["K"] * walk)
    yield "| tool | | N | B | K |"
    yield "|---|---|---|---|---|"
    rows = {}
    curves = asked(python, "allan_curves", {"y": np.array(records)})
    if curves is not None:
        rows = {
            "allantools, read off where a slope fits (MATLAB's example, NaveGo)": ("run, then rule", [by_slopes(x) for x in curves]),
            "two lines (kalibr_allan)": ("rule", [by_lines(x) for x in curves]),
            "two lines (allan_variance_ros)": ("rule", [by_short_line(x) for x in curves]),
            "non-negative least squares (nmayorov/allan-variance)": ("rule", [by_nnls(x) for x in curves]),
        }
    rows["jaxcal"] = ("run", [[float(getattr(fit(y, RATE).noise, term)) for term in "NBK"] for y in records])
    for name, (how, values) in rows.items():
        off = 100 * (np.array(values) / list(TRUE.values()) - 1)
        cells = [NOTHING if np.isnan(x).all() else f"{np.mean(x):+.2g}, {np.std(x):.2g}" for x in off.T]
        yield f"| {name} | {how} | {' | '.join(cells)} |"


# --- magnetometer


def magnitudes(python, runs):
    import magnetometer as others

    readings = []
    for run in range(runs):
        rng = np.random.default_rng([run, 7])
        readings.append(others.MILD.measure(others.directions(300, rng, "hemisphere")) + 0.02 * rng.normal(size=(300, 3)))
    sphere = others.directions(500, np.random.default_rng(99))
    rows = {}
    for name in ("ellipsoid_fit", "ellipsoid_fit_fang", "twostep_hsi"):
        found = asked(python, "magnitudes_magyc", {"m": np.array(readings)}, name)
        if found is not None:
            rows[f"magyc's `{name}`"] = "run", [(x[:, 0], x[:, 1:]) for x in found]
    rules = {"Li and Griffiths": "Li and Griffiths, as in Magneto", "Petrov": "Petrov, as in ellipsoid_fit_python",
             "quadric = 1": "quadric = 1, as in circuitpython-mag-cal", "mean-centred": "mean-centred, as in PyPI's magcal"}  # fmt: skip
    for kind, name in rules.items():
        rows[name] = "rule", [others.quadric(m, kind) for m in readings]
    rows["radial, as in ArduPilot and PX4 (both stop it before it diverges)"] = "rule", [others.radial(m) for m in readings]
    rows["jaxcal, maximum likelihood"] = "run", [others.ours(m) for m in readings]
    yield "| method | | hard iron off by, % of the field | directions, degrees rms |"
    yield "|---|---|---|---|"
    for name, (how, found) in rows.items():
        off, turned = [], []
        for centre, matrix in found:
            y = (others.MILD.measure(sphere) - centre) @ np.asarray(matrix).T
            cosine = np.sum(sphere * y, axis=1) / np.linalg.norm(y, axis=1)
            off.append(100 * np.linalg.norm(centre - others.MILD.hard_iron))
            turned.append(np.rad2deg(np.sqrt(np.mean(np.arccos(np.clip(cosine, -1, 1)) ** 2))))
        yield f"| {name} | {how} | {np.median(off):.2g} | {np.median(turned):.2g} |"


def with_gyroscope(python, runs):
    import magnetometer as others

    from jaxcal.magnetometer import Gyroscope, MagModel, fit

    kinds = ("everywhere", "three turns, tilt 20", "cap 40")
    rows = {}
    for kind in kinds:
        drives = [others.driven(kind, 1000, 50.0, np.random.default_rng([run, 5]), 0.01)[:2] for run in range(runs)]
        records = {"m": np.array([m for m, _ in drives]), "gyro": np.array([gyro for _, gyro in drives])}
        for name in ("magyc_ls", "magyc_nls", "magyc_bfg"):
            found = asked(python, "gyro_magyc", records, name)
            models = None if found is None else [MagModel(np.linalg.inv(x[:, 1:]), x[:, 0]) for x in found]
            rows.setdefault(f"magyc's `{name}`", []).append(models)
        rows.setdefault("jaxcal, `aid=Gyroscope(...)`", []).append([fit(m, aid=Gyroscope(w, 50.0)).model for m, w in drives])
    yield f"| method | | {' | '.join(kinds)} |"
    yield "|---|---|---|---|---|"
    for name, each in rows.items():
        cells = [NOTHING if models is None else f"{np.median([others.headings_off(one) for one in models]):.2g}" for models in each]
        yield f"| {name} | run | {' | '.join(cells)} |"


def magfit(m, up, north):
    """The rule of MAVProxy's MAGFit: an offset, a scale and a symmetric matrix, by SLSQP within the limits of its dialog.

    It makes the mean distance least between a corrected reading and the known field at the known level and the heading of that reading.
    """
    from scipy.optimize import fmin_slsqp

    flat, down = np.hypot(north[0], north[1]), north[2]

    def correct(m, p):
        return p[3] * (m + p[:3]) @ np.array([[p[4], p[7], p[8]], [p[7], p[5], p[9]], [p[8], p[9], p[6]]])

    def off(p):
        seen = correct(m, p)
        level = seen - np.sum(seen * up, axis=1, keepdims=True) * up
        expected = flat * level / np.linalg.norm(level, axis=1, keepdims=True) - down * up
        return np.mean(np.linalg.norm(expected - seen, axis=1))

    limits = [(-3, 3)] * 3 + [(1, 1 + 1e-5)] + [(0.8, 1.2)] * 3 + [(-0.2, 0.2)] * 3  # offsets of 1,500 mG in a field of 500
    found = fmin_slsqp(off, np.array([0, 0, 0, 1, 1, 1, 1, 0, 0, 0], dtype=float), bounds=limits, iter=300, iprint=0)
    return correct(np.eye(3), found) - correct(np.zeros((1, 3)), found), -found[:3]


def with_vertical(python, runs):
    import magnetometer as others

    from jaxcal.magnetometer import Accelerometer, MagModel, fit

    kinds = ("everywhere", "three turns, tilt 20", "cap 40")
    yield f"| sensor | method | | {' | '.join(kinds)} |"
    yield "|---|---|---|---|---|---|"
    for sensor, truth in (("mounted straight", others.MILD), ("turned by 3.7°", others.TURNED)):
        others.TURNED = truth  # of the drives and of the error of headings
        rows = {"MAGFit, as in MAVProxy": ("rule", []), "jaxcal, `aid=Accelerometer(...)`": ("run", [])}
        for kind in kinds:
            drives = [others.driven(kind, 1000, 50.0, np.random.default_rng([run, 5]), 0.01)[::2] for run in range(runs)]
            ups = [accel / np.linalg.norm(accel, axis=1, keepdims=True) for _, accel in drives]
            found = [magfit(m, up, others.NORTH) for (m, _), up in zip(drives, ups, strict=True)]
            theirs = [MagModel(np.linalg.inv(matrix.T), hard) for matrix, hard in found]
            ours = [fit(m, field=others.NORTH, aid=Accelerometer(accel)).model for m, accel in drives]
            for (_, cells), models in zip(rows.values(), (theirs, ours), strict=True):
                cells.append(np.median([others.headings_off(one) for one in models]))
        for name, (how, cells) in rows.items():
            yield f"| {sensor} | {name} | {how} | {' | '.join(f'{one:.2g}' for one in cells)} |"


# --- accelerometer and gyroscope


def regions():
    """Label -> samples of the session: six faces of 5 s, and a turn of 5 s about each axis."""
    labels = [f"{axis}_{kind}" for axis in "xyz" for kind in ("p", "a", "rot")]
    return {label: slice(500 * i, 500 * i + 500) for i, label in enumerate(labels)}


def session(python, runs):
    from jaxcal import Log
    from jaxcal.imu import ferraris

    force = np.zeros((4500, 3))
    rate = np.zeros((4500, 3))
    for label, part in regions().items():
        axis = "xyz".index(label[0])
        force[part, axis] = -GRAVITY if label.endswith("a") else GRAVITY
        rate[part, axis] = 2 * np.pi / 5 if label.endswith("rot") else 0.0
    records = {x: [] for x in ("accel", "gyro", "seen_accel", "seen_gyro")}
    truth = []
    for run in range(runs):
        rng = np.random.default_rng([run, 3])
        a, g = (np.eye(3) + 0.02 * rng.normal(size=(3, 3)) for _ in range(2))
        shift, drift, sensitivity = 0.3 * rng.normal(size=3), 0.02 * rng.normal(size=3), 1e-4 * rng.normal(size=(3, 3))
        f, w = rng.normal(size=(200, 3)) * GRAVITY / np.sqrt(3), rng.normal(size=(200, 3))
        for own, accel, gyro in (("", force, rate), ("seen_", f, w)):
            noisy = 1.0 if not own else 0.0
            records[f"{own}accel"].append(accel @ a.T + shift + noisy * 0.02 * rng.normal(size=accel.shape))
            records[f"{own}gyro"].append(gyro @ g.T + drift + accel @ sensitivity.T + noisy * 0.002 * rng.normal(size=gyro.shape))
        truth.append(np.stack([f, w]))
    records = {name: np.array(values) for name, values in records.items()}
    rows = {"imucal": asked(python, "session_imucal", records)}
    known = [(label, part.start, part.stop) for label, part in regions().items()]
    ours = []
    for accel, gyro, a, w in zip(*records.values(), strict=True):
        found = ferraris(Log(None, accel=accel, gyro=gyro, rate=RATE), known, gravity=GRAVITY)
        corrected = found.accel.correct(a)
        ours.append(np.stack([corrected, found.gyro.correct(w, corrected)]))
    rows["jaxcal, `ferraris`"] = np.array(ours)
    yield "| tool | | accelerometer, mg rms | gyroscope, % of the rate |"
    yield "|---|---|---|---|"
    for name, found in rows.items():
        if found is not None:
            rms = np.sqrt(np.mean((found - np.array(truth)) ** 2, axis=(2, 3)))
            yield f"| {name} | run | {np.median(rms[:, 0]) / GRAVITY * 1e3:.2g} | {100 * np.median(rms[:, 1]):.2g} |"


TABLES = {
    "noise": (noise, 12),
    "magnitudes": (magnitudes, 30),
    "gyroscope": (with_gyroscope, 6),
    "vertical": (with_vertical, 6),
    "session": (session, 20),
}


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--peers", default=sys.executable)
    options.add_argument("--write", action="store_true")
    options.add_argument("--only", choices=TABLES)
    options.add_argument("--run", nargs="+", help=argparse.SUPPRESS)
    options.add_argument("--folder", type=pathlib.Path, help=argparse.SUPPRESS)
    given = options.parse_args()
    if given.run:
        name, *rest = given.run
        np.save(given.folder / "out.npy", PEERS[name](dict(np.load(given.folder / "in.npz")), *rest))
        return
    for name, (table, runs) in TABLES.items():
        if given.only in (None, name):
            made = "\n".join(table(given.peers, runs))
            print(f"\n{name}, {runs} runs\n{made}", flush=True)
            if given.write:
                before, mark, rest = PAGE.read_text(encoding="utf-8").partition(f"<!-- peers: {name} -->\n")
                after = rest[rest.index("<!-- end -->") :]
                PAGE.write_text(before + mark + made + "\n" + after, encoding="utf-8")


if __name__ == "__main__":
    main()
