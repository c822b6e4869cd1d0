"""Verdicts and intervals of `multi_position` for recordings of an independent simulator with effects outside the model.

benchmarks/imu_honesty.py runs all cases with more seeds.
"""

import numpy as np
import pytest

import jaxcal

from . import world

SEEDS = range(4)


def calibrated(seed, case):
    stamps, accel, gyro, truth = world.record(seed, **world.CASES[case])
    return jaxcal.imu.multi_position(jaxcal.Log(stamps, accel=accel, gyro=gyro), gravity=world.GRAVITY, held_out=False), truth


@pytest.fixture(scope="module")
def base():
    return [calibrated(seed, "base") for seed in SEEDS]


@pytest.mark.long
def test_a_linear_sensor_is_good_and_in_its_intervals(base):
    assert all(found.verdict == "good" for found, _ in base)
    free = np.array(base[0][0].standard_error) > 0
    inside = [((f.interval[:, 0] <= truth) & (truth <= f.interval[:, 1]))[free] for f, truth in base]
    # 4 runs of 30 parameters in correlated groups: the coverage has a standard error of about 3 %
    assert np.mean(inside) > 0.88


@pytest.mark.long
def test_missing_samples_cost_next_to_nothing(base):
    """When 2 % of the samples are lost (only gaps in the stamps show it), all poses and turns are found; errors grow by 10 % at most.

    If one of two estimates uses a part of the other's data, the variance of their difference is the difference of their variances:
    1.1^2 - 1.
    """
    moved, wider = [], []
    for seed, (whole, _) in zip(SEEDS, base, strict=True):
        found, _ = calibrated(seed, "missing 2 %")
        assert found.verdict == "good"
        assert (len(found.still), len(found.residual_turn)) == (len(whole.still), len(whole.residual_turn))
        free = whole.standard_error > 0
        wider.append(found.standard_error[free] / whole.standard_error[free])
        moved.append((found.values - whole.values)[free] / whole.standard_error[free])
    assert np.mean(wider) <= 1.1
    assert np.sqrt(np.mean(np.square(moved))) <= np.sqrt(1.1**2 - 1)


@pytest.mark.long
@pytest.mark.parametrize(
    ("case", "words"),
    [
        ("quadratic", ("poses ask for", "quadratic term")),
        ("asymmetry", ("poses ask for", "asymmetry of sign")),
        ("gyro cubic", ("turns ask for", "cubic term")),
        ("warm-up", ("poses ask for", "drift")),
        ("9 poses", ("There are 9 poses",)),
        ("quadratic, 12", ("poses and turns ask for", "quadratic term")),
    ],
)
def test_what_the_model_lacks_is_named(case, words):
    found, _ = calibrated(0, case)
    assert found.verdict == "weak"
    assert all(word in found.reason for word in words)


@pytest.mark.long
def test_a_hand_that_turns_in_the_rests_makes_no_scale():
    """A drift of 1.5 degrees within the rests shortens the mean force by 3e-4 of it, which is five standard errors of the scale."""
    inside = []
    for seed in range(4):
        found, truth = calibrated(seed, "wide drift")
        inside.append((found.interval[[0, 4, 8], 0] <= truth[[0, 4, 8]]) & (truth[[0, 4, 8]] <= found.interval[[0, 4, 8], 1]))
    assert np.mean(inside) > 0.8


def test_nine_poses_are_known_as_well_as_their_scatter_says():
    found, truth = calibrated(1, "9 poses")
    free = np.array([0, 1, 2, 4, 5, 8, 9, 10, 11])
    assert np.all(found.standard_error[free] > 1e-5)
    assert np.all((found.interval[free, 0] <= truth[free]) & (truth[free] <= found.interval[free, 1]))


def test_few_poses_of_an_accelerometer_alone_are_held_against_the_scatter_inside_them():
    for case, verdict in (("12 poses", "good"), ("quadratic, 12", "weak")):
        stamps, accel, _, _ = world.record(0, **world.CASES[case])
        found = jaxcal.imu.multi_position(jaxcal.Log(stamps, accel=accel), gravity=world.GRAVITY, held_out=False)
        assert found.verdict == verdict
        assert ("scatter" in found.reason) == (verdict == "weak")
