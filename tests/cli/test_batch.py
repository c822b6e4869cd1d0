"""`jaxcal batch`."""

import json

import numpy as np
import pytest

import jaxcal

from .conftest import listing


@pytest.fixture
def logs(folder):
    """Three logs of a gyroscope."""
    (folder / "logs").mkdir()
    for i in range(3):
        rng = np.random.default_rng(i)
        np.savez(folder / "logs" / f"unit{i}.npz", time=np.arange(500) / 100, gyro=1e-3 * rng.standard_normal((500, 3)))
    return folder / "logs"


def test_a_fleet_is_answered_and_what_failed_is_told(call, folder, logs):
    (logs / "bad.csv").write_text("time,gyro_x\n0,1\n")
    found = call("batch", "logs", "--task", "allan", "--out", "out", "--workers", "1", "--set", "kind=mdev", "--set", "m=[1,10,100]")
    assert (found.status, found.err) == (0, "")
    lines = found.out.splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[0] == "4 logs: 3 answered, 1 not"
    assert "gyro_x.mdev(0.1 s)" in found.out
    assert " - bad.csv: the time column never rises; name another one with --columns" in found.out  # as it is typed
    assert any(line.startswith("wrote out/: overview.html") for line in lines)
    assert [name for name in listing(folder / "out") if "/" not in name] == [
        ".lock", "manifest.json", "overview.html", "results", "summary.csv", "summary.parquet"
    ]  # fmt: skip
    table = json.loads(next((folder / "out" / "results").glob("unit1*.json")).read_text())
    expected = jaxcal.allan.deviation(np.load(logs / "unit1.npz")["gyro"][:, 2], 100.0, kind="mdev", m=[1, 10, 100])
    np.testing.assert_allclose(table["result"]["channels"]["gyro_z"]["deviation"], expected.deviation, rtol=1e-9)
    # all results exist, so that no worker is started
    again = call("batch", "logs/*.npz", "logs/bad.csv", "--task", "allan", "--out", "out", "--set", "kind=mdev", "--set", "m=[1,10,100]")
    assert again.status == 0
    assert again.out.splitlines()[0] == "4 logs: 3 answered, 1 not; 4 of them were there already"
    quiet = call("batch", "logs/bad.csv", "--task", "allan", "--out", "out", "--set", "kind=mdev", "--set", "m=[1,10,100]", "--quiet")
    assert (quiet.status, quiet.out) == (1, "")
    assert quiet.reason.startswith("jaxcal: none of 1 log could be answered; the first: bad.csv: the time column never rises")
