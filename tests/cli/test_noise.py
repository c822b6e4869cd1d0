"""`jaxcal noise`, from a log to its output files."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest

import jaxcal

from .conftest import HEADER, listing, save, table

FILES = ["calibration.json", "imu.yaml", "noise.json", "report.html"]


def test_without_options_everything_goes_into_a_folder(call, folder, log):
    found = call("noise", "imu.csv")
    assert (found.status, found.err) == (0, "")
    assert listing(folder) == ["imu-noise", *(f"imu-noise/{name}" for name in FILES), "imu.csv"]
    assert "wrote imu-noise/: report.html, noise.json, calibration.json, imu.yaml" in found.out.splitlines()
    document = json.loads((folder / "imu-noise" / "noise.json").read_text())
    assert document["schema"] == "jaxcal.NoiseFits/1"
    assert sorted(document["channels"]) == sorted(f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz")
    for name, channel in document["channels"].items():
        truth = 1e-3 if name.startswith("gyro") else 1e-2
        assert channel["coefficients"]["N"] == pytest.approx(truth, rel=0.05)
        assert document["numbers"][f"{name}.N"]["unit"] == ("rad/sqrt(s)" if name.startswith("gyro") else "m/s^2/sqrt(Hz)")
        assert (channel["presence"]["K"], channel["duration"], channel["deviation"]["rate"]) == ("not detected", 80.0, 100.0)
    kept = jaxcal.Calibration.load(folder / "imu-noise" / "calibration.json")
    assert list(kept.noise.gyro.N) == pytest.approx([1e-3] * 3, rel=0.05)
    assert (folder / "imu-noise" / "report.html").read_text().startswith("<!DOCTYPE html>")


def test_several_recordings_of_one_device_have_a_table_with_the_interval_of_the_next(call, folder):
    for i in range(3):
        save(folder / f"{i}.csv", table(seed=i))
    found = call("noise", "0.csv", "--also", "1.csv", "--also", "2.csv", "--json", "first.json")
    assert (found.status, found.err) == (0, "")
    assert [line for line in found.out.splitlines() if line.startswith("gyroscope, next of 3 recordings")]
    assert sum(line.split()[:2] == ["N", "deg/sqrt(h)"] or line.startswith("N  angle") for line in found.out.splitlines()) == 2
    assert call("noise", "0.csv", "--also", "none.csv").status == 2


def test_upper_bounds_for_a_filter(call, folder, log):
    """The line for a filter has the numbers of imu.yaml; --conservative writes larger ones, and shows them."""

    def written():
        text = (folder / "imu-noise" / "imu.yaml").read_text()
        return {word: float(line.split()[1]) for line in text.splitlines() for word in line.split(":")[:1] if "noise_density" in word}

    out = call("noise", "imu.csv").out
    usual = written()
    for sensor, value in usual.items():
        assert any(line.strip().startswith(f"filter (SI, worst axis): N {value:.3g}") for line in out.splitlines()), sensor
    out = call("noise", "imu.csv", "--conservative").out
    assert sum("upper bound for a filter" in line for line in out.splitlines()) == 2
    assert all(1.0 < written()[sensor] / value < 1.5 for sensor, value in usual.items())


def test_models_of_the_slow_noise_are_compared_for_every_channel(call, folder, log):
    found = call("noise", "imu.csv", "--compare")
    assert (found.status, found.err, listing(folder)) == (0, "", ["imu.csv"])
    assert [line for line in found.out.splitlines() if line.endswith(("_x", "_y", "_z"))] == [
        f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz"
    ]
    assert found.out.count("B and K") == 6


def test_a_picture_is_drawn_where_it_is_asked_for(call, folder, log):
    assert call("noise", "imu.csv", "--plot", "allan.png").status == 0
    assert (folder / "allan.png").read_bytes().startswith(b"\x89PNG")
    assert listing(folder / "imu-noise") == FILES  # in addition to all other files


def test_the_answer_comes_before_the_files(log, folder):
    """The table is printed even if the report fails afterwards; matplotlib is imported only for figures."""
    code = """
import sys
import jaxcal, jaxcal.report
from jaxcal.cli import main
def fail(*args, **options):
    print("now the report")
    raise OSError(28, "No space left on device")
