"""Composed calibrations, and the field of a place."""

import datetime
import sys

import numpy as np
import pytest

from jaxcal import DataError
from jaxcal.magnetometer import MagModel, body_field, earth_field, fit, scenario

from . import cases


def test_a_log_that_was_corrected_by_a_wrong_model_is_fitted_again():
    raw = cases.readings(cases.MILD, cases.directions(300, 0), 0.005, 0)
    wrong = MagModel(np.diag([1.05, 1.0, 0.97]), np.array([0.5, 0.0, 0.1]))
    again = fit(wrong.correct(raw), model="symmetric", field=1.0).model
    np.testing.assert_allclose(wrong.measure(again.hard_iron), cases.MILD.hard_iron, atol=2e-3)
    assert np.linalg.norm(again.correct(wrong.correct(raw)), axis=1).std() < 0.006
    np.testing.assert_allclose(wrong.measure(wrong.correct(raw)), raw, atol=1e-14)


def test_the_field_of_a_place():
    """NOAA's test values of the World Magnetic Model 2025 at 80 N, 0 E, 0 km, 2025.0."""
    pytest.importorskip("pygeomag")
    field = earth_field(80.0, 0.0, 2025.0)
    np.testing.assert_allclose(1e9 * field, [6521.6, 145.9, 54791.5], atol=0.06)
    assert np.linalg.norm(earth_field(80.0, 0.0, datetime.date(2025, 1, 1)) - field) == 0.0
    ankara = earth_field(39.93, 32.86, 2026.5, altitude=900.0)
    found = fit(1e-6 * body_field(scenario("all"), 47.0), field=ankara)
    assert found.field == pytest.approx(np.linalg.norm(ankara))
    assert np.rad2deg(found.inclination) == pytest.approx(59, abs=2)
    for place, words in (((95, 0, 2026), "degrees of latitude"), ((0, 0, 1999), "hold from 2010"), ((0, 0, "today"), "datetime.date")):
        with pytest.raises(DataError, match=words):
            earth_field(*place)


def test_without_the_package_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygeomag", None)
    with pytest.raises(DataError, match=r"jaxcal\[geomag\]"):
        earth_field(0, 0, 2026)
