"""What the tables and lists say about fits that are not plain."""

import types

import pytest

from jaxcal.cli._screen import Screen
from jaxcal.cli._tables import left_out, longer_record, missed, noise_tables
from jaxcal.noise import Noise

DEG = 0.017453292519943295


def fit(**change):
    """A stand-in for a `NoiseFit` of one term, N = 0.25 deg/sqrt(h)."""
    n = 0.25 * DEG / 60
    fields = {
        "noise": Noise(N=n), "interval": {"N": (0.9 * n, 1.1 * n)}, "upper_limit": {"N": 1.2 * n}, "verdict": {"N": "present"},
        "longer_record": {"N": 60.0}, "terms": ("N",), "confidence": 0.95, "left_out": (), "band": (0.01, 900.0),
    }  # fmt: skip
    return types.SimpleNamespace(**(fields | change))


def printed(capsys, fits, truth=None):
    noise_tables(Screen(), fits, truth)
    return [line.split() for line in capsys.readouterr().out.splitlines() if line.strip()]


def test_a_term_that_is_there_has_its_interval_below(capsys):
    assert printed(capsys, {"gyro_x": fit()})[2:] == [["deg/sqrt(h)"], ["x", "0.250"], ["0.225", "to", "0.275"]]


def test_a_hint_says_so(capsys):
    assert printed(capsys, {"gyro_x": fit(verdict={"N": "hint"})})[-1] == ["only", "a", "hint"]


def test_a_term_that_is_not_there_shows_its_upper_limit_alone(capsys):
    assert printed(capsys, {"gyro_x": fit(verdict={"N": "not detected"})})[3:] == [["x", "<", "0.30"], ["not", "detected"]]


@pytest.mark.parametrize(("truth", "mark"), [(0.26, []), (0.3, ["*"])])
def test_a_missed_truth_is_marked_and_counted(capsys, truth, mark):
    noise = {"gyro": Noise(N=truth * DEG / 60)}
    rows = printed(capsys, {"gyro_x": fit()}, noise)
    assert rows[3] == ["truth", f"{truth:g}"]
    assert rows[4] == ["x", "0.250", *mark]
    assert missed({"gyro_x": fit()}, noise) == (len(mark), 1)


@pytest.mark.parametrize(("sensor", "unit"), [("accel", "m/s/sqrt(h)"), ("mag", "1e6 nT/sqrt(Hz)")])
def test_numbers_that_would_be_clumsy_get_a_power_of_ten(capsys, sensor, unit):
    value = 1.0 / 60 if sensor == "accel" else 0.2
    one = fit(noise=Noise(N=value), interval={"N": (0.9 * value, 1.1 * value)}, upper_limit={"N": 1.2 * value})
    rows = printed(capsys, {f"{sensor}_x": one})
    assert " ".join(rows[2]) == unit
    assert rows[3][0] == "x"
    assert 0.01 <= float(rows[3][1]) < 1e5


def test_what_was_left_out_is_one_line_for_channels_alike():
    fits = {"gyro_x": fit(left_out=("a", "b"), band=(0.04, 9.0)), "gyro_y": fit(left_out=("c", "d"), band=(0.04, 9.0)), "gyro_z": fit()}
    assert left_out(fits) == ["gyro_x, gyro_y: cluster times below 0.04 s (2 octaves), at which the noise model does not hold"]


def test_the_length_of_record_is_that_of_the_worst_axis_on_which_the_term_is_there():
    absent = fit(verdict={"N": "not detected"}, longer_record={"N": 1e9})
    assert longer_record({"gyro_x": fit(), "gyro_y": fit(longer_record={"N": 7200.0}), "gyro_z": absent}) == ["gyroscope: N 2 h"]
    assert longer_record({"gyro_x": absent}) == []
