"""`plot.allan`: curves, labels, positions and units of the figure; and `plot.save`."""

import os
import subprocess
import sys

import matplotlib
import matplotlib.colors
import numpy as np
import pytest
from matplotlib.figure import Figure

from jaxcal import ExportError
from jaxcal.allan import Deviation
from jaxcal.noise import Noise
from jaxcal.plot import TERM_COLORS, allan, save
from jaxcal.plot._style import duration_label, interval_labels, number_label, unit_label

from ..made_fit import made_deviation, made_fit, made_results

DEG_PER_H = np.pi / 180 / 3600


def lines(ax, color, style=None):
    return [line for line in ax.lines if line.get_color() == color and style in (None, line.get_linestyle())]


def key(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_points_are_the_deviation_in_the_unit_of_the_axis():
    fit = made_fit()
    ax = allan({"gyro_x": fit})
    assert ax.get_ylabel() == "Allan deviation (°/h)"
    assert ax.get_xlabel() == "Cluster time τ (s)"
    hollow, filled = ax.lines[0], ax.lines[1]
    np.testing.assert_allclose(filled.get_xdata(), fit.deviation.tau[fit.used])
    np.testing.assert_allclose(filled.get_ydata(), fit.deviation.deviation[fit.used] / DEG_PER_H, rtol=1e-12)
    np.testing.assert_allclose(hollow.get_xdata(), fit.deviation.tau[~fit.used])
    assert hollow.get_markerfacecolor() == "none"


def test_terms_follow_their_closed_forms():
    noise = Noise(Q=1e-6, N=1e-4, B=1e-5, K=1e-6)
    names = ("Q", "N", "B", "K")
    fit = made_fit(noise=noise, presence=dict.fromkeys(names, "present"), interval={t: (0.0, 2.0 * getattr(noise, t)) for t in names})
    ax = allan({"gyro_x": fit})
    for term, form in {
        "N": lambda t: 1e-4 / np.sqrt(t),
        "B": lambda t: 1e-5 * np.sqrt(2 * np.log(2) / np.pi) + 0 * t,
        "K": lambda t: 1e-6 * np.sqrt(t / 3),
        "Q": lambda t: np.sqrt(3) * 1e-6 / t,
    }.items():
        (line,) = lines(ax, TERM_COLORS[term], "--")
        tau = np.asarray(line.get_xdata())
        long = tau > 100 / 200.0  # at the shortest cluster times the sampled forms differ
        np.testing.assert_allclose(np.asarray(line.get_ydata())[long], form(tau[long]) / DEG_PER_H, rtol=1e-3)


def test_what_was_not_detected_is_a_dotted_upper_limit():
    fit = made_fit()
    ax = allan({"gyro_x": fit})
    (line,) = lines(ax, TERM_COLORS["K"], ":")
    tau = np.asarray(line.get_xdata())
    np.testing.assert_allclose(np.asarray(line.get_ydata())[-1], 2e-6 * np.sqrt(tau[-1] / 3) / DEG_PER_H, rtol=1e-3)
    assert "K < 0.41 °/h/√s" in key(ax)
    assert "N = 0.34 °/√h" in key(ax)
    assert "B ≈ 0.69 °/h" in key(ax)  # the symbol marks a hint


def test_model_is_full_in_the_band_alone_and_the_rest_is_shaded():
    fit = made_fit()
    ax = allan({"accel_z": fit})
    assert ax.get_ylabel() == "Allan deviation (mg)"
    full = next(line for line in ax.lines if line.get_label() == "fitted model")
    drawn = np.asarray(full.get_xdata())[np.isfinite(np.asarray(full.get_ydata(), dtype=float))]
    assert drawn[0] >= fit.band[0] * (1 - 1e-6)
    assert drawn[-1] <= fit.band[1] * (1 + 1e-6)
    assert len(ax.patches) == 2
    assert "left out of the fit" in key(ax)
    whole = made_fit(used=np.ones_like(fit.used), band=(fit.deviation.tau[0], fit.deviation.tau[-1]))
    assert len(allan({"accel_z": whole}).patches) == 0
    assert "left out of the fit" not in key(allan({"accel_z": whole}))


def test_axes_of_one_sensor_share_a_panel_in_colours_of_their_own():
    ax = allan({f"gyro_{axis}": made_fit(1.0 + i) for i, axis in enumerate("xyz")})
    assert ax.get_legend().get_title().get_text() == "Gyroscope"
    assert len(set(key(ax)) & {"x", "y", "z"}) == 3
    filled = [line for line in ax.lines if line.get_marker() == "o" and line.get_markerfacecolor() != "none"]
    assert len({line.get_color() for line in filled}) == 3


def test_several_sensors_get_a_panel_each():
    axes = allan(made_results())
    assert [ax.get_ylabel() for ax in axes] == ["Allan deviation (°/h)", "Allan deviation (mg)"]
    assert axes[0].figure is axes[1].figure


def test_given_axes_are_drawn_on(refuses):
    figure = Figure()
    given = figure.subplots(1, 2)
    axes = allan(made_results(), ax=given)
    assert list(axes) == list(given)
    single = Figure().subplots()
    assert allan(made_fit(), ax=single) is single
    with refuses("axes"):
        allan(made_results(), ax=single)


@pytest.mark.parametrize("own", [True, False])
def test_nothing_overlaps_and_nothing_leaves_the_figure(own):
    axes = np.ravel(allan(made_results(), ax=None if own else Figure(figsize=(10, 5), layout="constrained").subplots(1, 2)))
    figure = axes[0].figure
    figure.draw_without_rendering()
    whole = figure.bbox
    for ax in axes:
        box = ax.get_legend().get_window_extent()
        labels = [label.get_window_extent() for label in (*ax.get_xticklabels(), *ax.get_yticklabels()) if label.get_text()]
        assert box.x0 >= whole.x0 - 1
        assert box.x1 <= whole.x1 + 1
        assert box.y1 <= whole.y1 + 1
        if own:
            assert box.y0 >= ax.get_window_extent().y1 - 1  # the label is above the axes
        visible = [b for b in labels if ax.get_window_extent().padded(20).overlaps(b)]
        assert not any(a.overlaps(b) for i, a in enumerate(visible) for b in visible[:i])


def test_results_without_a_known_sensor():
    ax = allan(made_fit())
    assert ax.get_ylabel() == "Allan deviation (unit of the record)"
    assert "N = 1.0\u00d710⁻⁴" in key(ax)
    ax = allan({"a $x$": made_fit(), "_hidden": made_fit(2.0)})
    save_to_nowhere(ax)
    assert r"a \$x\$" in key(ax)
    assert " _hidden" in key(ax)


def save_to_nowhere(ax):
    ax.figure.draw_without_rendering()


def test_deviation_of_several_channels():
    one = made_deviation(Noise(N=1e-4))
    pair = {n: np.stack([getattr(one, n)] * 2, axis=1) for n in ("deviation", "lower", "upper", "edf", "count", "alpha", "skipped")}
    both = Deviation(tau=one.tau, m=one.m, kind="mdev", rate=one.rate, confidence=one.confidence, **pair)
    ax = allan(both)
    assert {"0", "1"} <= set(key(ax))
    assert ax.get_ylabel() == "Modified Allan deviation (unit of the record)"


def test_every_cluster_size_of_a_long_record_is_thinned():
    noise = Noise(N=1e-4)
    m = np.arange(1, 20_001)
    value = 1e-4 / np.sqrt(m / 100.0)
    dense = made_deviation(noise, tau=m / 100.0, m=m, deviation=value, lower=value, upper=value)
    ax = allan(dense)
    drawn = np.asarray(ax.lines[1].get_xdata())
    assert len(drawn) < 1000
    assert (drawn[0], drawn[-1]) == (0.01, 200.0)
    assert np.max(np.diff(np.log(drawn[40:]))) < 0.1


def test_zero_and_unknown_deviations_are_left_out(refuses):
    one = made_deviation(Noise(N=1e-4))
    value = one.deviation.copy()
    value[3], value[7] = 0.0, np.nan
    ax = allan(made_deviation(Noise(N=1e-4), deviation=value))
    assert len(ax.lines[1].get_xdata()) == len(value) - 2
    constant = made_deviation(Noise(N=1e-4), deviation=0.0 * value)
    for code, wrong in (("nothing", constant), ("nothing", {}), ("not_a_result", {"x": np.ones(3)})):
        with refuses(code):
            allan(wrong)


def test_no_global_setting_is_touched():
    before = dict(matplotlib.rcParams)
    save_to_nowhere(allan(made_fit()))
    assert dict(matplotlib.rcParams) == before
    script = (
        "import sys, jaxcal; assert 'matplotlib' not in sys.modules\n"
        "import numpy as np; d = jaxcal.allan.deviation(np.arange(50.0) % 7, 1.0)\n"
        "jaxcal.plot.allan(d); assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, env=os.environ | {"JAX_PLATFORMS": "cpu"})


@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_save(tmp_path, ending):
    path = tmp_path / f"allan.{ending}"
    save(allan(made_results()), path)
    start = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}[ending]
    assert path.read_bytes().startswith(start)
    save(allan(made_fit()).figure, path)
    assert os.listdir(tmp_path) == [path.name]


def test_save_refuses_other_endings(tmp_path, refuses):
    for name in ("a.docx", "a"):
        with refuses("ending", ExportError):
            save(allan(made_fit()), tmp_path / name)
    assert os.listdir(tmp_path) == []


def test_labels():
    assert unit_label("deg/h/sqrt(s)") == "°/h/√s"
    assert number_label(123456.0) == "1.23\u00d710⁵"
    assert number_label(9.999, 3) == "10.0"
    assert number_label(float("nan")) == "\u2013"
    assert interval_labels(1.8e-6, 1.2e-6, 2.4e-6) == ("1.8\u00d710⁻⁶", "1.2\u00d710⁻⁶", "2.4\u00d710⁻⁶")
    assert interval_labels(0.0, 0.0, 0.0) == ("0", "0", "0")
    assert interval_labels(7.56, 0.0, float("inf")) == ("7.56", "0", "∞")
    assert duration_label(4.2e7) == "486 days"
