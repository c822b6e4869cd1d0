"""Output of `jaxcal noise` and `jaxcal demo` for hints, upper limits, missed truths and other special cases."""

import pathlib
import re
import runpy
import types

import pytest

from jaxcal.noise import Noise

DEG = 0.017453292519943295


def fit(**change):
    """A substitute for a `NoiseFit` with one term, N = 0.25 deg/sqrt(h)."""
    n = 0.25 * DEG / 60
    fields = {
        "noise": Noise(N=n), "interval": {"N": (0.9 * n, 1.1 * n)}, "upper_limit": {"N": 1.2 * n}, "verdict": {"N": "present"},
        "longer_record": {"N": 60.0}, "terms": ("N",), "confidence": 0.95, "left_out": (), "band": (0.01, 900.0), "decides": {},
        "warnings": (), "notes": (),
    }  # fmt: skip
    return types.SimpleNamespace(**(fields | change))


@pytest.fixture
def printed(call, log, monkeypatch):
    """A function that returns the words of every line which the command prints below the summary of the log."""

    def run(fits):
        monkeypatch.setattr("jaxcal.noise.characterise", lambda *args, **options: fits)
        monkeypatch.setattr("jaxcal.report.document", lambda *args: {})
        found = call("noise", "imu.csv", "--json", "a.json", "--force")
        assert (found.status, found.err) == (0, "")
        lines = [line.split() for line in found.out.splitlines() if line.strip()]
        start = next(i for i, line in enumerate(lines) if line[1:2] == ["coefficient,"])
        return lines[start:-1]  # the last line names the output file

    return run


def test_a_term_that_is_there_has_its_interval_below(printed):
    assert printed({"gyro_x": fit()})[2:5] == [["deg/sqrt(h)"], ["x", "0.250"], ["0.225", "to", "0.275"]]


def test_a_hint_says_so(printed):
    assert printed({"gyro_x": fit(verdict={"N": "hint"})})[-1] == ["only", "a", "hint"]


def test_a_term_that_is_not_there_shows_its_upper_limit_alone(printed):
    assert printed({"gyro_x": fit(verdict={"N": "not detected"})})[3:] == [["x", "<", "0.30"], ["not", "detected"]]


def test_a_missed_truth_is_marked_and_counted(call, monkeypatch):
    """Intervals of the x axis contain the truth of the demo; those of N on the other axes do not."""
    made = runpy.run_path(str(pathlib.Path(__file__).parents[1] / "made_fit.py"))["made_fit"]
    truth = {"gyro": Noise(N=0.25 * DEG / 60), "accel": Noise(N=0.05 / 60)}
    fits = {f"{s}_{axis}": made(truth[s].N / 1e-4 * scale) for s in truth for axis, scale in (("x", 1.05), ("y", 1.3), ("z", 0.5))}
    monkeypatch.setattr("jaxcal.noise.characterise", lambda *args, **options: fits)
    monkeypatch.setattr("jaxcal.cli._demo._DURATION", 20.0)
    found = call("demo")
    assert found.status == 0
    rows = [re.split(" {2,}", line) for line in found.out.splitlines() if line[:3] in ("x  ", "y  ", "z  ")]
    assert [row[2] for row in rows] == ["0.263", "0.325 *", "0.125 *", "0.0525", "0.0650 *", "0.0250 *"]
    assert "2 of 24 intervals of 95 % hold the truth (* marks the others)" in found.out


@pytest.mark.parametrize(("sensor", "unit"), [("accel", "m/s/sqrt(h)"), ("mag", "1e6 nT/sqrt(Hz)")])
def test_numbers_that_would_be_clumsy_get_a_power_of_ten(printed, sensor, unit):
    value = 1.0 / 60 if sensor == "accel" else 0.2
    one = fit(noise=Noise(N=value), interval={"N": (0.9 * value, 1.1 * value)}, upper_limit={"N": 1.2 * value})
    rows = printed({f"{sensor}_x": one})
    assert " ".join(rows[2]) == unit
    assert rows[3][0] == "x"
    assert 0.01 <= float(rows[3][1]) < 1e5


def test_what_was_left_out_is_one_line_for_channels_alike(printed):
    fits = {"gyro_x": fit(left_out=("a", "b"), band=(0.04, 9.0)), "gyro_y": fit(left_out=("c", "d"), band=(0.04, 9.0)), "gyro_z": fit()}
    text = " ".join(word for line in printed(fits) for word in line)
    assert "gyro_x, gyro_y: cluster times below 0.04 s (2 octaves), at which the noise model does not hold" in text


def test_the_length_of_record_is_that_of_the_worst_axis_on_which_the_term_is_there(printed):
    absent = fit(verdict={"N": "not detected"}, longer_record={"N": 1e9})
    slow = fit(longer_record={"N": 7200.0})
    assert printed({"gyro_x": fit(), "gyro_y": slow, "gyro_z": absent})[-1] == ["-", "gyroscope:", "N", "2", "h"]
    assert printed({"gyro_x": absent})[-1] == ["not", "detected"]
