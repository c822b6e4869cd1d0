"""Deviations under jit and grad; `test_transforms` has the other transforms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal.allan import deviation

KINDS = ("adev", "oadev", "mdev", "tdev", "hdev", "ohdev")
M = [1, 2, 5, 12]


def record(length=200, gaps=False):
    y = np.random.default_rng(1).standard_normal(length) + 0.3
    if gaps:
        y[[20, 21, 150]] = np.nan
    return y


@pytest.mark.parametrize(
    ("kind", "data", "gaps"), [(kind, data, True) for kind in KINDS for data in ("rate", "phase")] + [("oadev", "rate", False)]
)
def test_jit_equals_eager(kind, data, gaps):
    y = record(gaps=gaps)
    eager = deviation(y, 10.0, kind=kind, m=M, data=data, alpha=0)
    traced = jax.jit(lambda y: deviation(y, 10.0, kind=kind, m=M, data=data, alpha=0))(jnp.asarray(y))
    for name in ("deviation", "lower", "upper", "edf", "count", "skipped"):
        rtol = 1e-6 if name in ("lower", "upper") else 1e-9
        np.testing.assert_allclose(getattr(traced, name), getattr(eager, name), rtol=rtol, err_msg=name)
    np.testing.assert_array_equal(traced.alpha, eager.alpha)


@pytest.mark.parametrize("kind", KINDS)
def test_gradient_equals_finite_differences(kind):
    y = record(60)
    weights = np.array([1.0, -0.5, 2.0, 0.3])

    def loss(y):
        return jnp.sum(jnp.asarray(weights) * deviation(y, 10.0, kind=kind, m=M).deviation)

    gradient = jax.jit(jax.grad(loss))(jnp.asarray(y))
    step = 1e-6
    for i in (0, 7, 30, 59):
        shifted = [weights @ deviation(y + sign * step * (np.arange(60) == i), 10.0, kind=kind, m=M).deviation for sign in (1, -1)]
        np.testing.assert_allclose(gradient[i], (shifted[0] - shifted[1]) / (2 * step), rtol=2e-6, atol=1e-9)


def test_gradient_leaves_gaps_alone():
    gradient = jax.jit(jax.grad(lambda y: jnp.sum(deviation(y, 10.0, m=M).deviation)))(jnp.asarray(record(gaps=True)))
    assert np.all(np.isfinite(gradient))
    assert np.all(np.asarray(gradient)[[20, 21, 150]] == 0.0)


def test_a_gap_that_leaves_nothing_is_an_error_even_when_traced():
    y = np.where(np.arange(40) % 3 == 0, np.nan, 1.0)
    with pytest.raises(Exception, match="no difference free of gaps"):
        jax.block_until_ready(jax.jit(lambda y: deviation(y, 10.0, m=[5]).deviation)(jnp.asarray(y)))
