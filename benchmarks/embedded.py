"""Calibration on a microcontroller: the exported C code beside `magnetometer.Moments` and `fit`, hostile readings, and what it costs.

python benchmarks/embedded.py [--sessions 1000] [--fuzz 1000000]

The simulator shares nothing with the package. gcc and clang are needed; arm-none-eabi-gcc and qemu-system-arm (Debian: gcc-arm-none-eabi,
libnewlib-arm-none-eabi, qemu-system-arm) give flash, memory and instructions.
"""

import argparse
import collections
import ctypes
import json
import pathlib
import shutil
import subprocess
import tempfile

import numpy as np

import jaxcal

H, DIP = 47.0, np.arccos(0.54)
SCENARIOS = ("all directions", "half of them", "three turns", "twelve points")
#: the magnetometer paper: soft iron of scenario 1 as a correction, its hard iron in uT, headings of Table I
PAPER = np.array([[0.9847, -0.2311, -0.0363], [-0.2311, 1.3609, -0.3391], [-0.0363, -0.3391, 0.8710]])
PAPER_HARD = np.array([2.1746, 5.1520, 10.2458])
PAPER_HEADINGS = np.deg2rad([2.4, 77.4, 115.5, 167.5, 222.6, 249.4, 300.3, 356.1])


class Mag(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_float * size) for name, size in (("sum", 35), ("lost", 35), ("centre", 3), ("scale", 1), ("last", 3))),
        ("bin", ctypes.c_uint16 * 24), *((name, ctypes.c_uint16) for name in ("count", "held", "outliers")),
        ("matrix", ctypes.c_float * 9), ("bias", ctypes.c_float * 3),
        *((name, ctypes.c_float) for name in ("field", "noise", "heading_error", "horizontal")),
        *((name, ctypes.c_uint8) for name in ("solved", "verdict", "reasons")),
    ]  # fmt: skip


def device():
    """A calibration of three sensors over temperature, and with ageing of one."""
    rng = np.random.default_rng(5)
    near = lambda size: np.eye(3) + size * rng.standard_normal((3, 3))  # noqa: E731
    accel = jaxcal.imu.Triad(near(0.01), 0.1 * np.ones(3))
    gyro = jaxcal.imu.Triad(near(0.01), 1e-3 * np.ones(3), 1e-3 * rng.standard_normal((3, 3)))
    powers = {name: size * rng.standard_normal((3, 3)) * [1, 1e-2, 1e-4] for name, size in (("accel", 1e-3), ("gyro", 1e-5))}
    thermal = jaxcal.calibration.polynomials(25.0, -20.0, 70.0, **powers)
    mags, names = [], [*(f"soft_iron[{i},{j}]" for i in range(3) for j in range(3)), *(f"hard_iron[{i}]" for i in range(3)), "field"]
    for hard in (1e-6, 3e-6):
        covariance = {"parameters": names, "values": 1e-16 * np.eye(13)}
        mags.append({"unit": "T", "soft_iron": near(0.05), "hard_iron": hard * np.ones(3), "field": 47e-6, "covariance": covariance})
    earlier, later = (jaxcal.Calibration(imu={"accel": accel, "gyro": gyro}, magnetometer=mag, temperature=thermal,
                                         provenance={"date": f"2026-0{i + 1}-01"}) for i, mag in enumerate(mags))  # fmt: skip
    return later, jaxcal.Calibration(magnetometer=earlier.magnetometer, provenance=earlier.provenance)


STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror")
#: a program that takes sessions from its input, each with its number of readings, for the sanitizers
FUZZED = """#include "sensors.c"
#include <stdio.h>
int main(void) {
  static jaxcal_mag mag;
  uint32_t n;
  float m[3];
  while (fread(&n, sizeof n, 1, stdin) == 1) {
    jaxcal_mag_begin(&mag);
    while (n-- > 0 && fread(m, sizeof m, 1, stdin) == 1) jaxcal_mag_add(&mag, m);
    jaxcal_mag_solve(&mag);
    jaxcal_mag_constrained(&mag);
  }
  return 0;
}
"""


