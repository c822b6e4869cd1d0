"""Records with gaps: the fit maximises the likelihood of the observed samples; its scatter and its intervals."""

import numpy as np
import pytest
import scipy.fft
import scipy.linalg
import scipy.optimize

import jaxcal

RATE = 100.0
TRUTH = {"N": 4.36e-5, "B": 3.68e-5, "K": 8.73e-6}  # gyroscope X of the thesis in rad and s
CHUNKS = {"scattered": (0.05, 1), "short gaps": (0.1, 200), "most": (0.6, 50), "one gap": (0.3, None)}


def lost(y, share, length, seed):
    """Remove a share of the samples in gaps of a given length, or in one gap if the length is None."""
    y, rng = y.copy(), np.random.default_rng(seed)
    length = int(share * len(y)) if length is None else length
    for start in rng.choice(len(y) - length, max(int(share * len(y)) // length, 1), replace=False):
        y[start : start + length] = np.nan
    return y


def columns(n, dt):
    """Density of DCT-II ordinates per squared coefficient of N, B and K; flicker is accurate to 1 in 1000, the others are exact."""
    k = np.arange(1, n)
    s = 2 * np.sin(np.pi * k / (2 * n))
    return np.stack([np.ones(n - 1), dt / s * (1 - 2 / (np.pi**2 * k)), dt**2 / s**2], axis=1)


def simulated(n, rate, noise, seed):
    """Simulate a record by drawing its ordinates, independently of `Noise.simulate`."""
    density = columns(n, 1 / rate) @ np.array([noise[term] ** 2 for term in "NBK"])
    ordinates = np.sqrt(density * rate) * np.random.default_rng(seed).standard_normal(n - 1)
    return scipy.fft.idct(np.concatenate([[0.0], ordinates]), norm="ortho")


@pytest.mark.parametrize("gaps", [(0.3, 1), (0.6, 1), (0.3, None)], ids=["scattered", "most scattered", "one gap"])
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_the_fit_is_at_the_maximum_of_the_dense_likelihood(gaps, seed):
    n, dt = 400, 1.0
    y = lost(simulated(n, 1 / dt, {"N": 1.0, "B": 0.6, "K": 0.2}, seed), *gaps, seed)
    there = ~np.isnan(y)
    basis = scipy.fft.dct(np.eye(n), norm="ortho", axis=0)[1:, there]
    design = columns(n, dt)

    def log_likelihood(squares):
        covariance = (basis.T * (design @ squares / dt)) @ basis
        root = scipy.linalg.cholesky(covariance + 1e-9 * np.trace(covariance) / n * np.eye(there.sum()), lower=True)
        one, z = scipy.linalg.solve_triangular(root, np.stack([np.ones(there.sum()), y[there]], axis=1), lower=True).T
        return -np.log(np.diag(root)).sum() - 0.5 * np.log(one @ one) - 0.5 * (z @ z - (one @ z) ** 2 / (one @ one))

    found = jaxcal.noise.fit(y, 1 / dt, terms="NBK", band=(dt, n * dt)).noise
    squares = np.maximum(np.array([float(found.N), float(found.B), float(found.K)]) ** 2, 1e-9)
    best = scipy.optimize.minimize(lambda logs: -log_likelihood(np.exp(logs)), np.log(squares), method="L-BFGS-B", bounds=[(-21, 5)] * 3)
    assert -best.fun - log_likelihood(squares) < 0.1


@pytest.mark.long
@pytest.mark.parametrize("kind", CHUNKS)
def test_gaps_cost_the_samples_that_are_missing_and_no_more(kind):
    n, runs = 2**13, 6
    ratio, inside = [], []
    for seed in range(runs):
        y = simulated(n, RATE, TRUTH, seed)
        whole, part = jaxcal.noise.fit(y, RATE), jaxcal.noise.fit(lost(y, *CHUNKS[kind], seed), RATE)
        ratio.append([float(getattr(part.noise, term)) / TRUTH[term] - float(getattr(whole.noise, term)) / TRUTH[term] for term in "NB"])
        inside += [low <= TRUTH[term] <= high for term, (low, high) in part.interval.items() if term in TRUTH]
        assert {"gaps", "unsettled"} & part.codes == {"gaps"}
    # the variance of the difference between both estimates is the difference of their variances
    assert np.std(ratio, axis=0)[0] < 0.012
    assert np.std(ratio, axis=0)[1] < 0.3
    assert np.mean(inside) > 0.75  # 18 intervals of 95 %


def test_a_fit_of_a_record_with_gaps_repeats_exactly():
    y = lost(simulated(2**13, RATE, TRUTH, 5), 0.02, 1, 5)
    assert float(jaxcal.noise.fit(y, RATE).noise.B) == float(jaxcal.noise.fit(y, RATE).noise.B)


@pytest.mark.long
@pytest.mark.parametrize("recording", ["imu1", "imu2"])
def test_masking_one_percent_of_a_real_record_moves_no_coefficient(reference, recording):
    with np.load(reference / "data" / "adis16405" / f"{recording}.npz") as file:
        y, rate = file["counts"][:, 0] * file["scale"][0], float(file["fs"])
    whole, part = jaxcal.noise.fit(y, rate), jaxcal.noise.fit(lost(y, 0.01, 1, 1), rate)
    for term, error in zip(whole.terms, np.sqrt(np.diag(whole.covariance)), strict=True):
        moved = float(getattr(part.noise, term)) ** 2 - float(getattr(whole.noise, term)) ** 2
        assert abs(moved) <= 0.25 * error, term


def test_a_fit_of_gaps_that_does_not_settle_says_so(monkeypatch):
    monkeypatch.setattr("jaxcal.noise._solve._ROUNDS", 2)
    assert "unsettled" in jaxcal.noise.fit(lost(simulated(2**12, RATE, TRUTH, 5), 0.6, 1, 5), RATE).codes
