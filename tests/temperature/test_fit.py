"""`fit` against NumPy: model choices, uncertainty, derivatives, and data that are refused."""

import itertools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.signal

from jaxcal import Log
from jaxcal.temperature import AbstractCurve, Chebyshev, Steps, characterise, fit, residuals, simulate, thermometer
from jaxcal.temperature._hysteresis import lagged, played
from jaxcal.temperature._record import binned

from .cases import smooth_record


@pytest.mark.parametrize("degree", [1, 3, 5])
def test_polynomials_of_the_thesis_are_numpys(degree):
    t, b, _ = smooth_record()
    found = fit(t, b, model="polynomial", degree=degree)
    bins = binned(t, b)
    expected = np.polynomial.Polynomial.fit(bins.t, bins.b, degree, w=np.sqrt(bins.count)).convert().coef
    np.testing.assert_allclose(found.estimate.values, expected, rtol=1e-6)
    np.testing.assert_allclose(found.model.bias_at(t), np.polynomial.polynomial.polyval(t, found.estimate.values), atol=1e-9)


def test_the_table_goes_through_the_means():
    t, b, _ = smooth_record()
    nodes = binned(t, b, 0.25)
    x = np.linspace(nodes.t[0], nodes.t[-1], 333)
    np.testing.assert_allclose(fit(t, b, model="table").model.bias_at(x), np.interp(x, nodes.t, nodes.b), atol=1e-15)


def test_the_curve_is_the_polynomial_where_the_truth_is_one():
    """The automatic model reproduces a straight line and a cubic to the noise."""
    t, b, truth = smooth_record(degree=1)
    assert len(fit(t, b).model.curve.coefficients) <= 41
    np.testing.assert_allclose(fit(t, b).model.bias_at(t), truth - truth.mean() + b.mean(), atol=2e-5)
    t, b, truth = smooth_record(degree=3)
    np.testing.assert_allclose(fit(t, b).model.bias_at(t), truth - truth.mean() + b.mean(), atol=3e-5)


@pytest.mark.parametrize(("ends", "one"), [((24, 45, 20, 30), False), ((24, 45), True)])
def test_ramps_are_counted_between_turning_points(ends, one):
    """The noise of the thermometer is not counted as additional ramps."""
    t = np.concatenate([np.linspace(start, stop, 300) for start, stop in itertools.pairwise(ends)])
    rng = np.random.default_rng(0)
    found = fit(t + 0.05 * rng.normal(size=len(t)), 1e-3 * t + 1e-3 * rng.normal(size=len(t)))
    assert ("one_way" in found.codes) == one


def test_a_ramp_with_the_noise_of_its_thermometer_has_no_outliers():
    rng = np.random.default_rng(0)
    t = 32.5 + 12.5 * np.sin(np.arange(2000) / 700)
    found = fit(t + 0.01 * rng.normal(size=2000), 1e-3 * t + 1e-2 * rng.normal(size=2000), time=np.arange(2000.0), lag=0.0, play=0.0)
    assert "left_out" not in found.codes
    assert pytest.approx(1e-2, rel=0.08) == found.noise.N


@pytest.mark.long
@pytest.mark.parametrize(("speeds", "timed", "code"), [((), True, "lag_or_play"), ((0.4, 0.4), True, None), ((), False, "untimed")])
def test_a_lag_needs_ramps_of_two_speeds_and_times(speeds, timed, code):
    """`benchmarks/finding_rates.py` has more runs."""
    legs = [np.linspace(0.0, 1.0, round(2250 / each)) for each in (1.0, 1.0, *speeds)]
    true = 20 + 25 * np.concatenate([1 - leg if k % 2 else leg for k, leg in enumerate(legs)])
    keep = np.exp(-1 / 60.0)
    inner = scipy.signal.lfilter([1 - keep], [1.0, -keep], true - 20) + 20 if timed else true
    rng = np.random.default_rng(0)
    # less noise shows the beginning of a ramp, which tells a lag from a play
    bias, seen = 0.4 * inner + 0.01 * inner**2 + rng.normal(size=len(true)), true + 0.02 * rng.normal(size=len(true))
    found = fit(seen, bias, time=np.arange(len(true)) if timed else None)
    assert found.codes & {"lag_or_play", "untimed"} == ({code} if code else set())


