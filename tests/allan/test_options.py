"""Options: robust variances, uneven stamps, and channels without samples."""

import jax
import numpy as np
import pytest
import scipy.optimize

import jaxcal
from jaxcal.allan import deviation
from jaxcal.noise import Noise


@pytest.mark.parametrize("kind", ["adev", "oadev", "hdev", "ohdev"])
def test_robust_scale_solves_its_equation(kind):
    y = Noise(N=1.0, K=0.01).simulate(1500, 1.0, seed=0)
    m = 7  # all starting points are used for sizes up to 16
    order = 2 if "a" in kind[:2] else 3
    theta = np.concatenate([[0.0], np.cumsum(y)])
    starts = np.arange(0, len(y) - order * m + 1, 1 if kind.startswith("o") else m)
    d = sum((-1.0) ** j * [1, order, order * (order - 1) // 2, 1][j] * theta[starts + (order - j) * m] for j in range(order + 1))
    z = np.random.default_rng(1).standard_normal(4_000_000)
    level = np.mean(np.maximum(1.0 - z**2 / 49.0, 0.0) ** 4 * z**2)  # expectation, to 4e-4

    def excess(s2):
        return np.mean(np.maximum(1.0 - d**2 / s2 / 49.0, 0.0) ** 4 * d**2) / s2 - level

    s2 = scipy.optimize.brentq(excess, 0.1 * np.mean(d**2), 10.0 * np.mean(d**2))
    found = deviation(y, 1.0, kind=kind, m=[m], robust=True)
    np.testing.assert_allclose(found.deviation**2, s2 / (2.0 if order == 2 else 6.0) / m**2, rtol=2e-3)


def test_robust_is_unbiased_on_gaussian_noise_and_costs_a_tenth():
    m, runs = np.array([1, 5, 40]), 400
    y = np.stack([Noise(N=1.0).simulate(1000, 1.0, seed=s) for s in range(runs)], axis=1)
    plain, robust = (deviation(y, 1.0, m=m, robust=way) for way in (False, True))
    ratio = (robust.deviation**2).mean(axis=1) / (plain.deviation**2).mean(axis=1)
    assert np.all(np.abs(ratio - 1.0) < [0.005, 0.01, 0.03])  # at least 2.5 standard errors of the paired difference
    spread = (plain.deviation**2).var(axis=1)[0] / (robust.deviation**2).var(axis=1)[0]
    np.testing.assert_allclose(spread, 0.92, atol=0.08)  # the ratio has a sampling error of 3 %
    np.testing.assert_allclose(robust.edf / plain.edf, 0.92, atol=0.005)  # as documented, robustness costs 8 % of the degrees of freedom


def test_outliers_do_not_carry_robust_off():
    y = Noise(N=1.0).simulate(20_000, 1.0, seed=3)
    wild = y.copy()
    wild[::500] += 200.0 * np.random.default_rng(4).standard_normal(40)
    m = np.array([1, 4, 16])
    clean = deviation(y, 1.0, m=m).deviation
    assert np.all(deviation(wild, 1.0, m=m).deviation > 3.0 * clean)
    np.testing.assert_allclose(deviation(wild, 1.0, m=m, robust=True).deviation, clean, rtol=0.1)


@pytest.mark.parametrize("data", ["rate", "phase"])
def test_robust_leaves_gaps_out(data):
    y = Noise(N=1.0).simulate(5000, 1.0, seed=5)
    if data == "phase":
        y = np.cumsum(y)
    y[2000:2050] = np.nan
    plain, robust = (deviation(y, 1.0, m=[1, 10], data=data, robust=way) for way in (False, True))
    np.testing.assert_array_equal(plain.count, robust.count)
    np.testing.assert_allclose(robust.deviation, plain.deviation, rtol=0.05)


def test_robust_of_a_constant_is_zero():
    assert deviation(np.full(100, 3.0), 1.0, m=[1, 2], robust=True).deviation.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("kind", ["mdev", "tdev", "totdev", "theo1", "mtie", "tierms"])
def test_robust_is_refused_where_it_has_no_meaning(kind):
    with pytest.raises(jaxcal.DataError, match=f"robust=True is for adev, oadev, hdev and ohdev; got {kind}"):
        deviation(np.random.default_rng(0).standard_normal(100), 1.0, kind=kind, m=[2], robust=True)


def test_robust_cannot_be_traced():
    with pytest.raises(jaxcal.DataError, match="not traced"):
        jax.jit(lambda y: deviation(y, 1.0, m=[1], robust=True).deviation)(np.arange(100.0))


@pytest.mark.parametrize("kind", ["oadev", "mtotdev", "mtie"])
def test_a_channel_without_samples_leaves_the_others_alone(kind):
    y = np.random.default_rng(8).standard_normal((500, 3))
    y[:, 1] = np.nan
    found = deviation(y, 1.0, kind=kind, m=[1, 3])
    alone = deviation(y[:, [0, 2]], 1.0, kind=kind, m=[1, 3])
    np.testing.assert_array_equal(found.deviation[:, [0, 2]], alone.deviation)
    assert np.isnan(found.deviation[:, 1]).all()
    assert found.count[:, 1].tolist() == [0, 0]
    assert (found.codes, found.findings[0].subject) == ({"empty"}, ("channel 1",))
    assert (found.channel(0).verdict, found.channel(1).verdict) == ("good", "weak")
