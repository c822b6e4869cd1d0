import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from jaxcal.fitting import Cauchy, Huber, covariance, solve, solve_many

from . import problems as p

LOSSES = {"huber": Huber, "cauchy": Cauchy}
TRUTH = np.array([0.3, -0.5, 0.2, 0.1])
START = {"c": np.zeros(4)}


@pytest.mark.parametrize("name", LOSSES)
def test_same_optimum_as_scipy(name):
    data, scale = p.thermal_data(seed=3), 1.5
    fit = solve(p.thermal, START, data, loss=LOSSES[name](scale)).checked()
    design = np.vander(data["t"], 4, increasing=True)
    expected = scipy.optimize.least_squares(
        lambda c: (design @ c - data["y"]) / 0.01, np.zeros(4), jac=lambda c: design / 0.01, loss=name, f_scale=scale,
        xtol=1e-15, ftol=1e-15, gtol=1e-15,
    )  # fmt: skip
    np.testing.assert_allclose(fit.parameters, expected.x, atol=1e-6)
    np.testing.assert_allclose(fit.cost, expected.cost, rtol=1e-9)
    one, step = lambda y: solve(p.thermal, START, {**data, "y": y}, loss=LOSSES[name](scale)).model["c"][1], 1e-7 * np.cos(data["y"])
    slope = np.vdot(jax.jit(jax.grad(one))(jnp.asarray(data["y"])), step)
    np.testing.assert_allclose(slope, (one(data["y"] + step) - one(data["y"] - step)) / 2, rtol=1e-4)


@pytest.mark.parametrize("loss", [Huber(), Cauchy()])
def test_weight_is_the_slope_of_the_cost(loss, precision):
    r = jnp.asarray([-20.0, -4.0, -1.0, -1e-6, 0.0, 1e-9, 0.5, 2.0, 3.0], dtype=precision)

    def cost(r):
        return 0.5 * jnp.sum(loss(r) ** 2)

    value, weight, slope, curvature = jax.jit(lambda r: (loss(r), loss.weight(r), jax.grad(cost)(r), jax.hessian(cost)(r)))(r)
    eps = np.finfo(precision).eps
    np.testing.assert_allclose(slope, weight * r, rtol=200 * eps, atol=eps)
    assert ((weight >= 0) & (weight <= 1)).all()
    assert weight[4] == 1
    assert value.dtype == precision
    np.testing.assert_allclose(value[3:6], r[3:6], rtol=1e-12 + 200 * eps)
    assert np.isfinite(curvature).all()


@pytest.mark.long
@pytest.mark.parametrize("loss", [Huber(), Cauchy()])
def test_covariance_and_gain_on_heavy_tails(loss):
    data = jax.tree.map(lambda *a: np.stack(a), *[p.thermal_data(seed) for seed in range(300)])
    rough = solve_many(p.thermal, START, data, batched=(False, True), loss=Huber())
    fits = rough if isinstance(loss, Huber) else solve_many(p.thermal, rough.model, data, loss=loss)
    assert fits.usable.all()
    error = np.asarray(fits.parameters) - TRUTH
    plain = np.asarray(solve_many(p.thermal, START, data, batched=(False, True)).parameters) - TRUTH
    assert (error.var(axis=0) < 0.5 * plain.var(axis=0)).all()
    predicted = np.diagonal(np.asarray(jax.vmap(covariance)(fits)), axis1=1, axis2=2).mean(axis=0)
    np.testing.assert_allclose(error.var(axis=0) / predicted, 1, atol=4 * np.sqrt(2 / 300))
