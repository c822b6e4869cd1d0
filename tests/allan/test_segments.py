"""Series end to end in one array, and the running sum in rows, against loops over them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal.allan._phase import integrate
from jaxcal.allan._segments import Segments, followed, steps


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
