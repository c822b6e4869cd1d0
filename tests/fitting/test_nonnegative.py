import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from jaxcal import FitError
from jaxcal.fitting import nonnegative

solve = jax.jit(nonnegative)
many = jax.jit(jax.vmap(nonnegative))


def random_problems(kind, p, rows=20, count=60, seed=0):
    rng = np.random.default_rng(seed)
    design, data = rng.normal(size=(count, rows, p)), rng.normal(size=(count, rows))
    if kind == "positive":
        design, data = abs(design), abs(data)
    if kind == "zero column":
        design[..., 0] = 0
    if kind == "equal columns":
        design[..., -1] = design[..., 0]
    if kind == "dependent":
        design[..., -1] = design[..., 0] + design[..., 1]
    if kind == "badly scaled":
        design *= 10.0 ** np.linspace(-12, 12, p)
    if kind == "exact":
        data = np.einsum("krp,p->kr", design, np.arange(p) * 1.0)
    if kind == "all negative":
        design, data = abs(design), -abs(data)
    return design, data


@pytest.mark.parametrize("p", [2, 7])
@pytest.mark.parametrize(
    "kind", ["normal", "positive", "zero column", "equal columns", "dependent", "badly scaled", "exact", "all negative"]
)
def test_agrees_with_scipy(kind, p):
    if p == 2 and kind == "dependent":
        pytest.skip("needs three columns")
    design, data = random_problems(kind, p)
    found = many(np.einsum("krp,krq->kpq", design, design), np.einsum("krp,kr->kp", design, data))
    for a, y, value, active, cost in zip(design, data, found.value, found.active, found.cost, strict=True):
        expected, norm = scipy.optimize.nnls(a, y)
        assert np.all(value >= 0)
        assert np.all(np.asarray(value)[~np.asarray(active)] == 0)
        np.testing.assert_allclose(cost + y @ y, norm**2, atol=1e-10 * (y @ y))
        if kind not in ("equal columns", "dependent"):  # otherwise the minimiser is not unique
            np.testing.assert_allclose(np.linalg.norm(a, axis=0) * (value - expected), 0, atol=1e-9 * np.linalg.norm(y))


def test_eight_unknowns_are_the_most():
    design, data = random_problems("positive", 8, count=1)
    found = solve(design[0].T @ design[0], design[0].T @ data[0])
    np.testing.assert_allclose(found.value, scipy.optimize.nnls(design[0], data[0])[0], atol=1e-10)
    with pytest.raises(FitError, match=r"9 unknowns were given .* at most 8"):
        nonnegative(jnp.eye(9), jnp.ones(9))


def test_the_empty_set_of_columns():
    found = solve(jnp.zeros((3, 3)), jnp.ones(3))
    assert not found.active.any()
    assert not found.value.any()
    assert found.cost == 0


def test_derivatives_match_finite_differences():
    design, data = random_problems("zero column", 4, count=6)

    def value(y, a):
        return nonnegative(a.T @ a, a.T @ y).value

    derivative = jax.jit(jax.vmap(jax.jacobian(value, argnums=(0, 1))))(data, design)
    step = 1e-6
    direction = np.random.default_rng(1).normal(size=design.shape) * (design != 0)
    both = jax.jit(jax.vmap(value))
    slope = (both(data + step, design) - both(data - step, design)) / (2 * step)
    np.testing.assert_allclose(derivative[0].sum(axis=2), slope, atol=1e-7)
    slope = (both(data, design + step * direction) - both(data, design - step * direction)) / (2 * step)
    np.testing.assert_allclose(np.einsum("kprq,krq->kp", derivative[1], direction), slope, atol=1e-7)


def test_dtype_follows_the_inputs(precision):
    design, data = random_problems("positive", 4, count=1)
    a, y = jnp.asarray(design[0], dtype=precision), jnp.asarray(data[0], dtype=precision)
    found = nonnegative(a.T @ a, a.T @ y)
    assert found.value.dtype == found.cost.dtype == precision
    np.testing.assert_allclose(found.value, scipy.optimize.nnls(design[0], data[0])[0], atol=1e-4 if precision == "float32" else 1e-12)


def test_bad_input_is_not_hidden_behind_zeros():
    found = eqx.filter_jit(nonnegative)(jnp.array([[jnp.nan]]), jnp.array([1.0]))
    assert np.isnan(found.value).all()
    assert np.isnan(found.cost)
