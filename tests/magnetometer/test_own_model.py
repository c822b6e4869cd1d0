"""A user-defined magnetometer model with a linear temperature term is fitted with intervals, plotted, saved, loaded and applied."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

import jaxcal
from jaxcal import DataError
from jaxcal.magnetometer import MagModel, fit, heading_uncertainty, residuals

from . import cases


class Warming(MagModel):
    """A model whose hard iron depends linearly on the temperature: b + k (T - 25)."""

    per_kelvin: jax.Array

    def _shift(self, temperature):
        return self.per_kelvin[None, :] * (jnp.asarray(temperature)[:, None] - 25.0)

    def measure(self, h, temperature):
        return jnp.asarray(h) @ jnp.asarray(self.soft_iron).T + self.hard_iron[None, :] + self._shift(temperature)

    def correct(self, m, temperature):
        return (jnp.asarray(m) - self.hard_iron[None, :] - self._shift(temperature)) @ jnp.linalg.inv(self.soft_iron).T


#: a field of 48 uT, in tesla
FIELD = 48e-6
TRUE = Warming(np.asarray(cases.MILD.soft_iron), np.array([8e-6, -5e-6, 3e-6]), np.array([2e-8, -3e-8, 1e-8]))
BEGIN = Warming(np.eye(3), np.zeros(3), np.zeros(3))
NAMES = (*(f"hard_iron[{i}]" for i in range(3)), *(f"soft_iron[{i},{j}]" for i in range(3) for j in range(3)),
         *(f"per_kelvin[{i}]" for i in range(3)))  # fmt: skip
TRUTH = np.r_[TRUE.hard_iron, np.ravel(TRUE.soft_iron), TRUE.per_kelvin]
RUNS, COUNT = 200, 200
WARMTH = np.random.default_rng(5).uniform(-10, 60, COUNT)
EXACT = np.asarray(TRUE.measure(FIELD * cases.directions(COUNT, 3), WARMTH))


def drawn(seed, runs=None):
    shape = EXACT.shape if runs is None else (runs, *EXACT.shape)
    return EXACT + 0.2e-6 * np.random.default_rng(seed).normal(size=shape)


@pytest.fixture(scope="module")
def found():
    return fit(drawn(0), model=BEGIN, field=FIELD, conditions={"temperature": WARMTH})


def test_the_leaves_of_the_model_are_fitted_with_intervals_by_name(found):
    assert found.verdict == "good"
    assert isinstance(found.model, Warming)
    assert found.estimate.names == (*NAMES[:12], "field", *NAMES[12:])
    half = scipy.stats.t.ppf(0.975, COUNT - 12) * found.estimate.select(*NAMES).error
    np.testing.assert_allclose([one.half for one in found.estimate.select(*NAMES).numbers()], half)
    assert found.estimate["field"].state == "held"
    assert found.noise == pytest.approx(0.2e-6, rel=0.15)
    # without the term the readings scatter far more
    assert fit(drawn(0), model="symmetric", field=FIELD).noise > 2 * found.noise


@pytest.mark.long
def test_the_truth_is_inside_the_intervals_as_often_as_they_say():
    """The mean coverage of twelve parameters in 200 fits has a standard error of 0.5 to 1 %."""
    fits = [fit(m, model=BEGIN, field=FIELD, conditions={"temperature": WARMTH}).estimate.select(*NAMES) for m in drawn(1, RUNS)]
    values, covariance = np.array([one.values for one in fits]), np.array([one.matrix for one in fits])
    half = scipy.stats.t.ppf(0.975, COUNT - 12) * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    inside = np.abs(values - TRUTH) < half
    assert 0.93 <= inside.mean() <= 0.97
    assert np.all(np.abs(inside.mean(axis=0) - 0.95) < 4 * np.sqrt(0.95 * 0.05 / RUNS))


def test_it_is_applied_and_plotted(found):
    m = drawn(0)
    h = found.model.correct(m, WARMTH)
    assert np.asarray(h).dtype == np.float64
    assert np.linalg.norm(h, axis=1).std() < 0.01 * FIELD
    np.testing.assert_allclose(found.model.measure(h, WARMTH), m, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(residuals(found.model, (m, FIELD, {"temperature": WARMTH})), found.residual, atol=1e-9 * FIELD)
    assert jaxcal.plot.coverage(found).get_xlabel()


def test_its_fields_are_in_every_output(found, tmp_path):
    pytest.importorskip("polars")
    assert found.numbers["per_kelvin[1]"] == found.estimate["per_kelvin[1]"]
    assert "per kelvin" in found.summary()
    assert "per_kelvin[2]" in found.to_dict()["numbers"]
    assert "per_kelvin[0]" in found.to_dataframe()["name"].to_list()
    jaxcal.report.write(found, tmp_path / "a.html")
    assert "per kelvin" in (tmp_path / "a.html").read_text()


def test_it_is_saved_loaded_and_applied_to_a_log(found, tmp_path):
    """The thermometer of the log has a value at every seventh reading; the correction gives the true field at each reading."""
    jaxcal.Calibration(magnetometer=found).save(tmp_path / "device.json")
    again = jaxcal.Calibration.load(tmp_path / "device.json")
    part = again.magnetometer
    assert isinstance(part.model, Warming)
    for leaf in ("soft_iron", "hard_iron", "per_kelvin"):
        np.testing.assert_array_equal(getattr(part.model, leaf), getattr(found.model, leaf))
    assert part.estimate.names == (*NAMES[:12], "field", *NAMES[12:])
    np.testing.assert_array_equal(part.estimate.matrix, found.estimate.matrix)
    assert (part.verdict, part.verdict_reason, part.field) == ("good", found.reason, FIELD)

    warmth = np.linspace(-5.0, 55.0, 50)
    field = FIELD * cases.directions(50, 4)
    log = jaxcal.Log(
        None, mag=TRUE.measure(field, warmth), gyro=np.zeros((50, 3)), temperature=np.where(np.arange(50) % 7, np.nan, warmth), rate=1.0
    )
    fixed = again.correct(log)
    np.testing.assert_allclose(fixed.mag, found.model.correct(log.mag, warmth), rtol=0, atol=1e-12 * FIELD)
    np.testing.assert_array_equal(fixed.gyro, log.gyro)
    assert fixed.findings[-1].subject == ("mag",)
    # with twelve parameters from 200 readings of 0.2 uT each, the field has an error of about 0.05 uT
    assert cases.rms(fixed.mag - field) < 0.1e-6
    without = dataclasses.replace(found.model, per_kelvin=np.zeros(3))
    assert cases.rms(jaxcal.Calibration(magnetometer=without).correct(log).mag - field) > 3 * cases.rms(fixed.mag - field)
    with pytest.raises(DataError, match="no temperature"):
        again.correct(jaxcal.Log(None, mag=log.mag, rate=10.0))


def test_a_model_object_without_more_fields_is_the_symmetric_fit():
    m = drawn(0)
    one, other = fit(m, model=MagModel(np.eye(3), np.zeros(3)), field=FIELD), fit(m, model="symmetric", field=FIELD)
    np.testing.assert_allclose(one.model.soft_iron, other.model.soft_iron, atol=1e-7)
    np.testing.assert_allclose(one.model.hard_iron, other.model.hard_iron, atol=1e-7 * FIELD)
    np.testing.assert_allclose(one.heading_error, other.heading_error, rtol=1e-4)
    np.testing.assert_allclose(one.estimate.select("hard_iron*").error, other.estimate.select("hard_iron*").error, rtol=1e-4)


def test_its_heading_uncertainty_is_that_of_all_its_parameters(found):
    headings = np.arange(24) * np.pi / 12
    for tilt, error in zip((0.0, np.deg2rad(20.0)), found.heading_error, strict=True):
        assert cases.rms(heading_uncertainty(found, headings, tilt=tilt)) == pytest.approx(error, rel=1e-6)
    assert len(jaxcal.plot.heading_error(found).lines) == 2
    plain, other = fit(drawn(0), model=MagModel(np.eye(3), np.zeros(3)), field=FIELD), fit(drawn(0), model="symmetric", field=FIELD)
    np.testing.assert_allclose(heading_uncertainty(plain, headings), heading_uncertainty(other, headings), rtol=1e-3)


def test_what_the_readings_leave_open_is_named():
    constant = fit(drawn(0), model=BEGIN, field=FIELD, conditions={"temperature": np.full(COUNT, 40.0)})
    assert constant.verdict == "refused"
    assert "per_kelvin" in next(one for one in constant.findings if one.code == "undetermined").facts["what"]


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"conditions": {"temperature": WARMTH[:5]}}, "condition_shape"),
        ({"conditions": {"temperature": WARMTH}, "method": "consistent"}, "no_such_model"),
        ({"conditions": {"temperature": WARMTH[:5]}, "model": "symmetric"}, "condition_shape"),
        ({"conditions": {"temperature": np.full(COUNT, np.nan)}}, "condition_not_finite"),
    ],
)
def test_bad_input_is_an_error_that_says_so(options, code, refuses):
    with refuses(code):
        fit(drawn(0), **{"model": BEGIN, "field": FIELD, **options})


@pytest.mark.parametrize("option", ["aid", "currents", "field_error"])
def test_an_own_model_takes_all_options(option):
    """The term of the model is that of the magnitudes, and iron, rotation and currents are those of the fit of both."""
    turned = Warming(np.array([[1.10, 0.08, -0.04], [0.04, 0.92, 0.05], [-0.04, 0.05, 1.0]]), TRUE.hard_iron, TRUE.per_kelvin)
    sensor = turned if option == "aid" else TRUE
    attitudes = jaxcal.magnetometer.scenario("all", samples=COUNT, seed=3)
    m = sensor.measure(jaxcal.magnetometer.body_field(attitudes, FIELD, cases.DIP), WARMTH)
    m = m + 0.1e-6 * np.random.default_rng(3).normal(size=m.shape)
    current, up = np.linspace(0.0, 5.0, COUNT) % 1.7, -9.81 * jaxcal.magnetometer.body_field(attitudes, 1.0, np.pi / 2)
    k = np.array([1e-6, -2e-6, 0.5e-6])
    options = {"aid": jaxcal.magnetometer.Accelerometer(up), "currents": {"motor": current}, "field_error": 0.01}
    m = m + current[:, None] * k if option == "currents" else m
    found = fit(m, model=BEGIN, field=FIELD, conditions={"temperature": WARMTH}, inclination=cases.DIP, **{option: options[option]})
    assert found.verdict == "good"
    assert isinstance(found.model, Warming)
    error = dict(zip(found.estimate.names, found.estimate.error, strict=True))
    truth = {f"per_kelvin[{i}]": x for i, x in enumerate(TRUE.per_kelvin)} | {f"hard_iron[{i}]": x for i, x in enumerate(TRUE.hard_iron)}
    truth |= {f"currents.motor[{i}]": x for i, x in enumerate(k)} if option == "currents" else {}
    assert all(abs(found.estimate[name].value - x) < 4 * error[name] for name, x in truth.items())
    size = np.cbrt(np.linalg.det(sensor.soft_iron)) if option == "field_error" else 1.0
    np.testing.assert_allclose(found.model.soft_iron / size, np.asarray(sensor.soft_iron) / size, atol=0.02)


def test_a_model_that_takes_any_condition_gets_those_that_the_log_has():
    class Any(MagModel):
        def measure(self, h, **conditions):
            return super().measure(h)

        def correct(self, m, **conditions):
            assert "temperature" not in conditions
            return super().correct(m)

    log = jaxcal.Log(None, mag=drawn(0), rate=10.0)
    plain = MagModel(TRUE.soft_iron, TRUE.hard_iron)
    one = jaxcal.Calibration(magnetometer=fit(drawn(0), model=plain, field=FIELD))
    part = dataclasses.replace(one.magnetometer, model=Any(plain.soft_iron, plain.hard_iron))
    fixed = jaxcal.Calibration(magnetometer=part).correct(log)
    np.testing.assert_allclose(fixed.mag, plain.correct(log.mag))
