"""Fleets of logs: speed beside one worker, kills and resumption, workers lost, a local Dask cluster; with fixed seeds.

    python benchmarks/fleet.py                                  everything, 1,000 logs (half an hour on two cores, 2.5 GB of disk)
    python benchmarks/fleet.py --logs 100 --kill-logs 40        reduced
    python benchmarks/fleet.py --only speed                     one part: speed, kill, workers, dask, bad
    python benchmarks/fleet.py --folder /scratch/fleet          where logs and results go; by default a temporary folder

The task is "noise": the Whittle fit of Q, N, B and K with intervals, six channels of 10^5 samples a log. All logs differ. Programs come
from a compilation cache that is filled before anything is timed, so that a worker loads them rather than compiles them. Times mean
something only on a machine that does nothing else; processor times are printed beside them.
"""

import argparse
import json
import multiprocessing
import os
import pathlib
import random
import resource
import signal
import subprocess
import sys
import tempfile
import textwrap
import time

import numpy as np

RATE = 100.0


def make_logs(folder, number, samples):
    """Six channels of white noise, bias instability and random walk at 100 Hz, each log with levels of its own, as float32."""
    from jaxcal.noise import Noise

    folder.mkdir(parents=True, exist_ok=True)
    for i in range(number):
        path = folder / f"unit{i:04d}.npz"
        if path.exists():
            continue
        rng = np.random.default_rng(i)
        level = np.repeat([1e-4, 1e-3], 3) * np.exp(0.1 * rng.standard_normal(6))
        y = Noise(N=level, B=0.05 * level, K=2e-4 * level).simulate(samples, rate=RATE, seed=i)
        np.savez(path, gyro=y[:, :3].astype(np.float32), accel=(y[:, 3:] + [0.0, 0.0, 9.80665]).astype(np.float32), rate=RATE)
    return sorted(folder.glob("unit*.npz"))[:number]


def results(out):
    return {path.name: path.read_bytes() for path in (out / "results").iterdir() if not path.name.startswith(".")}


def timed(paths, out, **options):
    from jaxcal.batch import run

    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    mine = time.process_time()
    fleet = run(paths, "noise", out=out, **options)
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    assert len(fleet.done) == len(paths), fleet.failed[:3]
    busy = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return wall, sum(entry.seconds for entry in fleet), np.median([entry.seconds for entry in fleet]), busy, time.process_time() - mine


def warm(paths, folder):
    """Fill the compilation cache, as the first command of a user does."""
    from jaxcal.batch import _run, run

    single(_run)
    run(paths[:2], "noise", out=folder / "warm", resume=False, workers=1)
    run(paths[:2], "noise", out=folder / "warm", resume=False, workers=2)


def single(module, threads=1):
    """Give one worker as many threads as each of two has."""
    from jaxcal.batch._pool import WorkerPool

    module.WorkerPool = lambda workers, _: WorkerPool(workers, threads)


def speed(paths, folder, _):
    from jaxcal.batch import _pool, _run

    rows = {}
    for name, workers, threads in (
        ("one worker, one thread", 1, 1),
        ("one worker, a thread for each core", 1, os.cpu_count()),
        ("two workers, one thread each", 2, 1),
    ):
        single(_run, threads)
        rows[name] = timed(paths, folder / f"speed-{workers}-{threads}", workers=workers, resume=False)
    _run.WorkerPool = _pool.WorkerPool
    print(f"\n{len(paths)} logs, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the end (above 2: others were at work)")
    print(f"{'':40s} time s   sum of logs s   median log s   logs/s   processor s: workers, this process")
    for name, (wall, total, each, busy, mine) in rows.items():
        print(f"{name:40s} {wall:6.1f}   {total:13.1f}   {each:12.3f}   {len(paths) / wall:6.2f}   {busy:.1f}, {mine:.1f}")
    one, both, two = rows.values()
    print(f"two workers: {one[0] / two[0]:.2f} times the speed of one with one thread (limit 1.7), {both[0] / two[0]:.2f} with all")
    print(
        f"time of two workers over half the sum of their logs: {2 * two[0] / two[1]:.3f} (limit 1.2); of one worker's logs: "
        f"{2 * two[0] / one[1]:.3f}"
    )
    print(f"time of one worker over the sum of its logs: {one[0] / one[1]:.3f} (limit 1.2)")
    again = time.perf_counter()
    from jaxcal.batch import run

    fleet = run(paths, "noise", out=folder / "speed-2-1")
    print(
        f"the same call again, all {sum(entry.kept for entry in fleet)} there: {time.perf_counter() - again:.1f} s with tables and overview"
    )
    same = results(folder / "speed-1-1") == results(folder / "speed-2-1")
    print(f"results of one and two workers bit for bit the same: {same}")
    print(f"memory of the largest worker {resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3:.0f} MB, of this process "
          f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3:.0f} MB")  # fmt: skip
    assert same