def test_several_cycles_share_one_fit(refuses):
    """Each cycle has its own level, and the spread of the levels widens the prediction."""
    rng, time = np.random.default_rng(1), np.arange(2000.0)
    t = 30 + 8 * np.sin(2 * np.pi * time / 2000)
    bias = [level + (t - 30) / 8 + 0.1 * rng.normal(size=2000) for level in (0.0, 0.4)]
    cycles = fit([t, t], bias, time=[time, time], lag=0.0, play=0.0)
    assert cycles.level == (pytest.approx(0.4 / np.sqrt(2) * np.sqrt(1.5), rel=0.1), 1)
    assert np.diff(cycles.prediction_at(30.0))[0] > 5 * np.diff(cycles.interval_at(30.0))[0]
    assert np.diff(cycles.model.bias_at(np.array([22.1, 37.9])))[0] == pytest.approx(15.8 / 8, abs=0.02)
    assert pytest.approx(0.1, rel=0.05) == cycles.noise.N
    with refuses("lengths") as caught:
        fit([t, t], [bias[0], bias[1][1:]], time=[time, time])
    assert caught.value.subject == "record 1"
    with refuses("one_record"):
        fit([t, t], bias, model="table")


def test_a_gap_begins_a_new_record():
    t, b, truth = smooth_record(n=2000, degree=2)
    keep = (np.arange(2000) < 900) | (np.arange(2000) > 1100)
    found = fit(t[keep], b[keep], time=np.arange(2000.0)[keep])
    held = np.abs(t - 25) < 14
    error = found.model.bias_at(t[held]) - truth[held]
    assert np.std(error) < 2e-4


def test_intervals_hold_the_truth_of_a_smooth_curve_and_of_its_coefficients():
    covered, inside = [], []
    for seed in range(8):
        t, b, truth = smooth_record(seed=seed, degree=3, n=600)
        found = fit(t, b, model="polynomial", degree=3)
        low, high = found.interval_at(t[::40])
        covered.append((low <= truth[::40]) & (truth[::40] <= high))
        inside.append(found.estimate["a4"].low < 0.001 / 15**3 < found.estimate["a4"].high)
    assert sum(inside) >= 5  # probability below 0.001 at 95 %
    # the noise is white and has no random walk, for which the intervals allow: they are too wide; the share has an error of 0.03
    assert np.mean(covered) > 0.9
    assert np.diff(found.interval_at(t[300]))[0] < 6 * 1e-4 * np.sqrt(4 / 600) * 2


def test_the_worst_degree_is_where_a_polynomial_misses_a_jump():
    t, b, _ = smooth_record()
    found = fit(t, b + 0.01 * (t > 24.5), model="polynomial", degree=5)
    assert found.worst > 2 * found.rms
    assert abs(found.worst_at - 24.5) < 1.0


def test_missing_samples_and_outliers_are_told():
    t, b, truth = smooth_record()
    b[::50] = np.nan
    b[77] = 5.0
    t[333] = -273.0
    found = fit(t, b, model="polynomial", degree=2)
    (told,) = [one for one in found.findings if one.code == "left_out"]
    assert (told.facts["missing"], told.facts["total"], told.facts["outliers"]) == (30, 1500, 2)
    t, _, truth = smooth_record()
    np.testing.assert_allclose(found.model.bias_at(t), truth, atol=4e-5)


