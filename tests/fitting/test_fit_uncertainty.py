"""Covariances, profiles and identifiability against closed forms and simulations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
import scipy.signal
import scipy.stats

from jaxcal.fitting import covariance, identifiability, information, intervals, solve, solve_many
from jaxcal.fitting._result import leverage


def line(model, data):
    return (data["design"] @ model - data["y"]) / data["sigma"]


def line_data(seed=0, n=40, clusters=10, shared=0.0, sigma=0.5):
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 1, n)
    design = np.stack([np.ones(n), t], axis=1)
    common = shared * np.repeat(rng.normal(size=clusters), n // clusters)
    return {"design": design, "y": design @ [1.0, 2.0] + common + sigma * rng.normal(size=n), "sigma": sigma}


def test_a_fit_prints_its_numbers():
    fit = solve(lambda model, y: (model["mean"] - y) / 2, {"mean": 0.0, "lost": 1.0}, jnp.array([1.0, 5.0, 3.0, 3.0]))
    first, *rows = repr(fit).splitlines()
    assert "4 residuals" in first
    assert [row.split() for row in rows] == [["lost", "open"], ["mean", "3.0", "±", "2.0"]]


def test_covariance_of_a_linear_model():
    data = line_data()
    fit = solve(line, np.zeros(2), data).checked()
    exact = np.linalg.inv(data["design"].T @ data["design"]) * 0.25
    np.testing.assert_allclose(covariance(fit), exact, rtol=1e-10)
    solution, squares, *_ = np.linalg.lstsq(data["design"], data["y"], rcond=None)
    np.testing.assert_allclose(fit.parameters, solution, rtol=1e-7)
    np.testing.assert_allclose(covariance(fit, scaled=True), exact * squares[0] / 0.25 / 38, rtol=1e-8)
    np.testing.assert_allclose(fit.goodness, scipy.stats.chi2.sf(squares[0] / 0.25, 38), rtol=1e-8)


def test_covariance_by_blocks_in_closed_form():
    data, label = line_data(shared=0.5), np.repeat(["a", "c", "b", "d", "e", "j", "i", "h", "g", "f"], 4)
    fit = solve(line, np.zeros(2), data)
    x = data["design"] / 0.5
    e = data["y"] / 0.5 - x @ fit.parameters
    bread = np.linalg.inv(x.T @ x)
    hat = x @ bread @ x.T
    # correction of Bell and McCaffrey: residuals of a block are multiplied by (1 - H)^-1/2
    blocks = [label == g for g in set(label)]
    score = np.array([x[one].T @ np.linalg.inv(scipy.linalg.sqrtm(np.eye(4) - hat[np.ix_(one, one)])) @ e[one] for one in blocks])
    expected = bread @ score.T @ score @ bread
    np.testing.assert_allclose(covariance(fit, "sandwich", blocks=label), expected, rtol=1e-7)
    np.testing.assert_allclose(covariance(fit, "sandwich", blocks=10), expected, rtol=1e-7)
    single = (x * (e / (1 - np.diag(hat)) ** 0.5)[:, None]).T
    np.testing.assert_allclose(covariance(fit, "sandwich"), bread @ single @ single.T @ bread, rtol=1e-7)

    without = np.array([np.linalg.lstsq(x[~one], data["y"][~one] / 0.5, rcond=None)[0] for one in blocks])
    away = without - without.mean(axis=0)
    for blocks in (label, 10):
        np.testing.assert_allclose(covariance(fit, "jackknife", blocks=blocks), 0.9 * away.T @ away, rtol=1e-5)
    np.testing.assert_allclose(leverage(fit), np.diag(hat), rtol=1e-8)
    np.testing.assert_allclose(leverage(fit).sum(), 2, rtol=1e-12)


def test_intervals_use_the_quantile_of_their_variance():
    fit = solve(line, np.zeros(2), line_data())
    wanted = (("model", {}, np.inf), ("model", {"scaled": True}, 38), ("sandwich", {"blocks": 8}, 7), ("jackknife", {}, 5))
    for kind, options, freedom in wanted:
        error = np.sqrt(np.diag(covariance(fit, kind, **options)))
        half = scipy.stats.t.ppf(0.95, freedom) * error
        expected = np.stack([fit.parameters - half, fit.parameters + half], axis=1)
        np.testing.assert_allclose(intervals(fit, kind, confidence=0.9, **options), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("kind", "blocks", "code"),
    [
        ("sandwich", np.arange(40) % 2, "few_blocks"),
        ("sandwich", np.arange(3), "labels"),
        ("jackknife", 1, "blocks"),
        ("model", 6, "no_blocks"),
    ],
)
def test_refused_covariances(kind, blocks, code, refuses):
    with refuses(code):
        covariance(solve(line, np.zeros(2), line_data()), kind, blocks=blocks)


def test_a_jackknife_without_its_data_or_identity(refuses):
    data = line_data()
    many = solve_many(line, np.zeros(2), jax.tree.map(lambda a: np.stack([a]), data), batched=(False, True))
    with refuses("no_data"):
        covariance(jax.tree.map(lambda a: a[0], many), "jackknife")
    # only the first block depends on the second parameter; without this block the parameter is undetermined
    apart = {**data, "design": np.stack([np.ones(40), np.arange(40) < 5], axis=1).astype(float)}
    fit = solve(line, np.zeros(2), apart)
    assert np.isfinite(covariance(fit)).all()
    assert np.isinf(covariance(fit, "jackknife")).all()


def test_information_of_a_jacobian():
    rng = np.random.default_rng(2)
    rows = rng.normal(size=(12, 3)) * [1.0, 1e-6, 1e6]
    known = information(rows)
    np.testing.assert_allclose(known.covariance, np.linalg.inv(rows.T @ rows), rtol=1e-9)
    np.testing.assert_allclose(known.leverage(rows), np.diag(rows @ np.linalg.inv(rows.T @ rows) @ rows.T), rtol=1e-9)
    traced = jax.jit(information)(rows)
    np.testing.assert_allclose(traced.covariance, known.covariance, rtol=1e-9)
    # the data determine only the sum of two parameters, and the third
    rows = np.stack([rows[:, 0], rows[:, 0], rows[:, 2]], axis=1)
    known = information(rows)
    assert known.rank == 2
    np.testing.assert_array_equal(known.determined, [False, False, True])
    np.testing.assert_array_equal(np.isinf(known.covariance), np.diag([True, True, False]))
    pair = np.linalg.inv(rows[:, 1:].T @ rows[:, 1:])
    np.testing.assert_allclose(known.covariance[2, 2], pair[1, 1], rtol=1e-9)
    held = information(rows, held=np.array([True, False, False]))
    np.testing.assert_allclose(held.covariance[1:, 1:], pair, rtol=1e-9)
    assert (held.covariance[0] == 0).all()


def test_covariance_has_a_derivative_where_singular_values_are_equal():
    design = np.kron(np.eye(2), np.ones((20, 1)))

    def variance(size):
        return covariance(solve(line, jnp.zeros(2), {"design": design * size, "y": np.ones(40), "sigma": 1.0}))[0, 0]

    np.testing.assert_allclose(jax.jit(jax.grad(variance))(2.0), -2 / 20 / 8, rtol=1e-10)


def test_identifiability_names_the_weak_direction():
    t = np.linspace(0, 1, 30)
    design = np.stack([np.ones(30), t, t + 1e-4 * np.sin(40 * t)], axis=1)
    fit = solve(line, np.zeros(3), {"design": design, "y": t, "sigma": 1.0})
    report = identifiability(fit)
    scaled = design / np.linalg.norm(design, axis=0)
    np.testing.assert_allclose(report.singular_values, np.linalg.svd(scaled, compute_uv=False), rtol=1e-9)
    np.testing.assert_allclose(report.condition, np.linalg.cond(scaled), rtol=1e-6)
    assert report.rank == 3
    assert "all 3 parameters" in report.sentence
    assert report.sentence.endswith("the least certain combination is that of parameter[1], parameter[2].")
