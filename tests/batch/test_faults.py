"""Faults during a run over many logs: all results together equal those of an undisturbed run, and no file is incomplete.

benchmarks/fleet.py has a longer version.
"""

import importlib.util
import json
import multiprocessing
import os
import pathlib
import random
import signal
import subprocess
import sys
import textwrap
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

import jaxcal
from jaxcal import ExportError, JaxcalError
from jaxcal.batch import run

from .conftest import counts, make_logs, results

posix = pytest.mark.skipif(os.name != "posix", reason="signals and limits of POSIX")


def undisturbed(tasks, logs, out):
    """Results of the same run without faults."""
    with ThreadPoolExecutor(1) as pool:
        run(logs, tasks.slow, executor=pool, out=out)
    return results(out)


def same(found, expected):
    """Check that results are equal, except for the name of the task."""
    plain = {name: {**json.loads(text), "task": 0} for name, text in found.items()}
    assert plain == {name: {**json.loads(text), "task": 0} for name, text in expected.items()}


@pytest.mark.long
@posix
def test_workers_killed_from_outside_and_by_their_logs(tasks, room, tmp_path):
    """unit3 kills its worker once and unit5 always; the test kills two more workers at random."""
    logs = make_logs(tmp_path / "logs", 9)
    expected = undisturbed(tasks, logs, tmp_path / "plain")
    rng, killed = random.Random(0), []

    def move(done, total, name):
        workers = multiprocessing.active_children()
        if done in (2, 5) and workers:
            worker = rng.choice(workers)
            killed.append(worker.pid)
            os.kill(worker.pid, signal.SIGKILL)

    before = counts(room)
    fleet = run(tmp_path / "logs", tasks.deadly, out=tmp_path / "out", workers=2, progress=move)
    assert len(killed) == 2
    failed = {entry.path.stem: entry for entry in fleet.failed}
    assert {"unit5"} <= set(failed) <= {"unit3", "unit5"}  # unit3 may have been in one of the two killed workers
    assert "its worker process died twice" in failed["unit5"].reason
    assert failed["unit5"].again
    # every log is computed once, except those that a worker had when it died
    assert sum(count - before[name] - 1 for name, count in counts(room).items()) <= 2 + len(killed)
    assert not multiprocessing.active_children()
    (logs[4]).unlink()
    again = run(tmp_path / "logs", tasks.deadly, out=tmp_path / "out", workers=1)
    assert [entry.status for entry in again] == ["done"] * 8
    assert [entry.path.stem for entry in again if not entry.kept] == [name for name in failed if name == "unit3"]
    five = next(name for name in expected if name.startswith("unit5"))
    same(*({name: text for name, text in each.items() if name != five} for each in (results(tmp_path / "out"), expected)))


@pytest.mark.long
@posix
def test_a_log_without_end_is_given_up(tasks, tmp_path):
    logs = make_logs(tmp_path / "logs", 2)
    fleet = run(logs, tasks.stuck, workers=1, timeout=8.0)  # enough time for the imports of the other log
    assert [entry.status for entry in fleet] == ["failed", "done"]
    assert fleet.failed[0].reason == "unit1.npz: it took longer than 8 s and was given up"


@pytest.mark.long
@posix
def test_a_log_that_takes_too_much_memory_is_given_up(tasks, tmp_path):
    logs = make_logs(tmp_path / "logs", 2)
    fleet = run(logs, tasks.greedy, workers=1, memory=1.2e9)
    assert [entry.status for entry in fleet] == ["failed", "done"]
    assert fleet.failed[0].reason.startswith("unit1.npz: it took more than 1.2 GB of memory and was given up; use fewer workers")


def environment(*folders):
    """That of a process which imports the same package, and modules of some folders."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(pathlib.Path(__file__).parents[2]), *folders, *sys.path])}


SCRIPT = """
import sys
sys.path.insert(0, {tasks!r})
import fleet_tasks, jaxcal
from concurrent.futures import ThreadPoolExecutor
if __name__ == "__main__":
    def move(done, total, name):
        print(done, flush=True)
    jaxcal.batch.run({logs!r}, fleet_tasks.slow, out={out!r}, workers={workers}, progress=move)
