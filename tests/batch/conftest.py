"""Fixtures: small logs, and a module of tasks that worker processes can import."""

import importlib
import sys
import textwrap

import numpy as np
import pytest

TASKS = '''
import os, pathlib, signal, time

def here(log):
    return pathlib.Path(os.environ["FLEET_ROOM"])

def counted(log):
    """Number of computations of each log, in files; then its mean and size."""
    with open(here(log) / (log.provenance["file"] + ".count"), "a") as file:
        file.write("x")
    return {"mean": log.gyro.mean(axis=0), "samples": len(log.time), "file": log.provenance["file"]}

def slow(log):
    found = counted(log)
    time.sleep(0.15)
    return found

def deadly(log):
    """unit3 kills its worker the first time, unit5 always, unit6 never ends where a room says so."""
    name = pathlib.Path(log.provenance["file"]).stem
    found = counted(log)
    marker = here(log) / (name + ".died")
    if name == "unit5" or (name == "unit3" and not marker.exists()):
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return found

def stuck(log):
    if "unit1" in log.provenance["file"]:
        time.sleep(1000)
    return {"samples": len(log.time)}

def greedy(log):
    if "unit1" in log.provenance["file"]:
        held = []
        for _ in range(40):
            held.append(b"1" * 100_000_000)
            time.sleep(0.1)
    return {"samples": len(log.time)}

def strange(log):
    raise ZeroDivisionError("seven\\nlines")

def leaves(log):
    raise SystemExit(3)
'''


@pytest.fixture(scope="session")
def tasks(tmp_path_factory):
    """The module of tasks, in a folder on the path of this process, which spawned workers receive."""
    folder = tmp_path_factory.mktemp("tasks")
    (folder / "fleet_tasks.py").write_text(textwrap.dedent(TASKS))
    sys.path.insert(0, str(folder))
    yield importlib.import_module("fleet_tasks")
    sys.path.remove(str(folder))


@pytest.fixture
def room(tmp_path, monkeypatch):
    """Folder in which tasks count their calls; `counts(room)` returns how often each log was computed."""
    folder = tmp_path / "room"
    folder.mkdir()
    monkeypatch.setenv("FLEET_ROOM", str(folder))
    return folder


def counts(room):
    return {file.stem: len(file.read_text()) for file in sorted(room.glob("*.count"))}


def make_logs(folder, number, samples=200, scale=1.0):
    """Write logs unit1.npz ... of white noise at 100 Hz."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for i in range(1, number + 1):
        rng = np.random.default_rng(i)
        path = folder / f"unit{i}.npz"
        np.savez(path, time=np.arange(samples) / 100, gyro=scale * 1e-3 * rng.standard_normal((samples, 3)))
        paths.append(path)
    return paths


def results(out):
    """Name -> bytes of every result file, including hidden ones."""
    return {path.name: path.read_bytes() for path in (out / "results").iterdir()}
