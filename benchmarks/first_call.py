"""CPU time of the first call of an estimator, in a fresh process with an empty compilation cache, and of later calls.

    python benchmarks/first_call.py                              every case, this checkout
    python benchmarks/first_call.py --beside ../other            alternate with the same cases of another checkout, and give the ratio
    python benchmarks/first_call.py --only noise gls --repeats 3

Every measurement is a separate process. `first` counts user and system seconds of the whole first call, including tracing and
compilation but not the imports of the package, which `import` counts. `warm` is the median wall time of later calls. `xsens` needs the
log of imu_tk in FOLDER/data/imu_tk, where FOLDER is JAXCAL_REFERENCE or ../shared.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[1]
CASES = ("noise", "gls", "magnetometer", "alignment", "xsens")
_CHILD = """
import json, os, pathlib, resource, sys, time
def spent():
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime
start = spent()
import numpy as np
import jaxcal
case = sys.argv[1]
rng = np.random.default_rng(1)
if case in ("noise", "gls"):
    from jaxcal.noise import Noise, fit
    y = Noise(N=1e-3, B=2e-4, K=1e-5).simulate(2**17, rate=100.0, seed=0)
    call = lambda: fit(y, 100.0, method="whittle" if case == "noise" else "gls")
elif case == "magnetometer":
    from jaxcal.magnetometer import fit
    u = rng.normal(size=(360, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    soft = np.array([[1.1, 0.06, -0.04], [0.06, 0.92, 0.05], [-0.04, 0.05, 1.0]])
    m = 47.0 * u @ soft + np.array([8.0, -5.0, 3.0]) + 0.3 * rng.normal(size=(360, 3))
    call = lambda: fit(m)
elif case == "alignment":
    from jaxcal.alignment import Sensor, fit, simulate
    gyro, accel = Sensor(bias=5e-8, white=1e-8), Sensor(bias=1e-3, white=1e-6)
    readings = simulate(np.deg2rad([0.0, 90.0, 180.0, 270.0]), np.deg2rad([2.0, -1.0, 40.0]), 0.6, accel=accel, gyro=gyro)
    call = lambda: fit(readings, 0.6)
else:
    from jaxcal.imu import multi_position
    folder = pathlib.Path(os.environ["JAXCAL_REFERENCE"]) / "data" / "imu_tk"
    accel, gyro = (np.loadtxt(folder / f"xsens_{name}.mat") for name in ("acc", "gyro"))
    log = jaxcal.Log(accel[:, 0], accel=accel[:, 1:], gyro=gyro[:, 1:])
    call = lambda: multi_position(log, gravity=9.81744, raw=True)
imported = spent() - start
start = spent()
call()
first = spent() - start
warm = []
for _ in range(2 if case == "xsens" else 15):
    start = time.perf_counter()
    call()
    warm.append(time.perf_counter() - start)
print(json.dumps({"import": imported, "first": first, "warm": sorted(warm)[len(warm) // 2]}))
"""


def measured(case: str, checkout: pathlib.Path) -> dict[str, float]:
    """Import and first call in CPU seconds, and warm call in s, of one fresh process."""
    reference = os.environ.get("JAXCAL_REFERENCE", str(ROOT.parent / "shared"))
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {
            "PYTHONPATH": str(checkout), "JAX_COMPILATION_CACHE_DIR": cache, "XLA_FLAGS": "", "JAXCAL_REFERENCE": reference,
            "PYTHONWARNINGS": "ignore",
        }  # fmt: skip
        done = subprocess.run([sys.executable, "-c", _CHILD, case], env=environment, cwd=cache, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{case} of {checkout} failed:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    """Print a table with one row per case; each figure is the median of the repeats."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=CASES, default=CASES)
    parser.add_argument("--beside", type=pathlib.Path, help="another checkout of jaxcal")
    parser.add_argument("--repeats", type=int, default=1)
    asked = parser.parse_args()
    checkouts = [ROOT] + ([asked.beside.resolve()] if asked.beside else [])
    print(f"{'case':14s}{'checkout':>12s}{'import CPU s':>14s}{'first CPU s':>13s}{'warm ms':>10s}")
    for case in asked.only:
        runs = [[measured(case, checkout) for checkout in checkouts] for _ in range(asked.repeats)]
        for i, name in enumerate(("this", "other")[: len(checkouts)]):
            figures = {key: statistics.median(run[i][key] for run in runs) for key in runs[0][i]}
            print(f"{case:14s}{name:>12s}{figures['import']:14.2f}{figures['first']:13.2f}{1e3 * figures['warm']:10.1f}", flush=True)
        if len(checkouts) == 2:
            ratio = statistics.median(run[0]["first"] / run[1]["first"] for run in runs)
            print(f"{'':14s}{'this/other':>12s}{'':14s}{ratio:13.2f}", flush=True)


if __name__ == "__main__":
    main()
