"""Compasses from an ordinary flight: the vertical of a filter that errs and drifts. `benchmarks/real_magnetometer.py` has more runs."""

import importlib.util
import pathlib

import numpy as np
import pytest

from jaxcal.magnetometer import Attitude, fit, heading_uncertainty

_PLACE = pathlib.Path(__file__).resolve().parents[2] / "benchmarks" / "_flight.py"
_SPEC = importlib.util.spec_from_file_location("flight", _PLACE)
flights = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(flights)
DIP, YAW = np.deg2rad(63.0), np.arange(24) * np.pi / 12


@pytest.mark.parametrize("runs", [25, pytest.param(100, marks=pytest.mark.long)])
def test_headings_are_within_a_degree_and_their_error_is_true(runs):
    actual, stated = [], []
    for seed in range(runs):
        flight = flights.flown(seed)
        found = fit(flight.readings[0], aid=Attitude(flight.attitude.as_quat(scalar_first=True)), inclination=DIP)
        assert found.verdict == "good"
        actual.append(flights.heading_errors(found.model, flight.irons[0]))
        tilts = np.deg2rad(flights.TILTS)
        stated.append([np.sqrt(np.mean(heading_uncertainty(found, YAW, tilt=tilt) ** 2)) for tilt in tilts])
    assert np.rad2deg(np.max(actual)) < 1.5
    assert np.rad2deg(np.max(actual, axis=0)[0]) < 1.0
    ratio = np.sqrt(np.mean(np.square(actual), axis=0) / np.mean(np.square(stated), axis=0))
    assert np.all((ratio > 0.8) & (ratio < 1.25))


def test_headings_of_the_filter_do_not_matter_and_missing_attitudes_are_left_out(refuses):
    flight = flights.flown(1, minutes=4.0)
    known = flight.attitude.as_quat(scalar_first=True)
    turned = (type(flight.attitude).from_euler("z", np.linspace(0.0, 3.0, len(known))[:, None]) * flight.attitude).as_quat(
        scalar_first=True
    )
    one, other = (fit(flight.readings[0], aid=Attitude(each), inclination=DIP) for each in (known, -turned))
    np.testing.assert_allclose(one.model.soft_iron, other.model.soft_iron, atol=1e-9)
    known[:100] = np.nan
    rest = fit(flight.readings[0], aid=Attitude(known), inclination=DIP)
    assert rest.alignment.source == "attitude"
    assert rest.alignment.used < one.alignment.used
    with refuses("bad_shape"):
        Attitude(known[:, :3])


def test_axes_of_the_compass_are_found():
    flight = flights.flown(2, minutes=5.0)
    aid = Attitude(flight.attitude.as_quat(scalar_first=True))
    assert "remounted" in fit(flight.readings[0][:, [1, 0, 2]] * [1, -1, 1], aid=aid, inclination=DIP).codes
    assert "mirrored" in fit(flight.readings[0] * [1, -1, 1], aid=aid, inclination=DIP).codes
