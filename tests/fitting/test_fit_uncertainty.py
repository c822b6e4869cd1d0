"""Covariances, profiles and identifiability against closed forms and Monte Carlo."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
import scipy.stats

from jaxcal._errors import FitError
from jaxcal.fitting import Outcome, covariance, identifiability, profile_interval, solve, solve_many, standard_errors

from . import problems as p


def line(model, data):
    return (data["design"] @ model - data["y"]) / data["sigma"]


def line_data(seed=0, n=40, clusters=10, shared=0.0, sigma=0.5):
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 1, n)
    design = np.stack([np.ones(n), t], axis=1)
    common = shared * np.repeat(rng.normal(size=clusters), n // clusters)
    return {"design": design, "y": design @ [1.0, 2.0] + common + sigma * rng.normal(size=n), "sigma": sigma}


def test_covariance_of_a_linear_model():
    data = line_data()
    fit = solve(line, np.zeros(2), data).checked()
    exact = np.linalg.inv(data["design"].T @ data["design"]) * 0.25
    np.testing.assert_allclose(covariance(fit), exact, rtol=1e-10)
    solution, squares, *_ = np.linalg.lstsq(data["design"], data["y"], rcond=None)
    np.testing.assert_allclose(fit.parameters, solution, rtol=1e-7)
    np.testing.assert_allclose(covariance(fit, scaled=True), exact * squares[0] / 0.25 / 38, rtol=1e-8)
    np.testing.assert_allclose(fit.goodness, scipy.stats.chi2.sf(squares[0] / 0.25, 38), rtol=1e-8)


def test_cluster_covariance_in_closed_form():
    data, label = line_data(shared=0.5), np.repeat(["a", "c", "b", "d", "e", "j", "i", "h", "g", "f"], 4)
    number = np.unique(label, return_inverse=True)[1]
    fit = solve(line, np.zeros(2), data)
    x, e = data["design"], data["y"] - data["design"] @ np.asarray(fit.parameters)
    meat = sum(np.outer(x[label == g].T @ e[label == g], x[label == g].T @ e[label == g]) for g in np.unique(label))
    bread = np.linalg.inv(x.T @ x)
    np.testing.assert_allclose(covariance(fit, clusters=number), 10 / 9 * 39 / 38 * bread @ meat @ bread, rtol=1e-7)
    np.testing.assert_allclose(covariance(fit, clusters=7 - 3 * number), covariance(fit, clusters=number), rtol=1e-10)
    with pytest.raises(FitError, match="2 clusters cannot give the covariance of 2 parameters; record more"):
        covariance(fit, clusters=np.arange(40) % 2)
    with pytest.raises(FitError, match=r"shape \(3,\); give one per residual, shape \(40,\)"):
        covariance(fit, clusters=np.arange(3))


def test_coverage_with_clusters():
    data = jax.tree.map(lambda *a: np.stack(a), *[line_data(seed, n=120, clusters=30, shared=1.0) for seed in range(400)])
    fits = solve_many(line, np.zeros(2), data, batched=(False, True))
    clusters = np.repeat(np.arange(30), 4)
    error = abs(np.asarray(fits.parameters)[:, 0] - 1)
    robust = np.asarray(jax.vmap(lambda fit: standard_errors(fit, clusters=clusters))(fits))[:, 0]
    naive = np.asarray(jax.vmap(lambda fit: standard_errors(fit, scaled=True))(fits))[:, 0]
    assert abs(np.mean(error < scipy.stats.t.ppf(0.975, 29) * robust) - 0.95) < 4 * np.sqrt(0.95 * 0.05 / 400)
    assert np.mean(error < 1.96 * naive) < 0.8


def test_profile_of_a_linear_model_is_the_covariance():
    fit = solve(line, np.zeros(2), line_data())
    for i, name in enumerate(fit.names):
        reach = scipy.stats.norm.ppf(0.95) * float(standard_errors(fit)[i])
        interval = profile_interval(fit, name, confidence=0.9)
        np.testing.assert_allclose([interval.low, interval.high], [fit.parameters[i] - reach, fit.parameters[i] + reach], rtol=1e-5)
        reach = scipy.stats.t.ppf(0.95, 38) * float(standard_errors(fit, scaled=True)[i])
        interval = profile_interval(fit, name, confidence=0.9, scaled=True)
        np.testing.assert_allclose([interval.low, interval.high], [fit.parameters[i] - reach, fit.parameters[i] + reach], rtol=1e-5)


def growth(model, data):
    return (model["top"] * (1 - jnp.exp(-model["speed"] * data["x"])) - data["y"]) / 0.1


GROWTH = {"x": np.array([0.5, 1.0, 1.5, 2.0, 2.5, 3.0]), "y": np.array([0.42, 0.85, 0.99, 1.32, 1.39, 1.6])}


def test_profile_of_a_curved_model():
    fit = solve(growth, {"top": 2.0, "speed": 0.5}, GROWTH).checked()

    def excess(speed):
        # top enters linearly: its best value for a given speed in closed form
        shape = 1 - np.exp(-speed * GROWTH["x"])
        top = shape @ GROWTH["y"] / (shape @ shape)
        return np.sum(((top * shape - GROWTH["y"]) / 0.1) ** 2) - 2 * float(fit.cost) - scipy.stats.chi2.ppf(0.95, 1)

    best = float(fit.model["speed"])
    interval = profile_interval(fit, "speed")
    np.testing.assert_allclose(interval.low, scipy.optimize.brentq(excess, 1e-3, best), rtol=1e-5)
    np.testing.assert_allclose(interval.high, scipy.optimize.brentq(excess, best, 5), rtol=1e-5)
    assert interval.high - best > 1.05 * (best - interval.low)
    with pytest.raises(FitError, match="no parameter 'slope'; the fit has speed, top"):
        profile_interval(fit, "slope")


def test_profile_at_a_bound_and_without_limit():
    data = p.noise_data((1e-4, 1e-2, 0.0, 0.0))
    fit = solve(p.noise, p.Coefficients(*[1.0] * 4), data, bounds=(0.0, np.inf))
    held = [name for name, at in zip(fit.names, fit.at_bound, strict=True) if at]
    assert held
    for name in held:
        interval = profile_interval(fit, name)
        assert interval.low == 0
        assert 0 < interval.high < 1e-3
    flat = solve(growth, {"top": 2.0, "speed": 0.5}, {"x": GROWTH["x"][:3], "y": GROWTH["y"][:3]})
    interval = profile_interval(flat, "top")  # three points do not bend enough to bound the level they tend to
    assert 0 < interval.low < flat.model["top"]
    assert interval.high == np.inf


def two_wells(model, _):
    return jnp.stack([(model["a"] ** 2 - 4) / 2, (model["a"] - 2) / 3])


def test_a_better_fit_on_the_way_is_not_kept_quiet():
    fit = solve(two_wells, {"a": -2.5})
    assert fit.outcome == Outcome.converged
    with pytest.raises(FitError, match=r"A better fit than the given one turned up at a = .*; start there, or use several starts"):
        profile_interval(fit, "a", confidence=0.95)


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