COUNTED = """
import os
import jaxcal
from jaxcal.batch._tasks import noise as _noise

def counted(log):
    with open(os.path.join(os.environ["FLEET_ROOM"], log.provenance["file"]), "a") as file:
        file.write("x")
    return _noise(log)[0]
"""

RUN = """
import sys
sys.path[:0] = {paths!r}
import fleet_counted, jaxcal
if __name__ == "__main__":
    import jax
    from jaxcal.cli._cache import keep_compiled
    keep_compiled()
    move = lambda done, total, name: print(done, flush=True)
    fleet = jaxcal.batch.run({logs!r}, fleet_counted.counted, out={out!r}, workers=2, progress=move)
    print(len(fleet.done), sum(entry.kept for entry in fleet))
"""


def counted_run(folder, logs, out, name):
    """A script that computes and counts, and the folder in which it counts."""
    folder.mkdir(exist_ok=True)
    (folder / "fleet_counted.py").write_text(textwrap.dedent(COUNTED))
    room = folder / f"room-{name}"
    room.mkdir()
    script = folder / f"{name}.py"
    script.write_text(RUN.format(paths=[str(folder), *sys.path], logs=[str(path) for path in logs], out=str(out)))
    return [sys.executable, str(script)], {**os.environ, "FLEET_ROOM": str(room)}, room


def computed(room):
    return sum(path.stat().st_size for path in room.iterdir())


def kill(paths, folder, arguments):
    """Kill the whole run at random moments and take it up again, until all is done."""
    paths = paths[: arguments.kill_logs]
    command, environment, room = counted_run(folder / "kill", paths, folder / "kill" / "plain", "plain")
    start = time.perf_counter()
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        process.stdout.readline()
        begin = time.perf_counter() - start  # of the first result
        process.stdout.read()
    undisturbed, expected = time.perf_counter() - start, results(folder / "kill" / "plain")
    out, rng = folder / "kill" / "out", random.Random(0)
    command, environment, room = counted_run(folder / "kill", paths, out, "killed")
    kills = left = broken = 0
    for _ in range(arguments.kills):
        process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, start_new_session=True)
        try:
            process.wait(begin * rng.uniform(0.5, 1.2) + (undisturbed - begin) / arguments.kills * rng.uniform(0.0, 2.0))
        except subprocess.TimeoutExpired:
            # half of them the run alone, whose workers must go by themselves; half with the workers
            (os.killpg if rng.random() < 0.5 else os.kill)(process.pid, signal.SIGKILL)
            kills += 1
        process.wait()
        if (out / "results").exists():
            for path in (out / "results").iterdir():
                if path.name.startswith("."):
                    left += 1
                    continue
                try:
                    json.loads(path.read_text())
                except ValueError:
                    broken += 1
    done = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout.split()[-2:]
    found = results(out)
    print(
        f"\n{len(paths)} logs, killed at {kills} of {arguments.kills} random moments (undisturbed {undisturbed:.0f} s), then run to the end"
    )
    print(f"logs done {done[0]}, of them kept by the last run {done[1]}; files equal to those of an undisturbed run: {found == expected}")
    print(
        f"half-written result files: {broken}; temporary files after a kill: {left}, at the end: {len(list((out / 'results').glob('.*')))}"
    )
    twice = computed(room) - len(paths)
    print(f"computed more than once: {twice} logs; in flight at the kills: at most {2 * kills}")
    assert found == expected
    assert not broken
    assert twice <= 2 * kills


