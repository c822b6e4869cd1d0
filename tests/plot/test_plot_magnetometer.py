"""Figures of a magnetometer calibration show the values of its result."""

import numpy as np
import pytest

import jaxcal
from jaxcal.magnetometer import body_field, coverage, fit, heading_uncertainty, scenario

M = body_field(scenario("all"), 50e-6) + np.array([2e-5, -1e-5, 0]) + 2e-7 * np.random.default_rng(0).normal(size=(360, 3))


@pytest.fixture(scope="module")
def found():
    return fit(M, model="symmetric")


def test_sphere_shows_both(found, refuses):
    axes = jaxcal.plot.sphere(M, found)
    before, after, circle = axes[0].lines
    np.testing.assert_allclose(before.get_xydata(), 1e6 * M[:, :2])
    np.testing.assert_allclose(after.get_xydata(), 1e6 * found.model.correct(M)[:, :2])
    assert np.hypot(*circle.get_xydata()[0]) == pytest.approx(1e6 * found.field)
    assert axes[0].get_xlabel() == "x (uT)"
    assert axes[3].name == "3d"
    with refuses("shape"):
        jaxcal.plot.sphere(M[0], found)


def test_coverage_map_puts_regions_where_they_are(found):
    ax = jaxcal.plot.coverage(found)
    corners = [path.vertices[:-1] for path in ax.collections[0].get_paths()]  # without the last corner, which repeats the first
    assert len(corners) == 100
    # the centre of every region lies in its cell, and all cells have the same area
    pole = coverage(np.array([[0.0, 0.0, 1.0]] * 5))  # with readings only at the pole, all other regions are missing
    for cell, middle in zip(corners[1:-1], pole.missing[:-1], strict=True):
        longitude = np.rad2deg(np.arctan2(middle[1], middle[0]))
        assert cell[:, 0].min() - 1e-6 <= longitude <= cell[:, 0].max() + 1e-6
        assert cell[:, 1].min() <= middle[2] <= cell[:, 1].max()
    areas = [np.ptp(cell[:, 0]) * np.ptp(cell[:, 1]) for cell in corners]
    np.testing.assert_allclose(areas, 360 * 2 / 100, rtol=2e-3)
    assert ax.collections[0].get_array().sum() == 360
    assert len(ax.lines[0].get_xdata()) == 3


def test_heading_error(found):
    level, tilted = jaxcal.plot.heading_error(found).lines
    # the rms over the headings is the heading error that the fit states
    assert np.sqrt(np.mean(level.get_ydata()[:-1] ** 2)) == pytest.approx(np.rad2deg(found.heading_error[0]), rel=1e-6)
    assert np.sqrt(np.mean(tilted.get_ydata()[:-1] ** 2)) == pytest.approx(np.rad2deg(found.heading_error[1]), rel=1e-6)


def test_in_a_plane():
    turn = body_field(np.stack([np.linspace(0, 6, 100), np.zeros(100), np.zeros(100)], axis=1), 50e-6)
    planar = fit(turn + 2e-7 * np.random.default_rng(0).normal(size=(100, 3)), model="planar")
    spread = heading_uncertainty(planar, np.linspace(0, 2 * np.pi, 24, endpoint=False))
    assert np.sqrt(np.mean(spread**2)) == pytest.approx(planar.heading_error[0], rel=0.01)


def test_what_cannot_be_drawn(refuses):
    for code, wrong in (("not_a_result", 3), ("nothing", fit(M[:2]))):
        for draw in (jaxcal.plot.coverage, jaxcal.plot.heading_error):
            with refuses(code):
                draw(wrong)
    with refuses("no_model"):
        heading_uncertainty(fit(M[:2]), 0.0)
