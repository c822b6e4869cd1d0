"""`plot.temperature`: curves, texts and units."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from jaxcal.plot import temperature
from jaxcal.temperature import fit, simulate


@pytest.fixture(scope="module")
def fits():
    made = simulate(profile="cycle", duration=4500.0, lag=60.0, walk=0.0, seed=1)
    found = fit(made.temperature, made.bias, time=made.time, lag=60.0, play=0.0, sensor="gyro")
    return {"gyro_x": found, "gyro_y": found, "accel_z": fit(made.temperature, made.bias, model="polynomial", degree=3, sensor="accel")}


def key(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_one_panel_for_each_sensor_in_its_unit(fits):
    axes = temperature(fits)
    assert [ax.get_ylabel() for ax in axes] == ["Change of bias (°/h)", "Change of bias (mg)"]
    axes[0].figure.draw_without_rendering()
    assert key(axes[0])[:2] == ["x", "y"]
    # 0.3 deg/s is 1080 deg/h
    assert key(axes[0])[2].startswith("smooth; 10")
    assert "°/h at 24.50 °C; lag 60.0 s" in key(axes[0])[2]
    assert key(axes[1]) == ["z", "polynomial 3"]
    curve = next(line for line in axes[0].lines if line.get_label().startswith("smooth"))
    t, y = curve.get_data()
    model = fits["gyro_x"].model
    expected = (model.curve.value(t) - model.curve.value((model.low + model.high) / 2)) / np.deg2rad(1 / 3600)
    np.testing.assert_allclose(y, expected, atol=1e-6)


def test_axes_of_the_user_and_single_fits(fits):
    ax = Figure().subplots()
    assert temperature(fits["gyro_x"], ax) is ax
    assert ax.get_ylabel() == "Change of bias (unit of the record)"


def test_what_cannot_be_drawn_is_refused(fits, refuses):
    for code, call in (("nothing", ({},)), ("not_a_result", ({"gyro_x": 1},)), ("axes", (fits, Figure().subplots()))):
        with refuses(code):
            temperature(*call)
