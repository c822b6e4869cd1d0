"""`plot.spectrum`: curves, labels and units of the figure."""

import numpy as np
import pytest

from jaxcal.noise import Noise, Term
from jaxcal.plot import TERM_COLORS, spectrum
from jaxcal.spectrum import Spectrum, density

from ..made_fit import made_fit

DEG_PER_H = np.pi / 180 / 3600
MILLI_G = 9.80665e-3
RATE = 100.0


def found(n=20_000, seed=0, channels=None, **options):
    shape = n if channels is None else (n, channels)
    return density(1e-3 * np.random.default_rng(seed).standard_normal(shape), RATE, **options)


def line(ax, label):
    return next(line for line in ax.lines if line.get_label() == label)


def key(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def drawn(ax):
    """Draw the figure, which finds errors that occur only in the layout."""
    ax.figure.draw_without_rendering()
    return ax


def test_points_are_the_density_in_the_unit_of_the_axis():
    result = found()
    ax = drawn(spectrum({"gyro_x": result}))
    assert ax.get_ylabel() == "Two-sided power spectral density, (°/h)²/Hz"
    assert ax.get_xlabel() == "Frequency (Hz)"
    points = line(ax, "measured, 95 % interval")
    np.testing.assert_allclose(points.get_xdata(), result.frequency)
    np.testing.assert_allclose(points.get_ydata(), result.density / DEG_PER_H**2, rtol=1e-12)
    outline = ax.collections[0].get_paths()[0].vertices
    assert outline[:, 1].min() == pytest.approx(np.min(result.lower) / DEG_PER_H**2)
    assert outline[:, 1].max() == pytest.approx(np.max(result.upper) / DEG_PER_H**2)
    ax = spectrum({"accel_z": found(sided=1)})
    assert ax.get_ylabel() == "One-sided power spectral density, mg²/Hz"
    np.testing.assert_allclose(ax.lines[0].get_ydata(), 2 * result.density / MILLI_G**2, rtol=1e-2)
    assert spectrum(result).get_ylabel() == "Two-sided power spectral density, (unit of the record)²/Hz"


@pytest.mark.parametrize("sided", [1, 2])
def test_model_and_terms_follow_their_forms_for_samples(sided):
    noise = Noise(Q=1e-6, N=1e-4, B=1e-5, K=1e-6)
    ax = drawn(spectrum({"gyro_x": found(sided=sided)}, noise=noise))
    factor = (2.0 if sided == 1 else 1.0) / DEG_PER_H**2
    forms = {
        "Q": lambda s: 1e-12 * s**2 * RATE,
        "N": lambda s: 1e-8 + 0 * s,
        "B": lambda s: 1e-10 / (s * RATE),
        "K": lambda s: 1e-12 / (s * RATE) ** 2,
    }
    model = line(ax, "noise model")
    s = 2 * np.sin(np.pi * np.asarray(model.get_xdata()) / RATE)
    np.testing.assert_allclose(model.get_ydata(), factor * sum(form(s) for form in forms.values()), rtol=1e-9)
    for term, form in forms.items():
        (one,) = (line for line in ax.lines if line.get_color() == TERM_COLORS[term])
        assert one.get_linestyle() == "--"
        np.testing.assert_allclose(one.get_ydata(), factor * form(s), rtol=1e-9)
    assert "N = 0.344 °/√h" in key(ax)


def test_a_fit_brings_its_intervals_and_upper_limits():
    ax = drawn(spectrum({"gyro_x": found()}, noise={"gyro_x": made_fit()}))
    (limit,) = (line for line in ax.lines if line.get_color() == TERM_COLORS["K"])
    assert limit.get_linestyle() == ":"
    f = np.asarray(limit.get_xdata())
    np.testing.assert_allclose(limit.get_ydata(), (2e-6 / (2 * RATE * np.sin(np.pi * f / RATE)) / DEG_PER_H) ** 2, rtol=1e-9)
    assert {"fitted model", "N = 0.34 °/√h", "K < 0.41 °/h/√s"} <= set(key(ax))


def test_markov_terms_and_ramps():
    ax = drawn(spectrum(found(), noise=Noise(N=1e-4, R=1e-3, markov=((1e-3, 20.0),))))
    assert "Gauss-Markov, 20.0 s" in key(ax)
    assert not any(label.startswith("R") for label in key(ax))  # a ramp has no density


class Level(Term):
    name: str = "L"

    def psd(self, f, dt=None):
        return 0 * f + 1.0


def test_a_term_of_ones_own_on_one_of_two_channels():
    models = {"gyro_x": Noise(N=1e-4), "gyro_y": Noise(N=1e-4, further=((2e-4, Level()),))}
    ax = drawn(spectrum(dict.fromkeys(models, found()), noise=models))
    assert {"L = 2.00\u00d710⁻⁴ SI", "N = 0.344 °/√h"} <= set(key(ax))


def test_channels_of_one_spectrum_with_a_model_of_channels():
    result = found(channels=2)
    ax = drawn(spectrum(result, noise=Noise(N=[1e-4, 2e-4])))
    assert {"0", "1"} <= set(key(ax))
    curves = [line for line in ax.lines if line.get_marker() == "None" and len(line.get_xdata()) > 2]
    assert sorted(float(np.asarray(curve.get_ydata())[0]) for curve in curves) == pytest.approx([1e-8, 4e-8])


def test_a_raw_spectrum_is_thinned_to_its_extremes():
    """A spectral line keeps its height although the curve is thinned, which keeps the file small."""
    n = 200_000
    y = np.random.default_rng(0).standard_normal(n) + 0.5 * np.sin(2 * np.pi * 17.3 * np.arange(n) / RATE)
    result = density(y, RATE, average=None)
    ax = drawn(spectrum({"gyro_x": result}))
    f, values = (np.asarray(v) for v in line(ax, "measured, 95 % interval").get_data())
    assert len(f) <= 2002
    assert np.all(np.diff(f) > 0)
    assert f[np.argmax(values)] == pytest.approx(17.3)
    assert values.max() == pytest.approx(result.density.max() / DEG_PER_H**2)
    assert values.min() == pytest.approx(result.density.min() / DEG_PER_H**2)
    assert ax.get_ylim()[0] > values.min()  # the deepest minima are outside the axes
    assert (f[0], f[-1]) == (result.frequency[0], result.frequency[-1])


def made(frequency, values):
    one = np.ones_like(values)
    return Spectrum(
        frequency=frequency, density=values, lower=values / 2, upper=values * 2, count=one, edf=2 * one, method="dct", sided=2,
        average=None, rate=RATE, confidence=0.95,
    )  # fmt: skip


def test_zero_densities_are_left_out(refuses):
    f = np.arange(1.0, 6.0)
    ax = drawn(spectrum(made(f, np.array([1.0, 0.0, 2.0, np.nan, 1.0]))))
    assert ax.lines[0].get_xdata().tolist() == [1.0, 3.0, 5.0]
    drawn(spectrum(made(f[:1], np.ones(1))))
    for code, wrong, noise in (
        ("nothing", made(f, np.zeros(5)), None), ("nothing", {}, None), ("not_a_result", {"x": np.ones(3)}, None), ("noise", found(), 1e-4),
        ("channels", {"gyro_x": found()}, {"gyro_y": Noise(N=1.0)}),
    ):  # fmt: skip
        with refuses(code):
            spectrum(wrong, noise=noise)
