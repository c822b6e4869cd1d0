"""The skewness correction of the test for an absent term: cumulants against simulations, the cube root against the exact law."""

import numpy as np
import pytest
import scipy.stats

import jaxcal
from jaxcal.noise import Noise, allan_covariance
from jaxcal.noise._allanfit import as_normal, response, skewness
from jaxcal.noise._curve import curve_of

TERMS = ("Q", "N", "B", "K")
OBJECTS = tuple(Noise().part(term)[2] for term in TERMS)


@pytest.mark.parametrize(("noise", "tested"), [(Noise(N=1.0, B=0.3), "K"), (Noise(N=1.0), "K"), (Noise(N=1.0, K=0.02), "Q")])
def test_skewness_of_the_statistic(noise, tested):
    samples, runs = 2048, 2000
    y = np.stack([noise.simulate(samples, 1.0, seed=s) for s in range(runs)], axis=1)
    m = np.unique(np.round(np.logspace(0, np.log10(samples // 4), 18)).astype(int))
    found = jaxcal.allan.deviation(y, 1.0, m=m, alpha=0)
    truth = np.array([float(getattr(noise, term)) ** 2 for term in TERMS])
    curve, used, unit = curve_of(found.channel(0), samples, OBJECTS, found.deviation[:, 0] ** 2, np.ones(len(m), bool))
    index = TERMS.index(tested)
    heard = response(samples, m.astype(float), 1.0, OBJECTS)
    theory = float(skewness(curve, used, heard, np.append(truth, 0.0) / unit, index))
    # compute the statistic by plain linear algebra, with the tested column orthogonal to those of the terms that are present
    c = allan_covariance(noise, samples, m, 1.0)
    columns = curve.columns[:, :4]
    there = columns[:, truth > 0]
    solved = np.linalg.solve(c, there)
    weight = np.linalg.solve(c, columns[:, index])
    weight = weight - solved @ np.linalg.solve(there.T @ solved, there.T @ weight)
    statistic = weight @ found.deviation**2
    halves = [scipy.stats.skew(part) for part in np.array_split(statistic, 10)]
    error = np.std(halves, ddof=1) / np.sqrt(10)
    # samples rarely reach the tail of the distribution, and the theory neglects a part of the effects at the ends of the record
    assert abs(theory - scipy.stats.skew(statistic)) < 0.12 * theory + 3.0 * error
    if tested == "K":
        assert theory > 0.8


def test_cube_root_against_the_gamma_law():
    chance = np.array([0.05, 0.01, 0.001])
    for skew in (1e-6, 0.1, 0.5, 1.0, 1.5):
        z = scipy.stats.pearson3.isf(chance, skew)
        np.testing.assert_allclose(np.sqrt(as_normal(z**2, skew)), scipy.stats.norm.isf(chance), rtol=0.015)


def test_a_symmetric_statistic_is_left_as_it_is():
    rise = np.array([0.0, 1.0, 5.41, 1e6])
    np.testing.assert_allclose(as_normal(rise, 0.0), rise)
    np.testing.assert_allclose(as_normal(rise, -0.2), rise)
