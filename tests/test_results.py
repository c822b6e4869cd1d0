"""Common properties of all results: verdict, reason, warnings, summary, dictionary, file."""

import dataclasses
import json
import math
import re
import sys

import jax
import numpy as np
import pytest

import jaxcal
from jaxcal import ExportError
from jaxcal.magnetometer import body_field, scenario
from jaxcal.noise._findings import FINDINGS

from .made_fit import made_deviation, made_fit

WORDS = ("good", "weak", "refused")


def test_a_magnetometer_fit_as_text_and_as_a_file(tmp_path, refuses):
    field = body_field(scenario("all"), 50e-6)
    found = jaxcal.magnetometer.fit(field + 1e-7 * np.random.default_rng(0).standard_normal(field.shape), field=50e-6)
    lines = found.summary().splitlines()
    assert lines[0] == f"MagFit: {found.verdict}: {found.headline}"
    line = next(line for line in lines if line.startswith("hard iron"))
    value, half = (1e-6 * float(word) for word in re.findall(r"-?\d+\.\d+", line)[2:4])
    error = found.estimate.error[1]
    assert value == pytest.approx(found.model.hard_iron[1], abs=0.1 * error)
    assert half == pytest.approx(1.96 * error, rel=0.06)
    found.save(tmp_path / "mag.json")
    document = json.loads((tmp_path / "mag.json").read_text())
    assert document["verdict"] in WORDS
    assert (document["schema"], document["version"]) == ("jaxcal.MagFit/1", jaxcal.__version__)
    np.testing.assert_array_equal(document["model"]["soft_iron"], found.model.soft_iron)
    np.testing.assert_array_equal(document["estimate"]["covariance"], found.estimate.matrix)
    assert document["numbers"]["hard_iron[1]"]["value"] == found.model.hard_iron[1]
    assert document["numbers"]["coverage.occupied"]["value"] == 100 * found.coverage.occupied
    with refuses("not_written", ExportError):
        found.save(tmp_path / "nowhere" / "mag.json")


def test_a_noise_fit_lists_every_term():
    found = made_fit(findings=(FINDINGS("unsettled"),))
    assert (found.verdict, found.headline) == ("weak", "N to 10 %")
    text = found.summary()
    assert ["N", "white", "noise", "unit", "sqrt(s)", "1.00e-04", "±", "1.0e-05"] in [line.split() for line in text.splitlines()]
    assert "The fit did not converge." in text
    document = found.to_dict()
    assert document["longer_record"]["Q"] is None  # infinite
    assert document["interval"]["N"] == pytest.approx([0.9e-4, 1.1e-4])
    json.dumps(document, allow_nan=False)


def test_a_curve_shows_its_values_at_powers_of_ten_and_its_floor():
    curve = made_deviation(jaxcal.noise.Noise(N=1e-4))
    assert (curve.verdict, curve.findings) == ("good", ())
    (sigma,) = (one for name, one in curve.numbers.items() if name == "oadev(1 s)")
    assert sigma.value == pytest.approx(1e-4, rel=0.01)
    assert sigma.low < sigma.value < sigma.high
    assert curve.numbers["floor"].state == "limit"  # white noise falls to the end
    unknown = made_deviation(jaxcal.noise.Noise(N=1e-4), lower=np.full(38, math.nan), upper=np.full(38, math.nan))
    assert unknown.to_dict()["lower"] == [None] * 38
    assert "±" not in unknown.summary()
    assert "floor" not in unknown.numbers


def test_a_result_prints_values_intervals_and_units():
    found = made_fit(sensor="gyro")
    lines = repr(found).splitlines()
    assert lines[0].startswith("NoiseFit: good: N to 10 %")
    assert ["N", "angle", "random", "walk", "deg/sqrt(h)", "0.344", "±", "0.034"] in [line.split() for line in lines]  # 1e-4 rad/sqrt(s)
    html = found._repr_html_()
    assert "0.344 ± 0.034" in html
    assert "0.3094 to 0.3782" in html
    short = dataclasses.replace(found, findings=(FINDINGS("no_intervals", method="a < b"),))
    assert "Method a &lt; b gives" in short._repr_html_()
    log = jaxcal.Log(None, gyro=np.eye(3), rate=10.0)
    assert repr(log).startswith("Log: 3 samples at 10 Hz")
    assert log._repr_html_().startswith("<pre>Log: 3 samples")


def test_a_traced_result_prints_its_structure():
    def look(y):
        seen.append(repr(jaxcal.noise.fit(y, 1.0)))
        return y

    seen: list[str] = []
    jax.eval_shape(look, np.random.default_rng(0).standard_normal(64))
    assert seen[0].startswith("NoiseFit(")


@pytest.mark.parametrize("value", [made_fit(), jaxcal.Log(None, gyro=np.eye(3), rate=1.0)], ids=lambda value: type(value).__name__)
def test_results_and_logs_are_clearly_not_hashable(value):
    with pytest.raises(TypeError, match=f"unhashable type: '{type(value).__name__}'"):
        hash(value)


@pytest.mark.parametrize("library", ["polars", "pandas"])
def test_data_frames(monkeypatch, library):
    pytest.importorskip(library)
    if library == "pandas":
        monkeypatch.setitem(sys.modules, "polars", None)
    frame = made_fit().to_dataframe()
    assert type(frame).__module__.startswith(library)
    assert list(frame.columns) == ["name", "value", "low", "high", "unit", "state"]
    assert list(frame["name"])[:6] == ["Q", "N", "B", "K", "floor", "floor_at"]
    assert list(frame["high"])[1] == pytest.approx(1.1e-4)
    curve = jaxcal.allan.deviation(np.random.default_rng(0).standard_normal((200, 2)), 10.0, m=[1, 2, 5])
    frame = curve.to_dataframe()
    assert list(frame["channel"]) == ["0", "0", "0", "1", "1", "1"]
    np.testing.assert_allclose(np.asarray(frame["deviation"]).reshape(2, 3).T, curve.deviation)
    np.testing.assert_allclose(np.asarray(frame["tau"]), np.tile([0.1, 0.2, 0.5], 2))


def test_without_a_library_of_data_frames_a_sentence_says_so(monkeypatch, refuses):
    monkeypatch.setitem(sys.modules, "polars", None)
    monkeypatch.setitem(sys.modules, "pandas", None)
    with refuses("no_data_frame"):
        made_fit().to_dataframe()


def test_results_draw_themselves(refuses):
    found = made_fit()
    assert found.plot().get_xscale() == "log"
    m = body_field(scenario("all"), 50e-6)
    iron = jaxcal.magnetometer.fit(m, field=50e-6)
    assert len(iron.plot(m)) > 0
    pair = jaxcal.noise.correlation(np.random.default_rng(0).standard_normal((2000, 2)), 1.0, [jaxcal.noise.Noise(N=1.0)] * 2)
    for code, one, readings in (
        ("figure_needs_readings", found, [np.eye(3)]),
        ("figure_needs_readings", iron, []),
        ("no_figure", pair, []),
    ):
        with refuses(code):
            one.plot(*readings)
