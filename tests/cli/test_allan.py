"""`jaxcal allan`."""

import json

import numpy as np
import pytest

import jaxcal

from .conftest import listing, save, table


def test_it_prints_and_writes_nothing_unless_asked(call, folder, log):
    found = call("allan", "imu.csv", "--m", "1,10,100")
    assert (found.status, found.err) == (0, "")
    assert listing(folder) == ["imu.csv"]
    lines = found.out.splitlines()
    assert max(map(len, lines)) <= 80
    assert len(lines) <= 30
    head = next(i for i, line in enumerate(lines) if line.startswith("gyroscope"))
    assert lines[head].split() == ["gyroscope", "x", "y", "z"]
    row = lines[head + 1].split()
    assert row[:4] == ["at", "1", "s", "deg/h"]
    # white noise: N / sqrt(tau)
    assert float(row[4]) == pytest.approx(1e-3 * 180 / np.pi * 3600, rel=0.2)
    shown = call("allan", "imu.csv", "--m", "1,10,100", "--unit", "deg/s").out.splitlines()[head + 1].split()
    assert shown[3] == "deg/s"
    assert float(shown[4]) == pytest.approx(float(row[4]) / 3600, rel=0.01)


@pytest.mark.parametrize(("kind", "unit"), [("oadev", "rad/s"), ("tdev", "rad")])
def test_files_hold_what_the_library_gives(call, folder, log, kind, unit):
    found = call("allan", "imu.csv", "--kind", kind, "--m", "octave", "--json", "a.json", "--export", "csv", "--plot", "a.svg", "--quiet")
    assert (found.status, found.out, found.err) == (0, "", "")
    assert listing(folder) == ["a.json", "a.svg", "imu-allan.csv", "imu.csv"]
    document = json.loads((folder / "a.json").read_text())
    assert document["schema"] == "jaxcal.Deviations/1"
    expected = jaxcal.allan.deviation(jaxcal.read(log, quiet=True).gyro, 100.0, kind=kind, m="octave")
    channel = document["channels"]["gyro_y"]
    assert (channel["kind"], channel["rate"], channel["unit"]) == (kind, 100.0, unit)
    assert channel["m"] == expected.m.tolist()
    for name in ("deviation", "lower", "upper", "edf"):
        np.testing.assert_allclose(channel[name], getattr(expected, name)[:, 1])
    rows = [line.split(",") for line in (folder / "imu-allan.csv").read_text().splitlines()]
    assert rows[0] == ["channel", "unit", "tau_s", "m", "deviation", "lower", "upper", "edf"]
    mine = [row for row in rows if row[0] == "gyro_y"]
    np.testing.assert_allclose([float(row[4]) for row in mine], expected.deviation[:, 1])
    assert "<svg" in (folder / "a.svg").read_text()


def test_the_bias_is_taken_off_on_request(call, folder, log):
    for words in ((), ("--bias-corrected",)):
        assert call("allan", "imu.csv", "--kind", "mtotdev", "--m", "4,16", "--json", "a.json", "--quiet", *words).status == 0
        channel = json.loads((folder / "a.json").read_text())["channels"]["gyro_x"]
        if not words:
            raw = channel
    assert raw["bias"] == [1.0, 1.0]
    np.testing.assert_allclose(np.square(np.divide(raw["deviation"], channel["deviation"])), channel["bias"])
    np.testing.assert_allclose(channel["bias"], [0.7837, 0.7714], atol=1e-4)  # white noise


def test_a_file_holds_all_cluster_sizes(call, folder):
    save(folder / "short.csv", table(1000))
    assert call("allan", "short.csv", "--m", "all", "--json", "a.json").status == 0
    assert len(json.loads((folder / "a.json").read_text())["channels"]["gyro_x"]["m"]) == 500


def test_the_noise_type_given_is_that_of_the_library(call, log, folder):
    words = ("allan", "imu.csv", "--m", "1,10", "--json", "a.json", "--quiet")
    assert call(*words, "--alpha", "-2").status == 0
    document = json.loads((folder / "a.json").read_text())
    expected = jaxcal.allan.deviation(jaxcal.read(log, quiet=True).gyro, 100.0, m=[1, 10], alpha=-2)
    np.testing.assert_allclose(document["channels"]["gyro_x"]["upper"], expected.upper[:, 0], rtol=1e-12)


def test_a_clock_has_no_unit(call, folder):
    x = np.cumsum(np.random.default_rng(1).standard_normal(400)) * 1e-9
    (folder / "clock.txt").write_text("# phase in s\n" + "\n".join(f"{value:.6e}" for value in x) + "\n")
    words = ("allan", "clock.txt", "--clock", "--data", "phase", "--rate", "1", "--m", "1,8", "--json", "clock.json")
    ended = call(*words)
    assert ended.status == 0
    assert any(line.startswith("clock ") for line in ended.out.splitlines())
    assert not any(word in ended.out for word in ("gyro", "rad/s"))
    channel = json.loads((folder / "clock.json").read_text())["channels"]["clock_x"]
    assert channel["unit"] == ""
    expected = jaxcal.allan.deviation(x, 1.0, m=[1, 8], data="phase")
    np.testing.assert_allclose(channel["deviation"], expected.deviation, rtol=1e-5)  # six digits in the file
    assert call(*words, "--kind", "tdev", "--report", "clock.html").status == 0
    assert json.loads((folder / "clock.json").read_text())["channels"]["clock_x"]["unit"] == "s"
    assert not any(word in (folder / "clock.html").read_text() for word in ("gyro_x", "rad/s", "gyro="))
