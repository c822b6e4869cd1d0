"""The check that noise is equally strong in all parts of a record: no message for stationary noise, a warning otherwise."""

import numpy as np
import pytest
import scipy.stats

import jaxcal
from jaxcal.noise import Noise
from jaxcal.noise._stationarity import unevenness, unevenness_of_level

N, DT = 1 << 13, 0.01
NOISE = Noise(N=4e-5, B=2e-5, K=4e-6)


def _density(count):
    k = np.arange(1, count + 1)
    columns = {term: NOISE.part(term)[2].ordinates(k, N, DT) for term in "NBK"}
    return columns, sum(float(getattr(NOISE, term)) ** 2 * columns[term] for term in "NBK")


@pytest.mark.parametrize("term", ["B", "K"])
def test_chances_of_stationary_records_are_what_they_say(term):
    columns, density = _density(512)
    found = [unevenness(NOISE.simulate(N, 1.0 / DT, seed=s), columns[term], density, DT) for s in range(600)]
    chances = np.array([one.chance for one in found])
    # large p-values come from 99 simulations, the same for all records, and are accurate to 0.1; small ones from 999
    assert abs(np.median(chances) - 0.5) < 0.15
    for level in (0.01, 0.05):
        error = np.sqrt(level / 600 + level / 999)
        assert level - 3.0 * error < np.mean(chances < level) < level + 3.0 * error
    # the factor has a mean of 1 by definition and scatters by about 1; its mean has an error of 0.05, and 0.1 from the simulations
    assert abs(np.mean([one.factor for one in found]) - 1.0) < 0.35


def test_chances_of_the_level_of_stationary_records_are_uniform():
    density = _density(N - 1)[1]
    share = float(NOISE.N) ** 2 / density
    records = (NOISE.simulate(N, 1.0 / DT, seed=s) for s in range(300))
    chances = [unevenness_of_level(scipy.fft.dct(y - y.mean(), norm="ortho")[1:], share, density, DT).chance for y in records]
    assert scipy.stats.kstest(chances, "uniform").pvalue > 1e-3


def test_wandering_in_one_part_alone_is_told_and_widens_the_intervals():
    n, truth = 1 << 16, Noise(N=4e-5, K=4e-6)
    steady = Noise(N=4e-5).simulate(n, 100.0, seed=1)
    walk = np.zeros(n)
    walk[16_500:24_500] = Noise(K=float(truth.K) * np.sqrt(n / 8_000)).simulate(8_000, 100.0, seed=2)
    walk[24_500:] = walk[24_499]
    even = jaxcal.noise.fit(truth.simulate(n, 100.0, seed=3), 100.0)
    uneven = jaxcal.noise.fit(steady + walk, 100.0)
    (told,) = [one for one in uneven.findings if one.code == "uneven"]
    # the louder part is the third eighth of the record: 163.8 to 245.8 s of 655
    assert (told.facts["what"], round(told.facts["start"], 1), round(told.facts["stop"], 1)) == ("slow wandering", 163.8, 245.8)
    assert "uneven" not in even.codes
    widths = [(fit.interval["K"][1] - fit.interval["K"][0]) / float(fit.noise.K) for fit in (even, uneven)]
    assert widths[1] > 1.5 * widths[0]


def test_white_noise_that_grows_is_told():
    n = 1 << 16
    y = Noise(N=4e-5, K=4e-6).simulate(n, 100.0, seed=4)
    louder = y + 1e-4 * np.random.default_rng(5).standard_normal(n) * (np.arange(n) > n * 7 // 8)
    plain, found = (jaxcal.noise.fit(record, 100.0) for record in (y, louder))
    assert "uneven" not in plain.codes
    assert [round(one.facts["start"], 1) for one in found.findings if one.code == "uneven" and one.facts["what"] == "white noise"] == [
        573.4
    ]
    widths = [fit.interval["N"][1] - fit.interval["N"][0] for fit in (plain, found)]
    assert widths[1] > 1.5 * widths[0]


def test_gaps():
    y = Noise(N=4e-5, K=4e-6).simulate(1 << 15, 100.0, seed=6)
    y[1000:1100] = np.nan
    y[16000:16100] = np.nan
    # no part between two gaps is most of this record, so that there is no message
    assert "uneven" not in jaxcal.noise.fit(y, 100.0).codes