@pytest.mark.parametrize(
    ("t", "b", "time", "code"),
    [
        (np.zeros(0), np.zeros(0), None, "no_numbers"),
        (np.linspace(20, 30, 100), np.zeros(99), None, "lengths"),
        (np.linspace(20, 30, 100), np.zeros(100), np.arange(99.0), "lengths"),
        (np.full(100, 25.0), np.arange(100.0), None, "range"),
        (np.linspace(20, 21.5, 100), np.arange(100.0), None, "range"),
        (np.repeat([20.0, 30.0, 40.0], 40), np.arange(120.0), None, "few_bins"),
        (np.full(100, np.nan), np.zeros(100), None, "no_numbers"),
        (np.linspace(20, 30, 100), np.zeros(100), np.zeros(100), "time_order"),
        (np.zeros((100, 3)), np.zeros(100), None, "shape"),
        (["a", "b"], np.zeros(2), None, "not_numbers"),
    ],
)
def test_data_that_allow_no_answer_are_refused_with_the_reason(refuses, t, b, time, code):
    with refuses(code):
        fit(t, b, time=time)


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"model": "magic"}, "model"),
        ({"degree": 3}, "degree"),
        ({"model": "polynomial", "degree": 99}, "degree"),
        ({"model": "polynomial"}, "degree"),
        ({"model": "table", "lag": "auto"}, "lag"),
        ({"lag": -1.0}, "lag"),
        ({"lag": 10.0}, "no_time"),
        ({"confidence": 95.0}, "confidence"),
        ({"sensor": "clock"}, "sensor"),
    ],
)
def test_options_without_a_meaning_are_refused(refuses, options, code):
    t, b, _ = smooth_record(n=300)
    with refuses(code):
        fit(t, b, **options)


def test_a_constant_bias_and_a_quick_ramp_are_no_failure():
    t = np.linspace(20, 30, 150)
    found = fit(t, np.full(150, 0.5))
    np.testing.assert_allclose(found.model.bias_at(t), 0.5, atol=1e-12)
    assert {"quick", "one_way"} <= found.codes
    assert np.isfinite(found.error).all()


def test_a_log_with_a_slow_thermometer(refuses):
    t, b, truth = smooth_record(n=3000)
    slow = np.where(np.arange(3000) % 20 == 0, t, np.nan)
    log = Log(None, gyro=np.stack([b, 2 * b], axis=1), temperature=slow, rate=10.0)
    np.testing.assert_allclose(thermometer(log)[5:-30], t[5:-30], atol=2e-3)
    fits = characterise(log, model="polynomial", degree=2)
    assert list(fits) == ["gyro_x", "gyro_y"]
    np.testing.assert_allclose(fits["gyro_y"].model.bias_at(t[30:-30]), 2 * truth[30:-30], atol=1e-4)
    with refuses("no_temperature"):
        characterise(Log(None, gyro=b, rate=10.0))
    with refuses("no_sensor"):
        characterise(Log(None, temperature=t, rate=10.0))
    with refuses("range") as caught:
        characterise(Log(None, gyro=b, temperature=np.full(3000, 20.0), rate=10.0))
    assert caught.value.subject == "gyro_x"
    # a dead channel and a refused one cost only themselves
    bad = np.stack([b, np.full(3000, 0.1), np.where(np.arange(3000) < 20, b, np.nan)], axis=1)
    part = characterise(Log(None, gyro=bad, temperature=t, rate=10.0), model="polynomial", degree=2)
    assert list(part) == ["gyro_x"]
    assert {(one.code, one.subject) for one in part.findings} >= {("constant", ("gyro_y",)), ("refused", ("gyro_z",))}
    np.testing.assert_allclose(part["gyro_x"].estimate.values, fits["gyro_x"].estimate.values, rtol=1e-3)


def test_the_fits_of_a_log_are_one_result_with_units():
    made = simulate(seed=1, duration=1200.0)
    both = np.stack([made.bias, 2 * made.bias], axis=1)
    found = characterise(Log(made.time, gyro=both, temperature=made.temperature), model="polynomial", degree=2)
    assert found.verdict == "weak"
    (told,) = {one for one in found.findings if one.code == "one_way" and one.subject == ("gyro_x",)}
    assert str(told) in str(found.warnings)
    assert found.numbers["gyro_y.change"].unit == "rad/s"
    assert found.numbers["gyro_y.change"].value == pytest.approx(2 * found.numbers["gyro_x.change"].value, rel=0.05)
    assert found.to_dict()["numbers"].keys() == found.numbers.keys()
    with pytest.raises(KeyError, match="gyro_x"):
        found["gyrox"]


