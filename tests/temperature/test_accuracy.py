"""Jumps, hysteresis, rate of change and intervals on simulated records, of which benchmarks/temperature.py runs hundreds."""

import importlib.util
import pathlib

import numpy as np
import pytest

from jaxcal.temperature import fit, simulate

from .cases import MDEG, errors, pair

_PLACE = pathlib.Path(__file__).resolve().parents[2] / "benchmarks" / "_thermal.py"


@pytest.fixture(scope="module")
def made():
    """The module benchmarks/_thermal.py, which simulates and evaluates records."""
    spec = importlib.util.spec_from_file_location("thermal_records", _PLACE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(("degree", "row"), [(3, (47, 114, 150)), *(pytest.param(*one, marks=pytest.mark.long) for one in (
    (1, (101, 125, 181)), (5, (41, 108, 131)),
))])  # fmt: skip
def test_polynomials_leave_what_the_table_of_the_specification_says(degree, row):
    found = []
    for seed in range(2):
        train, test = pair(0.3, seed)
        found.append(errors(fit(train.temperature, train.bias, time=train.time, model="polynomial", degree=degree).model, test, 0.3))
    assert np.mean(found, axis=0) == pytest.approx(row, rel=0.05)


@pytest.mark.parametrize("jump", [0.3, 0.02, 0.0])
def test_a_ramp_with_a_jump_is_followed(jump):
    """One record stays below limits for rms, rms near the jump and largest error, mdeg/s; random walks of the ramps cause about 0.6."""
    train, test = pair(jump, 4)
    found = fit(train.temperature, train.bias, time=train.time)
    assert (errors(found.model, test, jump) < [1.5, 3.0, 6.0]).all()
    assert len(found.steps) == (jump > 0)
    for step in found.steps:
        assert abs(step.centre - 24.5) < 4 * step.centre_error < 0.1
        assert step.height == pytest.approx(np.deg2rad(jump), abs=4 * step.height_error)
        assert step.chance < 0.003


@pytest.mark.long
def test_ramps_with_a_jump_of_300_mdeg_s_are_followed():
    """The mean errors of 12 records are below 0.7 and 2 mdeg/s, although on the jump the thermometer's noise changes a sample by 19."""
    found = []
    for seed in range(12):
        train, test = pair(0.3, seed)
        found.append(errors(fit(train.temperature, train.bias, time=train.time).model, test, 0.3))
    assert (np.mean(found, axis=0) < [0.7, 2.0, 4.0]).all()


@pytest.mark.parametrize(("case", "count"), [("none", 0), pytest.param("two", 2, marks=pytest.mark.long)])
def test_one_jump_is_one_jump(made, case, count):
    excess, inside = zip(*(made.counted(case, run) for run in range(1)), strict=True)
    assert excess == (0,)
    assert [len(one) for one in inside] == [count]


@pytest.mark.long
@pytest.mark.parametrize("case", ["none", "one", "two"])
def test_jumps_of_many_records(made, case):
    """The limits on false jumps and on heights outside their intervals are rarely exceeded by chance.

    At one false jump in 300 records, 2 or more in 8 records have a probability of 0.0003. At a coverage of 95 %, fewer than 6 of 8
    heights within their intervals have a probability of 0.006.
    """
    excess, errors = zip(*(made.counted(case, run) for run in range(8)), strict=True)
    assert sum(one > 0 for one in excess) <= 1
    assert case == "none" or np.mean(np.abs(np.concatenate(errors)) < 1.96) >= 0.75


def test_an_effect_of_the_rate_of_change_is_found(made):
    static, found = made.rate(0)
    assert static > 4.0
    assert found < 0.2  # limit for one record; the mean of many is below 0.1


def test_a_lag_is_found_with_a_noisy_thermometer(made):
    left, lag = made.lagging(0)
    assert left < 1.0
    assert lag == pytest.approx(60.0, abs=1.0)


@pytest.mark.long
@pytest.mark.parametrize(("lag", "play"), [(0.0, 0.0), (0.0, 0.6)], ids=["neither", "play"])
def test_the_true_hysteresis_is_found(lag, play):
    record = simulate(profile="cycle", duration=9000.0, walk=0.0, thermometer=0.0, lag=lag, play=play, seed=3)
    n = 4500
    chosen = fit(record.temperature[:n], record.bias[:n], time=record.time[:n])
    assert chosen.model.lag == pytest.approx(lag, abs=1.0)
    assert chosen.model.play == pytest.approx(play, abs=0.02)
    left = record.bias - chosen.model.correct(record.bias, record.temperature, time=record.time) - record.truth
    assert np.sqrt(np.mean(left[n:] ** 2)) / MDEG < 0.5


@pytest.mark.long
@pytest.mark.parametrize("random", [False, True])
def test_flicker_and_walk_of_the_sensor(made, random):
    """The model "auto" is as good as the best other model to within the scatter of 8 records; intervals contain truth and next cycle."""
    runs = [made.compared(run, random) for run in range(8)]
    rms = {name: np.sqrt(np.mean([errors[name] ** 2 for errors, _, _ in runs])) for name in runs[0][0]}
    assert rms["auto"] < 1.2 * min(rms.values())
    assert np.mean([curve for _, curve, _ in runs]) > 0.8
    assert np.mean([following for _, _, following in runs]) > 0.8
