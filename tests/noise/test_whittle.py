"""The likelihood fit against a general minimiser, in simulations, and with data that violate its assumptions."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
import scipy.signal
import scipy.stats

import jaxcal
from jaxcal.noise import Noise

RATE = 100.0
D = np.pi / 180
TERMS = ("Q", "N", "B", "K")
#: case A of the efficiency table: N 0.25 deg/sqrt(h), B 7.6 deg/h, K 1.8 deg/h/sqrt(s)
CASE_A = Noise(N=0.25 / 60 * D, B=7.6 / 3600 * D, K=1.8 / 3600 * D)


# in record 0 neither octaves nor parts of the record contradict the likelihood, so that intervals are those of the profile
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (3, 4, 5))])
def test_minimum_and_limits_equal_those_of_a_general_minimiser(seed):
    """L-BFGS-B from many starts finds no higher likelihood, and the profile likelihood has the expected level at the interval ends.

    In other records the level is higher, because errors are the larger of those of the likelihood and those that the record shows.
    """
    y = dataclasses.replace(CASE_A, Q=0.4 / 3600 * D).simulate(1 << 13, RATE, seed=seed)
    fit = jaxcal.noise.fit(y, RATE)
    assert fit.used.all()
    assert not fit.warnings
    assert fit.goodness > 0.05 or seed  # otherwise the intervals are wider than the profile
    scale = np.array([max(float(getattr(fit.noise, term)), 1e-3 * CASE_A.N) for term in TERMS])

    likelihood = jaxcal.noise.log_likelihood(y, RATE)

    def cost(x):
        return -likelihood(Noise(**dict(zip(TERMS, jnp.sqrt(x) * scale, strict=True))))

    # this function is evaluated thousands of times, so that the optimisation of compiled code, which other tests omit, saves time
    objective = jax.jit(jax.value_and_grad(cost), compiler_options={"xla_backend_optimization_level": 2})

    def least(starts, held=None):
        found = []
        for start in starts:
            # the bound avoids zero, where the root of a squared coefficient has no derivative
            bounds = [(1e-12, None)] * 4
            if held is not None:
                start = np.array(start, dtype=float)
                start[held[0]] = max((held[1] / scale[held[0]]) ** 2, 1e-12)
                bounds[held[0]] = (start[held[0]],) * 2
            done = scipy.optimize.minimize(
                objective, start, jac=True, bounds=bounds, options={"ftol": 1e-15, "gtol": 1e-9, "maxiter": 2000}
            )
            found.append(float(done.fun))
        return np.array(found)

    fitted = np.array([float(getattr(fit.noise, term)) for term in TERMS])
    lowest = float(objective(np.maximum((fitted / scale) ** 2, 1e-12))[0])
    reached = least(np.random.default_rng(seed).lognormal(sigma=2.0, size=(12, 4)))
    assert (reached >= lowest - 1e-6).all()
    assert reached.min() <= lowest + 1e-5  # L-BFGS-B itself stops 4e-6 above in record 4
    starts = [np.full(4, factor) for factor in (0.3, 1.0, 3.0)]
    for i, term in enumerate(TERMS):
        ends = {"low": fit.interval[term][0], "high": fit.interval[term][1], "upper": fit.upper_limit[term]}
        for end, value in ends.items():
            if value > 0:
                level = scipy.stats.norm.ppf(0.95) ** 2 if end == "upper" else scipy.stats.chi2.ppf(0.95, 1)
                ratio = 2 * (least(starts, (i, value)).min() - lowest)
                assert level - 0.02 <= ratio
                # the interval of N reaches to that of another model of the slow noise, where the record does not exclude it
                assert ratio <= level + 0.02 or term == "N" or seed
        rise = 2 * (least(starts, (i, 0.0)).min() - lowest)
        assert float(fit.significance[term]) <= rise + max(0.02, 1e-3 * rise)
        if not seed:
            assert rise == pytest.approx(float(fit.significance[term]), abs=0.02, rel=1e-3)
            assert (fit.interval[term][0] == 0.0) == (rise <= scipy.stats.chi2.ppf(0.95, 1))


@pytest.mark.long
def test_absent_terms_are_seldom_found():
    white = Noise(N=1.0)
    fits = [jaxcal.noise.fit(white.simulate(1 << 14, RATE, seed=seed), RATE) for seed in range(60)]
    for term in ("Q", "B", "K"):
        assert sum(fit.presence[term] == "present" for fit in fits) <= 3  # 1 % nominal: P(> 3 of 60) = 0.3 %


@pytest.fixture(scope="module")
def record():
    return CASE_A.simulate(1 << 17, RATE, seed=5)


def departs(fit, term, truth):
    """Departure of a coefficient from the truth in standard errors of the fit."""
    value = float(getattr(fit.noise, term))
    return abs(value**2 - truth**2) / np.sqrt(float(fit.covariance[term, term]))


def test_a_low_pass_is_left_out_and_named(record):
    b, a = scipy.signal.butter(2, 20.0, fs=RATE)
    fit = jaxcal.noise.fit(scipy.signal.lfilter(b, a, record), RATE)
    assert fit.band[0] > 0.03
    assert not fit.used[0]
    assert "band" in fit.codes
    for term in "NBK":
        assert departs(fit, term, getattr(CASE_A, term)) < 4
    assert not fit.noise.sinusoid
    assert float(fit.noise.N) == pytest.approx(CASE_A.N, rel=0.03)  # the standard error is 0.7 % for the remaining band


def test_a_line_is_taken_out_and_told(record):
    fit = jaxcal.noise.fit(record + 2e-3 * D * np.sin(2 * np.pi * 0.1 * np.arange(1 << 17) / RATE + 0.7), RATE)
    ((amplitude, frequency),) = fit.noise.sinusoid
    assert amplitude / D == pytest.approx(2e-3, rel=0.3)  # noise at the frequency of the line causes a scatter of 10 %
    assert frequency == pytest.approx(0.1, rel=0.04)
    assert "lines" in fit.codes
    for term in "NBK":
        assert departs(fit, term, getattr(CASE_A, term)) < 4


def test_what_is_no_noise_is_set_aside(record):
    spoilt = record.copy()
    where = np.random.default_rng(0).choice(np.arange(5, 1 << 17, 50), 10, replace=False)
    spoilt[where] += 50 * CASE_A.N * np.sqrt(RATE)
    spoilt[70_000:70_100] += 30 * CASE_A.N * np.sqrt(RATE) * np.sin(np.linspace(0, np.pi, 100))
    fit, clean = jaxcal.noise.fit(spoilt, RATE), jaxcal.noise.fit(record, RATE)
    aside = {one.code: one.facts for one in fit.findings}["set_aside"]
    assert 1.0 < aside["length"] < 15.0  # the knock lasts 1 s, and what is near the outliers goes too
    assert "set_aside" not in clean.codes
    for term in "NBK":
        low, high = clean.interval[term]
        assert abs(getattr(fit.noise, term) - getattr(clean.noise, term)) < 0.1 * (high - low)


def test_steps_are_told(record):
    y = record.copy()
    y[50_000:] += 0.5 * CASE_A.N * np.sqrt(RATE)
    found = {one.code: one.facts for one in jaxcal.noise.fit(y, RATE).findings}["step"]
    ((at, size, error),) = found["steps"]
    assert at == pytest.approx(500.0, abs=30.0)
    assert abs(size - 0.5 * CASE_A.N * np.sqrt(RATE)) < 3 * error
    assert "step" not in jaxcal.noise.fit(record, RATE).codes


def test_coarse_rounding_is_told(record):
    white = CASE_A.N * np.sqrt(RATE)
    step = 6 * white
    assert "coarse" in jaxcal.noise.fit(np.round(record / step) * step, RATE).codes
    step = 1.5 * white
    fit = jaxcal.noise.fit(np.round(record / step) * step, RATE)
    assert "rounding" in fit.codes
    # dithered rounding is white: N^2 + step^2 dt / 12
    assert float(fit.noise.N) == pytest.approx(np.sqrt(CASE_A.N**2 + step**2 / RATE / 12), rel=0.01)


def test_a_ramp_is_told_and_fitted_where_asked(record):
    slope = 0.1 * D / (len(record) / RATE) * 2
    y = record + slope * np.arange(len(record)) / RATE
    assert "ramp" in jaxcal.noise.fit(y, RATE).codes
    fit = jaxcal.noise.fit(y, RATE, terms=("Q", "N", "B", "K", "R"))
    assert fit.presence["R"] == "present"
    low, high = fit.interval["R"]
    assert low < slope < high
    assert departs(fit, "B", CASE_A.B) < 4
    assert "ramp" not in fit.codes


@pytest.mark.long
def test_the_interval_of_a_ramp_has_the_level_asked_for():
    """The slope has a normal distribution: half-widths are proportional to its quantiles, and 50 % intervals contain half of the truths."""
    slope = 2e-4 * D
    levels = (0.5, 0.8, 0.99)
    terms = ("N", "R")
    records = [Noise(N=CASE_A.N).simulate(1 << 12, RATE, seed=seed) + slope * np.arange(1 << 12) / RATE for seed in range(60)]
    fits = [jaxcal.noise.fit(records[0], RATE, terms=terms, confidence=level) for level in levels]
    halves = [fit.interval["R"][1] - float(fit.noise.R) for fit in fits]
    np.testing.assert_allclose(halves / halves[0], scipy.stats.norm.ppf(0.5 + np.array(levels) / 2) / scipy.stats.norm.ppf(0.75), rtol=1e-9)
    uppers = [fit.upper_limit["R"] - float(fit.noise.R) for fit in fits[1:]]
    np.testing.assert_allclose(uppers[1] / uppers[0], scipy.stats.norm.ppf(0.99) / scipy.stats.norm.ppf(0.8), rtol=1e-9)
    found = [jaxcal.noise.fit(y, RATE, terms=terms, confidence=0.5).interval["R"] for y in records]
    # by the binomial distribution, 17 to 43 of 60 intervals of 50 % contain the truth except once in a thousand tries
    assert 17 <= sum(low <= slope <= high for low, high in found) <= 43


def test_a_gauss_markov_process_is_told_and_fitted_where_asked():
    sigma, time = 6e-3 * D, 1.0
    strength = sigma * np.sqrt(2 / time)
    y = dataclasses.replace(CASE_A, markov=((strength, time),)).simulate(1 << 17, RATE, seed=3)
    fit = jaxcal.noise.fit(y, RATE, terms=("Q", "N", "B", "K", "markov"))
    ((found, correlation),) = fit.noise.markov
    assert fit.presence["markov"] == "present"
    assert 0.5 < correlation < 2.0
    assert float(found) * np.sqrt(correlation / 2) == pytest.approx(sigma, rel=0.3)
    assert float(fit.noise.N) == pytest.approx(CASE_A.N, rel=0.02)
    assert fit.terms == (*TERMS, "markov")
    assert fit.numbers["markov_time"].value == correlation


def test_a_log_that_carries_temperature_is_tested_for_it(record):
    n = len(record)
    temperature = 25 + 5 * np.sin(2 * np.pi * np.arange(n) / n) + 3 * np.arange(n) / n
    y = record + 5e-4 * temperature
    others = [CASE_A.simulate(n, RATE, seed=seed) for seed in (7, 8)]
    log = jaxcal.Log(None, gyro=np.stack([y, *others], axis=1), temperature=temperature, rate=RATE)
    fits = jaxcal.noise.characterise(log)
    assert "temperature" in fits.gyro_x.codes
    assert "temperature" not in fits.gyro_y.codes  # an axis that does not follow it


def test_jit_vmap_and_derivative():
    """One compiled program computes values and derivatives of two records."""
    records = np.stack([CASE_A.simulate(1 << 13, RATE, seed=s) for s in range(2)])

    def coefficients(y):
        noise = jaxcal.noise.fit(y, RATE).noise
        found = jnp.stack([jnp.asarray(noise.N), jnp.asarray(noise.B)])
        return found, found

    slopes, both = jax.jit(jax.vmap(jax.jacrev(coefficients, has_aux=True)))(jnp.asarray(records))
    plain = [jaxcal.noise.fit(y, RATE).noise for y in records]
    np.testing.assert_allclose(both, [(noise.N, noise.B) for noise in plain], rtol=1e-6)
    # the search ends 1e-8 standard errors from the minimum, which limits a difference over a smaller step
    direction, step = np.random.default_rng(0).normal(size=1 << 13) * 1e-3, 3e-3
    for y, slope in zip(records, slopes, strict=True):
        up, down = (np.array(coefficients(y + sign * step * direction)[0]) for sign in (1, -1))
        np.testing.assert_allclose(slope @ direction, (up - down) / (2 * step), rtol=1e-4)


def test_in_float32_it_is_close():
    y = CASE_A.simulate(1 << 13, RATE, seed=1)
    with jax.enable_x64(False), pytest.warns(jaxcal.PrecisionWarning):
        found = jax.jit(lambda y: jaxcal.noise.fit(y, RATE).noise.N)(jnp.asarray(y, dtype=jnp.float32))
    assert float(found) == pytest.approx(float(jaxcal.noise.fit(y, RATE).noise.N), rel=1e-3)


def test_a_large_offset_changes_nothing(record):
    white = CASE_A.N * np.sqrt(RATE)
    near, far = (jaxcal.noise.fit(record + offset, RATE) for offset in (0.0, 1e6 * white))
    for term in "NBK":
        assert float(getattr(far.noise, term)) == pytest.approx(float(getattr(near.noise, term)), rel=1e-6)


@pytest.mark.parametrize("scale", [1e-310, 1e-120, 1e120])
def test_numbers_whose_squares_are_lost_are_refused(scale):
    with pytest.raises(jaxcal.DataError, match=r"rescale|no sensor gives"):
        jaxcal.noise.fit(scale * np.random.default_rng(0).normal(size=2000), RATE)


def test_log_likelihood_has_its_maximum_at_the_fit():
    y = CASE_A.simulate(1 << 14, RATE, seed=3)
    fit = jaxcal.noise.fit(y, RATE)
    values = jnp.asarray([float(fit.noise.N), float(fit.noise.B)])

    for likelihood in (jaxcal.noise.log_likelihood(y, RATE), fit.log_likelihood):

        def of(x, likelihood=likelihood):
            return likelihood(Noise(Q=float(fit.noise.Q), N=x[0], B=x[1], K=float(fit.noise.K)))

        slope = jax.jit(jax.grad(of))(values) * values
        curvature = -jnp.diagonal(jax.jit(jax.hessian(of))(values)) * values**2
        assert (abs(slope) < 1e-3 * jnp.sqrt(curvature)).all()
        assert (curvature > 1).all()
        assert float(of(values)) == pytest.approx(float(likelihood(fit.noise)), rel=1e-9)  # traced or not


def test_log_likelihood_of_a_record_with_gaps_has_its_maximum_at_the_fit():
    y = CASE_A.simulate(1 << 13, RATE, seed=3)
    y[np.random.default_rng(0).random(len(y)) < 0.05] = np.nan
    fit = jaxcal.noise.fit(y, RATE, terms="NB")
    likelihood = jaxcal.noise.log_likelihood(y, RATE)
    values = [float(fit.noise.N), float(fit.noise.B)]
    for scale in ((1.01, 1.0), (0.99, 1.0), (1.0, 1.3), (1.0, 0.7)):
        other = Noise(N=values[0] * scale[0], B=values[1] * scale[1])
        assert likelihood(other) < likelihood(fit.noise)


def test_messages_of_log_likelihood():
    with pytest.raises(jaxcal.DataError, match=r"y must be \(n,\), one channel"):
        jaxcal.noise.log_likelihood(np.zeros((100, 2)), RATE)
    with pytest.raises(jaxcal.DataError, match="one channel that was fitted by method"):
        _ = jaxcal.noise.fit(CASE_A.simulate(1 << 12, RATE, seed=0), RATE, method="gls").log_likelihood


def test_gaps_everywhere_are_fitted_and_a_record_of_gaps_is_refused(record):
    y = record[:5000].copy()
    y[::10] = np.nan
    assert departs(jaxcal.noise.fit(y, RATE), "N", CASE_A.N) < 4
    y[15:] = np.nan
    with pytest.raises(jaxcal.DataError, match=r"13 of 5000 samples are there; a noise model needs 16"):
        jaxcal.noise.fit(y, RATE)


def test_an_interval_is_known_where_only_one_term_is_there():
    """B is zero; if N were also zero, the model would have no density."""
    sides = []
    for seed in range(15):
        found = jaxcal.noise.fit(Noise(N=8.1e-5).simulate(4_000, 100.0, seed=seed), 100.0, terms=("N", "B"))
        low, high = found.interval["N"]
        # for white noise alone the relative standard error of N is 1 / sqrt(2 n)
        sides.append(np.array([found.noise.N - low, high - found.noise.N]) / (1.96 * found.noise.N / np.sqrt(8_000)))
    below, above = np.median(sides, axis=0)
    assert 0.9 < above < 1.1
    assert 0.9 < below < 1.4  # a part of the noise could be slow, which only the rival of the model allows


def test_half_of_the_truths_lie_below_an_upper_limit_of_50_percent():
    fit = jaxcal.noise.fit(Noise(N=CASE_A.N).simulate(1 << 12, RATE, seed=1), RATE, terms=("N",), confidence=0.5)
    assert fit.upper_limit["N"] == pytest.approx(float(fit.noise.N), rel=1e-3)