JUMP = Steps(Chebyshev(np.zeros(4), 10.0, 40.0), np.array([0.003]), np.array([24.0]), np.array([0.5]))
AT = np.array([24.3, 33.0])


def jumping(n=600):
    t, b, _ = smooth_record(n=n, degree=3)
    return t, b + 0.005 / (1 + np.exp(-(t - 24.5) / 0.3))


@pytest.mark.parametrize(
    "options",
    [{"model": "table"}, *(pytest.param(one, marks=pytest.mark.long) for one in ({"model": "polynomial", "degree": 3}, {"model": JUMP}))],
)
def test_a_given_form_responds_to_temperatures_lag_and_play_as_finite_differences_say(options):
    rng, time = np.random.default_rng(2), np.arange(900.0)
    t = 25 + 14 * np.sin(time / 150) + 0.01 * rng.normal(size=900)
    felt = played(lagged(t, 1.0, 20.0), 0.3)
    b = 0.01 + 0.004 * (felt - 25) / 15 + 0.005 / (1 + np.exp(-(felt - 24.5) / 0.3)) + 1e-4 * rng.normal(size=900)
    #: argument -> a step so small that no sample changes its bin
    steps = {"temperature": 1e-7 * rng.normal(size=900), "lag": 1e-6, "play": 1e-7}

    def values(change):
        held = {"lag": 20.0 + change["lag"], "play": 0.3 + change["play"]}
        found = fit(t + change["temperature"], b, time=time, **held, **options).model.bias_at(jnp.asarray(AT))
        return found, found

    # values and slopes share one program, since its compilation takes seconds
    both, none = jax.jit(jax.jacrev(values, has_aux=True)), jax.tree.map(np.zeros_like, steps)
    slopes, plain = both(none)
    # without tracing, `fit` averages the record to seconds first
    np.testing.assert_allclose(plain, fit(t, b, time=time, lag=20.0, play=0.3, **options).model.bias_at(AT), rtol=1e-3)
    for name, step in steps.items():
        up, down = (both(none | {name: sign * step})[1] for sign in (0.5, -0.5))
        np.testing.assert_allclose(np.reshape(slopes[name], (2, -1)) @ np.ravel(step), up - down, rtol=1e-4, atol=1e-16, err_msg=name)


class Sine(AbstractCurve):
    """A user-defined curve."""

    line: Chebyshev = eqx.field(default_factory=lambda: Chebyshev(np.zeros(2), 10.0, 40.0))
    amplitude: Any = 1e-3
    period: Any = 8.0

    def value(self, t):
        xp = jnp if isinstance(t, jax.Array) else np
        return self.line.value(t) + self.amplitude * xp.sin(2 * np.pi * t / self.period)


def test_a_curve_of_ones_own_is_fitted_with_intervals_and_reported():
    inside = []
    t = np.linspace(10, 40, 900)
    truth = Sine(Chebyshev(np.array([0.02, 0.003]), 10.0, 40.0), 2e-3, 7.5)
    for seed in range(8):
        found = fit(t, truth.value(t) + 1e-4 * np.random.default_rng(seed).normal(size=900), model=Sine if seed else Sine())
        inside.append(found.estimate["period"].low < 7.5 < found.estimate["period"].high)
    assert isinstance(found.model.curve, Sine)
    assert found.kind == "Sine"
    assert sum(inside) >= 5  # probability below 0.001 at 95 %
    assert "period" in found.summary()
    bins = found.bins
    np.testing.assert_allclose(residuals(found.model, bins), np.sqrt(bins.count) * -found.residual, rtol=1e-9, atol=1e-15)
    low, high = found.interval_at(t)
    assert np.mean((low <= truth.value(t)) & (truth.value(t) <= high)) > 0.5


def test_what_the_host_decides_is_not_traced(refuses):
    t, b = jumping()
    for options in ({}, {"model": "polynomial"}):
        with refuses("traced"):
            jax.jit(lambda b, options=options: fit(t, b, **options).rms)(b)
