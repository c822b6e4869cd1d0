"""Collection plans against the table of the methods' comparison, simulated fits, and finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal import DataError
from jaxcal.magnetometer import MagModel, body_field, fit, plan, predict, scenario

from . import cases

UNIT = 1.0 / 47.0


def test_prediction_is_the_tabulated_bound():
    """Heading error in degrees per uT at C = I, by inclination; the reference values are accurate to 5 to 10 %."""
    for dip, twelve, turns in ((10, 3.7, 0.15), (30, 3.4, 0.21), (45, 4.9, 0.37), (57, 8.2, 0.77), (70, 21, 2.7)):
        for name, listed in (("twelve_points", twelve), ("three_turns", turns)):
            found = np.rad2deg(predict(scenario(name), UNIT, inclination=np.deg2rad(dip))[0])
            assert found == pytest.approx(listed, rel=0.08)


def test_prediction_is_what_fits_then_scatter():
    attitudes = np.concatenate([scenario("twelve_points", elevation=np.deg2rad(60.0))] * 4)
    field, sensor, errors = body_field(attitudes, 47.0, cases.DIP), MagModel(np.eye(3), np.zeros(3)), []
    for seed in range(40):
        m = field + 0.2 * np.random.default_rng(seed).normal(size=field.shape)
        errors.append(cases.heading_errors(fit(m, model="symmetric").model, sensor))
    # 40 runs with about five independent numbers: the rms has a standard error of 5 %
    assert cases.rms(errors) == pytest.approx(np.rad2deg(predict(attitudes, 0.2 / 47)[0]), rel=0.15)


@pytest.mark.long
def test_a_plan_beats_every_listed_one_and_keeps_its_limits():
    # the best twelve-point plan of the reference is six faces with two points each: 2.5 degrees per uT for C = inv(Si1)
    found = plan(12, UNIT)
    assert np.rad2deg(found.heading_error[0]) < 2.3
    assert np.all(found.heading_error < predict(scenario("twelve_points"), UNIT) / 3)
    limited = plan(12, UNIT, elevation=(-0.5, 0.5), bank=(-0.6, 0.6), limit=np.deg2rad(0.5))
    assert np.abs(limited.attitudes[:, 1]).max() <= 0.5
    assert np.abs(limited.attitudes[:, 2]).max() <= 0.6
    assert limited.heading_error.max() <= np.deg2rad(0.5)
    repeated = np.repeat(limited.attitudes, limited.repeats, axis=0)
    np.testing.assert_allclose(predict(repeated, UNIT), limited.heading_error, rtol=1e-6)
    fewer = np.repeat(limited.attitudes, max(limited.repeats - 1, 1), axis=0)
    assert predict(fewer, UNIT).max() > np.deg2rad(0.5)


def test_the_prediction_is_the_bound_written_out_and_has_a_gradient():
    attitudes = scenario("all", samples=12, seed=3)
    least = cases.least_heading_error(MagModel(np.eye(3), np.zeros(3)), 1.0, body_field(attitudes, 1.0, 0.9), UNIT, dip=0.9)
    assert np.rad2deg(predict(attitudes, UNIT, inclination=0.9)[0]) == pytest.approx(least, rel=1e-6)
    cost = jax.jit(lambda a: jnp.log(jnp.mean(predict(a, UNIT, inclination=0.9) ** 2)))  # the cost that `plan` minimises
    slope = np.asarray(jax.grad(cost)(jnp.asarray(attitudes)))
    for index in ((0, 0), (3, 1), (7, 2)):
        ends = []
        for step in (1e-6, -1e-6):
            moved = attitudes.copy()
            moved[index] += step
            ends.append(float(cost(jnp.asarray(moved))))
        assert slope[index] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-5, abs=1e-7)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"count": 9}, "10 attitudes or more"),
        ({"count": 12, "elevation": (1.0, -1.0)}, "no interval"),
        ({"count": 12, "noise": 0.0}, "positive noise"),
    ],
)
def test_bad_plans_are_errors(options, words):
    with pytest.raises(DataError, match=words):
        plan(**{"noise": UNIT, **options})
    with pytest.raises(DataError, match="at least 10 rows"):
        predict(np.zeros((3, 3)), UNIT)
    with pytest.raises(DataError, match="leave the calibration open"):
        plan(12, UNIT, elevation=(0.0, 0.0), bank=(0.0, 0.0))
