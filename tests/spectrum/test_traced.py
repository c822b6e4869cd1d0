"""Spectra under jit, vmap and grad in both precisions; without tracing nothing is compiled."""

import logging

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal import PrecisionWarning
from jaxcal.spectrum import Spectrum, density

METHODS = ("periodogram", "welch", "dct")


def record(n=300, channels=None):
    shape = (n,) if channels is None else (n, channels)
    return np.random.default_rng(1).standard_normal(shape) + 9.81


@pytest.mark.parametrize("average", ["octave", "log", None])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("n", [300, 301])
def test_jit_equals_eager(method, average, n):
    y = record(n)
    options = {"method": method, "average": average, "sided": 1}
    eager = density(y, 10.0, **options)
    traced = jax.jit(lambda y: density(y, 10.0, **options))(jnp.asarray(y))
    assert isinstance(traced, Spectrum)
    for name in ("frequency", "density", "lower", "upper", "count", "edf"):
        np.testing.assert_allclose(getattr(traced, name), getattr(eager, name), rtol=1e-9, atol=1e-14, err_msg=name)
    assert (traced.method, traced.sided, traced.average, traced.findings) == (method, 1, average, eager.findings)


@pytest.mark.parametrize("method", METHODS)
def test_gradient_equals_finite_differences(method):
    y = record(80)
    size = len(density(y, 10.0, method=method).density)
    weights = np.random.default_rng(2).standard_normal(size)

    def loss(y):
        found = density(y, 10.0, method=method, sided=1)
        return jnp.sum(jnp.asarray(weights) * jnp.log(found.density))

    gradient = jax.jit(jax.grad(loss))(jnp.asarray(y))
    step = 1e-6
    for i in (0, 7, 40, 79):
        shifted = [
            weights @ np.log(density(y + sign * step * (np.arange(80) == i), 10.0, method=method, sided=1).density) for sign in (1, -1)
        ]
        np.testing.assert_allclose(gradient[i], (shifted[0] - shifted[1]) / (2 * step), rtol=2e-5, atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_vmap_equals_a_loop_and_channels(method):
    y = record(150, channels=3)
    loop = np.stack([density(column, 10.0, method=method).density for column in y.T])
    batch = jax.jit(jax.vmap(lambda y: density(y, 10.0, method=method).density))(jnp.asarray(y.T))
    np.testing.assert_allclose(batch, loop, rtol=1e-9)
    channels = jax.jit(lambda y: density(y, 10.0, method=method).density)(jnp.asarray(y))
    np.testing.assert_allclose(channels, loop.T, rtol=1e-9)


def test_float32_warns_and_names_the_remedy():
    with jax.enable_x64(False):
        y = jnp.asarray(record() - 9.81, dtype=jnp.float32)
        with pytest.warns(PrecisionWarning, match="jax_enable_x64"):
            traced = jax.jit(lambda y: density(y, 10.0))(y)
        assert traced.density.dtype == jnp.float32
    np.testing.assert_allclose(traced.density, density(record(), 10.0).density, rtol=5e-3, atol=1e-6)


def test_a_constant_inside_a_trace_and_integers():
    y = np.random.default_rng(0).integers(0, 50, 100)
    inside = jax.jit(lambda: density(y, 10.0).density)()
    np.testing.assert_allclose(inside, density(y, 10.0).density, rtol=1e-9, atol=1e-12)


def test_a_gap_is_an_error_even_when_traced():
    y = np.where(np.arange(40) == 5, np.nan, np.arange(40.0) % 3)
    with pytest.raises(Exception, match="a record without gaps"):
        jax.block_until_ready(jax.jit(lambda y: density(y, 10.0).density)(jnp.asarray(y)))


def test_nothing_is_compiled_on_the_host_whatever_the_length(caplog):
    density(record(100), 10.0)  # the first call may compile what chooses between the two paths
    with jax.log_compiles(), caplog.at_level(logging.WARNING):
        for n in (101, 202, 1003):
            for method in METHODS:
                density(record(n), 10.0, method=method)
    assert not [entry.getMessage() for entry in caplog.records if "ompil" in entry.getMessage()]
