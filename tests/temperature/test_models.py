"""Curves, hysteresis filters and `ThermalModel`: closed forms, scipy, plain loops, derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import chebyshev
from scipy.interpolate import CubicSpline

from jaxcal import DataError
from jaxcal.temperature import Chebyshev, ClampWarning, Piecewise, Steps, ThermalModel
from jaxcal.temperature._hysteresis import lagged, played

T = np.linspace(20.0, 45.0, 57)
BASE = Chebyshev(np.array([0.2, -0.1, 0.05, 0.02]), 20.0, 45.0)
STEPPED = Steps(BASE, np.array([0.3, -0.1]), np.array([24.5, 33.0]), np.array([0.08, 0.5]))
_CUBIC = CubicSpline([20.0, 27.0, 36.0, 45.0], [0.1, 0.4, 0.2, 0.3])
SPLINE = Piecewise(_CUBIC.x, np.ascontiguousarray(_CUBIC.c[::-1].T))


def test_curves_are_their_formulas():
    u = (T - 32.5) / 12.5
    np.testing.assert_allclose(BASE.value(T), chebyshev.chebval(u, BASE.coefficients), atol=1e-15)
    logistic = 0.3 / (1 + np.exp(-(T - 24.5) / 0.08)) - 0.1 / (1 + np.exp(-(T - 33) / 0.5))
    np.testing.assert_allclose(STEPPED.value(T), chebyshev.chebval(u, BASE.coefficients) + logistic, atol=1e-12)
    np.testing.assert_allclose(SPLINE.value(T), _CUBIC(T), atol=1e-14)
    assert SPLINE.value(np.array([0.0, 99.0])) == pytest.approx([0.1, 0.3])


@pytest.mark.parametrize("curve", [BASE, STEPPED, SPLINE])
def test_curves_are_traced_and_differentiable(curve):
    t = jnp.asarray(T[1:-1])
    np.testing.assert_allclose(jax.jit(lambda c, x: c.value(x))(curve, t), curve.value(T[1:-1]), rtol=1e-12)
    np.testing.assert_allclose(jax.vmap(curve.value)(t), curve.value(T[1:-1]), rtol=1e-12)
    slope = jax.vmap(jax.grad(lambda x: curve.value(x)))(t)
    np.testing.assert_allclose(slope, (curve.value(T[1:-1] + 1e-6) - curve.value(T[1:-1] - 1e-6)) / 2e-6, atol=1e-6)


def test_the_derivative_by_the_parameters_is_that_of_finite_differences():
    gradient = jax.grad(lambda c: c.value(jnp.asarray(24.55)))(jax.tree.map(jnp.asarray, STEPPED))
    for name in ("height", "centre", "width"):
        shift = 1e-6 * np.array([1.0, 0.0])
        up, down = (
            Steps(BASE, *(getattr(STEPPED, n) + (sign * shift if n == name else 0) for n in ("height", "centre", "width")))
            for sign in (1, -1)
        )
        expected = (up.value(24.55) - down.value(24.55)) / 2e-6
        assert float(getattr(gradient, name)[0]) == pytest.approx(float(expected), rel=1e-6)


def test_the_filters_are_their_recurrences():
    rng = np.random.default_rng(0)
    t = 30 + np.cumsum(rng.normal(size=300)) * 0.2
    dt = rng.uniform(0.5, 2.0, 300)
    slow, behind = [t[0]], [t[0]]
    for k in range(1, 300):
        slow.append(slow[-1] + (1 - np.exp(-dt[k] / 20)) * (t[k] - slow[-1]))
        behind.append(min(max(behind[-1], t[k] - 0.6), t[k] + 0.6))
    np.testing.assert_allclose(lagged(t, dt, 20.0), slow, atol=1e-11)
    np.testing.assert_allclose(played(t, 0.6), behind, atol=1e-12)
    np.testing.assert_array_equal(lagged(t, 1.0, 0.0), t)
    np.testing.assert_array_equal(played(t, 0.0), t)
    np.testing.assert_allclose(jax.jit(lagged)(t, dt, 20.0), slow, atol=1e-11)
    np.testing.assert_allclose(jax.jit(played)(t, 0.6), behind, atol=1e-12)
    assert np.isfinite(jax.grad(lambda tau: jnp.sum(lagged(t, 1.0, tau)))(0.0))
    slope = jax.grad(lambda tau: jnp.sum(lagged(t, dt, tau)))(20.0)
    assert float(slope) == pytest.approx((lagged(t, dt, 20.001).sum() - lagged(t, dt, 19.999).sum()) / 2e-3, rel=1e-4)


def test_correct_takes_the_bias_off_at_the_effective_temperature(precision):
    model = ThermalModel(STEPPED, 20.0, 45.0, lag=30.0, play=0.2)
    t = 32 + 12 * np.sin(np.arange(500) / 60)
    felt = played(lagged(t, 0.5, 30.0), 0.2)
    y = np.full(500, 0.1)
    np.testing.assert_allclose(model.correct(y, t, rate=2.0), y - STEPPED.value(felt), atol=1e-12)
    np.testing.assert_allclose(model.correct(y, t, time=np.arange(500) / 2), y - STEPPED.value(felt), atol=1e-12)
    np.testing.assert_allclose(model.correct(model.measure(y, t, rate=2.0), t, rate=2.0), y, atol=1e-14)


def test_outside_its_range_a_model_keeps_its_end_and_says_so():
    model = ThermalModel(BASE, 20.0, 45.0)
    with pytest.warns(ClampWarning, match=r"40 % of the temperatures \(10.00 to 50.00 degC\) are outside the range of the model, 20.00 to"):
        found = model.bias_at(np.array([10.0, 20.0, 30.0, 45.0, 50.0]))
    np.testing.assert_array_equal(found[[0, -1]], BASE.value(np.array([20.0, 45.0])))
    with pytest.warns(ClampWarning):
        model.correct(np.zeros(2), np.array([30.0, 50.0]))


def test_what_cannot_be_corrected_is_refused():
    model = ThermalModel(BASE, 20.0, 45.0, lag=30.0)
    with pytest.raises(DataError, match="one temperature per reading"):
        model.correct(np.zeros(3), np.zeros(2))
    with pytest.raises(DataError, match=r"give time= \(s\) or rate="):
        model.correct(np.zeros(3), np.full(3, 30.0))
    with pytest.raises(DataError, match="must increase"):
        model.correct(np.zeros(3), np.full(3, 30.0), time=np.array([0.0, 2.0, 1.0]))
    with pytest.raises(DataError, match="1 temperatures are not finite"):
        model.correct(np.zeros(3), np.array([30.0, np.nan, 31.0]), rate=1.0)
    with pytest.raises(DataError, match="one temperature per reading"):
        model.correct(np.zeros(0), np.zeros(0), rate=1.0)