"""


@posix
def test_a_run_that_is_killed_is_taken_up_again_and_leaves_no_workers(tasks, room, tmp_path):
    logs = make_logs(tmp_path / "logs", 7)
    expected = undisturbed(tasks, logs, tmp_path / "plain")
    before, out = counts(room), tmp_path / "out"
    script = tmp_path / "script.py"
    folder = str(pathlib.Path(tasks.__file__).parent)
    script.write_text(SCRIPT.format(tasks=folder, logs=str(tmp_path / "logs"), out=str(out), workers=2))
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True, env=environment()) as process:
        for line in process.stdout:
            if int(line) == 2:
                workers = pathlib.Path(f"/proc/{process.pid}/task/{process.pid}/children")
                children = [int(word) for word in workers.read_text().split()] if workers.exists() else []
                process.kill()
                break
    for child in children:  # children end with their parent, although it was killed
        deadline = time.monotonic() + 10
        while pathlib.Path(f"/proc/{child}/cmdline").exists() and pathlib.Path(f"/proc/{child}/cmdline").read_bytes():
            assert time.monotonic() < deadline
            time.sleep(0.05)
    done = results(out)
    assert 2 <= len([name for name in done if not name.startswith(".")]) < 7
    assert all(text == expected[name] for name, text in done.items() if not name.startswith("."))
    with ThreadPoolExecutor(2) as pool:
        fleet = run(tmp_path / "logs", tasks.slow, executor=pool, out=out)
    assert results(out) == expected
    assert sum(entry.kept for entry in fleet) == len([name for name in done if not name.startswith(".")])
    twice = sum(count - before[name] - 1 for name, count in counts(room).items())
    assert twice <= 2 * 2  # only logs that the two workers held: one whose result was on its way, and the next


def test_files_truncated_removed_and_changed_during_the_run(tasks, room, tmp_path, monkeypatch):
    logs = make_logs(tmp_path / "logs", 6)
    whole = [path.read_bytes() for path in logs]

    def move(done, total, name):
        if done == 1:
            logs[3].write_bytes(whole[3][:1000])
            logs[4].unlink()
            logs[5].write_bytes(whole[0])

    with ThreadPoolExecutor(1) as pool:
        fleet = run(logs, tasks.slow, executor=pool, workers=1, out=tmp_path / "out", progress=move)
        status = {entry.path.stem: (entry.status, entry.again) for entry in fleet}
        assert status == {f"unit{i}": ("done", False) for i in (1, 2, 3, 6)} | {"unit4": ("failed", False), "unit5": ("failed", True)}
        # the result of a log belongs to the content that was read
        assert fleet.entries[5].sha256 == fleet.entries[0].sha256
        for path, content in zip(logs, whole, strict=True):
            path.write_bytes(content)
        mended = run(logs, tasks.slow, executor=pool, out=tmp_path / "out")
        assert [entry.kept for entry in mended] == [True, True, True, False, False, False]
        assert len(mended.done) == 6

        # a log that is still being written
        def growing(path, **options):
            log = jaxcal.read(path, **options)
            with open(path, "ab") as file:
                file.write(b"more")
            return log

        monkeypatch.setattr("jaxcal.batch._answer.read", growing)
        (entry,) = run(logs[0], tasks.slow, executor=pool)
        assert (entry.status, entry.again) == ("failed", True)
        assert "changed while it was read" in entry.reason


@posix
def test_a_full_disk_ends_the_run_with_a_sentence_and_keeps_what_is_done(tasks, room, tmp_path, refuses):
    import resource

    logs = make_logs(tmp_path / "logs", 5)
    expected = undisturbed(tasks, logs, tmp_path / "plain")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def move(done, total, name):
        if done == 2:
            resource.setrlimit(resource.RLIMIT_FSIZE, (500, limits[1]))  # limit of the size of a file, too small for a result

    with ThreadPoolExecutor(1) as pool:
        try:
            with refuses("not_written", ExportError):
                run(logs, tasks.slow, executor=pool, workers=1, out=tmp_path / "out", progress=move)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        found = results(tmp_path / "out")
        assert len(found) == 2
        assert found.items() <= expected.items()
        run(logs, tasks.slow, executor=pool, out=tmp_path / "out")
    assert results(tmp_path / "out") == expected


def test_a_folder_that_cannot_be_listed_costs_no_other(tasks, room, tmp_path, monkeypatch):
    make_logs(tmp_path / "logs", 2)
    make_logs(tmp_path / "logs" / "closed", 2)
    scandir = os.scandir

    def refused(path="."):  # imitates missing rights, which the superuser would not notice
        if str(path).endswith("closed"):
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refused)
    with ThreadPoolExecutor(1) as pool:
        fleet = run(tmp_path / "logs", tasks.slow, executor=pool, out=tmp_path / "out")
        assert [entry.status for entry in fleet] == ["failed", "done", "done"]
        assert fleet.failed[0].reason == "the folder cannot be listed: permission denied"
        monkeypatch.undo()
        monkeypatch.setenv("FLEET_ROOM", str(room))
        assert len(run(tmp_path / "logs", tasks.slow, executor=pool, out=tmp_path / "out").done) == 4


def test_a_second_run_into_the_same_folder_is_refused(tasks, room, tmp_path, refuses):
    logs = make_logs(tmp_path / "logs", 2)
    refusals = []

    def move(done, total, name):
        with refuses("busy"):
            run(logs, tasks.slow, executor=pool, out=tmp_path / "out")
        refusals.append(done)

    with ThreadPoolExecutor(1) as pool:
        run(logs, tasks.slow, executor=pool, out=tmp_path / "out", progress=move)
        assert refusals == [1, 2]
        if os.name == "posix":  # another process has the lock, which is free as soon as that process ends in any way
            hold = "import fcntl, sys, time; f = open(sys.argv[1]); fcntl.flock(f, fcntl.LOCK_EX); print(1, flush=True); time.sleep(60)"
            with subprocess.Popen([sys.executable, "-c", hold, tmp_path / "out" / ".lock"], stdout=subprocess.PIPE) as other:
                other.stdout.readline()
                with refuses("busy"):
                    run(logs, tasks.slow, executor=pool, out=tmp_path / "out")
                other.kill()
        assert len(run(logs, tasks.slow, executor=pool, out=tmp_path / "out").done) == 2


def test_half_written_files_of_a_killed_run_are_cleared_and_its_results_not_trusted(tasks, room, tmp_path):
    logs = make_logs(tmp_path / "logs", 3)
    expected = undisturbed(tasks, logs, tmp_path / "out")
    files = list((tmp_path / "out" / "results").iterdir())
    (tmp_path / "out" / "results" / ".0123.part").write_text("{")
    files[0].write_text("[" * 100_000)
    files[1].write_bytes(b"\xff\xfe\x00")
    with ThreadPoolExecutor(1) as pool:
        run(logs, tasks.slow, executor=pool, out=tmp_path / "out")
    assert results(tmp_path / "out") == expected


@posix
def test_a_script_without_a_guard_is_told_so(tasks, tmp_path):
    """Spawned workers import the script again and would start the run again without the guard."""
    make_logs(tmp_path / "logs", 1)
    script = tmp_path / "script.py"
    script.write_text(f"import jaxcal\njaxcal.batch.run({str(tmp_path / 'logs')!r}, 'allan', workers=1)\n")
    found = subprocess.run([sys.executable, script], capture_output=True, text=True, env=environment(), check=False)
    assert found.returncode == 1
    assert 'if __name__ == "__main__":' in found.stderr.splitlines()[-1]


DASK = """
import os, signal, sys, threading, time
sys.path.insert(0, {tasks!r})
import fleet_tasks, jaxcal
from distributed import Client, LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        client.run(lambda: sys.path.insert(0, {tasks!r}))
        def move(done, total, name):
            if done == 3:
                pids = client.run(os.getpid)
                os.kill(next(iter(pids.values())), signal.SIGKILL)  # its nanny starts another
            if done == 6:
                client.restart(wait_for_workers=False)  # the scheduler forgets all it was given
        fleet = jaxcal.batch.run({logs!r}, fleet_tasks.slow, executor=client.get_executor(), workers=2, out={out!r}, progress=move)
        print(len(fleet.done), [entry.reason for entry in fleet.failed])
