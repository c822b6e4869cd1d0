"""`jaxcal simulate noise` and `jaxcal demo`."""

import json
import pathlib
import re

import numpy as np
import pytest

import jaxcal

from .conftest import listing, save, table


@pytest.mark.parametrize("name", ["log.csv", "log.npz"])
def test_a_simulated_log_reads_back_with_the_noise_that_was_asked_for(call, folder, name):
    options = ["--gyro", "N=0.25deg/sqrt(h)", "--accel", "N=0.06 m/s/sqrt(h),B=0.01mg", "--rate", "50", "--duration", "200", "--seed", "3"]
    found = call("simulate", "noise", "--out", name, *options)
    assert (found.status, found.err) == (0, "")
    truth = "gyro, every axis: N 7.272e-05 rad/sqrt(s)", "accel, every axis: N 0.001 m/s^2/sqrt(Hz), B 9.807e-05 m/s^2"
    assert found.out.splitlines() == [*truth, "", f"wrote {name}"]
    assert listing(folder) == [name]
    log = jaxcal.read(folder / name, units={"gyro": "rad/s", "accel": "m/s^2"}, quiet=True)
    assert (log.rate, len(log.time)) == (50.0, 10_000)
    assert log.accel.mean(axis=0) == pytest.approx([0, 0, 9.80665], abs=1e-3)
    # white noise of density N has the variance N^2 rate
    assert log.gyro.std(axis=0) == pytest.approx(np.deg2rad(0.25 / 60) * np.sqrt(50) * np.ones(3), rel=0.03)
    assert log.accel.std(axis=0) == pytest.approx(0.001 * np.sqrt(50) * np.ones(3), rel=0.03)


def test_the_seed_decides_and_axes_are_independent(call, folder):
    words = ("simulate", "noise", "--gyro", "N=1deg/sqrt(h)", "--accel", "N=1m/s/sqrt(h)", "--duration", "100")
    logs = []
    for seed, name in ((1, "a.npz"), (1, "b.npz"), (2, "c.npz")):
        call(*words, "--out", name, "--seed", seed)
        with np.load(folder / name) as file:
            logs.append(np.column_stack([file["gyro"], file["accel"]]))
    np.testing.assert_array_equal(logs[0], logs[1])
    assert not np.any(logs[0] == logs[2])
    assert np.abs(np.corrcoef(logs[0].T) - np.eye(6)).max() < 0.05


def test_a_simulated_device_prints_its_truth(call, folder):
    found = call("simulate", "device", "--out", "d.csv", "--duration", "20", "--seed", "4", "--rests", "2", "--gyro", "N=1deg/sqrt(h)")
    assert (found.status, found.err) == (0, "")
    log = jaxcal.read(folder / "d.csv", quiet=True)
    again, device, _ = jaxcal.device.simulate(20.0, seed=4, rests=2, noise={"gyro": jaxcal.noise.Noise(N=np.deg2rad(1 / 60))})
    for sensor in ("accel", "gyro", "mag"):
        assert getattr(log, sensor) == pytest.approx(getattr(again, sensor), rel=1e-7, abs=1e-12)
    printed = " ".join(found.out.split())
    for number in (*device.accel.bias, *np.rad2deg(device.gyro.bias), *(1e6 * device.magnetometer.hard_iron)):
        assert f"{number:+.5f}" in printed
    assert f"delay of the gyroscope {1e3 * device.gyro_delay:+.4f} ms" in printed


def test_the_demo_runs_from_the_shell_and_its_log_gives_the_same_again(tmp_path, shell):
    found = shell("demo", "--out", "device", cwd=tmp_path, cached=True)
    assert (found.status, found.err) == (0, "")
    assert listing(tmp_path / "device") == ["calibration.json", "imu.csv", "imu.yaml", "noise.json", "report.html"]
    lines = found.out.splitlines()
    assert max(map(len, lines)) <= 80
    readme = (pathlib.Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    assert re.search(r"```\n(good: .*?)```", readme, re.DOTALL)[1] in found.out
    hits = next(line for line in lines if "intervals of 95 % hold the truth" in line)
    assert int(hits.split()[0]) >= 20  # of 24; fewer have a probability below 1 in 100
    numbers = json.loads((tmp_path / "device" / "noise.json").read_text())["numbers"]
    assert numbers["gyro_x.N"]["value"] == pytest.approx(np.deg2rad(0.25 / 60), rel=0.01)

    log = jaxcal.read(tmp_path / "device" / "imu.csv", quiet=True)
    again = jaxcal.noise.fit(log.gyro[:, 0], log.rate)
    for term in "QNBK":
        assert numbers[f"gyro_x.{term}"]["value"] == pytest.approx(getattr(again.noise, term))


def test_a_cache_that_cannot_be_written_is_done_without(tmp_path, shell, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setitem(shell.environment, "XDG_CACHE_HOME", str(tmp_path / "file"))
    save(tmp_path / "imu.csv", table(200))
    found = shell("allan", "imu.csv", "--m", "1", "--json", "a.json", "--quiet", cwd=tmp_path)
    assert (found.status, found.out, found.err) == (0, "", "")
