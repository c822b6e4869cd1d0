"""`run`: its results, which of them are kept or computed again, and the summary files."""

import csv
import functools
import json
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import polars as pl
import pytest

import jaxcal
from jaxcal.batch import run
from jaxcal.imu import multi_position

from ..imu import cases
from .conftest import counts, make_logs, results

INDICES = [f"{i},{j}" for i in range(3) for j in range(3)]


@pytest.fixture(scope="module")
def pool():
    with ThreadPoolExecutor(2) as executor:
        yield executor


def test_every_log_has_its_result_and_one_bad_log_costs_no_other(tasks, room, tmp_path, pool):
    paths = make_logs(tmp_path / "logs", 11)
    paths[4].write_bytes(b"PK\x03\x04 and no archive")
    (tmp_path / "logs" / "empty.csv").touch()
    missing = tmp_path / "unit99.npz"
    moves = []
    fleet = run(
        [tmp_path / "logs", missing], tasks.counted, executor=pool, out=tmp_path / "out", progress=lambda *at: moves.append(at)
    )  # fmt: skip
    names = ["empty.csv", *(f"unit{i}.npz" for i in range(1, 12)), "unit99.npz"]  # numbers in names are in numerical order
    assert [entry.path.name for entry in fleet] == names
    assert {entry.path.name for entry in fleet.failed} == {"empty.csv", "unit5.npz", "unit99.npz"}
    reasons = {entry.path.name: entry.reason for entry in fleet.failed}
    assert reasons["empty.csv"] == "empty.csv: the file is empty"
    assert "it may be cut off or damaged" in reasons["unit5.npz"]
    assert "there is no such file" in reasons["unit99.npz"]
    for entry in fleet.done:
        log = np.load(entry.path)["gyro"]
        np.testing.assert_allclose([entry.coefficients[f"mean[{i}]"].value for i in range(3)], log.mean(axis=0), rtol=1e-9)
        assert entry.document["result"]["file"] == entry.path.name
        assert entry.sha256 == jaxcal.read(entry.path, quiet=True).provenance["sha256"]
    assert sorted(done for done, total, _ in moves) == list(range(1, 14))
    assert {total for _, total, _ in moves} == {13}
    assert len(results(tmp_path / "out")) == 13


def test_a_run_taken_up_again_computes_only_what_is_new_changed_or_may_now_succeed(tasks, room, tmp_path, pool):
    paths = make_logs(tmp_path / "logs", 6)
    damaged, good = paths[1], paths[1].read_bytes()
    damaged.write_bytes(b"PK\x03\x04 and no archive")
    missing = tmp_path / "logs" / "unit7.npz"

    def go(task=tasks.counted, **options):
        for file in room.glob("*.count"):
            file.unlink()
        fleet = run([tmp_path / "logs", missing], task, executor=pool, out=tmp_path / "out", **options)
        return fleet, sorted(counts(room))

    first, computed = go()
    assert computed == [f"unit{i}.npz" for i in (1, 3, 4, 5, 6)]
    files = results(tmp_path / "out")
    stamps = {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "results").iterdir()}
    second, computed = go()
    assert computed == []
    assert results(tmp_path / "out") == files
    again = next(path for path in stamps if path.name.startswith("unit7"))
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in stamps.items() if path != again)  # only a missing log is tried again
    assert [(e.status, e.reason, e.coefficients) for e in first] == [(e.status, e.reason, e.coefficients) for e in second]
    # one log is repaired, one has new content of the same size and time, one result is deleted, and one is truncated
    damaged.write_bytes(good)
    state = paths[0].stat()
    np.savez(paths[0], **{**np.load(paths[0]), "gyro": np.load(paths[0])["gyro"] * 2.0})
    assert paths[0].stat().st_size == state.st_size
    os.utime(paths[0], ns=(state.st_atime_ns, state.st_mtime_ns))
    entry = {e.path: e for e in second}
    entry[paths[2]].file.unlink()
    entry[paths[3]].file.write_text(entry[paths[3]].file.read_text()[:200])
    third, computed = go()
    assert computed == [f"unit{i}.npz" for i in (1, 2, 3, 4)]
    assert len(third.done) == 6
    assert third.entries[0].coefficients["mean[0]"].value == pytest.approx(entry[paths[0]].coefficients["mean[0]"].value * 2.0)
    # another task or other options require a new computation
    assert len(go(functools.partial(tasks.counted))[1]) == 6
    assert len(go(functools.partial(tasks.counted))[1]) == 0
    assert len(go(functools.partial(tasks.counted), reading={"stop": 1.0})[1]) == 6
    assert len(go(functools.partial(tasks.counted), reading={"stop": 1.0}, resume=False)[1]) == 6


