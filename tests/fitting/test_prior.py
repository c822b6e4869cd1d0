"""Priors against the closed form of Bayesian linear regression."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal.fitting import AbstractPrior, Gaussian, Huber, covariance, identifiability, solve, solve_many
from jaxcal.fitting._result import leverage

RNG = np.random.default_rng(4)
DESIGN = RNG.normal(size=(30, 3))
Y = DESIGN @ [1.0, 2.0, 3.0] + RNG.normal(size=30)
START = {"x": np.zeros(2), "scale": 0.0}
MEAN, SIGMA = np.array([0.5, 0.8, 2.9]), np.array([0.1, 0.2, 0.3])  # for scale and x, in the order of the leaves


def line(model, data):
    design, y = data
    return design @ jnp.concatenate([model["scale"][None], model["x"]]) - y


PRIORS = (Gaussian("scale", MEAN[0], SIGMA[0]), Gaussian("x", MEAN[1:], SIGMA[1:]))
PRIOR = np.diag(SIGMA**-2)
POSTERIOR = np.linalg.inv(DESIGN.T @ DESIGN + PRIOR)


def test_posterior_of_a_linear_model():
    fit = solve(line, START, (DESIGN, Y), priors=PRIORS).checked()
    np.testing.assert_allclose(fit.parameters, POSTERIOR @ (DESIGN.T @ Y + PRIOR @ MEAN), rtol=1e-8)
    np.testing.assert_allclose(covariance(fit), POSTERIOR, rtol=1e-10)
    # degrees of freedom count only the data: n less the trace of the hat matrix of the data
    hat = DESIGN @ POSTERIOR @ DESIGN.T
    np.testing.assert_allclose(leverage(fit), np.diag(hat), rtol=1e-9)
    np.testing.assert_allclose(fit.degrees_of_freedom, 30 - np.trace(hat), rtol=1e-10)
    assert fit.residuals.shape == (30,)
    assert fit.count == 30
    # scaling applies to the errors of the data, not to those of the priors
    scatter = fit.variance * DESIGN.T @ DESIGN + PRIOR
    np.testing.assert_allclose(covariance(fit, scaled=True), POSTERIOR @ scatter @ POSTERIOR, rtol=1e-9)


def test_covariances_by_blocks_hold_the_prior_for_certain():
    fit = solve(line, START, (DESIGN, Y), priors=PRIORS)
    residual, hat = Y - DESIGN @ fit.parameters, DESIGN @ POSTERIOR @ DESIGN.T
    score = DESIGN * (residual / np.sqrt(1 - np.diag(hat)))[:, None]
    np.testing.assert_allclose(covariance(fit, "sandwich"), POSTERIOR @ (score.T @ score + PRIOR) @ POSTERIOR, rtol=1e-6)
    blocks = np.repeat(np.arange(6), 5)
    kept = [(DESIGN[blocks != b], Y[blocks != b]) for b in range(6)]
    without = np.array([np.linalg.solve(a.T @ a + PRIOR, a.T @ y + PRIOR @ MEAN) for a, y in kept])
    away = without - without.mean(axis=0)
    expected = 5 / 6 * away.T @ away + POSTERIOR @ PRIOR @ POSTERIOR
    np.testing.assert_allclose(covariance(fit, "jackknife"), expected, rtol=1e-6)


@pytest.mark.long
def test_coverage_with_a_prior():
    """The true parameters are drawn from the prior, and the errors of the data are three times the assumed ones."""
    rng = np.random.default_rng(5)
    truth = MEAN + SIGMA * rng.normal(size=(2000, 3))
    y = np.einsum("np,kp->kn", DESIGN, truth) + 3 * rng.normal(size=(2000, 30))
    fits = solve_many(line, START, (DESIGN, y), batched=(False, (False, True)), priors=PRIORS)
    error = np.asarray(jax.jit(jax.vmap(lambda fit: jnp.sqrt(jnp.diagonal(covariance(fit, scaled=True)))))(fits))
    assert abs(np.mean(abs(fits.parameters - truth) < 1.96 * error) - 0.95) < 0.02


def test_a_prior_determines_what_the_data_do_not():
    data = (np.ones((5, 3)), np.full(5, 4.0))
    fit = solve(line, START, data, priors=PRIORS[1]).checked()
    np.testing.assert_allclose(fit.model["x"], MEAN[1:], rtol=1e-8)
    assert identifiability(fit).rank == 3
    assert solve(line, START, (DESIGN[:1], Y[:1]), priors=PRIORS).usable  # three residuals of priors and one of the data


class Ratio(AbstractPrior):
    """A user-defined prior: both elements of x are equal to within 0.1."""

    def residuals(self, model):
        return (model["x"][0] - model["x"][1]) / 0.1


def test_a_prior_of_ones_own_and_a_function_of_the_model():
    by_name = solve(line, START, (DESIGN, Y), priors=Gaussian("x[1]", 2.0, 0.1))
    by_function = solve(line, START, (DESIGN, Y), priors=Gaussian(lambda model: model["x"][1], 2.0, 0.1))
    np.testing.assert_allclose(by_function.parameters, by_name.parameters, rtol=1e-10)
    row = np.array([0, 10, -10])
    own = solve(line, START, (DESIGN, Y), priors=Ratio())
    np.testing.assert_allclose(own.parameters, np.linalg.solve(DESIGN.T @ DESIGN + np.outer(row, row), DESIGN.T @ Y), rtol=1e-8)


def test_a_loss_does_not_act_on_a_prior():
    far = Gaussian("scale", 100.0, 0.1)
    robust = solve(line, START, (DESIGN, Y), priors=far, loss=Huber(1e3)).checked()
    np.testing.assert_allclose(robust.parameters, solve(line, START, (DESIGN, Y), priors=far).parameters, rtol=1e-8)
    assert robust.weights.shape == (30,)


def test_derivatives_of_priors_and_held_values():
    free = {"x": np.array([True, False]), "scale": True}

    @jax.jit
    def scale(values):
        mean, sigma, held = values
        start = {"x": jnp.stack([jnp.zeros(()), held]), "scale": 0.0}
        return solve(line, start, (DESIGN, Y), free=free, loss=Huber(), priors=(Gaussian("scale", mean, sigma),)).model["scale"]

    at, step = jnp.array([0.5, 0.2, 2.5]), 1e-5 * jnp.eye(3)
    differences = [(scale(at + one) - scale(at - one)) / 2e-5 for one in step]
    np.testing.assert_allclose(jax.grad(scale)(at), differences, rtol=1e-4)


@pytest.mark.parametrize(("prior", "code"), [(Gaussian("slope", 0.0, 1.0), "no_parameter"), (Gaussian("scale", 0.0, 0.0), "not_finite")])
def test_refused_priors(prior, code, refuses):
    with refuses(code):
        solve(line, {"x": np.ones(2), "scale": 1.0}, (DESIGN, Y), priors=(prior,))
