"""Errors of the soft iron, fields of currents with their errors, saturated readings, and held-out readings."""

import numpy as np
import pytest

from jaxcal.magnetometer import body_field, check, fit, scenario

SOFT = np.array([[1.1, 0.06, -0.04], [0.06, 0.92, 0.05], [-0.04, 0.05, 1.0]])
HARD = np.array([0.3, -0.2, 0.4])
DIP = np.deg2rad(57.0)


def sphere(rng, count):
    u = rng.normal(size=(count, 3))
    return u / np.linalg.norm(u, axis=1, keepdims=True)


def inside(found, truth, name):
    return [one.low < true < one.high for one, true in zip(found.estimate.select(name).numbers(), truth.ravel(), strict=True)]


@pytest.mark.parametrize("field", [None, 1.0])
def test_intervals_of_the_soft_iron_hold_it(field):
    rng, held = np.random.default_rng(0), []
    truth = SOFT / (np.cbrt(np.linalg.det(SOFT)) if field is None else 1.0)
    for _ in range(40):
        m = sphere(rng, 150) @ SOFT.T + HARD + 0.01 * rng.normal(size=(150, 3))
        held += inside(fit(m, model="symmetric", field=field), truth, "soft_iron*")
    # 360 intervals of 95 %; six per run are independent
    assert 0.92 < np.mean(held) < 0.98


def test_saturated_readings_are_named_and_left_out():
    off = []
    for seed in range(10):
        rng = np.random.default_rng([4, seed])
        m = sphere(rng, 400) @ SOFT.T + HARD + 0.005 * rng.normal(size=(400, 3))
        m[:, 1] = np.maximum(m[:, 1], np.quantile(m[:, 1], 0.05))
        found = fit(m)
        assert next(one for one in found.findings if one.code == "clipped").facts["count"] == 20
        assert found.numbers["used"].value == 380
        assert len(found.residual) == 400
        off.append((found.model.hard_iron - HARD)[1] / found.estimate.select("hard_iron*").error[1])
    assert np.sqrt(np.mean(np.square(off))) < 1.6


@pytest.mark.parametrize("step", [0.0, 0.01])
def test_coarse_readings_are_not_taken_for_saturated_ones(step):
    wrong = 0
    for seed in range(20):
        rng = np.random.default_rng([5, seed])
        m = np.repeat(sphere(rng, 60), 8, axis=0) @ SOFT.T + HARD + 0.004 * rng.normal(size=(480, 3))
        m = np.round(m / step) * step if step else m
        wrong += "clipped" in fit(m).codes
    assert wrong <= 1


def test_a_check_says_good_where_it_is(refuses):
    words, wrong = [], []
    for seed in range(40):
        rng = np.random.default_rng([6, seed])
        attitudes = scenario("all", samples=200, seed=seed)
        m = body_field(attitudes, 1.0, DIP) @ SOFT.T + HARD + 0.01 * rng.normal(size=(200, 3))
        up = -9.81 * body_field(attitudes, 1.0, np.pi / 2)
        found = fit(m[:100], model="symmetric", inclination=DIP)
        seen = check(found, m[100:], accel=up[100:], headings=attitudes[100:, 0])
        words.append(seen.verdict)
        assert seen.norm == pytest.approx(seen.expected_norm, rel=0.35)
        other = check(found, m[100:], accel=up[100:], headings=attitudes[100:, 0] + 0.1)
        wrong.append(other.verdict)
    assert words.count("good") >= 36
    assert wrong.count("weak") == 40
    assert seen.table.shape == (12, 5)
    assert 80 < seen.table[:, 1].sum() <= 100
    with refuses("rows_differ"):
        check(found, m, headings=np.zeros(3))


def test_errors_are_listed_by_sector():
    rng = np.random.default_rng(0)
    heading = np.repeat(np.deg2rad([0.0, 90.0, 180.0, 270.0]), 10)
    attitudes = np.stack([heading, np.zeros(40), np.zeros(40)], axis=1)
    m = body_field(attitudes, 1.0, DIP) + 0.002 * rng.normal(size=(40, 3))
    found = fit(body_field(scenario("all"), 1.0, DIP) + 0.002 * rng.normal(size=(360, 3)))
    table = check(found, m, headings=heading + np.deg2rad([2.0, 0.0, 0.0, 0.0])[np.repeat(range(4), 10)]).table
    np.testing.assert_allclose(np.rad2deg(table[:, 0]), [0, 90, 180, 270])
    np.testing.assert_array_equal(table[:, 1], 10)
    np.testing.assert_allclose(np.rad2deg(table[:, 2]), [-2, 0, 0, 0], atol=0.3)
