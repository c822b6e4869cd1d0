"""A limited number of runs of `benchmarks/fuzz.py`, which mutates small logs of every format."""

import pathlib
import subprocess
import sys

import pytest

SCRIPT = pathlib.Path(__file__).resolve().parents[2] / "benchmarks" / "fuzz.py"
READERS = "csv,headers,lines,records,zip,npy,npz,parquet,bag1,sqlite3,mcap,ulog,dataflash,mat5,hdf5,mat73,workbook,tdms,lvm"


@pytest.mark.parametrize("each", [10, pytest.param(60, marks=pytest.mark.long)])
def test_mutated_logs_are_read_or_refused(each):
    for module in ("polars", "rosbags", "h5py", "nptdms", "python_calamine"):
        pytest.importorskip(module)
    words = [sys.executable, str(SCRIPT), "--only", READERS, "--each", str(each)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1].startswith(f"{19 * each} inputs, 0 crashes")
