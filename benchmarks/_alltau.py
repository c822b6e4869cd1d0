"""Allan deviations at every cluster size: jaxcal's time, error and memory, and allantools' time extrapolated, in one run."""

import subprocess
import sys
import time

import allantools
import numpy as np

import jaxcal

RATE = 100.0


def all_tau(longest):
    """Print one line per statistic and length up to `longest`."""
    print("every cluster size: allantools' seconds are extrapolated from 24 cluster sizes, spaced evenly, in this run; error: largest")
    print("relative difference of the deviation from direct sums in extended precision at 20 cluster sizes; MB beyond the record")
    print(f"{'kind':6} {'samples':>9} {'tau':>8} {'jaxcal s':>9} {'allantools s':>12} {'ratio':>7} {'error':>7} {'MB':>6}")
    for samples in (n for n in (10**6, 10**7) if n <= longest):
        random = np.random.default_rng(0)
        y = random.standard_normal(samples) + 1e-3 * np.cumsum(random.standard_normal(samples))
        for kind in ("oadev", "ohdev", "mdev", "adev", "hdev") if samples < 10**7 else ("oadev",):
            jaxcal.allan.deviation(y, RATE, kind=kind, m="all")  # compiles
            start = time.perf_counter()
            found = jaxcal.allan.deviation(y, RATE, kind=kind, m="all")
            ours = time.perf_counter() - start
            theirs, error = _extrapolated(y, kind, len(found.m)), _error(y, kind, found)
            line = f"{kind:6} {samples:9d} {len(found.m):8d} {ours:9.2f} {theirs:12.0f} {theirs / ours:7.0f} {error:7.0e}"
            print(f"{line} {_memory(samples, kind):6.0f}", flush=True)


def _extrapolated(y, kind, number):
    """Seconds that allantools would take at `number` cluster sizes, extrapolated from the mean over some of them."""
    # evenly spaced, as the time falls about linearly with m; allantools refuses the last sizes, many of those of adev and hdev
    chosen = np.unique(np.linspace(1, (0.6 if kind in ("adev", "hdev") else 0.98) * number, 24).astype(int))
    theta = np.concatenate([[0.0], np.cumsum(y)]) / RATE  # integrate once, as a whole run would
    function = getattr(allantools, kind)

    def seconds(m):
        start = time.perf_counter()
        function(theta, rate=RATE, data_type="phase", taus=m / RATE)
        return time.perf_counter() - start

    once = min(seconds(chosen[-1:]) for _ in range(3))
    return once + (seconds(chosen) - once) / (len(chosen) - 1) * number


def _error(y, kind, found):
    """Largest relative difference from sums of squared differences in extended precision."""
    long = np.longdouble
    x = np.concatenate([[long(0)], np.cumsum(y.astype(long) - y.astype(long).mean())])
    if kind == "mdev":
        x = np.concatenate([[long(0)], np.cumsum(x)])
    worst = 0.0
    for i in np.unique(np.round(np.geomspace(1, len(found.m), 20)).astype(int)) - 1:
        m = int(found.m[i])
        order = 2 if kind in ("adev", "oadev") else 3
        d = np.diff([x[j * m : len(x) - (order - j) * m] for j in range(order + 1)], n=order, axis=0)[0]
        d = d[::m] if kind in ("adev", "hdev") else d
        scale = (6.0 if kind in ("hdev", "ohdev") else 2.0) * float(m) ** (4 if kind == "mdev" else 2)
        worst = max(worst, abs(float(found.deviation[i] / np.sqrt(np.mean(d * d) / scale)) - 1.0))
    return worst


def _memory(samples, kind):
    """Growth of the peak memory beyond the record in MB, in a separate process."""
    done = subprocess.run([sys.executable, __file__, str(samples), kind], capture_output=True, text=True, check=True)
    return float(done.stdout)


def _growth(samples, kind):
    def peak():
        with open("/proc/self/status") as status:
            return next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1e3

    jaxcal.allan.deviation(np.random.default_rng(0).standard_normal(20_000), RATE, kind=kind, m="all")
    y = np.random.default_rng(0).standard_normal(samples)
    before = peak()
    jaxcal.allan.deviation(y, RATE, kind=kind, m="all")
    return peak() - before


if __name__ == "__main__":
    if len(sys.argv) == 3:
        print(_growth(int(sys.argv[1]), sys.argv[2]))
    else:
        all_tau(int(sys.argv[1]) if len(sys.argv) == 2 else 10**7)