def library(folder):
    """The code as a shared library, built with all warnings as errors."""
    later, earlier = device()
    jaxcal.export.write(later, folder / "sensors.h", format="c", solver=True, earlier=earlier, force=True)
    (folder / "sensors.c").write_text("""#define JAXCAL_IMPLEMENTATION
#include "sensors.h"
void correct(const float y[9], float temperature, float days, float x[9]);
void correct(const float y[9], float temperature, float days, float x[9]) {
  jaxcal_correct_accel(y, temperature, days, x);
  jaxcal_correct_gyro(y + 3, x, temperature, days, x + 3);
  jaxcal_correct_mag(y + 6, temperature, days, x + 6);
}
""")
    subprocess.run(["gcc", *STRICT, "-O2", "-shared", "-fPIC", "sensors.c", "-lm", "-o", "sensors.so"], cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "sensors.so"))


def corrections(code):
    """Largest difference of corrected readings from those of `Calibration.correct`, relative to the largest reading of the sensor."""
    later, rng, count = device()[0], np.random.default_rng(8), 1000
    y = (rng.standard_normal((count, 9)) * np.repeat([10.0, 1.0, 50e-6], 3)).astype(np.float32)
    t, x = np.linspace(-30.0, 80.0, count, dtype=np.float32), np.zeros((count, 9), dtype=np.float32)
    for row, out, at in zip(y, x, t, strict=True):
        code.correct(row.ctypes.data_as(ctypes.c_void_p), ctypes.c_float(at), ctypes.c_float(0.0), out.ctypes.data_as(ctypes.c_void_p))
    sensors = {name: y[:, i : i + 3].astype(float) for name, i in (("accel", 0), ("gyro", 3), ("mag", 6))}
    right = later.correct(jaxcal.Log(None, **sensors, temperature=t.astype(float), rate=100.0))
    pairs = zip((right.accel, right.gyro, right.mag), np.split(x, 3, axis=1), strict=True)
    apart = [np.abs(found - one).max() / np.abs(one).max() for one, found in pairs]
    print("corrected readings over temperature, C beside Python, relative:", *(f"{one:.1e}" for one in apart))


def calibrated(code, m, method="solve"):
    mag = Mag()
    code.jaxcal_mag_begin(ctypes.byref(mag))
    for row in np.asarray(m, dtype=np.float32):
        code.jaxcal_mag_add(ctypes.byref(mag), row.ctypes.data_as(ctypes.c_void_p))
    getattr(code, f"jaxcal_mag_{method}")(ctypes.byref(mag))
    return mag


def fields(azimuth, elevation):
    """Unit field in body axes, bank 0."""
    north = np.stack([np.cos(DIP) * np.cos(azimuth), -np.cos(DIP) * np.sin(azimuth), np.full_like(azimuth, np.sin(DIP))], axis=1)
    x, z = north[:, 0], north[:, 2]
    return np.stack([np.cos(elevation) * x - np.sin(elevation) * z, north[:, 1], np.sin(elevation) * x + np.cos(elevation) * z], axis=1)


