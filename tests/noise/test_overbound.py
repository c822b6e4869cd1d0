"""The overbound lies above every limit, is the least that does so, and lies above the truth in simulations."""

import dataclasses
import itertools

import numpy as np
import pytest

from jaxcal import FitError
from jaxcal.noise import Noise, fit, overbound
from jaxcal.noise._overbound import overbound_curve

DT = 0.01
TERMS = ("Q", "N", "B", "K")


def limits(seed, clusters=12, longest=300.0):
    """An irregular curve of upper limits, as of a measured record."""
    random = np.random.default_rng(seed)
    tau = np.geomspace(DT, longest, clusters)
    smooth = Noise(Q=1e-5, N=1e-3, B=5e-4, K=1e-4).avar(tau, dt=DT)
    return tau, np.sqrt(smooth) * np.exp(random.normal(0.0, 0.1, clusters)) * np.geomspace(1.01, 2.0, clusters)


def least_cost(tau, upper, terms):
    """Least mean ratio of variance to limit; all corners of the feasible set are tried."""
    columns = np.stack([Noise(**{t: 1.0}).avar(tau, dt=DT) for t in terms], axis=1) / upper[:, None] ** 2
    columns = columns / columns.max(axis=0)
    best = np.inf
    for size in range(1, len(terms) + 1):
        for rows, kept in itertools.product(itertools.combinations(range(len(tau)), size), itertools.combinations(range(len(terms)), size)):
            square = columns[np.ix_(rows, kept)]
            if np.linalg.matrix_rank(square) == size:
                theta = np.linalg.solve(square, np.ones(size))
                reached = columns[:, kept] @ theta
                if np.all(theta >= 0.0) and np.all(reached >= 1.0 - 1e-9):
                    best = min(best, float(np.mean(reached)))
    return best


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("terms", [TERMS, ("N", "B"), ("N", "K", "R"), ("B",)])
def test_nothing_smaller_lies_above_the_limits(terms, seed):
    tau, upper = limits(seed)
    found = overbound_curve(tau, upper, terms=terms, dt=DT)
    excess = found.avar(tau, dt=DT) / upper**2
    assert np.all(excess >= 1.0)
    np.testing.assert_allclose(np.mean(excess), least_cost(tau, upper, terms), rtol=1e-7)
    # the overbound touches the limits as many times as it has positive coefficients
    positive = [term for term in TERMS if getattr(found, term) > 0.0] + (["R"] if found.R > 0.0 else [])
    assert set(positive) <= set(terms)
    assert np.sum(excess < 1.0 + 1e-6) >= len(positive)


def test_limits_that_are_a_model_give_that_model():
    """If the limits are a curve of the model, the least curve at or above them is this model."""
    tau = np.geomspace(DT, 1e3, 25)
    model = Noise(Q=1e-5, N=1e-3, B=5e-4, K=1e-4)
    found = overbound_curve(tau, np.sqrt(model.avar(tau, dt=DT)), terms=TERMS, dt=DT)
    for term in TERMS:
        np.testing.assert_allclose(getattr(found, term), getattr(model, term), rtol=1e-5)
    # the same is true in the continuous form and in any unit
    found = overbound_curve(tau, 1e9 * np.sqrt(model.avar(tau)), terms=("B", "N", "K", "Q"))
    np.testing.assert_allclose([found.Q, found.N, found.B, found.K], [1e4, 1e6, 5e5, 1e5], rtol=1e-5)


def test_eight_decades_and_one_cluster_time():
    """The columns span more powers of ten than a float has digits."""
    tau = np.geomspace(1e-3, 1e5, 40)
    upper = 1.2 * np.sqrt(Noise(Q=1e-7, N=1e-4, B=1e-5, K=1e-7).avar(tau))
    for terms in (TERMS, ("N",), ("Q",), ("Q", "N", "B", "K", "R")):
        excess = overbound_curve(tau, upper, terms=terms).avar(tau) / upper**2
        assert np.all(excess >= 1.0)
        assert np.min(excess) < 1.0 + 1e-6
    np.testing.assert_allclose(overbound_curve([4.0], [3.0]).avar(4.0), 9.0, rtol=1e-6)


@pytest.fixture(scope="module")
def fits():
    """The truth, and fits of 40 simulated channels with 65,536 samples."""
    truth = Noise(N=1e-3, B=5e-4, K=1e-4)
    y = np.stack([truth.simulate(2**16, 1.0 / DT, seed=s) for s in range(40)], axis=1)
    return truth, fit(y, 1.0 / DT, method="gls")


