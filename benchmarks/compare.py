"""jaxcal beside allantools in one run: speed, agreement, memory, compilations, and the whole command `jaxcal noise`.

    python benchmarks/compare.py                     everything (about twenty minutes on two cores)
    python benchmarks/compare.py --only stream       one part: command, speed, calls, all, stream, ... (see main)
    python benchmarks/compare.py --longest 1000000   shorter records only
    python benchmarks/compare.py --log imu.csv.gz    the command on your own log instead of a simulated one

Times are the best of several after compilation; compilation is timed separately. Ratios above 1 favour jaxcal.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time

import _alltau
import _stream
import allantools
import jax
import numpy as np

import jaxcal

RATE = 100.0
_COMPILED = "/jax/core/compile/backend_compile_duration"


def best(function, budget=4.0):
    """Smallest wall time of repeated calls within about `budget` seconds."""
    times, began = [], time.perf_counter()
    while len(times) < 2 or (time.perf_counter() - began < budget and len(times) < 20):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


class Compilations:
    """Counts the programs that XLA compiles, and the seconds they take."""

    def __init__(self):
        self.count, self.seconds = 0, 0.0
        jax.monitoring.register_event_duration_secs_listener(self._hear)

    def _hear(self, event, duration, **_):
        if event == _COMPILED:
            self.count += 1
            self.seconds += duration

    def during(self, function):
        """Number of programs compiled during a call, their seconds, and the seconds of the call."""
        count, seconds, start = self.count, self.seconds, time.perf_counter()
        function()
        return self.count - count, self.seconds - seconds, time.perf_counter() - start


def log_grid(largest):
    """About 93 cluster sizes at 10^7 samples, as in the published comparison."""
    return np.unique(np.round(np.logspace(0, np.log10(largest), int(14.9 * np.log10(largest)))).astype(int))


def octave_grid(largest):
    """Powers of two."""
    return 2 ** np.arange(int(np.log2(largest)) + 1)


def speed(longest, compilations):
    """Print one row per statistic, length, grid and number of channels."""
    print(f"{'kind':6} {'samples':>9} {'grid':7} {'tau':>4} {'ch':>2} {'allantools s':>12} {'jaxcal s':>9} {'ratio':>6} ", end="")
    print(f"{'1st call s':>10} {'agree':>8}")
    random = np.random.default_rng(0)
    for samples in (n for n in (10**5, 10**6, 10**7) if n <= longest):
        record = random.standard_normal((samples, 6)) + 0.01 * np.cumsum(random.standard_normal((samples, 6)), axis=0)
        record = np.asfortranarray(record)  # channels one after another, as a reader provides them
        cases = [("oadev", "log", 1), ("oadev", "octave", 1), ("oadev", "log", 6), ("oadev", "octave", 6)]
        cases += [(kind, "log", 1) for kind in ("adev", "mdev", "hdev", "ohdev")]
        for kind, name, channels in cases:
            order = 2 if kind in ("adev", "oadev") else 3
            m = (log_grid if name == "log" else octave_grid)(samples // order)
            peer, y = getattr(allantools, kind), record[:, :channels]

            def theirs(peer=peer, y=y, m=m):
                return [peer(y[:, i], rate=RATE, data_type="freq", taus=m / RATE)[1] for i in range(y.shape[1])]

            def ours(kind=kind, y=y, m=m):
                return jaxcal.allan.deviation(y, RATE, kind=kind, m=m)

            _, _, first = compilations.during(ours)
            # allantools drops cluster sizes with a single difference, so compare only those that it returns
            other, own = theirs(), ours().deviation
            agree = max(float(np.max(np.abs(own[: len(o), i] / o - 1))) for i, o in enumerate(other))
            a, b = best(theirs), best(ours)
            print(f"{kind:6} {samples:9d} {name:7} {len(m):4d} {channels:2d} {a:12.4f} {b:9.4f} {a / b:6.1f} ", end="")
            print(f"{first:10.2f} {agree:8.0e}", flush=True)


def calls():
    """Time one ordinary log per call, alternating loops of 20 calls: median ratio of wall times, and of CPU times."""
    random = np.random.default_rng(2)
    print(f"{'samples':>9} {'tau':>4} {'allantools ms':>13} {'jaxcal ms':>9} {'ratio':>6} {'of processor time':>18}")
    for samples in (10_000, 50_000, 100_000, 150_000):
        y, grid = random.standard_normal(samples), np.geomspace(1, samples // 2 - 1, 200)
        m = np.unique(np.round(grid).astype(int))
        m = m[np.round(np.linspace(0, len(m) - 1, 60)).astype(int)]
        peers = (
            lambda y=y, m=m: allantools.oadev(y, rate=RATE, data_type="freq", taus=m / RATE),
            lambda y=y, m=m: jaxcal.allan.deviation(y, RATE, m=m),
        )
        times = []
        for _ in range(16):  # alternate, so that both see the same state of the machine
            row = []
            for peer in peers:
                calls = []
                for _ in range(20):
                    start = time.perf_counter(), time.process_time()
                    peer()
                    calls.append((time.perf_counter() - start[0], time.process_time() - start[1]))
                row.append(np.median(calls, axis=0))
            times.append(row)
        theirs, ours = np.moveaxis(times[1:], 1, 0)  # the first compiles
        wall, processor = np.median(theirs / ours, axis=0)
        slow, quick = 1e3 * np.median(theirs[:, 0]), 1e3 * np.median(ours[:, 0])
        print(f"{samples:9d} {len(m):4d} {slow:13.2f} {quick:9.2f} {wall:6.1f} {processor:18.1f}", flush=True)


def compilations_over_lengths(compilations):
    """Count compilations for 100 logs of different lengths, with one statistic and the default grid."""
    random = np.random.default_rng(1)
    lengths = random.choice(np.arange(50_000, 1_000_000), 100, replace=False)
    record = random.standard_normal(lengths.max())

    def run(lengths):
        for length in lengths:
            jaxcal.allan.deviation(record[:length], RATE)

    jax.clear_caches()
    programs, seconds, _ = compilations.during(lambda: run(lengths))
    buckets = len({int(np.ceil(np.log2(length))) for length in lengths})
    span = f"{lengths.min()} to {lengths.max()} samples ({buckets} powers of two)"
    print(f"deviation: 100 logs of {span} compiled {programs} programs in {seconds:.1f} s")
    again, _, _ = compilations.during(lambda: run(lengths + 1))
    print(f"deviation: 100 more of other lengths compiled {again}")

    def fits(lengths):
        for length in lengths:
            jaxcal.noise.fit(record[:length], RATE)

    programs, seconds, _ = compilations.during(lambda: fits(lengths[:100]))
    print(f"noise.fit: the same 100 logs compiled {programs} programs more in {seconds:.1f} s")


def memory(samples):
    """Print the peak resident memory beyond the record itself, each measured in a separate process."""
    for which in ("allantools", "jaxcal"):
        arguments = [sys.executable, __file__, "--memory-of", which, "--longest", str(samples)]
        done = subprocess.run(arguments, capture_output=True, text=True, check=True)
        record = f"the record's {samples * 8 / 1e6:.0f} MB"
        print(f"{which:10} oadev, {samples} samples, 1 channel, log grid: {float(done.stdout):.0f} MB beyond {record}")


def peak():
    """Peak resident memory of this process in KiB."""
    try:  # ru_maxrss of a child starts at its parent's peak
        with open("/proc/self/status") as status:
            return next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))
    except FileNotFoundError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def memory_of(which, samples):
    """Print the growth of the peak memory in MB; runs in a separate process."""
    m = log_grid(samples // 2)
    small = np.random.default_rng(0).standard_normal(100_000)
    run = {
        "allantools": lambda y, m: allantools.oadev(y, rate=RATE, data_type="freq", taus=m / RATE),
        "jaxcal": lambda y, m: jaxcal.allan.deviation(y, RATE, m=m),
    }[which]
    run(small, m[m < 50_000])
    record = np.random.default_rng(0).standard_normal(samples)
    before = peak()
    run(record, m)
    print((peak() - before) / 1024)


def command(log):
    """Time the whole process `jaxcal noise`, with a cold and with a warm compilation cache."""
    with tempfile.TemporaryDirectory() as folder:
        if log is None:
            log = os.path.join(folder, "imu.csv")
            noise = {"gyro": jaxcal.noise.Noise(N=[7e-5] * 3, B=[3.7e-5] * 3), "accel": jaxcal.noise.Noise(N=[1e-3] * 3, B=[3e-4] * 3)}
            parts = [model.simulate(10**6, RATE, seed=i) for i, model in enumerate(noise.values())]
            table = np.column_stack([np.arange(10**6) / RATE, *parts])
            names = ["time_s", *(f"gyro_{a}_radps" for a in "xyz"), *(f"accel_{a}_mps2" for a in "xyz")]
            np.savetxt(log, table, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
        environment = os.environ | {"XDG_CACHE_HOME": os.path.join(folder, "cache")}
        for state in ("cold", "warm", "warm"):
            start = time.perf_counter()
            arguments = [sys.executable, "-m", "jaxcal", "noise", str(log), "--quiet", "--out", os.path.join(folder, "out")]
            child = subprocess.Popen(arguments, env=environment, stdout=subprocess.DEVNULL)
            _, status, usage = os.wait4(child.pid, 0)
            child.returncode = os.waitstatus_to_exitcode(status)
            wall = time.perf_counter() - start
            peak = f"peak {usage.ru_maxrss / 1024**2:.2f} GiB"
            print(f"jaxcal noise {os.path.basename(log)}, {state} cache: {wall:.1f} s, {peak}, exit {child.returncode}", flush=True)


def main():
    """Run everything, or the requested part."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--longest", type=int, default=10**7, help="longest record, in samples")
    parser.add_argument("--log", help="log for the command")
    parser.add_argument("--only", help="one part")
    parser.add_argument("--stream", type=int, default=10**8, help="longest stream, in samples; 10^9 needs 4 GB on disk")
    parser.add_argument("--memory-of", choices=["allantools", "jaxcal"], help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.memory_of:
        memory_of(options.memory_of, options.longest)
        return
    versions = f"jaxcal {jaxcal.__version__}, allantools {allantools.__version__}, jax {jax.__version__}"
    print(f"{versions}, {os.cpu_count()} cores, {jax.default_backend()}")
    compilations = Compilations()
    parts = {
        "command": lambda: command(options.log),
        "speed": lambda: speed(options.longest, compilations),
        "calls": calls,
        "all": lambda: _alltau.all_tau(options.longest),
        "stream": lambda: _stream.stream(options.stream),
        "logs": _stream.many_logs,
        "memory": lambda: memory(options.longest),
        "programs": lambda: compilations_over_lengths(compilations),
    }
    if options.only not in (None, *parts):
        parser.error(f"unknown part {options.only!r}; expected one of {', '.join(parts)}")
    for name, part in parts.items():
        if options.only in (None, name):
            print(f"\n{name}")
            part()


if __name__ == "__main__":
    main()