def session(rng):
    kind, n = int(rng.integers(4)), int(np.exp(rng.uniform(np.log(100), np.log(5000))))
    soft = np.eye(3) + 0.15 * rng.standard_normal((3, 3))
    soft = (soft + soft.T) / 2
    hard = rng.standard_normal(3)
    hard *= H * rng.uniform(0, 3) / np.linalg.norm(hard)
    if kind < 2:
        h = rng.standard_normal((2 * n + 100 if kind else n, 3))
        h /= np.linalg.norm(h, axis=1, keepdims=True)
        h = h[h @ h[0] > 0][:n] if kind else h
    else:
        turn = np.linspace(0, 2 * np.pi, n // 3 if kind == 2 else 4, endpoint=False)
        h = fields(np.tile(turn, 3), np.repeat(np.deg2rad([-30, 0, 30]), len(turn)))
        h = np.repeat(h, max(n // len(h), 1), axis=0)
    noise = np.exp(rng.uniform(np.log(0.002), np.log(0.05)))
    return kind, (H * (h @ soft.T + noise * rng.standard_normal(h.shape)) + hard).astype(np.float32), soft, hard


def headings(matrix, bias, soft, hard, psi):
    x = (H * fields(psi, np.zeros_like(psi)) @ soft.T + hard - bias) @ np.reshape(matrix, (3, 3)).T
    return np.arctan2(-x[:, 1], x[:, 0])


def off(*model):
    psi = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    return np.rad2deg(np.sqrt(np.mean(np.angle(np.exp(1j * (headings(*model, psi) - psi))) ** 2)))


def sessions(code, number):
    rng, rows = np.random.default_rng(47), collections.defaultdict(list)
    for _ in range(number):
        kind, m, soft, hard = session(rng)
        mag = calibrated(code, m)
        moments = jaxcal.magnetometer.Moments()
        moments.add(m)
        moments.solve(inclination=DIP)
        fit = jaxcal.magnetometer.fit(m.astype(float), method="consistent", model="symmetric")
        rows[kind].append((mag, moments, fit, soft, hard))
    print("scenario: sessions, good; C beside Python, largest of 'good', hard and soft iron; rmse beside fit; good and above 1 degree; "
          "actual over stated error, rms; verdicts that agree")  # fmt: skip
    for kind, found in sorted(rows.items()):
        good = [one for one in found if one[0].verdict == 0]
        apart = [np.linalg.norm(mag.bias - moments.model.hard_iron) / H for mag, moments, *_ in good]
        iron = [np.abs(np.linalg.inv(np.reshape(mag.matrix, (3, 3))) - moments.model.soft_iron).max() for mag, moments, *_ in good]
        both = [one for one in found if one[0].solved and one[2].model is not None]
        ours, theirs = (np.sqrt(np.mean([np.sum((get(one) - one[4]) ** 2) for one in both]))
                        for get in (lambda one: np.array(one[0].bias), lambda one: one[2].model.hard_iron))  # fmt: skip
        actual = np.array([off(mag.matrix, mag.bias, soft, hard) for mag, _, _, soft, hard in good])
        stated = np.rad2deg([mag.heading_error for mag, *_ in good])
        same = np.mean([("good", "weak", "refused")[mag.verdict] == moments.verdict for mag, moments, *_ in found])
        print(f"{SCENARIOS[kind]:16} {len(found):4} {len(good):4}  {max(apart, default=0):.1e} {max(iron, default=0):.1e}  "
              f"{ours / theirs:.3f}  "
              f"{100 * np.mean(actual > 1):.1f} %  {np.sqrt(np.mean((actual / stated) ** 2)):.2f}  {100 * same:.1f} %")  # fmt: skip


def paper(code):
    """Headings of Table I from three scenarios, with the constraint of the paper, in C and in Python."""
    rng, soft = np.random.default_rng(1), np.linalg.inv(PAPER)
    turn, four = np.linspace(0, 2 * np.pi, 120, endpoint=False), np.arange(4) * np.pi / 2
    every = rng.standard_normal((4000, 3))
    motions = {
        "12 points": fields(np.tile(four, 3), np.repeat(np.deg2rad([30, 0, -30]), 4)),
        "3 turns": fields(np.tile(turn, 3), np.repeat(np.deg2rad([-30, 0, 30]), 120)),
        "all": every / np.linalg.norm(every, axis=1, keepdims=True),
    }
    table = {}
    for name, h in motions.items():
        m = (H * h @ soft.T + PAPER_HARD + 0.05 * rng.standard_normal(h.shape)).astype(np.float32)
        mag = calibrated(code, m, "constrained")
        table[name] = np.rad2deg(headings(mag.matrix, mag.bias, soft, PAPER_HARD, PAPER_HEADINGS)) % 360
        fit = jaxcal.magnetometer.fit(m.astype(float), method="constrained", model="symmetric").model
        print(f"paper, {name}: hard iron {np.round(mag.bias, 3)}, {np.abs(mag.bias - fit.hard_iron).max():.1e} uT from Python")
    for row in np.array(list(table.values())).T:
        print("  ", *(f"{value:8.3f}" for value in row))
    apart = np.ptp(np.unwrap(np.array(list(table.values())), axis=0, period=360), axis=0)
    print(f"   largest difference between scenarios {apart.max():.2f} degrees (the paper: below 1)")


def hostile(number):
    """Sessions with readings of every kind, `number` of them."""
    rng, left = np.random.default_rng(3), number
    kinds = (
        lambda n: rng.integers(0, 2**32, (n, 3), dtype=np.uint32).view(np.float32), lambda n: rng.uniform(-1, 1, (n, 3)),
        lambda n: rng.choice([np.inf, -np.inf, np.nan, 0, 1, 2, 3], (n, 3)), lambda n: np.full((n, 3), 3.0),
        lambda n: rng.integers(-1, 2, (n, 3)), lambda n: 1e18 * rng.uniform(-1, 1, (n, 3)), lambda n: 1e-30 * rng.integers(0, 100, (n, 3)),
        lambda n: rng.integers(-32768, 32768, (n, 3)), lambda n: rng.uniform(-1, 1, (n, 3)) * [1, 1, 0],
    )  # fmt: skip
    while left > 0:
        n = int(rng.integers(1, 300))
        left -= n
        with np.errstate(all="ignore"):
            yield np.asarray(kinds[rng.integers(len(kinds))](n), dtype=np.float32)


def survived(code, number, folder):
    """Whatever comes, no number of a fit is NaN, and no compiler's sanitizer has anything to say."""
    bad = good = 0
    for m in hostile(number):
        for method in ("solve", "constrained"):
            mag = calibrated(code, m, method)
            numbers = [*mag.matrix, *mag.bias, mag.field, mag.noise, mag.heading_error]
            bad += np.isnan([mag.field, mag.noise, mag.heading_error]).any() or bool(mag.solved and not np.isfinite(numbers).all())
            good += mag.verdict == 0
    print(f"hostile readings: {number}, not finite {bad}, called good {good}")
    (folder / "fuzzed.c").write_text(FUZZED)
    told = b"".join(np.uint32(len(m)).tobytes() + m.tobytes() for m in hostile(number))
    for compiler in ("gcc", "clang"):
        sanitize = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
        subprocess.run([compiler, *STRICT, *sanitize, "fuzzed.c", "-lm", "-o", "fuzzed"], cwd=folder, check=True)
        subprocess.run(["./fuzzed"], cwd=folder, check=True, input=told)
        print(f"the same under the address and undefined sanitizers of {compiler}: clean")


def cost(folder):
    if shutil.which("arm-none-eabi-gcc") is None or shutil.which("qemu-system-arm") is None:
        print("flash, memory and instructions: arm-none-eabi-gcc and qemu-system-arm are not there")
        return
    here = pathlib.Path(__file__).parent / "cortex"
    boards = {
        "M4F": (["-mcpu=cortex-m4", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"], "mps2-an386"), "M0+": (["-mcpu=cortex-m0plus"], "mps2-an385")
    }  # fmt: skip
    for name, (core, board) in boards.items():
        build = ["arm-none-eabi-gcc", *core, "-mthumb", "-Os", "-std=gnu99", "-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections"]
        subprocess.run([*build, "-c", "sensors.c", "-o", "sensors.o"], cwd=folder, check=True)
        size = subprocess.run(["arm-none-eabi-size", "sensors.o"], cwd=folder, check=True, capture_output=True, text=True).stdout
        link = ["-T", str(here / "board.ld"), "--specs=rdimon.specs", "-nostartfiles", "-lm", "-o", "main.elf"]
        sources = [str(here / "main.c"), str(here / "start.c"), "sensors.c"]
        subprocess.run([*build, f"-I{folder}", *sources, *link], cwd=folder, check=True, capture_output=True)
        run = ["qemu-system-arm", "-M", board, "-nographic", "-semihosting-config", "enable=on,target=native", "-icount", "shift=5"]
        said = subprocess.run([*run, "-kernel", "main.elf"], cwd=folder, check=True, capture_output=True, text=True, timeout=120).stdout
        print(f"Cortex-{name}: flash {size.split()[6]} bytes;", json.loads(said))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=1000)
    parser.add_argument("--fuzz", type=int, default=1_000_000)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        place = pathlib.Path(name)
        built = library(place)
        corrections(built)
        sessions(built, asked.sessions)
        paper(built)
        cost(place)
        survived(built, asked.fuzz, place)
