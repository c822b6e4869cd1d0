"""Methods that fit an Allan deviation curve: exact curves, dense algebra, bias and scatter in simulations, traced path, messages."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal.allan import deviation
from jaxcal.noise import Noise, _curvefit, allan_covariance, fit
from jaxcal.noise._record import clusters

RATE, DT = 100.0, 0.01
TERMS = ("Q", "N", "B", "K")
#: thesis table 7.3, gyroscope X, in deg and s
GYRO = Noise(N=0.25 / 60, B=7.6 / 3600, K=1.8 / 3600)
WITHOUT = ("log", "slope")
METHODS = ("gls", "log", "slope")


def objects(terms):
    return tuple(Noise().part(term)[2] for term in terms)


def fitted(method, y, terms=TERMS, inside=None, **changes):
    """Fit one channel as `jaxcal.noise.fit` does; `changes` replace fields of the deviation."""
    curve = dataclasses.replace(deviation(y, RATE, m=clusters(len(y), terms), alpha=0), **changes)
    chosen = np.ones(len(curve.m), dtype=bool) if inside is None else inside(curve.tau)
    return fitted_curve(method, curve, len(y), objects(terms), chosen)


def fitted_curve(method, curve, samples, terms, chosen):
    return _curvefit.fit_deviation(curve, samples, terms, chosen, method, 0.95)


def exact(method, noise, samples=2**15, terms=TERMS):
    """Fit the curve of the model itself, which has no scatter."""
    tau = clusters(samples, terms) * DT
    return fitted(method, np.random.default_rng(0).standard_normal(samples), terms, deviation=np.sqrt(noise.avar(tau, dt=DT)))


def coefficients(found, terms=TERMS):
    return np.array([float(getattr(found.noise, term)) for term in terms])


@pytest.fixture(scope="module")
def runs():
    """Fits of 40 records of 2^15 samples with N, B and K by every method."""
    records = [GYRO.simulate(2**15, RATE, seed=s) for s in range(40)]
    return {method: [fitted(method, y) for y in records] for method in METHODS}


@pytest.mark.parametrize("method", ["gls", "log"])
@pytest.mark.parametrize("noise", [GYRO, Noise(Q=5e-4, N=0.25 / 60, B=7.6 / 3600, K=1.8 / 3600), Noise(N=0.25 / 60), Noise(B=1.0)])
def test_the_model_s_own_curve_gives_its_coefficients(method, noise):
    truth = np.array([noise.Q, noise.N, noise.B, noise.K])
    found = coefficients(exact(method, noise))
    np.testing.assert_allclose(found[truth > 0], truth[truth > 0], rtol=1e-9)
    # the contribution of an absent term to the variance is zero to the rounding of the curve
    tau = clusters(2**15, TERMS) * DT
    for term, value in zip(np.array(TERMS)[truth == 0], found[truth == 0], strict=True):
        assert np.all(Noise(**{term: value}).avar(tau, dt=DT) < 1e-12 * noise.avar(tau, dt=DT).max())


@pytest.mark.parametrize("method", WITHOUT)
def test_a_ramp_where_asked(method):
    found = exact(method, Noise(N=1e-3, R=1e-4), terms=("N", "R"))
    np.testing.assert_allclose(found.noise.R, 1e-4, rtol=0.02 if method == "slope" else 1e-9)
    np.testing.assert_allclose(found.noise.N, 1e-3, rtol=0.02 if method == "slope" else 1e-9)


def allan_columns(m):
    """Exact Allan variances per squared coefficient from the semivariogram of each term, summed lag by lag."""
    columns = []
    for size in m:
        h = np.arange(1, 2 * size)
        weight = np.where(h <= size, 2.0 * size - 3.0 * h, h - 2.0 * size)
        flicker = 2 / np.pi * np.cumsum(1 / (2.0 * h - 1))
        quantised = (2.0 + (h == 1)) / DT**2
        gamma = np.stack([quantised, np.full(len(h), 1 / DT), flicker, DT * h / 2], axis=1)
        columns.append(-(weight @ gamma) / size**2)
    return np.array(columns)


def dense(v, m, samples):
    """Solve v = A theta by iterated least squares with the whole covariance.

    Every set of non-zero coefficients is tried. Returns the coefficients and the covariance of all columns, including those at zero.
    """
    columns = allan_columns(m)

    def covariance(theta):
        return allan_covariance(Noise(**dict(zip(TERMS, np.sqrt(theta), strict=True))), samples, m, DT)

    sets = [np.array([bool(code >> i & 1) for i in range(4)]) for code in range(1, 16)]
    theta = None
    for _ in range(400):
        c = np.diag(v**2) if theta is None else covariance(theta)
        inverse = np.linalg.inv(c)
        best = (np.inf, None)
        for free in sets:
            part = columns[:, free]
            scale = np.sqrt(np.diagonal(part.T @ inverse @ part))
            solved = np.linalg.solve(part.T @ inverse @ part / np.outer(scale, scale), part.T @ inverse @ v / scale) / scale
            if np.all(solved >= 0):
                left = v - part @ solved
                value = np.zeros(4)
                value[free] = solved
                best = min(best, (left @ inverse @ left, value), key=lambda one: one[0])
        theta = best[1] if theta is None else 0.5 * (theta + best[1])
    inverse = np.linalg.inv(covariance(theta))
    gram = columns.T @ inverse @ columns
    scale = np.sqrt(np.diagonal(gram))
    return theta, np.linalg.inv(gram / np.outer(scale, scale)) / np.outer(scale, scale)


@pytest.mark.parametrize("seed", [1, 4])
def test_equals_dense_algebra(seed):
    samples = 3000
    y = Noise(Q=2e-5, N=0.25 / 60, B=0.02, K=0.02).simulate(samples, RATE, seed=seed)
    found = fitted("gls", y)
    theta, spread = dense(found.deviation.deviation**2, found.deviation.m, samples)
    # the results differ only because `fit` adds 1e-8 to the diagonal of the correlation
    np.testing.assert_allclose(coefficients(found) ** 2, theta, rtol=2e-4, atol=1e-12 * theta.max())
    np.testing.assert_allclose(found.covariance, spread, rtol=2e-3)


def test_slope_equals_a_plain_reading():
    found = fitted("slope", GYRO.simulate(2**15, RATE, seed=6), ("Q", "N", "B", "K", "R"))
    tau, ad = found.deviation.tau, found.deviation.deviation
    slope = np.gradient(np.log(ad), np.log(tau))
    i = np.argmin(ad)
    n = np.argmin(np.abs(slope[: i + 1] + 0.5))
    k = i + 1 + np.argmin(np.abs(slope[i + 1 :] - 0.5))
    assert slope[k] > 0.25
    assert slope[: i + 1].min() > -0.75
    np.testing.assert_allclose(found.noise.N, ad[n] * np.sqrt(tau[n]), rtol=1e-12)
    np.testing.assert_allclose(found.noise.K, ad[k] * np.sqrt(3 / tau[k]), rtol=1e-12)
    np.testing.assert_allclose(found.noise.B, ad.min() / 0.664, rtol=1e-12)
    assert found.noise.Q == 0.0
    quantised = exact("slope", Noise(Q=1e-3, N=1e-4))
    np.testing.assert_allclose(quantised.noise.Q, 1e-3, rtol=0.01)


@pytest.mark.long
@pytest.mark.parametrize("method", METHODS)
def test_scatter_is_that_of_the_method(runs, method):
    """Root mean square errors of 40 records of 5.5 minutes exceed the expected ones by less than four standard errors (45 %)."""
    bounds = {"gls": (0.8, 21, 55), "log": (7, 55, 80)}
    relative = {term: np.array([float(getattr(f.noise, term)) for f in runs[method]]) / getattr(GYRO, term) - 1 for term in "NBK"}
    error = {term: 100 * np.sqrt(np.mean(relative[term] ** 2)) for term in "NBK"}
    if method != "slope":
        for term, bound in zip("NBK", bounds[method], strict=True):
            assert error[term] < 1.45 * bound, (term, error)
    if method == "gls":
        assert abs(relative["B"].mean()) < 0.1
        for term in "NBK":
            ends = np.array([f.interval[term] for f in runs[method]])
            share = np.mean((ends[:, 0] <= getattr(GYRO, term)) & (getattr(GYRO, term) <= ends[:, 1]))
            # fewer than 33 of 40 intervals of 95 % contain the truth once in a thousand tries
            assert share >= 33 / 40, (term, share)


def test_k_is_found_where_b_is_absent():
    """The fit without K starts with weights that are far too large; it must not oscillate, so that K is significant in every record."""
    noise = Noise(N=0.25 / 60, K=1.8 / 3600)
    for seed in (1002, 1022, 1037, 1042, 1045, 1053):
        y = noise.simulate(2**17, RATE, seed=seed)
        assert fitted("gls", y).presence["K"] == "present"


@pytest.mark.parametrize("method", WITHOUT)
def test_methods_without_uncertainty_say_so(method):
    found = fitted(method, GYRO.simulate(2**13, RATE, seed=3))
    for table in (found.interval, found.upper_limit, found.presence, found.significance, found.longer_record):
        assert table == {}
    assert np.isnan(found.covariance["N", "N"])
    assert 0.0 <= found.goodness <= 1.0
    assert found.codes == {"no_intervals"}
    assert found.method == method
    assert not any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(found))


@pytest.mark.parametrize("method", METHODS)
def test_band_on_request(method):
    y = GYRO.simulate(2**15, RATE, seed=1)
    found = fitted(method, y, inside=lambda tau: (tau > 0.03) & (tau < 50))
    assert 0.03 < found.band[0] < found.band[1] < 50
    np.testing.assert_array_equal(found.used, (found.deviation.tau > 0.03) & (found.deviation.tau < 50))
    np.testing.assert_allclose(found.noise.N, GYRO.N, rtol=0.15)


@pytest.mark.parametrize("method", METHODS)
def test_units_scale(method):
    y = GYRO.simulate(2**14, RATE, seed=1)
    one, other = fitted(method, y), fitted(method, y * 1e-9)
    np.testing.assert_allclose(coefficients(other) * 1e9, coefficients(one), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(other.goodness, one.goodness, rtol=1e-5)
    if method == "gls":
        np.testing.assert_allclose(
            np.array([other.interval[t] for t in TERMS]) * 1e9, [one.interval[t] for t in TERMS], rtol=1e-4, atol=1e-9
        )


def test_a_trace_is_for_the_likelihood(refuses):
    with refuses("only_whittle"):
        jax.jit(lambda y: fit(y, RATE, method="gls").noise.N)(jnp.asarray(GYRO.simulate(600, RATE, seed=8)))


def test_gaps_are_allowed_for():
    y = GYRO.simulate(2**15, RATE, seed=5)
    for start in (1000, 12_000, 21_000):
        y[start : start + 40] = np.nan
    for method in METHODS:
        found = fit(y, RATE, method=method)
        np.testing.assert_allclose(found.noise.N, GYRO.N, rtol=0.15 if method == "log" else 0.03)
        assert "gaps" in found.codes


def test_clusters(refuses):
    sizes = clusters(2**17, TERMS)
    assert len(sizes) <= 25
    assert sizes[0] == 1
    assert sizes[-1] == 2**15
    with refuses("too_short"):
        clusters(27, TERMS)
