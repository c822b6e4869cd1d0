"""Streams larger than memory, and many logs: parts of compare.py that hardly need another package.

python benchmarks/_stream.py --longest 1000000000     everything; the longest stream needs 4 GB on disk
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time

import jax
import numpy as np

import jaxcal

RATE = 100.0
_COMPILED = "/jax/core/compile/backend_compile_duration"


def stream(samples, folder=None):
    """Read float32 files through `batch.deviation`, each length in a separate process: speed, memory, cluster sizes."""
    lengths = [10**e for e in range(6, 12) if 10**e <= samples]
    head = f"{'samples':>10} {'kind':6} {'cluster sizes':>13} {'seconds':>8} {'samples/us':>10} {'ns/sample':>9}"
    print(f"{head} {'of processor time':>17} {'peak MB':>8}")
    for length in lengths:
        with tempfile.TemporaryDirectory(dir=folder) as place:
            path = os.path.join(place, "stream.npy")
            _write(path, length)
            for kind in ("oadev", "ohdev", "adev") if length <= 10**8 else ("oadev",):
                done = subprocess.run([sys.executable, __file__, "--stream-of", path, kind], capture_output=True, text=True, check=True)
                seconds, processor, clusters, peak = (float(v) for v in done.stdout.split())
                print(f"{length:10d} {kind:6} {clusters:13.0f} {seconds:8.2f} {length / seconds / 1e6:10.1f} ", end="")
                print(f"{seconds / length * 1e9:9.1f} {processor / length * 1e9:17.1f} {peak:8.0f}", flush=True)


def _write(path, length):
    """Write white noise with a mean of 9.81 in float32, block by block."""
    file = np.lib.format.open_memmap(path, mode="w+", dtype=np.float32, shape=(length,))
    random, block = np.random.default_rng(0), 1 << 22
    for start in range(0, length, block):
        stop = min(start + block, length)
        file[start:stop] = random.standard_normal(stop - start, dtype=np.float32) + np.float32(9.81)
    file.flush()


def _stream_of(path, kind):
    """Print seconds and processor seconds after compilation, cluster sizes, and peak resident MB; runs in a separate process."""
    y = np.load(path, mmap_mode="r")
    jaxcal.allan.Accumulator(RATE, kind=kind).update(y[:1_500_000]).result()  # compiles the programs that the stream needs
    times = []
    for _ in range(1 if len(y) > 10**8 else 3):
        start = np.array([time.perf_counter(), time.process_time()])
        accumulator = jaxcal.allan.Accumulator(RATE, kind=kind)
        found = accumulator.update(y).result()
        times.append([time.perf_counter(), time.process_time()] - start)
    print(*np.min(times, axis=0), len(found.m), _peak() / 1024)


def _peak():
    """Peak resident memory of this process in KiB."""
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))


def many_logs(logs=1000):
    """Process logs of 0.5 to 1.5 x 10^5 samples, all of different lengths, beside allantools one after another."""
    import allantools

    random = np.random.default_rng(1)
    lengths = random.choice(np.arange(50_000, 150_001), logs, replace=False)
    long = random.standard_normal(int(lengths.max()))
    records = [long[:length] for length in lengths]
    programs = []

    def hear(event, duration, fun_name="", **_):
        if event == _COMPILED:
            programs.append((fun_name, duration))

    jax.monitoring.register_event_duration_secs_listener(hear)

    def timed(function):
        start = np.array([time.perf_counter(), time.process_time()])
        return function(), [time.perf_counter(), time.process_time()] - start

    found, ours = timed(lambda: jaxcal.batch.deviation(records, RATE))
    compiled, spent = len([name for name, _ in programs if "block_sums" in name]), sum(seconds for _, seconds in programs)
    peers = [(y, d.tau) for y, d in zip(records, found, strict=True)]
    other, theirs = timed(lambda: [allantools.oadev(y, rate=RATE, data_type="freq", taus=tau) for y, tau in peers])
    agree = max(float(np.max(np.abs(d.deviation[: len(o[1])] / o[1] - 1))) for d, o in zip(found, other, strict=True))
    _, again = timed(lambda: jaxcal.batch.deviation([y[:-1] for y in records], RATE))
    print(f"{logs} logs of {lengths.min()} to {lengths.max()} samples, log grid: allantools {theirs[0]:.1f} s; ", end="")
    print(f"jaxcal {ours[0]:.1f} s with compilation, {again[0]:.1f} s after it: ", end="")
    first, then = theirs / ours, theirs / again
    print(f"{first[0]:.1f} and {then[0]:.1f} times; of processor time {first[1]:.1f} and {then[1]:.1f}; agree to {agree:.0e}")
    print(f"compiled: the kernel {compiled} times for {np.log2(lengths.max() / lengths.min()):.1f} doublings of length, ", end="")
    print(f"{len(programs)} programs in all in {spent:.1f} s", flush=True)


def main():
    """Run everything, or the requested part."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--longest", type=int, default=10**8, help="longest stream, in samples")
    parser.add_argument("--folder", help="where the file of the stream is written")
    parser.add_argument("--stream-of", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.stream_of:
        _stream_of(*options.stream_of)
        return
    stream(options.longest, options.folder)
    many_logs()


if __name__ == "__main__":
    main()
