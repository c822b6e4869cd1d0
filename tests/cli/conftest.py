"""Fixtures: a small log, and calls of the command line in this process or in another."""

import dataclasses
import os
import subprocess
import sys

import jax
import numpy as np
import pytest

from jaxcal.cli import _app, main

RATE, SAMPLES = 100.0, 8000
HEADER = "time [s],gyro_x [rad/s],gyro_y [rad/s],gyro_z [rad/s],accel_x [m/s^2],accel_y [m/s^2],accel_z [m/s^2]"


@dataclasses.dataclass(frozen=True)
class Outcome:
    status: int
    out: str
    err: str
    #: code of the error, which tests ask for instead of its wording
    code: str = ""

    @property
    def reason(self):
        """The text on standard error as one line."""
        return " ".join(self.err.split())


@pytest.fixture
def call(monkeypatch, capsys, tmp_path):
    """Call the command line in an empty working folder; returns the exit status, the output, the errors, and the code of the error."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")

    codes = []

    def attempt(argv, attempt=_app.attempt):
        failure = attempt(argv)
        codes.append(failure.code if failure else "")
        return failure

    monkeypatch.setattr(_app, "attempt", attempt)

    def run(*argv):
        status = main([str(word) for word in argv])
        return Outcome(status, *capsys.readouterr(), codes.pop())

    limit = "jax_persistent_cache_min_compile_time_secs"
    before = jax.config.values[limit]
    yield run
    jax.config.update(limit, before)  # a command changes the limit of its process, which is that of the tests here


@pytest.fixture(scope="session")
def shell(tmp_path_factory):
    """Call the command line in a separate process, as a shell does.

    Its compilation cache is that of a new user; with `cached` it is that of the tests.
    """
    tests = {name: value for name, value in os.environ.items() if name.startswith("JAX_COMPILATION") or "PERSISTENT_CACHE" in name}
    # output is buffered, as it is for users
    environment = {name: value for name, value in os.environ.items() if not name.startswith("JAX") and name != "PYTHONUNBUFFERED"}
    environment |= {"XDG_CACHE_HOME": str(tmp_path_factory.mktemp("cache")), "COLUMNS": "80"}

    def run(*argv, cwd, cached=False):
        command = [sys.executable, "-m", "jaxcal", *map(str, argv)]
        found = subprocess.run(
            command, cwd=cwd, env=environment | ({} if not cached else tests), capture_output=True, text=True, check=False
        )
        return Outcome(found.returncode, found.stdout, found.stderr)

    run.environment, run.cached = environment, environment | tests
    return run


@pytest.fixture
def folder(tmp_path):
    """The working folder of `call`."""
    return tmp_path


def table(samples=SAMPLES, seed=0):
    """Rows of time, gyroscope and accelerometer at rest, with white noise of 1e-3 rad/sqrt(s) and 1e-2 m/s/sqrt(s)."""
    noise = np.random.default_rng(seed).standard_normal((samples, 6)) * np.sqrt(RATE) * np.repeat([1e-3, 1e-2], 3)
    return np.column_stack([np.arange(samples) / RATE, noise + np.array([0, 0, 0, 0, 0, 9.80665])])


def save(path, rows, header=HEADER):
    np.savetxt(path, rows, delimiter=",", fmt="%.9g", header=header, comments="")
    return path


@pytest.fixture
def log(folder):
    """A log of 80 s at 100 Hz as CSV with units in its header."""
    return save(folder / "imu.csv", table())


def listing(folder):
    """Names of all files and folders below a folder, including hidden ones."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