jaxcal.report.write = fail
status = main(["noise", "imu.csv", "--report", "a.html"])
print(status, *(name for name in ("matplotlib", "scipy.stats") if name in sys.modules))
"""
    found = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True)
    lines = found.stdout.splitlines()
    assert lines[-1] == "2"
    assert "gyroscope" in found.stdout[: found.stdout.index("now the report")]


def test_the_table_is_in_data_sheet_units_with_intervals_and_limits(call, log):
    lines = call("noise", "imu.csv", "--json", "a.json").out.splitlines()
    assert max(map(len, lines)) <= 80
    assert not [line for line in lines if line != line.rstrip() or "\x1b" in line]
    assert len(lines) <= 40
    start = next(i for i, line in enumerate(lines) if line.startswith("gyroscope "))
    assert lines[start].split() == ["gyroscope", "x", "y", "z"]
    rows = {line[:1]: re.split(" {2,}", line)[-4:] for line in lines[start + 1 : start + 5]}
    assert [row[0] for row in rows.values()] == ["arcsec", "deg/sqrt(h)", "deg/h", "deg/h/sqrt(s)"]
    value, half = (float(word) for word in rows["N"][1].split(" ± "))
    assert value == pytest.approx(1e-3 * 180 / np.pi * 60, rel=0.05)  # 3.44 deg/sqrt(h)
    assert half < 0.1 * value
    assert all(cell.startswith("< ") for cell in rows["K"][1:])
    assert lines[start + 5].startswith("floor")


def test_what_is_read_as_what_is_printed_on_request(call, log):
    out = " ".join(call("noise", "imu.csv", "--json", "a.json", "-v").out.split())
    assert "imu.csv: gyroscope and accelerometer, 100 Hz, 1 min 20 s" in out
    assert "record for N to 10 %" in out
    assert "m/s^2 (from the name; median norm 9.808). wrote" in out


def test_with_an_output_option_only_that_is_written(call, folder, log):
    assert call("noise", "imu.csv", "--json", "a.json", "--report", "b.html", "--export", "kalibr=c.yaml").status == 0
    assert listing(folder) == ["a.json", "b.html", "c.yaml", "imu.csv"]
    assert call("noise", "imu.csv", "--export", "kalibr", "--out", "deep/er").status == 0
    assert listing(folder / "deep") == ["er", "er/imu.yaml"]


def test_an_upper_limit_in_place_of_a_random_walk_is_said(call, folder, log):
    found = call("noise", "imu.csv", "--export", "kalibr", "-v")
    assert "K was not found: its 95 % upper limit is written" in " ".join(found.out.split())
    assert "upper limit" in (folder / "imu.yaml").read_text()


def test_a_log_of_a_gyroscope_alone_has_no_imu_yaml_and_says_so(call, folder):
    save(folder / "gyro.csv", table()[:, :4], header=",".join(HEADER.split(",")[:4]))
    found = call("noise", "gyro.csv", "-v")
    assert found.status == 0
    assert listing(folder / "gyro-noise") == [name for name in FILES if name != "imu.yaml"]
    assert "imu.yaml is not written: the calibration holds no noise of the accelerometer" in " ".join(found.out.split())
    assert found.out.splitlines()[-1] == "wrote gyro-noise/: report.html, noise.json, calibration.json"
    found = call("noise", "gyro.csv", "--json", "a.json", "--export", "kalibr")  # now it was asked for
    assert (found.status, "accelerometer" in found.reason, (folder / "a.json").exists()) == (1, True, False)


def test_units_columns_rate_and_part_of_the_log_are_passed_on(call, folder):
    rows = table()
    rows[:, 1:4] *= 180 / np.pi
    rows[:, 4:] /= 9.80665
    save(folder / "plain.txt", rows, header="")
    options = ["--columns", "time=none,gyro=1:3", "--columns", "accel=4:6", "--units", "gyro=deg/s,accel=g", "--rate", "200"]
    found = call("noise", "plain.txt", *options, "--start", "10", "--stop", "-10", "--json", "a.json")
    assert found.status == 0, found.err
    document = json.loads((folder / "a.json").read_text())
    assert (document["channels"]["gyro_x"]["deviation"]["rate"], document["channels"]["gyro_x"]["duration"]) == (200.0, 20.0)
    # white noise: at twice the rate the same samples have a density smaller by sqrt(2)
    assert document["channels"]["gyro_x"]["coefficients"]["N"] == pytest.approx(1e-3 / np.sqrt(2), rel=0.05)
    assert document["channels"]["accel_z"]["coefficients"]["N"] == pytest.approx(1e-2 / np.sqrt(2), rel=0.05)


def test_options_reach_the_fit(call, folder, log):
    words = ("--terms", "n,b", "--confidence", "0.9", "--band", "0.1", "5", "--method", "gls", "--json", "a.json")
    assert call("noise", "imu.csv", *words).status == 0
    channel = json.loads((folder / "a.json").read_text())["channels"]["gyro_x"]
    assert (channel["terms"], channel["confidence"], channel["method"]) == (["N", "B"], 0.9, "gls")
    assert channel["band"][0] >= 0.1
    assert channel["band"][1] <= 5.0
    found = call("noise", "imu.csv", "--terms", "QNBKM", "--json", "a.json")  # M is a Gauss-Markov process
    assert found.status == 0, found.err
    assert [line for line in found.out.splitlines() if line.startswith("M ")]
    assert len(json.loads((folder / "a.json").read_text())["channels"]["gyro_x"]["noise"]["markov"]) == 1
