"""Spectra under jit; without tracing nothing is compiled. `test_transforms` has the other transforms."""

import logging

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal.spectrum import Spectrum, density

METHODS = ("periodogram", "welch", "dct")


def record(n=300):
    return np.random.default_rng(1).standard_normal(n) + 9.81


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