def test_the_files_about_the_whole(tasks, room, tmp_path, pool):
    paths = make_logs(tmp_path / "logs", 5)
    (tmp_path / "logs" / "=<script>&.csv").write_text("no log")
    (tmp_path / "logs" / "a.npz").mkdir()
    twin = make_logs(tmp_path / "logs" / "a.npz", 1)[0]  # a log of the same name in another folder
    fleet = run(tmp_path / "logs", tasks.counted, executor=pool, out=tmp_path / "logs" / "out")
    again = run(tmp_path / "logs", tasks.counted, executor=pool, out=tmp_path / "logs" / "out")
    assert len(again) == len(fleet) == 7  # results in the folder are not logs
    manifest = json.loads((tmp_path / "logs" / "out" / "manifest.json").read_text())
    assert manifest["count"] == {"logs": 7, "done": 6, "failed": 1, "left": 0}
    assert (manifest["task"]["name"], manifest["versions"]["jaxcal"]) == ("fleet_tasks.counted", jaxcal.__version__)
    for row in manifest["logs"]:
        document = json.loads((tmp_path / "logs" / "out" / row["result"]).read_text())
        assert (document["log"]["path"], document["log"]["sha256"]) == (row["log"], row["sha256"])
    assert {row["log"] for row in manifest["logs"]} >= {str(twin), str(paths[0])}
    rows = list(csv.DictReader((tmp_path / "logs" / "out" / "summary.csv").read_text().splitlines()))
    table = pl.read_parquet(tmp_path / "logs" / "out" / "summary.parquet")
    assert len(rows) == table.height == 7
    for entry, row, other in zip(again, rows, table.to_dicts(), strict=True):
        assert row["status"] == other["status"] == entry.status
        value = entry.coefficients["mean[1]"].value if entry.coefficients else None
        assert other["mean[1]"] == value == (float(row["mean[1]"]) if row["mean[1]"] else None)
    page = (tmp_path / "logs" / "out" / "overview.html").read_text()
    assert "=<script>" not in page  # the name of the log
    assert "=&lt;script&gt;&amp;.csv" in page


def test_without_a_folder_the_results_are_in_memory_and_equal_those_on_the_disk(tasks, room, tmp_path, pool):
    make_logs(tmp_path / "logs", 3)
    loose = run(str(tmp_path / "logs" / "*.npz"), tasks.counted, executor=pool)
    kept = run(tmp_path / "logs", tasks.counted, executor=pool, out=tmp_path / "out")
    assert [entry.document for entry in loose] == [entry.document for entry in kept]
    assert loose.out is None


@pytest.mark.parametrize(("task", "said"), [("strange", "ZeroDivisionError: seven"), ("leaves", "SystemExit: 3")])
def test_a_fault_of_a_task_is_a_sentence(tasks, tmp_path, pool, task, said):
    make_logs(tmp_path / "logs", 1)
    (entry,) = run(tmp_path / "logs", getattr(tasks, task), executor=pool)
    assert entry.reason == f"the task ended with {said}"
    assert any(f"raise {said.partition(':')[0]}" in line for line in entry.document["trace"])


def test_named_tasks_give_what_the_library_gives(tmp_path, pool):
    rng = np.random.default_rng(0)
    n = 4000
    ball = rng.standard_normal((n, 3))
    field = 50e-6 * ball / np.linalg.norm(ball, axis=1, keepdims=True) + [1e-6, 2e-6, 3e-6] + 1e-8 * rng.standard_normal((n, 3))
    warmth = 20 + 20 * np.arange(n) / n
    gyro = 1e-3 * rng.standard_normal((n, 3)) + 1e-4 * warmth[:, None]
    path = tmp_path / "unit7.npz"
    np.savez(path, time=np.arange(n) / 10, gyro=gyro, mag=field, temperature=warmth)
    log = jaxcal.read(path, quiet=True)

    def one(task, **options):
        (entry,) = run([path], task, executor=pool, options=options)
        assert entry.reason is None
        return entry

    found, expected = one("allan", m="octave").coefficients, jaxcal.allan.deviation(log.gyro, log.rate, m=[10, 100])
    # the value is interpolated logarithmically between octaves of the curve
    assert found["gyro_y.oadev(1 s)"].value == pytest.approx(expected.deviation[0, 1], rel=0.02)
    assert found["gyro_y.oadev(10 s)"].unit == "rad/s"
    entry, fit = one("mag", method="consistent"), jaxcal.magnetometer.fit(log.mag, method="consistent")
    assert entry.coefficients["hard_iron[2]"].value == pytest.approx(fit.model.hard_iron[2], rel=1e-9)
    assert entry.document["result"]["schema"] == "jaxcal.MagFit/1"
    fits = jaxcal.temperature.characterise(jaxcal.Log(log.time, gyro=log.gyro, temperature=log.temperature), model="polynomial", degree=1)
    found = one("temperature", model="polynomial", degree=1).coefficients
    assert found["gyro_x.rms"].value == pytest.approx(fits["gyro_x"].rms, rel=1e-9)
    assert found["gyro_x.change"].value == pytest.approx(2e-3, rel=0.1)


