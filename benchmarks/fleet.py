"""Fleets of logs, with fixed seeds: speed relative to one worker, kills and resumption, lost workers, a local Dask cluster.

    python benchmarks/fleet.py                                  everything, 1,000 logs (half an hour on two cores, 2.5 GB of disk)
    python benchmarks/fleet.py --logs 100 --kill-logs 40        reduced
    python benchmarks/fleet.py --only speed                     one part: speed, kill, workers, dask, bad
    python benchmarks/fleet.py --only bad                       1,000 small logs, a tenth of them bad: undisturbed, killed, on Dask
    python benchmarks/fleet.py --folder /scratch/fleet          folder for logs and results; by default a temporary folder

The task is "noise": the Whittle fit of Q, N, B and K with intervals, for six channels of 10^5 samples per log. All logs differ. The
compilation cache is filled before anything is timed, so that workers load programs instead of compiling them. Times are meaningful
only on a machine that does nothing else; CPU times are printed beside them.
"""

import argparse
import gzip
import io
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
import zipfile

import numpy as np

RATE = 100.0


def make_logs(folder, number, samples):
    """Write logs with six channels of white noise, bias instability and random walk at 100 Hz, as float32; each log has its own levels."""
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
    """Fill the compilation cache, as a user's first command does."""
    from jaxcal.batch import _run, run

    single(_run)
    run(paths[:2], "noise", out=folder / "warm", resume=False, workers=1)
    run(paths[:2], "noise", out=folder / "warm", resume=False, workers=2)


def single(module, threads=1):
    """Give a single worker as many threads as each of two workers has."""
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
from jaxcal.batch._tasks import perform

def counted(log):
    with open(os.path.join(os.environ["FLEET_ROOM"], log.provenance["file"]), "a") as file:
        file.write("x")
    return perform("noise", log, {})["result"]
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
    """Kill the whole run at random moments and resume it, until all is done."""
    paths = paths[: arguments.kill_logs]
    command, environment, room = counted_run(folder / "kill", paths, folder / "kill" / "plain", "plain")
    start = time.perf_counter()
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        process.stdout.readline()
        begin = time.perf_counter() - start  # time of the first result
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
            # half of the kills hit the run alone, whose workers must then end by themselves; the other half hit the workers too
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
    print(f"computed more than once: {twice} logs; held by workers at the kills: at most {4 * kills}")
    assert found == expected
    assert not broken
    assert twice <= 4 * kills


def workers(paths, folder, arguments):
    """Kill workers at random while the run continues."""
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


