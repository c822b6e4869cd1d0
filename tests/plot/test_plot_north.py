"""Figures of north finding show the turntable readings and the azimuth."""

import numpy as np
import pytest

import jaxcal
from jaxcal.alignment import Positions, Readings, Sensor, fit, simulate

DEG = np.pi / 180


@pytest.fixture(scope="module")
def fitted():
    places = Positions(np.array([0, 90, 180, 270, 0, 0]) * DEG, ["x"] * 4 + ["z", "-z"], dwell=40.0)
    noise = {"accel": Sensor(white=5e-4), "gyro": Sensor(white=3e-6)}
    readings = simulate(places, np.array([2.0, -1.0, 40.0]) * DEG, 35 * DEG, **noise)
    return readings, fit(readings, 35 * DEG)


def test_points_curve_and_density(fitted):
    readings, found = fitted
    axes = jaxcal.plot.north(readings, found)
    assert len(axes) == 3
    line = axes[1].lines[0]
    amplitude = (np.max(line.get_ydata()) - np.min(line.get_ydata())) / 2
    # the horizontal Earth's rate at 35 degrees is 12.3 deg/h; the small tilt changes it by less than 0.4
    assert amplitude == pytest.approx(15.041 * np.cos(35 * DEG), abs=0.4)
    x, density = axes[2].lines[0].get_data()
    assert np.trapezoid(density, x) == pytest.approx(1, abs=1e-3)
    assert x[np.argmax(density)] == pytest.approx(found.psi / DEG)
    assert [text.get_text() for text in axes[0].get_legend().get_texts()][1:] == [f"reading {word}, 95 %" for word in ("x", "z", "-z")]


def test_without_an_azimuth_the_panel_says_so(fitted):
    readings, _ = fitted
    flat = Readings(readings.positions, accel=readings.accel, accel_noise=5e-4)
    axes = jaxcal.plot.north(flat, fit(flat, np.pi / 2, free=("phi", "theta", "b_a")))
    assert len(axes) == 2
    assert "no azimuth" in axes[1].texts[0].get_text()


def test_wrong_things(fitted, refuses):
    with refuses("not_a_result"):
        jaxcal.plot.north(*fitted[::-1])
    with refuses("axes"):
        jaxcal.plot.north(*fitted, ax=jaxcal.plot.north(*fitted)[:2])
