"""Model, attitudes, heading and coverage against closed forms and published figures."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal import DataError
from jaxcal.magnetometer import MagModel, body_field, coverage, heading, scenario

from . import cases


def test_measure_is_the_matrix_product_and_correct_undoes_it(precision):
    h = cases.directions(20, 0)
    m = cases.PAPER.measure(h)
    np.testing.assert_allclose(m, h @ np.asarray(cases.PAPER.soft_iron).T + cases.PAPER.hard_iron, rtol=1e-13)
    np.testing.assert_allclose(cases.PAPER.correct(m), h, atol=1e-13)
    np.testing.assert_allclose(cases.PAPER.correct(m[3]), h[3], atol=1e-13)


def test_the_model_is_traced_like_any_function():
    model = MagModel(jnp.asarray(cases.MILD.soft_iron), jnp.asarray(cases.MILD.hard_iron))
    m = jnp.asarray(cases.directions(5, 1))
    eager = cases.MILD.correct(np.asarray(m))
    np.testing.assert_allclose(jax.jit(lambda a, b: a.correct(b))(model, m), eager, rtol=1e-12)
    np.testing.assert_allclose(jax.vmap(model.correct)(m), eager, rtol=1e-12)
    slope = jax.grad(lambda a: jnp.sum(a.correct(m)[:, 0]))(model)
    np.testing.assert_allclose(slope.hard_iron, -5 * np.linalg.inv(cases.MILD.soft_iron)[0], rtol=1e-12)


def test_the_field_in_body_axes_has_its_norm_and_the_right_signs():
    attitudes = np.deg2rad([[0, 0, 0], [90, 0, 0], [0, 90, 0], [0, 0, 90]])
    expected = [[0.5, 0, np.sqrt(0.75)], [0, -0.5, np.sqrt(0.75)], [-np.sqrt(0.75), 0, 0.5], [0.5, np.sqrt(0.75), 0]]
    np.testing.assert_allclose(body_field(attitudes, 1.0, np.pi / 3), expected, atol=1e-12)


def test_scenarios_are_those_of_the_paper():
    everywhere, turns, twelve = (scenario(name) for name in ("all", "three_turns", "twelve_points"))
    assert set(np.rad2deg(turns[:, 1]).round(9)) == {-30.0, 0.0, 30.0} == set(np.rad2deg(twelve[:, 1]).round(9))
    assert sorted(set(np.rad2deg(twelve[:, 0]).round(9))) == [0.0, 90.0, 180.0, 270.0]
    assert not turns[:, 2].any()
    # for uniform directions, the mean sine of the elevation is 0 +- 1/sqrt(3 n)
    assert abs(np.mean(np.sin(everywhere[:, 1]))) < 4 / np.sqrt(3 * 360)
    np.testing.assert_array_equal(everywhere, scenario("all", seed=0))
    with pytest.raises(DataError, match="no scenario 'thirteen'"):
        scenario("thirteen")
    with pytest.raises(DataError, match="of 0 samples"):
        scenario("all", samples=0)


@pytest.mark.parametrize("tilt", [0.0, 20.0, 60.0])
def test_heading_undoes_any_attitude(tilt, precision):
    rng = np.random.default_rng(0)
    attitudes = np.stack(
        [rng.uniform(0, 2 * np.pi, 50), np.deg2rad(tilt) * rng.uniform(-1, 1, 50), np.deg2rad(tilt) * rng.uniform(-1, 1, 50)], 1
    )
    up = -9.81 * body_field(attitudes, 1.0, np.pi / 2)  # gravity is a field that dips by 90 degrees
    found = heading(body_field(attitudes, 50e-6, 1.0), up, declination=0.1)
    np.testing.assert_allclose(np.exp(1j * (found - 0.1)), np.exp(1j * attitudes[:, 0]), atol=1e-12)
    assert ((found >= 0) & (found < 2 * np.pi)).all()


def test_heading_is_traced():
    m, f = jnp.array([20.0, 5.0, 40.0]), jnp.array([1.0, -2.0, -9.5])
    eager = heading(np.asarray(m), np.asarray(f))
    assert float(jax.jit(heading)(m, f)) == pytest.approx(float(eager), rel=1e-12)
    np.testing.assert_allclose(jax.vmap(heading)(jnp.stack([m, m]), jnp.stack([f, f])), [eager, eager], rtol=1e-12)
    slope, step = jax.grad(heading)(m, f), 1e-6
    for i in range(3):
        change = np.zeros(3)
        change[i] = step
        finite = (heading(np.asarray(m) + change, np.asarray(f)) - heading(np.asarray(m) - change, np.asarray(f))) / (2 * step)
        assert float(slope[i]) == pytest.approx(float(finite), rel=1e-6, abs=1e-10)


def test_where_there_is_no_heading_it_says_why():
    up = np.tile([0.0, 0.0, -9.81], (3, 1))
    up[1] = 0.0
    with pytest.warns(UserWarning, match="2 of 3 headings are NaN"):
        found = heading(np.array([[20.0, 0, 40], [20, 0, 40], [1, 0, 40]]), up)
    assert np.isnan(found).tolist() == [False, True, True]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isfinite(heading(np.array([20.0, 0, 40]), np.array([9.81, 0.0, 0.0])))  # nose up
    with pytest.raises(DataError, match="both must be"):
        heading(np.ones(3), np.ones((2, 3)))


def test_coverage_of_known_directions():
    u = cases.directions(20_000, 0)
    full = coverage(u)
    # regions have equal areas: each has 200 readings on average, with a standard deviation of 14
    assert np.abs(full.counts - 200).max() < 5 * np.sqrt(200)
    assert not len(full.missing)
    half = coverage(u[u[:, 0] > 0])
    assert half.largest_gap == pytest.approx(np.pi / 2, abs=0.05)
    assert half.occupied == pytest.approx(0.5, abs=0.05)
    assert np.all(half.missing[:, 0] < 0.3)
    with pytest.raises(DataError, match="zero or not finite"):
        coverage(np.zeros((3, 3)))
    with pytest.raises(DataError, match="shape"):
        coverage(np.ones(3))
