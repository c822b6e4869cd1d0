"""Pooling over a fleet: records drawn from densities written out here, so that nothing is shared with the package's simulation."""

import numpy as np
import pytest
import scipy.fft

import jaxcal
from jaxcal import DataError
from jaxcal.batch import population

RATE = 100.0
SAMPLES = 2**14
#: unit/sqrt(Hz), and a bias instability that a record of this length shows now and then
N, B = 1.0, 0.35


def record(n, b, rng):
    k = np.arange(1, SAMPLES)
    s = 2 * np.sin(np.pi * k / (2 * SAMPLES))
    density = n**2 + b**2 / (RATE * s) * (1 - 2 / (np.pi**2 * k))
    return scipy.fft.idct(np.concatenate([[0.0], np.sqrt(density * RATE) * rng.standard_normal(SAMPLES - 1)]), norm="ortho")


def fleet(seed, devices=16, recordings=1, spread=0.15, repeat=0.0, odd=0.0):
    """Coefficients (recordings in all, 2), the fits, and the device of each."""
    rng = np.random.default_rng(seed)
    truth, names = [], []
    for device in range(devices):
        own = np.log([N, B]) + np.array([0.1, spread]) * rng.standard_normal(2)
        if device == 0 and odd:
            own[0] = np.log(N) + 0.1 * odd
        for _ in range(recordings):
            truth.append(np.exp(own + repeat * rng.standard_normal(2)))
            names.append(f"unit {device}")
    return np.array(truth), [jaxcal.noise.fit(record(*row, rng), RATE, terms="NB") for row in truth], names


@pytest.fixture(scope="module")
def one():
    truth, fits, _ = fleet(0)
    return truth, fits, population(fits, terms=("N", "B"))


def test_the_population_halves_the_error_of_what_a_record_hardly_shows(one):
    truth, _, found = one
    alone, pooled = (np.sqrt(np.mean(np.log(np.maximum(values, 0.1) / truth) ** 2, axis=0)) for values in (found.raw, found.pooled))
    assert pooled[1] < 0.6 * alone[1]
    assert pooled[0] < 1.05 * alone[0]  # N is known by each record
    assert np.all((found.median_interval[:, 0] <= [N, B]) & (found.median_interval[:, 1] >= [N, B]))
    assert found.spread_interval[0, 0] < 0.1 < found.spread_interval[0, 1]
    assert found.verdict == "good"
    assert "16 recordings of 16 devices" in found.summary()
    assert found.to_dict()["terms"] == ["N", "B"]


@pytest.mark.long
def test_pooled_intervals_hold_the_truth():
    inside = []
    for seed in range(25):
        truth, fits, _ = fleet(seed)
        found = population(fits, terms=("N", "B"), seed=seed)
        inside.append((found.pooled_interval[..., 0] <= truth) & (truth <= found.pooled_interval[..., 1]))
    # 400 intervals of 95 % each, those of a fleet correlated
    np.testing.assert_array_less(np.abs(np.mean(inside, axis=(0, 1)) - 0.95), 0.04)


def test_an_odd_unit_is_named_and_not_drawn_in():
    _, fits, _ = fleet(3, odd=8.0)
    found = population(fits, terms=("N", "B"), devices=[f"unit {i}" for i in range(16)])
    assert ("unit 0", "N") in found.outliers
    low, high = found.raw_interval[0, 0]
    assert abs(found.raw[0, 0] - found.pooled[0, 0]) < 0.5 * (high - low) / 3.92
    assert "odd: unit 0 in N" in found.reason


@pytest.mark.long
def test_recordings_of_a_device_tell_its_repeatability_and_covariates_their_effect():
    truth, fits, names = fleet(4, devices=12, recordings=3, repeat=0.05)
    warmth = np.log(truth[:, 0]) + 0.02 * np.random.default_rng(0).standard_normal(len(truth))
    found = population(fits, devices=names, terms=("N",))
    low, high = found.repeatability_interval[0]
    assert low < 0.05 < high < 0.1
    assert found.device_values.shape == (12, 1)
    explained = population(fits, devices=names, terms=("N",), covariates={"warmth": warmth})
    assert explained.effect[0, 0] == pytest.approx(np.std(np.log(truth[:, 0])), rel=0.25)
    assert explained.spread[0] < 0.6 * found.spread[0]


def test_messages(one):
    _, fits, _ = one
    with pytest.raises(DataError, match="4 devices: a population needs 5"):
        population(fits[:4])
    with pytest.raises(DataError, match="16 fits and 2 names"):
        population(fits, devices=["a", "b"])
    with pytest.raises(DataError, match="every fit must have them"):
        population(fits, terms=("K",))
    with pytest.raises(DataError, match="covariate 'age'"):
        population(fits, covariates={"age": np.zeros(16)})
    other = jaxcal.noise.fit(record(N, B, np.random.default_rng(0)), RATE, terms="NB", method="gls")
    with pytest.raises(DataError, match="fit 0: expected a NoiseFit of one channel by method 'whittle'"):
        population([other] * 6)
