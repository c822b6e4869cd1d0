"""Time interval errors: the largest range of phase within windows (mtie), and the rms difference (tierms)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal import DataError
from jaxcal.allan import deviation

M = [1, 2, 3, 4, 7, 8, 15, 16, 17, 60]


def by_definition(theta, m, kind, valid):
    """Value by definition for a rate of 1, over the windows theta[k] .. theta[k + m] that are valid, and their number."""
    found = []
    for k in range(len(theta) - m):
        if valid(k, m):
            window = theta[k : k + m + 1]
            found.append(np.max(window) - np.min(window) if kind == "mtie" else (window[-1] - window[0]) ** 2)
    return (np.max(found) if kind == "mtie" else np.sqrt(np.mean(found))), len(found)


@pytest.mark.parametrize("walk", [False, True])
@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize("data", ["rate", "phase"])
@pytest.mark.parametrize("kind", ["mtie", "tierms"])
def test_definition(kind, data, gaps, walk):
    y = np.random.default_rng(7).standard_normal(120) + 0.3
    y = np.cumsum(y) if walk else y
    if gaps:
        y[[0, 30, 31]] = np.nan
    gone = np.isnan(y)
    if data == "rate":
        theta = np.concatenate([[0.0], np.cumsum(np.where(gone, 0.0, y - np.nanmean(y)))])
        expected = [by_definition(theta, m, kind, lambda k, m: not gone[k : k + m].any()) for m in M]
    else:
        ends = [(lambda k, m: not gone[k : k + m + 1].any()) if kind == "mtie" else (lambda k, m: not (gone[k] or gone[k + m]))]
        expected = [by_definition(y, m, kind, ends[0]) for m in M]
    found = deviation(y, 1.0, kind=kind, m=M, data=data)
    np.testing.assert_allclose(found.deviation, [value for value, _ in expected], rtol=1e-12)
    assert found.count.tolist() == [count for _, count in expected]
    full = len(y) - np.array(M) + (1 if data == "rate" else 0)
    np.testing.assert_array_equal(found.skipped, full - found.count)
    assert np.isnan(found.lower).all()
    assert np.isnan(found.upper).all()
    assert np.isnan(found.edf).all()
    assert np.all(found.bias == 1.0)
    faster = deviation(y, 4.0, kind=kind, m=M, data=data).deviation
    np.testing.assert_allclose(faster, found.deviation / (4.0 if data == "rate" else 1.0), rtol=1e-12)


def test_a_line_in_phase_stays_and_a_constant_rate_goes():
    for kind in ("mtie", "tierms"):
        np.testing.assert_allclose(deviation(np.arange(50.0), 2.0, kind=kind, m=[1, 10, 49], data="phase").deviation, [1.0, 10.0, 49.0])
        assert np.all(deviation(np.full(50, 3.0), 2.0, kind=kind, m=[1, 10]).deviation < 1e-12)


def test_unsorted_sizes_channels_and_grids():
    y = np.random.default_rng(1).standard_normal((300, 2))
    for kind in ("mtie", "tierms"):
        found = deviation(y, 1.0, kind=kind, m=[40, 1, 300, 7])
        for channel in range(2):
            alone = [deviation(y[:, channel], 1.0, kind=kind, m=[m]).deviation[0] for m in (40, 1, 300, 7)]
            np.testing.assert_allclose(found.deviation[:, channel], alone, rtol=1e-12, atol=1e-12)
        assert deviation(y, 1.0, kind=kind, m="all").m.tolist() == list(range(1, 151))
        assert deviation(y, 1.0, kind=kind, m="octave").m[-1] == 128
        with pytest.raises(DataError, match=f"outside 1 .. 300, the sizes that {kind} can have"):
            deviation(y, 1.0, kind=kind, m=[301])
        with pytest.raises(DataError, match=f"{kind} needs a record of at least 2 rate samples"):
            deviation(y[:1, 0], 1.0, kind=kind)


def test_sizes_that_no_window_serves_are_left_out():
    y = np.random.default_rng(1).standard_normal(90)
    y[::30] = np.nan
    for kind in ("mtie", "tierms"):
        found = deviation(y, 1.0, kind=kind, m=[5, 29, 30])
        assert found.m.tolist() == [5, 29]
        assert [(one.code, one.facts["tau"]) for one in found.findings] == [("no_difference", "30")]


@pytest.mark.parametrize("data", ["rate", "phase"])
def test_tierms_traced(data):
    y = np.random.default_rng(2).standard_normal(100) + 1.0
    options = {"kind": "tierms", "m": [1, 5, 30], "data": data}
    eager = deviation(y, 10.0, **options)
    traced = jax.jit(lambda y: deviation(y, 10.0, **options))(jnp.asarray(y))
    np.testing.assert_allclose(traced.deviation, eager.deviation, rtol=1e-10)
    np.testing.assert_array_equal(traced.alpha, eager.alpha)
    assert np.isnan(traced.upper).all()
    options["alpha"] = 0
    gradient = jax.jit(jax.grad(lambda y: jnp.sum(deviation(y, 10.0, **options).deviation)))(jnp.asarray(y))
    for i in (0, 50, 99):
        ends = [np.sum(deviation(y + s * 1e-6 * (np.arange(100) == i), 10.0, **options).deviation) for s in (1, -1)]
        np.testing.assert_allclose(gradient[i], (ends[0] - ends[1]) / 2e-6, rtol=1e-5, atol=1e-8)


def test_precision_of_the_caller_does_not_matter(precision):
    y = 9.81 + 1e-3 * np.random.default_rng(2).standard_normal(2000)
    theta = np.concatenate([[0.0], np.cumsum(y - y.mean())])
    found = deviation(y, 1.0, kind="mtie", m=[10])
    assert found.deviation.dtype == np.float64
    expected = np.max([np.ptp(theta[k : k + 11]) for k in range(1991)])
    np.testing.assert_allclose(found.deviation, [expected], rtol=1e-9)
