"""User-defined noise terms are fitted with correct intervals, simulated, reported and saved like the built-in terms."""

import json
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcal
from jaxcal.noise import Noise, Term


class PowerLaw(Term):
    """A term whose density falls as a power of the frequency, with exponents between flicker (1) and random walk (2)."""

    exponent: float
    name: ClassVar[str] = "P"

    def psd(self, f, dt=None):
        omega = 2 * np.pi * f if dt is None else 2 / dt * jnp.sin(jnp.pi * f * dt)
        return omega**-self.exponent


class Resonance(Term):
    """Second-order Gauss-Markov process: white noise that excites a damped oscillator of natural frequency `frequency` (Hz)."""

    frequency: float
    damping: float
    name: str = "second order"

    def psd(self, f, dt=None):
        ratio = (f / self.frequency) ** 2
        return 1.0 / ((1.0 - ratio) ** 2 + 4.0 * self.damping**2 * ratio)


LAW, STRENGTH, SAMPLES = PowerLaw(1.5), 0.1, 1 << 12


def power_law(n, exponent, random):
    """Simulate fractionally integrated white noise at dt = 1 (N. J. Kasdin, Proc. IEEE 83, 1995) that started long before."""
    long = 8 * n
    lag = np.arange(1, long)
    response = np.cumprod(np.append(1.0, (lag - 1 + exponent / 2) / lag))
    drawn = random.standard_normal(long)
    return np.fft.irfft(np.fft.rfft(response, 2 * long) * np.fft.rfft(drawn, 2 * long), 2 * long)[:long][-n:]


def records(count):
    random = np.random.default_rng(1)
    return [random.standard_normal(SAMPLES) + STRENGTH * power_law(SAMPLES, LAW.exponent, random) for _ in range(count)]


def numeric(name, **shape):
    """Copy a built-in term to a user-defined one with only its density, so that all else is integrated numerically."""
    inner = Noise(**{name: 1.0}).part(name)[2] if name != "markov" else jaxcal.noise.GaussMarkov(**shape)

    class Own(Term):
        name: ClassVar[str] = "own"

        def psd(self, f, dt=None):
            return inner.psd(f, dt)

    return Own(), inner


@pytest.fixture(scope="module")
def two():
    return [jaxcal.noise.fit(y, 1.0, terms=("N", LAW)) for y in records(2)]


@pytest.mark.long
def test_intervals_hold_the_truth():
    """The 95 % intervals of both coefficients contain the truth in 93 to 97 % of 200 records."""
    fits = [jaxcal.noise.fit(y, 1.0, terms=("N", LAW)) for y in records(200)]
    truth = {"N": 1.0, "P": STRENGTH}
    held = {name: np.mean([fit.interval[name][0] <= value <= fit.interval[name][1] for fit in fits]) for name, value in truth.items()}
    assert 0.93 <= np.mean(list(held.values())) <= 0.97, held
    # the coverage of each coefficient is within three standard errors for 200 records
    assert all(abs(share - 0.95) < 3 * np.sqrt(0.95 * 0.05 / len(fits)) for share in held.values()), held
    for name, value in truth.items():
        found = np.array([float(fit.noise.coefficient(name)) for fit in fits])
        assert abs(found.mean() - value) < 4 * found.std() / np.sqrt(len(fits))
    assert np.mean([fit.presence["P"] == "present" for fit in fits]) > 0.9
    assert np.mean([bool(fit.warnings) for fit in fits]) < 0.1


def test_everything_that_a_letter_has(two):
    fit = two[0]
    assert fit.terms == ("N", "P")
    for table in (fit.interval, fit.upper_limit, fit.presence, fit.significance, fit.longer_record):
        assert list(table) == ["N", "P"]
    assert fit.covariance.names == ("N", "P")
    assert fit.significance["P"] > 5.41
    assert "P  " in fit.summary()
    assert fit.noise.further == ((fit.noise.coefficient("P"), LAW),)


def test_methods_on_the_allan_variance_need_closed_forms(refuses):
    with refuses("no_closed_form"):
        jaxcal.noise.fit(records(1)[0], 1.0, terms=(LAW, "N"), method="gls")


def test_derivative_of_a_traced_fit():
    y = records(1)[0]

    def strength(scale):
        return jaxcal.noise.fit(jnp.asarray(y) * scale, 1.0, terms=("N", LAW)).noise.coefficient("P")

    value, slope = jax.jit(jax.value_and_grad(strength))(1.0)
    np.testing.assert_allclose(slope, value, rtol=1e-5)  # the coefficient is proportional to the record


