"""Some libraries read in a separate process: if it crashes, an error explains this, and the next file is read."""

import os
import subprocess
import sys

import numpy as np
import polars as pl
import pytest

from jaxcal import read
from jaxcal.io._readers import _sandbox


@pytest.fixture
def log(still, tmp_path):
    path = tmp_path / "log.parquet"
    pl.DataFrame({"t": still.time, "gx": still.gyro[:, 0]}).write_parquet(path)
    return path


@pytest.fixture
def program(tmp_path, monkeypatch):
    """Replace the program of the reading process."""

    def put(text):
        _sandbox.sandbox.stop()
        (tmp_path / "program.py").write_text(text)
        monkeypatch.setattr(_sandbox, "__file__", str(tmp_path / "program.py"))

    yield put
    _sandbox.sandbox.stop()


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("import os; os.abort()", "broke_down"),
        ("import os; input(); os.abort()", "broke_down"),
        ("import time; print('!', end='', flush=True); time.sleep(60)", "damaged"),
        ("import time; x = b'x' * (1 << 28); time.sleep(60)", "too_large"),
    ],
)
def test_a_process_that_breaks_down_is_replaced(text, code, log, program, monkeypatch, refuses):
    with monkeypatch.context() as inside:
        inside.setattr(_sandbox, "_SECONDS", 2.0)
        inside.setattr(_sandbox, "_MEMORY", 1 << 27)
        program(text)
        with refuses(code):
            read(log, quiet=True)
    monkeypatch.undo()
    assert len(read(log, quiet=True).time) == 400


def test_one_process_serves_all_files(log):
    read(log, quiet=True)
    first = _sandbox.sandbox._process.pid
    read(log, quiet=True)
    assert _sandbox.sandbox._process.pid == first
    _sandbox.sandbox._process.kill()
    _sandbox.sandbox._process.wait()
    assert len(read(log, quiet=True).time) == 400


def test_threads_take_no_memory_away(log):
    code = f"import jaxcal; jaxcal.read({str(log)!r}, quiet=True)"
    subprocess.run([sys.executable, "-c", code], env=os.environ | {"POLARS_MAX_THREADS": "64"}, check=True)


def test_nothing_is_left_running(log):
    code = (
        f"import jaxcal; jaxcal.read({str(log)!r}, quiet=True); "
        "from jaxcal.io._readers._sandbox import sandbox; print(sandbox._process.pid)"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    with pytest.raises(ProcessLookupError):
        os.kill(int(done.stdout), 0)


def test_all_kinds_of_columns_come_through(tmp_path, still, refuses):
    frame = pl.DataFrame(
        {
            "time": pl.Series(still.time * 1e9).cast(pl.Int64).cast(pl.Datetime("ns")),
            "gx": still.gyro[:, 0].astype(np.float32),
            "gy": pl.Series([None, *still.gyro[1:, 1]]),
            "gz": pl.Series(range(400), dtype=pl.Int16),
            "note": ["a"] * 400,
            "ok": [True] * 400,
        }
    )
    frame.write_parquet(tmp_path / "log.parquet")
    log = read(tmp_path / "log.parquet", units="gyro=rad/s", quiet=True)
    np.testing.assert_array_equal(log.gyro[1:, 0], frame["gx"].to_numpy()[1:])
    assert np.isnan(log.gyro[0]).tolist() == [False, True, False]
    np.testing.assert_array_equal(log.gyro[1:, 2], np.arange(1, 400))
    with refuses("text"):
        read(tmp_path / "log.parquet", columns="gyro=note", rate=100.0, quiet=True)
