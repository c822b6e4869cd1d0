"""Series end to end in one array, and the running sum in rows, against loops over them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal.allan._kernels._phase import integrate
from jaxcal.allan._kinds import cluster_sizes, find_kind
from jaxcal.allan._noise_type._identify import identify
from jaxcal.allan._noise_type._lag_one import lag_one, moments_of
from jaxcal.allan._noise_type._segments import Segments, followed, steps
from jaxcal.noise import Noise


@pytest.mark.parametrize("xp", [np, jnp])
@pytest.mark.parametrize("lengths", [[5], [3, 9, 2, 30], [4, 4, 4]])
def test_what_is_done_to_all_is_done_to_each(lengths, xp):
    random = np.random.default_rng(0)
    each = [random.standard_normal(n) for n in lengths]
    series, values = Segments(np.array(lengths), xp), xp.asarray(np.concatenate(each))
    np.testing.assert_allclose(series.sums(values), [z.sum() for z in each], rtol=1e-12)
    np.testing.assert_allclose(series.shorter().sums(steps(values, xp)), [np.diff(z).sum() for z in each], rtol=1e-12)
    np.testing.assert_allclose(series.shorter().sums(followed(values, xp)), [z[1:] @ z[:-1] for z in each], rtol=1e-12)
    np.testing.assert_array_equal(series.spread(xp.arange(float(len(each)))), np.repeat(np.arange(len(each)), lengths))
    time = np.split(series.shorter().time(), series.stops[:-1])
    for t, n in zip(time, lengths, strict=True):
        np.testing.assert_array_equal(t, np.arange(n) - (n - 2) / 2.0)


def test_sums_under_jit_and_vmap_are_those_of_numpy():
    lengths = np.array([3, 9, 2])
    values = np.random.default_rng(1).standard_normal((4, 14))
    found = jax.jit(jax.vmap(lambda v: Segments(lengths, jnp).shorter().sums(v)))(values)
    np.testing.assert_allclose(found, [Segments(lengths, np).shorter().sums(v) for v in values], rtol=1e-12)


@pytest.mark.parametrize("length", [1, 2, 15, 16, 17, 31, 33, 1000, 65_536, 65_537, 65_560])
def test_phase_is_the_running_sum_about_the_mean(length):
    y = 9.81 + np.random.default_rng(length).standard_normal(length)
    out = np.full(length + 1, np.nan)
    assert integrate(y, out, 1)
    exact = np.concatenate([[0.0], np.cumsum((y - y.mean()).astype(np.longdouble))]).astype(float)
    np.testing.assert_allclose(out, exact, atol=1e-13 * length**0.5 * 10)
    assert not integrate(np.where(np.arange(length) == length - 1, np.nan, y), out, 1)


@pytest.mark.parametrize("noise", [{"N": 1.0}, {"Q": 1.0}, {"K": 1.0}, {"B": 1.0}, {"N": 1e-3, "R": 1.0}], ids=str)
def test_moments_give_the_types_that_the_residuals_give(noise):
    for seed in range(4):
        samples = 3000 + 2111 * seed
        y = Noise(**noise).simulate(samples, 1.0, seed=seed)
        theta = np.concatenate([[0.0], np.cumsum(y - np.mean(y))])
        kind = find_kind("oadev")
        sizes = cluster_sizes("log", kind, samples)
        by_residuals = identify(theta, np.zeros(samples + 1), sizes, kind, samples, "rate")  # weights of one: the general route
        np.testing.assert_array_equal(identify(theta, None, sizes, kind, samples, "rate"), by_residuals)


def test_a_line_that_hides_the_noise_is_taken_off_first():
    z = 1e9 * np.arange(100.0) + np.random.default_rng(0).standard_normal(100)
    series = Segments(np.array([100]), np)
    assert lag_one(moments_of(z, series), series.points)[1].all()
    left = np.random.default_rng(1).standard_normal(100)
    e = left - np.polynomial.Polynomial.fit(np.arange(100.0), left, 1)(np.arange(100.0))
    r1, lost = lag_one(moments_of(left + 3.0 + 0.5 * np.arange(100.0), series), series.points)
    np.testing.assert_allclose(r1, (e[1:] @ e[:-1]) / (e @ e) * 100 / 99, rtol=1e-9)
    assert not lost.any()
