"""Each kind of calibration is solved, differentiated through its solution, and run under vmap and lax.map."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from jaxcal.fitting import Outcome, covariance, solve, solve_many

from . import problems as p


def check_derivative(fitted, y, step, rtol=1e-4):
    """Compare the derivative of a fitted quantity along a fixed direction with finite differences."""
    direction = np.random.default_rng(5).normal(size=y.shape)
    slope = np.vdot(jax.grad(fitted)(jnp.asarray(y)), direction)
    np.testing.assert_allclose(slope, (fitted(y + step * direction) - fitted(y - step * direction)) / (2 * step), rtol=rtol)


@pytest.mark.parametrize("truth", [(1e-4, 1e-2, 1e-3, 1e-5), (1e-4, 1e-2, 0.0, 1e-5), (0.0, 1e-2, 0.0, 0.0)])
def test_noise(truth):
    data = p.noise_data(truth)
    fit = solve(p.noise, p.Coefficients(1.0, 1.0, 1.0, 1.0), data, bounds=(0.0, np.inf)).checked()
    design = np.asarray(p.allan_columns(data["tau"])) / data["sigma"][:, None]
    size = np.linalg.norm(design, axis=0)
    exact = scipy.optimize.nnls(design / size, data["avar"] / data["sigma"])[0] / size
    np.testing.assert_allclose(fit.parameters, exact, rtol=1e-7, atol=1e-18)
    np.testing.assert_array_equal(fit.parameters == 0, exact == 0)
    np.testing.assert_array_equal(fit.at_bound, exact == 0)
    assert (fit.outcome == Outcome.at_bound) == (exact == 0).any()
    assert fit.steps < 10
    many = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(p.noise_data(truth, seed) for seed in range(60)))
    assert solve_many(p.noise, p.Coefficients(1.0, 1.0, 1.0, 1.0), many, batched=(False, True), bounds=(0.0, np.inf)).steps.max() < 12

    def white(avar):
        return solve(p.noise, p.Coefficients(1.0, 1.0, 1.0, 1.0), {**data, "avar": avar}, bounds=(0.0, np.inf)).model.N2

    check_derivative(white, data["avar"], 1e-7 * data["avar"].min())


def test_noise_starting_on_the_bound():
    data = p.noise_data((1e-4, 1e-2, 1e-3, 1e-5))
    inside, edge = (solve(p.noise, p.Coefficients(*[x] * 4), data, bounds=(0.0, np.inf)) for x in (1.0, 0.0))
    np.testing.assert_allclose(edge.parameters, inside.parameters, rtol=1e-6)


def test_magnetometer():
    data = p.magnetometer_data(count=200)
    fits = solve_many(p.magnetometer, p.IRON_START, data, batched=(False, True))
    assert fits.usable.all()
    assert fits.steps.max() <= 8
    expected = np.concatenate([p.IRON.upper, p.IRON.hard])
    error = np.asarray(fits.parameters) - expected
    matrix = np.asarray(jax.vmap(covariance)(fits))
    ratio = error / np.sqrt(np.diagonal(matrix, axis1=1, axis2=2))
    assert abs(ratio.mean(axis=0)).max() < 4 / np.sqrt(200)
    np.testing.assert_allclose(ratio.std(axis=0), 1, atol=0.2)  # four standard deviations of a sample of 200
    distance = np.einsum("ki,kij,kj->k", error, np.linalg.inv(matrix), error)
    assert abs(distance.mean() - 9) < 4 * np.sqrt(18 / 200)
    assert abs(fits.goodness.mean() - 0.5) < 4 / np.sqrt(12 * 200)

    together = solve_many(p.magnetometer, p.IRON_START, jax.tree.map(lambda a: a[:20], data), batched=(False, True), batch="vmap")
    np.testing.assert_allclose(together.parameters, fits.parameters[:20], atol=1e-8)

    one = jax.tree.map(lambda a: a[0], data)
    fit = solve(p.magnetometer, p.IRON_START, one).checked()
    np.testing.assert_allclose(fit.parameters, fits.parameters[0], atol=1e-8)
    assert fit.names == (*(f"upper[{i}]" for i in range(6)), "hard[0]", "hard[1]", "hard[2]")
    check_derivative(lambda m: solve(p.magnetometer, p.IRON_START, {**one, "m": m}).model.hard[0], one["m"], 1e-5)


@pytest.mark.parametrize("azimuth", [0.4, -2.9])
def test_alignment_over_its_branches(azimuth):
    data = p.north_data(azimuth)
    start = {"rate": 1.0, "azimuth": 0.0, "bias": 0.0}
    starts = {"rate": np.ones(4), "azimuth": np.arange(4) * np.pi / 2, "bias": np.zeros(4)}
    bounds = ({"rate": 0.0, "azimuth": -np.inf, "bias": -np.inf}, np.inf)
    fit = solve(p.north, start, data, starts=starts, bounds=bounds).checked()
    turn = (fit.model["azimuth"] - azimuth + np.pi) % (2 * np.pi) - np.pi
    assert abs(turn) < 4 * covariance(fit)[fit.names.index("azimuth"), fit.names.index("azimuth")] ** 0.5
    # rate cos(angle + azimuth) is linear in its cosine and sine amplitudes, which give the azimuth in closed form
    design = np.stack([np.cos(data["angle"]), -np.sin(data["angle"]), np.ones(8)], axis=1)
    cosine, sine, _ = np.linalg.lstsq(design, data["y"], rcond=None)[0]
    np.testing.assert_allclose(np.exp(1j * float(fit.model["azimuth"])), np.exp(1j * np.arctan2(sine, cosine)), atol=1e-7)
    if azimuth == 0.4:
        # test the sine: the starts reach azimuths that differ by a whole turn, and rounding decides between them
        check_derivative(
            lambda y: jnp.sin(solve(p.north, start, {**data, "y": y}, starts=starts, bounds=bounds).model["azimuth"]), data["y"], 1e-4
        )