def workers(paths, folder, arguments):
    """Kill workers at random while the run goes on."""
    from jaxcal.batch import run

    paths = paths[: arguments.kill_logs]
    plain = run(paths, "noise", out=folder / "workers" / "plain", workers=2)
    rng, state = random.Random(1), {"kills": 0, "next": 2}

    def move(done, total, name):
        children = multiprocessing.active_children()
        if done >= state["next"] and children and state["kills"] < arguments.kills:
            os.kill(rng.choice(children).pid, signal.SIGKILL)
            state["kills"] += 1
            state["next"] = done + rng.randint(1, 3)

    fleet = run(paths, "noise", out=folder / "workers" / "out", workers=2, progress=move)
    first = len(fleet.failed)
    fleet = run(paths, "noise", out=folder / "workers" / "out", workers=2)
    same = results(folder / "workers" / "out") == results(folder / "workers" / "plain")
    print(f"\n{len(paths)} logs, {state['kills']} workers killed at random: {first} logs met two, {len(fleet.failed)} failed after the "
          f"same call again; results equal to those of an undisturbed run: {same}")  # fmt: skip
    assert same
    assert len(plain.done) == len(fleet.done)


def dask(paths, folder, arguments):
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        print("\nDask: not installed (pip install distributed)")
        return
    from jaxcal.batch import run

    paths = paths[: arguments.kill_logs]
    run(paths, "noise", out=folder / "dask" / "plain", workers=2)
    expected = results(folder / "dask" / "plain")
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        client.run(keep)
        start = time.perf_counter()
        fleet = run(paths, "noise", executor=client.get_executor(), workers=2, out=folder / "dask" / "out")
        wall = time.perf_counter() - start
        same = results(folder / "dask" / "out") == expected
        print(f"\nDask, two workers, {len(paths)} logs in {wall:.1f} s: {len(fleet.done)} answered; bit for bit as by processes: {same}")
        assert same
        killed = []

        def move(done, total, name):
            if done == len(paths) // 3:
                killed.append(next(iter(client.run(os.getpid).values())))
                os.kill(killed[0], signal.SIGKILL)

        fleet = run(paths, "noise", executor=client.get_executor(), workers=2, out=folder / "dask" / "lost", progress=move)
        same = results(folder / "dask" / "lost") == expected
        print(f"a worker killed after {len(paths) // 3} logs: {len(fleet.done)} answered, {len(fleet.failed)} not; bit for bit so: {same}")
        assert same


