"""`fit` of a given kind under `jit`, `vmap` and `grad`: it has the numbers of the untraced fit and its derivative, but no verdict."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal.magnetometer import fit

from . import cases

TUMBLES = np.array([cases.paper_readings("all", 0.2, seed) for seed in range(6)])
#: noise of 5 % of the field, so that the curvature term matters
NOISY = np.array([cases.paper_readings("all", 2.5, seed) for seed in range(6)])


@pytest.fixture(scope="module")
def compiled():
    return jax.jit(jax.vmap(lambda m: fit(m, model="symmetric", field=cases.FIELD, inclination=cases.DIP)))


@pytest.mark.parametrize("tumbles", [TUMBLES, NOISY])
def test_many_fits_in_one_call_are_those_of_a_loop(compiled, tumbles):
    many = compiled(tumbles)
    for i, m in enumerate(tumbles):
        one = fit(m, model="symmetric", field=cases.FIELD, inclination=cases.DIP)
        for name in ("soft_iron", "hard_iron"):
            np.testing.assert_allclose(getattr(many.model, name)[i], getattr(one.model, name), rtol=1e-9, atol=1e-9 * cases.FIELD)
        size = np.maximum(one.estimate.error, 1e-12)
        spread = np.outer(size, size)
        np.testing.assert_allclose(many.estimate.matrix[i] / spread, one.estimate.matrix / spread, atol=1e-6)
        np.testing.assert_allclose(many.heading_error[i], one.heading_error, rtol=1e-7)
        np.testing.assert_allclose(many.residual[i], one.residual, atol=1e-7)
        assert float(many.noise[i]) == pytest.approx(one.noise, rel=1e-8)
    assert many.verdict == "not judged"
    assert many.codes == {"not_judged"}


@pytest.mark.parametrize("kind", ["symmetric", pytest.param("sphere", marks=pytest.mark.long)])
def test_the_derivative_is_that_of_finite_differences(kind):
    @jax.jit
    @functools.partial(jax.value_and_grad, argnums=(0, 1))
    def value(m, norm):
        found = fit(m, model=kind, field=norm)
        return found.model.hard_iron @ jnp.array([1.0, 2.0, -1.0]) + found.model.soft_iron[0, 0] + 10 * found.noise

    for m in (TUMBLES[0], NOISY[0]):
        by_m, by_norm = value(m, cases.FIELD)[1]
        change = np.random.default_rng(1).normal(size=m.shape)
        finite = (value(m + 1e-4 * change, cases.FIELD)[0] - value(m - 1e-4 * change, cases.FIELD)[0]) / 2e-4
        assert float(np.sum(by_m * change)) == pytest.approx(float(finite), rel=1e-4)
        finite = (value(m, cases.FIELD + 1e-3)[0] - value(m, cases.FIELD - 1e-3)[0]) / 2e-3
        assert float(by_norm) == pytest.approx(float(finite), rel=1e-4)


@pytest.mark.parametrize("options", [{}, {"model": "planar"}, {"method": "consistent", "model": "sphere"}])
def test_what_the_host_decides_is_not_traced(options, refuses):
    with refuses("traced_options"):
        jax.jit(lambda m: fit(m, **options).noise)(jnp.asarray(TUMBLES[0]))