ROWS = b"".join(b"0.%03d,0.1,0.2,%d.5\n" % (i, i % 7) for i in range(500))
#: bad logs by kind: each must give a sentence and nothing else
BAD = {
    "empty.csv": b"",
    "text.csv": b"these are my notes\n" * 50,
    "zeros.bin": bytes(5000),
    "cut.npz": b"PK\x03\x04" + bytes(range(200)),
    "pointer.mcap": b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 990\n",
    "counter.csv": b"sample_idx,gx [deg/s],gy [deg/s],gz [deg/s]\n" + b"".join(b"%d,0.1,0.2,%d.5\n" % (i, i % 7) for i in range(500)),
    "wrong_unit.csv": b"time_s,ax [g],ay [g],az [g]\n"
    + b"".join(b"%d.%02d,0.1,0.2,9.%d\n" % (i // 100, i % 100, 7 + i % 3) for i in range(500)),
    "no_gravity.csv": b"time_s,ax,ay,az\n" + b"".join(b"%d.%02d,0.%d,0.2,0.%d\n" % (i // 100, i % 100, i % 9, i % 4) for i in range(500)),
    "two_devices.csv": b"time_ms,device,ax,ay,az\n"
    + b"".join(b"%d,d%d,0.1,0.2,9.%d\n" % (10 * (i // 2), i % 2, i % 9) for i in range(500)),
    "wide.csv": b"1.0," * 200_000 + b"1\n",
    "twice.csv": b"t,gx,gy,gz\n" + 2 * ROWS,
    "backwards.csv": b"t,gx,gy,gz\n" + b"".join(reversed(ROWS.splitlines(keepends=True)))[:40] * 200,
    "huge.csv": b"t,gx,gy,gz\n" + ROWS.replace(b"0.1", b"1e999"),
    "page.csv": b"<!DOCTYPE html><html><body>404</body></html>",
    "list.txt": b'[{"time": 1, "x": 2}]' * 100,
    "book.dat": b"\xd0\xcf\x11\xe0" + bytes(600),
    "damaged.ulg": b"ULog\x01\x12\x35\x01" + bytes(range(256)) * 8,
    "damaged.bin": b"\xa3\x95\x80" + bytes(range(256)) * 8,
    "damaged.bag": b"#ROSBAG V2.0\n" + bytes(range(256)) * 8,
    "damaged.db3": b"SQLite format 3\0" + bytes(range(256)) * 8,
    "damaged.parquet": b"PAR1" + bytes(range(256)) * 8 + b"PAR1",
    "damaged.h5": b"\x89HDF\r\n\x1a\n" + bytes(range(256)) * 8,
    "damaged.mat": b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + bytes(range(256)) * 4,
    "caf\udce9.csv": b"no text, in a file whose name is none",
    "new\nline.csv": b"no text, in a file whose name has two lines",
}  # fmt: skip


def bombs():
    """Files that unpack to far more data than a log can have."""
    arrays, packed = io.BytesIO(), gzip.compress(b"0.0,1.0,2.0,3.0\n" * 5_000_000, 9)
    np.savez_compressed(arrays, gyro=np.zeros((5_000_000, 3)), rate=100.0)
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("log.csv", "0.0,1.0,2.0,3.0\n" * 10_000_000)
    return {"bomb.npz": arrays.getvalue(), "bomb.csv.gz": packed, "bomb.dat": archive.getvalue()}


def bad(paths, folder, arguments):
    """Run the command on many small logs, a tenth of them bad in every way: undisturbed, killed repeatedly, and on a Dask cluster."""
    logs = folder / "bad"
    logs.mkdir()
    rng, number, kinds = np.random.default_rng(0), arguments.logs, list((BAD | bombs()).items())
    for i in range(number):
        if i % 10 == 9:
            name, content = kinds[i // 10 % len(kinds)]
            (logs / f"unit{i:04d}_{name}").write_bytes(content)
            continue
        rows = 0.001 * rng.standard_normal((300, 3))
        text = "".join(f"{t / 100:.2f},{x:.6f},{y:.6f},{z:.6f}\n" for t, (x, y, z) in enumerate(rows))
        (logs / f"unit{i:04d}.csv").write_text("time_s,gx [rad/s],gy [rad/s],gz [rad/s]\n" + text)
    good = 9 * number // 10

    def words(out, *more):
        return [sys.executable, "-m", "jaxcal", "batch", str(logs), "--task", "allan", "--set", "m=octave", "--out", str(out), *more]

    def told(title, out, done, seconds):
        manifest = json.loads((out / "manifest.json").read_text())
        count = manifest["count"]
        lost = [name for name, text in results(out).items() if b'"trace"' in text or b"its worker process died" in text]
        print(f"{title}: {count['logs']} logs, {count['done']} results, {count['failed']} sentences, status {done.returncode}, "
              f"{len(lost)} by a worker that was lost or a fault, {seconds:.0f} s", flush=True)  # fmt: skip
        assert done.returncode == 0, done.stderr[-2000:]
        assert (count["done"], count["failed"], len(lost)) == (good, number - good, 0), lost
        return [row["reason"] for row in manifest["logs"] if row["status"] == "failed"]

    print(f"\n{number} logs, {number - good} of them bad, of {len(kinds)} kinds")
    begin = time.perf_counter()
    done = subprocess.run(words(folder / "bad-out"), capture_output=True, text=True, check=False)
    sentences = told("as it is", folder / "bad-out", done, time.perf_counter() - begin)
    for reason in sorted({reason.partition(": ")[2][:110] for reason in sentences}):
        print(f"    {reason}")
    nothing = folder / "only-bad"
    nothing.mkdir()
    (nothing / "empty.csv").touch()
    status = subprocess.run(
        [*words(folder / "none")[:4], str(nothing), *words(folder / "none")[5:]], capture_output=True, check=False
    ).returncode
    print(f"a folder with a bad log alone: status {status}")
    assert status == 1
    expected = results(folder / "bad-out")

    rng, out, kills, begin = random.Random(0), folder / "bad-killed", 0, time.perf_counter()
    while kills < arguments.kills:
        before = len(list((out / "results").glob("*.json"))) if out.exists() else 0
        wanted = before + rng.randint(1, max(1, 2 * (number - before) // (arguments.kills + 1 - kills)))
        process = subprocess.Popen(words(out), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
        while process.poll() is None and (not out.exists() or len(list((out / "results").glob("*.json"))) < min(wanted, number - 1)):
            time.sleep(0.01)
        if process.poll() is None:
            # half of the kills hit the command alone, whose workers must then end by themselves; the other half hit the workers too
            (os.killpg if rng.random() < 0.5 else os.kill)(process.pid, signal.SIGKILL)
            kills += 1
        process.wait()
        broken = [path for path in (out / "results").glob("*.json") if not path.read_text().endswith("}\n")]
        assert not broken, broken
    done = subprocess.run(words(out), capture_output=True, text=True, check=False)
    told(f"killed at {kills} random moments, then run to the end", out, done, time.perf_counter() - begin)
    left = [path.name for path in [*out.glob(".jaxcal-*"), *(out / "results").glob(".*")]]
    print(f"results equal to those of an undisturbed run: {results(out) == expected}; left behind: {left}")
    assert results(out) == expected
    assert not left


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
    if arguments.folder:
        arguments.folder.mkdir(parents=True, exist_ok=True)
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
