"""mtotdev and htotdev beside allantools, whose time grows at least quadratically: measured at small sizes, then extrapolated."""

import time

import allantools
import numpy as np

import jaxcal

_SAMPLES = 10**4


def total_family(budget=60.0):
    """Print one row for each statistic at 10^4 samples on octaves; `budget` is about the total time in s spent on allantools.

    allantools visits every window of mtotdev and htotdev with a loop over 6 m positions: its time
    per window is linear in m. All windows cost the same, so allantools is timed on records just long enough for a few windows, at
    three cluster sizes. The line through these costs is then summed over the windows of all cluster sizes.
    """
    y = np.random.default_rng(0).standard_normal(_SAMPLES)
    print(f"{'kind':8} {'samples':>8} {'grid':7} {'allantools s (extrapolated)':>28} {'jaxcal s':>9} {'ratio':>9} {'agree':>8}")
    for kind in ("mtotdev", "htotdev"):
        first = jaxcal.allan.deviation(y, 1.0, kind=kind, m="octave")
        m = first.m[first.m > 1] if kind == "htotdev" else first.m  # at m = 1 htotdev is ohdev
        windows = (_SAMPLES + 2 if kind == "mtotdev" else _SAMPLES + 1) - 3 * m
        intercept, slope, agreement = _cost_of_a_window(kind, y, budget / 2.0)
        theirs = float(np.sum(windows * (intercept + slope * m)))
        ours = _best(lambda kind=kind: jaxcal.allan.deviation(y, 1.0, kind=kind, m="octave"))
        print(f"{kind:8} {_SAMPLES:8d} {'octave':7} {theirs:28.0f} {ours:9.3f} {theirs / ours:9.0f} {agreement:8.0e}", flush=True)
    print("  allantools: cost of a window at m = 4, 16 and 64 measured in this run, a line in m, times the windows of every octave")


def _cost_of_a_window(kind, y, seconds):
    """Intercept and slope in m of allantools' seconds per window, and largest relative difference of its values from jaxcal's."""
    sizes, costs, worst = np.array([4, 16, 64]), [], 0.0
    for m in sizes:
        spent, fewest, chosen = 0.0, np.inf, 20
        while spent < seconds / len(sizes):
            record = y[: chosen + 3 * m]
            count = len(record) + (2 if kind == "mtotdev" else 1) - 3 * m
            start = time.perf_counter()
            theirs = getattr(allantools, kind)(record, rate=1.0, data_type="freq", taus=[float(m)])[1]
            taken = time.perf_counter() - start
            fewest = min(fewest, taken / count)
            spent += taken
            ours = jaxcal.allan.deviation(record, 1.0, kind=kind, m=[m], alpha=0).deviation
            worst = max(worst, abs(theirs[0] / ours[0] - 1.0))
            chosen = min(2 * chosen, 2000)
        costs.append(fewest)
    slope, intercept = np.polyfit(sizes, costs, 1)
    return max(intercept, 0.0), slope, worst


def _best(function, budget=3.0):
    times, began = [], time.perf_counter()
    while len(times) < 3 or time.perf_counter() - began < budget:
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


if __name__ == "__main__":
    total_family()