"""


@posix
@pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="needs distributed (extra dask)")
def test_a_cluster_gives_the_same_and_survives_the_loss_of_a_worker_and_a_restart(tasks, room, tmp_path):
    logs = make_logs(tmp_path / "logs", 10)
    expected = undisturbed(tasks, logs, tmp_path / "plain")
    script = tmp_path / "script.py"
    folder = str(pathlib.Path(tasks.__file__).parent)
    script.write_text(textwrap.dedent(DASK).format(tasks=folder, logs=str(tmp_path / "logs"), out=str(tmp_path / "out")))
    found = subprocess.run([sys.executable, script], capture_output=True, text=True, env=environment(folder), check=False, timeout=120)
    assert found.stdout.strip() == "10 []", found.stderr[-3000:]
    assert results(tmp_path / "out") == expected


def test_an_executor_that_closes_ends_the_run_with_a_sentence_and_another_goes_on(tasks, room, tmp_path):
    class Closing(ThreadPoolExecutor):
        given = 0

        def submit(self, *arguments):
            self.given += 1
            if self.given > 3:
                raise RuntimeError("the scheduler is gone")
            return super().submit(*arguments)

    logs, out = make_logs(tmp_path / "logs", 5), tmp_path / "out"
    expected = undisturbed(tasks, logs, tmp_path / "plain")
    with Closing(1) as pool, pytest.raises(JaxcalError) as caught:
        run(logs, tasks.slow, executor=pool, workers=1, out=out)
    assert "the scheduler is gone" in str(caught.value)
    assert f"of 5 logs are done and kept in {out}" in str(caught.value)
    done = len(results(out))
    assert 1 <= done <= 3
    with ThreadPoolExecutor(1) as pool:
        assert sum(entry.kept for entry in run(logs, tasks.slow, executor=pool, out=out)) == done
    assert results(out) == expected
