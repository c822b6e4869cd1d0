"""Logs with small faults give a result and a finding; an output that cannot be written is found first. See also `test_wrong_calls`."""

import json

import numpy as np
import pytest

from .conftest import RATE, listing, save, table


def test_a_log_with_small_faults_is_mended_with_findings(call, folder):
    rows = table(6000)
    rows[500:510, 1], rows[700, 4] = np.nan, np.inf
    rows[:, 0] += np.random.default_rng(1).normal(size=len(rows)) * 0.05 / RATE
    rows[[100, 101]] = rows[[101, 100]]
    save(folder / "rough.csv", np.insert(np.delete(rows, slice(1000, 1300), axis=0), 200, rows[200], axis=0))
    found = call("noise", "rough.csv", "--json", "a.json")
    assert found.status == 0, found.err
    document = json.loads((folder / "a.json").read_text())
    assert {"gaps", "infinite", "jitter", "unsorted", "copies"} <= {one["code"] for one in document["log"]["findings"]}
    assert document["channels"]["gyro_y"]["coefficients"]["N"] == pytest.approx(1e-3, rel=0.1)


@pytest.mark.parametrize("argv", ["--out file", "--out file/deep", "--json file/a.json", "--report missing/a.html"])
def test_an_output_folder_that_cannot_be_written_is_found_before_the_work(call, folder, log, monkeypatch, argv):
    (folder / "file").write_text("")
    monkeypatch.setattr("jaxcal.read", lambda *a, **k: pytest.fail("the log must not be read yet"))
    found = call("noise", "imu.csv", *argv.split())
    assert found.status == 2
    assert "cannot" in found.reason
    assert listing(folder) == ["file", "imu.csv"]