def test_kept_in_a_calibration(two, tmp_path):
    jaxcal.Calibration(noise={"gyro_x": two[0], "gyro_z": two[1]}).save(tmp_path / "device.json")
    held = jaxcal.Calibration.load(tmp_path / "device.json").noise.gyro
    (further,) = held.further
    assert further.term == LAW
    np.testing.assert_allclose(further.coefficient, [two[0].noise.coefficient("P"), np.nan, two[1].noise.coefficient("P")])
    np.testing.assert_allclose(held.upper_limit["P"][0], two[0].upper_limit["P"])
    assert held.verdict["P"] == ("present", None, "present")
    assert held.covariance.parameters == ("N^2", "P^2")


def test_saved_reported_and_drawn(two, tmp_path):
    fit = two[0]
    fit.save(tmp_path / "fit.json")
    saved = json.loads((tmp_path / "fit.json").read_text())
    assert saved["interval"]["P"] == pytest.approx(fit.interval["P"])
    channels = {"gyro_x": fit, "gyro_y": two[1]}
    document = jaxcal.noise.NoiseFits(channels).to_dict()
    assert document["channels"]["gyro_x"]["coefficients"]["P"] == pytest.approx(fit.noise.coefficient("P"))
    assert document["channels"]["gyro_x"]["noise"]["further"] == [[pytest.approx(fit.noise.coefficient("P")), {"exponent": 1.5}]]
    labels = [line.get_label() for line in jaxcal.plot.allan({"gyro_x": fit}).get_lines()]
    assert any(label.startswith("P = ") for label in labels), labels
    lines = jaxcal.plot.spectrum(jaxcal.spectrum.density(records(1)[0], 1.0, method="dct"), noise=fit).get_lines()
    line = next(line for line in lines if line.get_label().startswith("P = "))
    f, density = line.get_data()
    np.testing.assert_allclose(density, fit.noise.coefficient("P") ** 2 * np.asarray(LAW.psd(f, 1.0)), rtol=1e-9)
    jaxcal.plot.allan(channels)
    jaxcal.report.write(channels, tmp_path / "report.html")
    assert "a term of your own" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(("name", "shape"), [("Q", {}), ("N", {}), ("B", {}), ("K", {}), ("markov", {"time": 3.0})])
def test_what_follows_from_a_density_equals_the_closed_forms(name, shape):
    own, inner = numeric(name, **shape)
    m = np.array([1.0, 2.0, 7.0, 100.0, 1e5])
    np.testing.assert_allclose(own.avar(m * 0.1, 0.1), inner.avar(m * 0.1, 0.1), rtol=1e-8)
    if name != "Q":
        np.testing.assert_allclose(own.avar(m), inner.avar(m), rtol=1e-4)
    for n in (100, 5000):
        k = np.arange(1, n)
        np.testing.assert_allclose(own.ordinates(k, n, 0.1), inner.ordinates(k, n, 0.1), rtol=1e-3 if name == "Q" else 2e-5)


def test_a_resonance():
    """Simulated samples of an oscillator have the Allan variance of the model, and a fit finds the coefficient."""
    term = Resonance(frequency=0.05, damping=0.1)
    noise = Noise(N=0.5, further=((1.0, term),))
    m = np.array([1, 4, 10, 30, 200])
    y = np.stack([noise.simulate(SAMPLES, 1.0, seed=seed) for seed in range(100)], axis=1)
    variance = jaxcal.allan.deviation(y, 1.0, m=m, alpha=0).deviation ** 2
    z = (variance.mean(axis=1) - noise.avar(m, dt=1.0)) / (variance.std(axis=1) / 10.0)
    assert np.all(np.abs(z) < 4.5), z
    found = jaxcal.noise.fit(y[:, 0], 1.0, terms=("N", term))
    low, high = found.interval["second order"]
    assert low < 1.0 < high
    assert found.presence["second order"] == "present"


def test_state_space_of_a_term():
    model = jaxcal.noise.discrete(Noise(N=1.0, further=((STRENGTH, LAW),)), rate=1.0, band=(1e-3, 0.5))
    assert model.psd_error < 0.1
    assert model.names[0] == "P 1"
    f = np.geomspace(1e-3, 0.5, 50)
    np.testing.assert_allclose(model.noise.psd(f, dt=1.0), 1.0 + STRENGTH**2 * np.asarray(LAW.psd(f, 1.0)), rtol=1.01 * model.psd_error)


@pytest.mark.parametrize(
    ("terms", "words"),
    [
        (("N", LAW, PowerLaw(2.0)), "distinct names"),
        (("N", PowerLaw(np.array([1.0, 2.0]))), "must be numbers"),
        (("N", PowerLaw(0.0)), "N and P have densities of the same shape"),
    ],
)
def test_messages(terms, words):
    with pytest.raises(jaxcal.DataError, match=words):
        jaxcal.noise.fit(np.zeros(SAMPLES), 1.0, terms=terms)


def test_a_method_that_reads_slopes_has_none_for_it():
    with pytest.raises(jaxcal.DataError, match="for P"):
        jaxcal.noise.fit(records(1)[0], 1.0, terms=("N", LAW), method="slope")