def test_of_a_fit(fits):
    _, found = fits
    bound = overbound(found)
    assert bound.N.shape == (40,)
    tau, used = found.deviation.tau, found.used
    excess = np.sqrt(bound.avar(tau, dt=DT)) / found.deviation.upper
    assert np.all(excess[used] >= 1.0)
    assert np.all(np.min(np.where(used, excess, np.inf), axis=0) < 1.0 + 1e-6)
    one = overbound(found.channel(3))
    for term in TERMS:
        np.testing.assert_allclose(getattr(one, term), getattr(bound, term)[3], rtol=1e-9)
    assert one.R == 0.0
    # the variance that the fit predicts lies below the overbound in the fitted range
    predicted = found.noise.avar(tau, dt=DT)
    assert np.all((bound.avar(tau, dt=DT) > predicted)[used])


def test_the_truth_lies_below(fits):
    """At each cluster time, at least 97.5 % of the overbounds lie above the truth, less 2.6 standard errors of 40 channels."""
    truth, found = fits
    bound = overbound(found).avar(found.deviation.tau, dt=DT)
    below = truth.avar(found.deviation.tau, dt=DT)[:, None] <= bound
    assert found.used.mean() > 0.9
    assert np.all(below.mean(axis=1) >= 0.975 - 2.6 * np.sqrt(0.975 * 0.025 / 40))


def test_only_the_cluster_times_in_use_and_the_terms_of_the_fit():
    y = Noise(N=1e-3).simulate(20_000, 100.0, seed=1)
    found = fit(y, 100.0, method="gls", terms=("N", "K"), band=(0.1, 10.0))
    bound = overbound(found)
    assert bound.Q == bound.B == bound.R == 0.0
    inside = found.used
    assert 0 < inside.sum() < len(inside)
    again = overbound_curve(found.deviation.tau[inside], found.deviation.upper[inside], terms=("N", "K"), dt=DT)
    assert (again.N, again.K) == (bound.N, bound.K)


def test_processes_that_are_known_stay():
    """If a sinusoid and a Gauss-Markov process are given, the other terms cover the rest; otherwise they would have to cover all."""
    tau = np.geomspace(DT, 300.0, 20)
    known = Noise(markov=((1e-3, 2.0),), sinusoid=((2e-4, 0.5),))
    rest = Noise(N=1e-3, K=1e-5)
    upper = np.sqrt(rest.avar(tau, dt=DT) + known.avar(tau, dt=DT))
    found = overbound_curve(tau, upper, dt=DT, beside=known)
    assert (found.markov, found.sinusoid) == (known.markov, known.sinusoid)
    np.testing.assert_allclose([found.N, found.K], [1e-3, 1e-5], rtol=1e-4)
    assert np.all(found.avar(tau, dt=DT) >= upper**2 * (1.0 - 1e-12))
    assert overbound_curve(tau, upper, dt=DT).N > 1.05e-3
    # if the given processes exceed all limits, no other term is added
    assert overbound_curve(tau, 0.9 * np.sqrt(known.avar(tau, dt=DT)), dt=DT, beside=known).N == 0.0


def test_processes_of_a_fit_stay(fits):
    _, found = fits
    one = dataclasses.replace(
        found.channel(0), noise=Noise(N=1e-3, markov=((1e-4, 2.0),), sinusoid=((1e-5, 0.5),)), terms=("N", "B", "K", "markov")
    )
    bound = overbound(one)
    assert (bound.markov, bound.sinusoid) == (one.noise.markov, one.noise.sinusoid)
    excess = bound.avar(one.deviation.tau, dt=DT) / one.deviation.upper**2
    assert np.all(excess[one.used] >= 1.0 - 1e-12)
    # channels with and without a spectral line can be mixed
    lines = ((np.append(1e-5, 0.0 * found.noise.N[1:]), np.append(0.5, 1.0 + 0.0 * found.noise.N[1:])),)
    both = overbound(dataclasses.replace(found, noise=dataclasses.replace(found.noise, sinusoid=lines)))
    np.testing.assert_array_equal(both.sinusoid, lines)


def test_limits_that_are_not_finite(refuses):
    with refuses("no_upper"):
        overbound_curve([1.0, 2.0], [1.0, np.inf])


def test_terms_that_cannot_follow_the_limits():
    """The limits fall over eight decades, but all terms rise."""
    tau = np.geomspace(1e-3, 1e5, 40)
    with pytest.raises(FitError, match="add N or B"):
        overbound_curve(tau, tau**-1.0, terms=("K", "R"))