def test_noise_has_no_value_where_a_term_is_not_there(tmp_path, pool):
    (path,) = make_logs(tmp_path, 1, samples=5000)
    (entry,) = fleet = run([path], "noise", executor=pool, options={"terms": ("N", "K")})
    fits = jaxcal.noise.characterise(jaxcal.read(path, quiet=True), terms=("N", "K"))
    fit = fits["gyro_x"]
    assert entry.coefficients["gyro_x.N"].value == float(fit.noise.N)
    assert (entry.coefficients["gyro_x.N"].low, entry.coefficients["gyro_x.N"].high) == fit.interval["N"]
    assert fit.presence["K"] == "not detected"
    assert np.isnan(entry.coefficients["gyro_x.K"].value)
    assert entry.coefficients["gyro_x.K"].high == fit.upper_limit["K"]
    n, k = max(float(one.noise.N) for one in fits.values()), max(one.upper_limit["K"] for one in fits.values())
    assert fleet.for_filters == [("gyro N", "rad/sqrt(s)", 1, n, n), ("gyro K", "rad/s/sqrt(s)", 1, k, k)]
    assert entry.document["result"]["schema"] == "jaxcal.NoiseFits/1"


def test_pages_of_single_logs_are_made_on_demand(tmp_path, pool, refuses):
    (path,) = make_logs(tmp_path, 1, samples=2000)
    call = {"executor": pool, "options": {"terms": ("N",)}, "out": tmp_path / "out"}
    kept = [run([path], "noise", **call, reports=reports).done[0].kept for reports in (False, True, True, False)]
    assert kept == [False, False, True, True]  # a result without its page is computed again
    (page,) = (tmp_path / "out" / "results").glob("*.html")
    overview = (tmp_path / "out" / "overview.html").read_text()
    assert f"results/{page.name}" in overview
    assert '<h2 id="filter">' in overview
    run([path], "noise", **call, resume=False)
    assert not page.exists()
    with refuses("reports"):
        run([path], "noise", reports=True)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"task": "nose"}, "task"), ({"task": 3}, "task"), ({"executor": None, "task": lambda log: 1}, "task"),
        ({"task": "noise", "options": {"term": "Q"}}, "option"), ({"options": {"a": 1}}, "option"), ({"reading": {"rat": 1}}, "reading"),
        ({"reading": {"units": "gyro=furlong"}}, "units"), ({"executor": None, "workers": 0}, "workers"), ({"timeout": 1.0}, "timeout"),
        ({"executor": None, "timeout": -1.0}, "timeout"), ({"paths": []}, "no_logs"), ({"paths": 3}, "paths"),
        ({"paths": "nothing/*.csv"}, "no_logs"),
    ],
    ids=lambda each: each if isinstance(each, str) else " ".join(each),
)  # fmt: skip
def test_a_wrong_call_is_said_before_anything_is_done(tasks, room, tmp_path, pool, change, code, refuses):
    (path,) = make_logs(tmp_path / "logs", 1)
    call = {"paths": [path], "task": tasks.counted, "executor": pool, "out": tmp_path / "out", **change}
    with refuses(code):
        run(call.pop("paths"), call.pop("task"), **call)
    assert not (tmp_path / "out").exists()
    assert counts(room) == {}


@pytest.mark.long
def test_a_fleet_of_multi_position_recordings(tmp_path, pool):
    """The second of three units was hardly moved and fails; the intervals of the others contain the truth."""
    for i, poses in enumerate((cases.POSES, 6, cases.POSES)):
        log = cases.recording(i, poses=poses, up=cases.UP[:poses])
        np.savez(tmp_path / f"unit{i}.npz", time=log.time, gyro=log.gyro, accel=log.accel)
    fleet = run(tmp_path, "imu", executor=pool, workers=1, options={"gravity": cases.GRAVITY, "held_out": False})
    assert [entry.status for entry in fleet] == ["done", "failed", "done"]
    assert "There are 6 still intervals" in fleet.failed[0].reason
    sensors = [f"{sensor}.{part}" for sensor, part in (("accel", "matrix"), ("accel", "bias"), ("gyro", "matrix"), ("gyro", "bias"))]
    names = [f"{sensor}[{k}]" for sensor in sensors for k in (["0", "1", "2"] if "bias" in sensor else INDICES)]
    truth = dict(zip([*names, *(f"gyro.g_sensitivity[{k}]" for k in INDICES)], cases.turned_truth(), strict=True))
    for entry in fleet.done:
        assert set(truth) - set(entry.coefficients) == {"accel.matrix[1,0]", "accel.matrix[2,0]", "accel.matrix[2,1]"}  # fixed at zero
        inside = [one.low <= truth[name] <= one.high for name, one in entry.coefficients.items() if name in truth]
        assert sum(inside) >= 25  # of 30 intervals of 95 %; fewer have a probability of 0.3 %
    alone = multi_position(jaxcal.read(fleet.done[0].path, quiet=True), gravity=cases.GRAVITY, held_out=False)
    assert [fleet.done[0].coefficients[name].value for name in names[-3:]] == alone.gyro.bias.tolist()
