"""Inputs that `solve` accepts and refuses, and the fields of its result."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from jaxcal.fitting import Cauchy, Outcome, covariance, identifiability, intervals, solve, solve_many

from . import problems as p

X = np.linspace(0, 4, 12)
TRACES = []


def decay(model, data):
    TRACES.append(None)
    return (model["size"] * jnp.exp(-model["speed"] * data["x"]) + model["floor"] - data["y"]) / 0.02


START = {"size": 1.0, "speed": 1.0, "floor": 0.0}


def decay_data(size=2.0, speed=0.7, floor=0.1, seed=0):
    return {"x": X, "y": size * np.exp(-speed * X) + floor + 0.02 * np.random.default_rng(seed).normal(size=X.size)}


def test_new_values_never_compile_again():
    def everything(seed, size, lower, scale):
        fit = solve(decay, {**START, "size": size}, decay_data(seed=seed), bounds=(lower, np.inf), loss=Cauchy(scale)).checked()
        return intervals(fit, "jackknife")

    everything(0, 1.0, 0.0, 2.0)
    count = len(TRACES)
    everything(1, 1.5, -1.0, 3.0)
    assert len(TRACES) == count


def test_any_tree_is_a_model_and_other_leaves_stay():
    def residuals(model, y):
        assert model["kind"] == "mean"
        return model["values"][model["which"]] - y

    start = {"values": (0.0, np.zeros(2)), "which": 0, "kind": "mean"}
    fit = solve(residuals, start, np.array([1.0, 3.0]), free={"values": (True, False), "which": False, "kind": False})
    assert fit.names == ("values.0",)
    assert fit.model["kind"] == "mean"
    assert float(fit.model["values"][0]) == pytest.approx(2)


def test_held_parameters_carry_derivatives():
    data = decay_data()
    free = {"size": True, "speed": True, "floor": False}

    def size(floor):
        return solve(decay, {**START, "floor": floor}, data, free=free).model["size"]

    step = 1e-4
    np.testing.assert_allclose(jax.jit(jax.grad(size))(0.1), (size(0.1 + step) - size(0.1 - step)) / (2 * step), rtol=1e-5)


def test_an_active_bound_passes_its_derivative():
    data = decay_data()

    def speed(low):
        return solve(decay, {**START, "floor": 1.0}, data, bounds=({"size": 0.0, "speed": 0.0, "floor": low}, np.inf)).model["speed"]

    fit = solve(decay, {**START, "floor": 1.0}, data, bounds=({"size": 0.0, "speed": 0.0, "floor": 0.3}, np.inf))
    assert fit.outcome == Outcome.at_bound
    assert fit.message.endswith("At its bound: floor.")
    assert fit.model["floor"] == 0.3
    assert (covariance(fit)[fit.names.index("floor")] == 0).all()
    assert fit.degrees_of_freedom == X.size - 2
    step = 1e-4
    np.testing.assert_allclose(jax.jit(jax.grad(speed))(0.3), (speed(0.3 + step) - speed(0.3 - step)) / (2 * step), rtol=1e-5)


def test_box_bounds_give_the_constrained_optimum():
    data = decay_data()
    low, high = {"size": 0.0, "speed": 0.75, "floor": -1.0}, {"size": 1.9, "speed": 2.0, "floor": 1.0}
    fit = solve(decay, {"size": 1.0, "speed": 1.0, "floor": 0.5}, data, bounds=(low, high)).checked()
    names = list(low)
    expected = scipy.optimize.least_squares(
        lambda v: np.asarray(decay(dict(zip(names, v, strict=True)), jax.tree.map(jnp.asarray, data))), [1.0, 1.0, 0.5],
        bounds=([low[k] for k in names], [high[k] for k in names]), xtol=1e-15, ftol=1e-15, gtol=1e-15,
    )  # fmt: skip
    np.testing.assert_allclose([fit.model[k] for k in names], expected.x, atol=1e-6)
    assert fit.cost <= expected.cost * (1 + 1e-9)
    assert fit.at_bound.any()


def test_padding_changes_nothing():
    data = p.magnetometer_data()
    fit = solve(p.magnetometer, p.IRON_START, data)

    def padded(model, data):
        return jnp.where(data["use"], p.magnetometer(model, data), 0)

    more = {"m": np.vstack([data["m"], np.ones((7, 3))]), "sigma": data["sigma"], "use": np.arange(67) < 60}
    other = solve(padded, p.IRON_START, more)
    np.testing.assert_allclose(other.parameters, fit.parameters, atol=1e-9)
    np.testing.assert_allclose([other.goodness, other.degrees_of_freedom], [fit.goodness, 51])
    # padding forms no block, neither for five contiguous blocks of twelve nor with labels that only padding has
    for kind, blocks, padded_blocks in (("sandwich", 12, 12), ("jackknife", 5, 5), ("jackknife", np.arange(60) // 12, np.arange(67) // 12)):
        expected = covariance(fit, kind, blocks=blocks)
        np.testing.assert_allclose(covariance(other, kind, blocks=padded_blocks), expected, rtol=1e-5, atol=1e-6 * expected.max())


def test_precision_follows_the_inputs(precision):
    data = jax.tree.map(lambda a: np.asarray(a, dtype=precision), p.magnetometer_data())
    start = jax.tree.map(lambda a: np.asarray(a, dtype=precision), p.IRON_START)
    fit = solve(p.magnetometer, start, data).checked()
    assert {leaf.dtype for leaf in jax.tree.leaves((fit.model, fit.cost, covariance(fit)))} == {jnp.dtype(precision)}
    np.testing.assert_allclose(fit.model.hard, p.IRON.hard, atol=0.01)
    assert identifiability(fit).rank == 9
    gradient = jax.jit(jax.grad(lambda m: solve(p.magnetometer, start, {**data, "m": m}).model.hard[0]))(jnp.asarray(data["m"]))
    assert gradient.dtype == precision
    np.testing.assert_allclose(gradient.sum(axis=0), [1, 0, 0], atol=1e-3)  # a shift of all readings shifts the hard iron


def test_one_bad_log_does_not_spoil_the_others():
    data = p.magnetometer_data(count=20)
    data["m"][3, 5] = np.nan
    fits = solve_many(p.magnetometer, p.IRON_START, data, batched=(False, True))
    np.testing.assert_array_equal(~fits.usable, np.arange(20) == 3)
    assert Outcome[jax.tree.map(lambda a: a[3], fits.outcome)] == Outcome[Outcome.not_finite]


def test_step_limit(refuses):
    fit = solve(decay, START, decay_data(), max_steps=2)
    assert fit.outcome == Outcome.step_limit
    with refuses("not_converged"):
        fit.checked()


def kinked(model, _):
    return jnp.stack([jnp.abs(model) + 1, jnp.abs(model) + 1])


def test_a_kink_is_not_a_minimum():
    assert solve(kinked, 0.7).outcome == Outcome.stalled


def scale_and_bias(model, y):
    return model["scale"] * (9.81 + model["bias"]) - y


def test_an_unidentifiable_model_says_so():
    fit = solve(scale_and_bias, {"bias": 0.0, "scale": 1.0}, np.array([9.9, 9.8, 9.9]))
    assert fit.outcome == Outcome.unidentifiable
    assert not fit.usable
    assert np.isinf(covariance(fit)).all()
    report = identifiability(fit)
    assert report.rank == 1
    assert np.isinf(report.condition)
    assert "determine 1 of 2 parameters and cannot tell apart bias, scale" in report.sentence


def no_effect(model, y):
    return model["mean"] - y + 0 * model["extra"]


def test_a_parameter_without_effect_is_named():
    sentence = identifiability(solve(no_effect, {"mean": 0.0, "extra": 1.0}, np.array([1.0, 2.0, 4.0]))).sentence
    assert "determine 1 of 2 parameters and say nothing about extra; hold it fixed" in sentence


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"start": {**START, "speed": np.nan}}, "start"),
        ({"bounds": (0.5, np.inf)}, "outside"),
        ({"bounds": (1.0, -1.0)}, "bounds"),
        ({"bounds": ({"size": 0.0}, 1.0)}, "shape"),
        ({"data": {"x": X[:2], "y": X[:2]}}, "few_residuals"),
        ({"data": {"x": X, "y": np.where(X > 3.5, np.nan, X)}}, "not_finite"),
        ({"free": False}, "nothing_free"),
        ({"residuals": lambda model, data: (model["speed"],)}, "residuals"),
    ],
)
def test_refusals(change, code, refuses):
    with refuses(code):
        solve(**{"residuals": decay, "start": START, "data": decay_data()} | change)