#: bad logs by kind: what ends in a sentence, and in nothing else
BAD = {
    "empty.csv": b"",
    "text.csv": b"these are my notes\n" * 50,
    "zeros.bin": bytes(5000),
    "cut.npz": b"PK\x03\x04" + bytes(range(200)),
    "pointer.mcap": b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 990\n",
    "counter.csv": b"sample_idx,gx [deg/s],gy [deg/s],gz [deg/s]\n" + b"".join(b"%d,0.1,0.2,%d.5\n" % (i, i % 7) for i in range(500)),
    "wrong_unit.csv": b"time_s,ax [g],ay [g],az [g]\n"
    + b"".join(b"%d.%02d,0.1,0.2,9.%d\n" % (i // 100, i % 100, 7 + i % 3) for i in range(500)),
    "wide.csv": b"1.0," * 200_000 + b"1\n",
    "damaged.ulg": b"ULog\x01\x12\x35\x01" + bytes(range(256)) * 8,
    "damaged.parquet": b"PAR1" + bytes(range(256)) * 8 + b"PAR1",
    "damaged.h5": b"\x89HDF\r\n\x1a\n" + bytes(range(256)) * 8,
    "damaged.mat": b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + bytes(range(256)) * 4,
    "caf\udce9.csv": b"no text, in a file whose name is none",
    "twice.csv": b"t,gx,gy,gz\n" + 2 * b"".join(b"0.%03d,0.1,0.2,%d.5\n" % (i, i % 7) for i in range(500)),
}  # fmt: skip


def bad(paths, folder, arguments):
    """The command on many small logs, a tenth of which are bad in every way."""
    logs = folder / "bad"
    logs.mkdir()
    rng, number = np.random.default_rng(0), arguments.logs
    for i in range(number):
        if i % 10 == 9:
            name, content = list(BAD.items())[i // 10 % len(BAD)]
            (logs / f"unit{i:04d}_{name}").write_bytes(content)
            continue
        rows = 0.001 * rng.standard_normal((1000, 3))
        text = "".join(f"{t / 100:.2f},{x:.6f},{y:.6f},{z:.6f}\n" for t, (x, y, z) in enumerate(rows))
        (logs / f"unit{i:04d}.csv").write_text("time_s,gx [rad/s],gy [rad/s],gz [rad/s]\n" + text)
    (logs / "unit9999_bomb.npz").write_bytes(b"")
    np.savez_compressed(logs / "unit9999_bomb.npz", gyro=np.zeros((5_000_000, 3)), rate=100.0)
    words = [
        sys.executable,
        "-m",
        "jaxcal.cli",
        "batch",
        str(logs),
        "--task",
        "allan",
        "--out",
        str(folder / "bad-out"),
        "--set",
        "m=octave",
    ]
    begin = time.perf_counter()
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    manifest = json.loads((folder / "bad-out" / "manifest.json").read_text())
    sentences = [row["reason"] for row in manifest["logs"] if row["status"] == "failed"]
    count = manifest["count"]
    lost = [name for name, text in results(folder / "bad-out").items() if b'"trace"' in text or b"its worker process died" in text]
    print(f"\n{count['logs']} logs, of which {count['logs'] - 9 * number // 10} are bad: {count['done']} results, "
        f"{len(sentences)} sentences, "
          f"status {done.returncode}, {len(lost)} by a worker that was lost or a fault, {time.perf_counter() - begin:.0f} s")  # fmt: skip
    for reason in sorted({reason.partition(": ")[2][:110] for reason in sentences}):
        print(f"    {reason}")
    assert done.returncode == 0, done.stderr[-2000:]
    assert (count["done"], len(sentences), len(lost)) == (9 * number // 10, number // 10 + 1, 0)


def keep():
    from jaxcal.cli._cache import keep_compiled

    keep_compiled()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("speed", "kill", "workers", "dask", "bad"))
    parser.add_argument("--logs", type=int, default=1000)
    parser.add_argument("--samples", type=int, default=100_000)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--kill-logs", type=int, default=120, help="logs of the parts kill, workers and dask")
    parser.add_argument("--folder", type=pathlib.Path)
    arguments = parser.parse_args()
    arguments.kill_logs = min(arguments.kill_logs, arguments.logs)
    with tempfile.TemporaryDirectory(dir=arguments.folder, prefix="fleet-") as folder:
        folder = pathlib.Path(folder)
        os.environ["XDG_CACHE_HOME"] = str(folder / "cache")
        keep()
        needed = arguments.logs if arguments.only in (None, "speed") else arguments.kill_logs
        paths = [] if arguments.only == "bad" else make_logs((arguments.folder or folder) / "logs", needed, arguments.samples)
        if paths:
            warm(paths, folder)
        for part in (speed, kill, workers, dask, bad):
            if arguments.only in (None, part.__name__):
                part(paths, folder, arguments)


if __name__ == "__main__":
    main()
